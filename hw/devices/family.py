"""Everything that a family of motor controllers declares about itself, one MotorFamily value; listening to devices."""

import contextlib
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from msgspec import Struct

from truearc.hw.devices.axis import Axis, Bounds
from truearc.hw.devices.bus_rules import Rules
from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.encoder_plausibility import LAG_S, MOVING_RAD_S, Agreement, is_byte_swapped
from truearc.hw.fault_codes import BY_NAME
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.protocols import BadFrame, Bus, Clock, Frame, Motor, MotorReading
from truearc.hw.reason import Message, Reason, render

Reading = TypeVar("Reading")
NS_PER_S = 1_000_000_000
LOOK_NS = 5_000_000                   # between looks at the bus
AxisKind = TypeVar("AxisKind", bound=Axis)


ASKED_AT = (0.0, 0.25, 0.6)           # share of the time listened; uneven, so that a late answer is no early one thrice


class Heard(NamedTuple):
    """Everything that the bus carried in `seconds`, and what it was asked, stamped when it was."""

    frames: tuple[Frame, ...]
    seconds: float
    asked: tuple[Frame, ...] = ()

    def of(self, frame_id: int, extended: bool = False) -> list[Frame]:
        """Devices' frames with one id, oldest first."""
        return [frame for frame in self.frames
                if frame.arbitration_id == frame_id and frame.is_extended == extended and not frame.is_remote]

    def answering(self, question: Frame) -> int:
        """How many devices answer a remote frame."""
        answers = len(self.of(question.arbitration_id, question.is_extended))
        return math.ceil(answers / max(1, len(self._askings(question))))

    def answer_s(self, question: Frame) -> float | None:
        """How long the answer to a remote frame takes, the median of all askings; None without any answer."""
        came_ns = [frame.t_ns for frame in self.of(question.arbitration_id, question.is_extended)]
        took_ns = [min(later) - asked_ns for asked_ns in self._askings(question)
                   if (later := [t_ns for t_ns in came_ns if t_ns >= asked_ns])]
        return statistics.median(took_ns) / NS_PER_S if took_ns else None

    def _askings(self, question: Frame) -> list[int]:
        return [asked.t_ns for asked in self.asked if asked == question._replace(t_ns=asked.t_ns)]

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
    """Listen, and put the questions, none of which may change anything, three times; LinkLost when the adapter goes."""
    bus.read()                                    # what was said before we asked
    began_ns = clock.now_ns()
    due_ns = [began_ns + round(share * seconds * NS_PER_S) for share in ASKED_AT]
    asked, frames, questions = list[Frame](), list[Frame](), list(questions)
    while (now_ns := clock.now_ns()) - began_ns < seconds * NS_PER_S:
        if due_ns and now_ns >= due_ns[0]:
            due_ns.pop(0)
            for question in questions:            # an adapter that says that it was too slow may have sent it
                asked.append(question._replace(t_ns=clock.now_ns()))
                bus.write(question)
        clock.sleep_until_ns(now_ns + LOOK_NS)
        frames += bus.read()
    return Heard(tuple(frames), (now_ns - began_ns) / NS_PER_S, tuple(asked))


def check_estimates(name: str, frames: Sequence[Frame],
                    parse: Callable[[Frame, MotorReading], MotorReading]) -> Finding:
    """Whether positions and speeds, two 32-bit floats a frame, can be those of one encoder; whether it turns."""
    check, reading, agreement = f"{name}, estimates", MotorReading(), Agreement(LAG_S)
    if is_byte_swapped(part for frame in frames for part in (frame.data[:4], frame.data[4:])):
        return failure(check, "make sense only with their bytes the other way round (big-endian)",
                       "the frames are little-endian: take the maker's own firmware, or correct the device's program")
    for frame in frames:
        before = reading
        with contextlib.suppress(BadFrame):       # another check says so
            reading = parse(frame, reading)
            agreement.take(before, reading)
            if (fault := agreement.fault(name, reading)) is not None:
                return failure(check, render(fault, BY_NAME), "look at the encoder, its plug and its settings")
    if abs(reading.velocity_rad_s) > MOVING_RAD_S:
        return warning(check, f"turns at {reading.velocity_rad_s:.0f} rad/s, and nothing drives it",
                       "check it at rest; a speed that stays is not its encoder's")
    return ok(check, f"at rest at {reading.position_rad:.4g} rad; whether they follow the motor, --move tells")


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
    signs_current: whether the current that it reports has the sign of its torque, so that braking is told from driving.
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
    signs_current: bool = True
    stored_settings: Callable[[AxisKind, Bounds, Endpoints], StoredSettings] | None = None
