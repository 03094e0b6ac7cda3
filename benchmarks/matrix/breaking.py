"""What can be broken, as data: each says what is done, to whom; `begin` and `end` come from the run's span."""

import math

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


class Motion(Struct, frozen=True):
    """Something wrong with what moves or with what says how it moves, while the robot is armed and fires no ball;
    benchmarks.matrix.motion. Angles in degrees."""

    what: str                         # of benchmarks.matrix.moving
    names: tuple[str, ...]            # devices whose frames it spoils; none: it is in the plant
    when: str                         # "start", "spinning", "settled", "hood homes", "hood rises"
    axis: str                         # that has to be released: "wheels", "hood"; "": none
    since: str                        # what the row's time counts from: "reading" (the last true one), "fault", "push"
    code: str                         # of benchmarks.matrix.motion_rows.CODES: what the page has to say
    pushes: int = 1                   # times that the axis may be driven while it stands: 2 with one retry
    hood_deg: float = 45.0            # set point
    high_deg: float = 75.0            # soft limit; the plant's own stop is at 75
    travel_deg: float = math.inf      # the hood's after the fault
    start_deg: float = 22.0           # where the hood is found
    has_encoder: bool = True          # a hood encoder; without one its motor's count is all that is known


Breaking = Device | Both | Inside | Wire | Box | Camera | Disk | Model | Time | Process | Start | Key | Motion
