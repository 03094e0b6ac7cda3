"""Everything that a family of motor controllers declares about itself, one MotorFamily value; listening to devices."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from msgspec import Struct

from truearc.hw.devices.axis import Axis
from truearc.hw.devices.bus_rules import Rules
from truearc.hw.devices.limits import Bounds
from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.finding import Finding
from truearc.hw.protocols import BadFrame, Bus, Clock, Frame, Motor, MotorReading
from truearc.hw.reason import Message, Reason

Reading = TypeVar("Reading")
NS_PER_S = 1_000_000_000
LOOK_NS = 5_000_000                   # between looks at the bus
AxisKind = TypeVar("AxisKind", bound=Axis)


class Heard(NamedTuple):
    """Everything that the bus carried in `seconds`."""

    frames: tuple[Frame, ...]
    seconds: float

    def of(self, frame_id: int, extended: bool = False) -> list[Frame]:
        """Devices' frames with one id, oldest first."""
        return [frame for frame in self.frames
                if frame.arbitration_id == frame_id and frame.is_extended == extended and not frame.is_remote]

    def read(self, keys: Iterable[tuple[int, bool]], parse: Callable[[Frame, Reading], Reading],
             reading: Reading) -> tuple[Reading, list[BadFrame]]:
        """`reading` brought up to date by the frames of these ids, and what was wrong with others of them."""
        wanted, refused = set(keys), []
        for frame in self.frames:
            if (frame.arbitration_id, frame.is_extended) in wanted and not frame.is_remote:
                try:
                    reading = parse(frame, reading)
                except BadFrame as error:
                    refused.append(error)
        return reading, refused


def listen(bus: Bus, clock: Clock, questions: Iterable[Frame], seconds: float) -> Heard:
    """Put the questions, none of which may change anything, and listen; LinkLost when the adapter goes."""
    bus.read()                                    # what was said before we asked
    for question in questions:
        bus.write(question)
    began_ns = clock.now_ns()
    frames: list[Frame] = []
    while (now_ns := clock.now_ns()) - began_ns < seconds * NS_PER_S:
        clock.sleep_until_ns(now_ns + LOOK_NS)
        frames += bus.read()
    return Heard(tuple(frames), (now_ns - began_ns) / NS_PER_S)


class Endpoints(Struct, frozen=True):
    """Numbers of the parameters of one firmware (the doctor's --endpoints)."""

    firmware: str
    ids: dict[str, int]


class AxisCheck(NamedTuple):
    """An axis as the doctor knows it, beside its table."""

    name: str                         # "flywheel motor 1", "hood motor", "feeder motor"
    tick_hz: int
    endpoints: Endpoints | None       # None: no table was given


class Stored(NamedTuple):
    """One setting that a device keeps without power: the second line, which holds when nothing of the robot runs.

    name: as its maker's tool has it. low, high: values that may stay. read: from what was heard; None: no answer.
    """

    name: str
    wanted: float
    low: float
    high: float
    ask: Frame
    write: Frame
    read: Callable[[Heard], float | None]

    def is_well(self, value: float | None) -> bool:
        return value is not None and self.low <= value <= self.high


class StoredSettings(NamedTuple):
    """Those of one axis.

    refuse: why nothing may be written, from the answers to `ask`; "" where it may. save: keeps what was written.
    restart_s: how long a device is away then.
    """

    settings: tuple[Stored, ...]
    ask: tuple[Frame, ...]
    refuse: Callable[[Heard], str]
    save: tuple[Frame, ...]
    restart_s: float

    def questions(self) -> list[Frame]:
        return [*self.ask, *(one.ask for one in self.settings)]


class AttachedMotor(NamedTuple):
    """The motor of an emulated world that an emulated controller drives."""

    name: str                         # of `plant.motors`
    plant: Plant
    kt_nm_a: float
    resistance_ohm: float
    watchdog_ms: int                  # of a controller in which it can be set
    endstop: Callable[[], bool] | None    # reads the limit switch, if there is one
    is_absolute: bool = False         # its position survives a restart, where the controller can do that


class MotorFamily(Struct, Generic[AxisKind], frozen=True, kw_only=True, eq=False):
    """One family of motor controllers.

    driver: its name, `driver` in launcher.toml.
    axis: struct of its table there.
    example: such a table, for tests and documents.
    dbc: its frames; None for a family that has none of its own. Node "Host" sends what the robot may send.
    is_commanded: whether the robot commands its motors; if not, `make_rules` allows nothing.
    make_motors: drivers of all its axes on one bus, in their order, given the bounds of each; they may share a
        heartbeat.
    make_rules: from an axis, and how often within WINDOW_NS a frame may be sent that each tick sends once.
    errors: what the device reports as wrong with it; empty when it is healthy. Called in the tick.
    is_driven: whether the device does as it is asked. Called in the tick.
    questions: what the doctor asks of the device; no answer may need a change of it.
    examine: the doctor's findings from what was heard on the bus.
    make_node: the emulated device.
    messages: reasons and errors that are its own, named "DRIVER.WHAT": their codes, and what the operator's page says.
    stored_settings: what the device keeps and `truearc doctor --set` may write; None where a run sets all there is.
    """

    driver: str
    axis: type[AxisKind]
    example: AxisKind
    dbc: Path | None
    is_commanded: bool
    make_motors: Callable[[Sequence[AxisKind], Sequence[Bounds]], Sequence[Motor]]
    make_rules: Callable[[AxisKind, int], Rules]
    errors: Callable[[AxisKind, MotorReading], tuple[Reason, ...]]
    is_driven: Callable[[AxisKind, MotorReading], bool]
    questions: Callable[[AxisKind, Endpoints | None], Sequence[Frame]]
    examine: Callable[[AxisKind, AxisCheck, Heard], Iterable[Finding]]
    make_node: Callable[[AxisKind, AttachedMotor], Node]
    messages: tuple[Message, ...] = ()
    stored_settings: Callable[[AxisKind, Bounds, Endpoints], StoredSettings] | None = None
