"""What can be broken, as data: each says what is done, to whom; `begin` and `end` come from the run's span."""

from msgspec import Struct


class Device(Struct, frozen=True):
    """Something is wrong with a device's frames or power (truearc_proof.world.faults)."""

    name: str                         # "flywheel_a", "flywheel_b", "hood", "feeder", "hood_encoder"
    kind: str
    message: str = ""                 # of the DBC file; "": all its frames
    length: int = 0
    at: int = 0
    data: bytes = b""
    by: int = 0


class Both(Struct, frozen=True):
    """Something is wrong with the frames of two devices."""

    one: Device
    other: Device


class Inside(Struct, frozen=True):
    """Something happens inside a device: "error", "idle", "magnet", "settings lost"; in a SPARK, what
    benchmarks.matrix.spark_troubles has."""

    name: str
    what: str


class Wire(Struct, frozen=True):
    """A fault of the bus itself, or another host on it."""

    what: str


class Box(Struct, frozen=True):
    """Something is wrong with the button box or its cable, or with who presses."""

    what: str


class Camera(Struct, frozen=True):
    """A fault of the camera."""

    what: str


class Disk(Struct, frozen=True):
    """A fault of the disk."""

    what: str


class Model(Struct, frozen=True):
    """A fault of the gate's model, while the policy is "model"."""

    what: str


class Time(Struct, frozen=True):
    """A process stands still, or the wall clock jumps."""

    what: str


class Process(Struct, frozen=True):
    """A signal to a process: who ("devices", "control"), which ("stop", "kill")."""

    who: str
    signal: str


class Start(Struct, frozen=True):
    """The robot is started with this: it is to refuse."""

    what: str


class Key(Struct, frozen=True):
    """A key of the robot's NetworkTables, or all that begin so, while truearc advises; benchmarks.matrix.keys."""

    what: str                         # "freezes", "jumps", "disappears", "not a number", "impossible", "server gone"
    key: str


Breaking = Device | Both | Inside | Wire | Box | Camera | Disk | Model | Time | Process | Start | Key
