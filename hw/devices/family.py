"""Everything that a family of motor controllers declares about itself: one MotorFamily value."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from msgspec import Struct

from truearc.hw.devices.axis import Axis
from truearc.hw.devices.bus_rules import Rules
from truearc.hw.devices.listening import Heard
from truearc.hw.emulated.nodes import Node
from truearc.hw.emulated.plant import Plant
from truearc.hw.finding import Finding
from truearc.hw.motor import Motor
from truearc.hw.protocols import Frame
from truearc.hw.readings import MotorReading
from truearc.hw.reason import Message, Reason

AxisKind = TypeVar("AxisKind", bound=Axis)


class Endpoints(Struct, frozen=True):
    """Numbers of the parameters of one firmware (the doctor's --endpoints)."""

    firmware: str
    ids: dict[str, int]


class AxisCheck(NamedTuple):
    """An axis as the doctor knows it, beside its table."""

    name: str                         # "flywheel motor 1", "hood motor", "feeder motor"
    tick_hz: int
    endpoints: Endpoints | None       # None: no table was given


class AttachedMotor(NamedTuple):
    """The motor of an emulated world that an emulated controller drives."""

    name: str                         # of `plant.motors`
    plant: Plant
    kt_nm_a: float
    resistance_ohm: float
    watchdog_ms: int                  # of a controller in which it can be set
    endstop: Callable[[], bool] | None    # reads the limit switch, if there is one


class MotorFamily(Struct, Generic[AxisKind], frozen=True, kw_only=True, eq=False):
    """One family of motor controllers.

    driver: its name, `driver` in launcher.toml.
    axis: struct of its table there.
    example: such a table, for tests and documents.
    dbc: its frames; None for a family that has none of its own. Node "Host" sends what the robot may send.
    is_commanded: whether the robot commands its motors; if not, `make_rules` allows nothing.
    make_motors: drivers of all its axes on one bus, in their order; they may share a heartbeat.
    make_rules: from an axis, and how often within WINDOW_NS a frame may be sent that each tick sends once.
    errors: what the device reports as wrong with it; empty when it is healthy. Called in the tick.
    is_driven: whether the device does as it is asked. Called in the tick.
    questions: what the doctor asks of the device; no answer may need a change of it.
    examine: the doctor's findings from what was heard on the bus.
    make_node: the emulated device.
    messages: reasons and errors that are its own, named "DRIVER.WHAT": their codes, and what the operator's page says.
    """

    driver: str
    axis: type[AxisKind]
    example: AxisKind
    dbc: Path | None
    is_commanded: bool
    make_motors: Callable[[Sequence[AxisKind]], Sequence[Motor]]
    make_rules: Callable[[AxisKind, int], Rules]
    errors: Callable[[AxisKind, MotorReading], tuple[Reason, ...]]
    is_driven: Callable[[AxisKind, MotorReading], bool]
    questions: Callable[[AxisKind, Endpoints | None], Sequence[Frame]]
    examine: Callable[[AxisKind, AxisCheck, Heard], Iterable[Finding]]
    make_node: Callable[[AxisKind, AttachedMotor], Node]
    messages: tuple[Message, ...] = ()
