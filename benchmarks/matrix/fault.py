"""The schema of one fault: what fails, the reasons that the robot must give, how soon, and when it may continue."""

import math
from collections.abc import Iterable
from typing import Any

from msgspec import Struct

from truearc.hw.reason import Code, Reason

ITSELF = "by itself"                  # fires again when the fault is over
REARM = "arm again"                   # fires again when the driver has armed again, and not before
DISARMS = "disarmed: arm"             # what happened has disarmed it; fires again when the driver has armed
EITHER = "by itself, or arm again"    # how it is told from what latches depends on what garbage happens to say
KEEPS = "keeps firing"                # there is nothing to recover from


# --- what can be broken; `begin` and `end` come from the run's span

class What(Struct, frozen=True):
    """A fault that one word states."""

    what: str


class Wire(What, frozen=True):
    """A fault of the bus itself, or another host on it."""


class Box(What, frozen=True):
    """Something is wrong with the button box or its cable, or with who presses."""


class Camera(What, frozen=True):
    """A fault of the camera."""


class Disk(What, frozen=True):
    """A fault of the disk."""


class Model(What, frozen=True):
    """A fault of the gate's model, while the policy is "model"."""


class Time(What, frozen=True):
    """A process stands still, or the wall clock jumps."""


class Key(What, frozen=True):
    """A key of NetworkTables, or all that begin so, while truearc advises: it "freezes", "jumps", "disappears", is
    "not a number" or "impossible", or "server gone"."""

    key: str


class Device(Struct, frozen=True):
    """Something is wrong with a device's frames or power (truearc_proof.world.faults)."""

    name: str                         # of DEVICES
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
    benchmarks.matrix.broken has."""

    name: str
    what: str


class Process(Struct, frozen=True):
    """A signal to a process: who ("devices", "control", "vision", "recorder"), which ("stop", "kill")."""

    who: str
    signal: str


class Motion(Struct, frozen=True):
    """Something wrong with what moves or with what says how it moves, while the robot is armed and fires no ball;
    benchmarks.matrix.motion. Angles in degrees."""

    what: str
    names: tuple[str, ...]            # devices whose frames it spoils; none: it is in the plant
    when: str                         # "start", "spinning", "settled", "hood homes", "hood starts" (up), "hood rises",
                                      # "hood is near"
    axis: str                         # that has to be released: "wheels", "hood"; "": none
    since: str                        # what the row's time counts from: "reading" (the last true one), "fault", "push"
    code: str                         # of benchmarks.matrix.rows.CODES: what the page has to say
    pushes: int = 1                   # times that the axis may be driven while it stands: 2 with one retry
    hood_deg: float = 45.0            # set point
    high_deg: float = 75.0            # soft limit; the plant's own stop is at 75
    travel_deg: float = math.inf      # the hood's after the fault
    start_deg: float = 22.0           # where the hood is found
    most_deg_s: float = 22.0          # the hood's, its limit with a tenth for the loop that keeps it
    has_encoder: bool = True          # a hood encoder; without one its motor's count is all that is known


Breaking = Device | Both | Inside | Wire | Box | Camera | Disk | Model | Time | Process | Key | Motion


# --- what a verdict of the run must hold

class Sign(Struct, frozen=True):
    """A reason of this code with these parameters; of a list, these among others; of a cause, one of these signs."""

    code: Code
    params: dict[str, Any] = {}

    def fits(self, reason: Reason) -> bool:
        return reason.code == self.code.name and all(
            _fits(wanted, reason.params.get(name)) for name, wanted in self.params.items())


Signs = tuple[Sign, ...]


def says(*codes: Code, **params: Any) -> Signs:
    """Any of these codes, with these parameters."""
    return tuple(Sign(code, params) for code in codes)


def of(device: str, signs: Signs) -> Signs:
    """The same, of one motor or encoder."""
    return tuple(Sign(sign.code, {**sign.params, next(name for name in ("motor", "device")
                                                      if name in sign.code.params): device}) for sign in signs)


def find(signs: Signs, reasons: Iterable[Reason]) -> Reason | None:
    """The first reason that fits one of the signs."""
    return next((reason for reason in reasons if any(sign.fits(reason) for sign in signs)), None)


def _fits(wanted: Any, value: Any) -> bool:
    if isinstance(wanted, tuple) and any(isinstance(one, Sign) for one in wanted):
        return isinstance(value, Reason) and find(wanted, (value,)) is not None
    if isinstance(wanted, tuple):
        return isinstance(value, tuple | list) and all(one in value for one in wanted)
    return bool(value == wanted)


class Row(Struct, frozen=True):
    """One fault. `reason`: what a verdict says, one of these; of a fault that does not hold, what is seen of it, if
    anything (none asks for nothing). `within_s`: of its begin. `real`: needs real time on the virtual bus, too.
    `first`: it stands from before the robot starts. `launcher`: of benchmarks.matrix.run.with_launcher."""

    name: str
    family: str
    breaking: Breaking
    reason: Signs
    within_s: float
    after: str = ITSELF
    lasts_s: float = 0.6
    real: bool = False
    buses: tuple[str, ...] = ("virtual", "slcan", "socketcan")
    first: bool = False
    launcher: str = "odrive"
