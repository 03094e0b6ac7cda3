"""The declaration of a device family: its launcher.toml tables, MotorFamily or EncoderFamily, and doctor checks."""

import contextlib
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, NamedTuple, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from truearc.hw import bus_rules, reason
from truearc.hw.devices.drivers import LAG_S, MOVING_RAD_S, Agreement, RoundTrip, is_byte_swapped
from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.fault_codes import BY_NAME
from truearc.hw.protocols import NS_PER_S, AngleReading, BadFrame, Bus, Clock, Frame, Motor, MotorReading

# --- what one check found

OK, WARNING, FAILURE = "ok", "warning", "failure"


class Finding(Struct, frozen=True):
    """One line: what was checked, its state, and what to do about it (empty if it is fine)."""

    check: str
    level: str                        # OK, WARNING (it runs, with something less) or FAILURE (it will not run well)
    says: str
    do: str = ""


def ok(check: str, says: str) -> Finding:
    return Finding(check, OK, says)


def warning(check: str, says: str, do: str) -> Finding:
    return Finding(check, WARNING, says, do)


def failure(check: str, says: str, do: str) -> Finding:
    return Finding(check, FAILURE, says, do)


def line(finding: Finding) -> str:
    """Return the finding as it is printed; a failure is in capitals."""
    level = finding.level.upper() if finding.level == FAILURE else finding.level
    return f"{level:8s} {finding.check}: {finding.says}" + (f" -> {finding.do}" if finding.do else "")


# --- tables of axes and of the hood encoder

Finite = Annotated[float, msgspec.Meta(gt=-1e9, lt=1e9)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, lt=1e9)]
CanNode = Annotated[int, msgspec.Meta(ge=0, le=62)]     # 63 addresses every ODrive, and every device of the FRC
TorquePerAmp = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]      # Nm/A: a motor of 10 kW has 1
Direction = Literal[-1, 1]            # sign that makes positive launch a ball or raise the hood

SPEED_SPARE = 1.15                    # times the top speed: an ODrive's torque fades as its speed nears the limit
CURRENT_SPARE = 1.1                   # times the current of the top torque, so that no rounding cuts it


class Axis:
    """Base of the structs that a family declares for its table, beside msgspec.Struct.

    Such a struct has `forbid_unknown_fields=True`, `tag_field="driver"` and its family's name as `tag`. No key has a
    default but one that earlier files lack, and then `omit_defaults=True`: their recordings keep their hash.
    """

    __slots__ = ()
    __struct_config__: ClassVar[Any]


class HoodEncoder:
    """Base of the structs that a family declares for [hood_encoder], beside msgspec.Struct; tagged as an Axis's are, or
    with a key `driver`."""

    __slots__ = ()
    __struct_config__: ClassVar[Any]
    is_heard: ClassVar[bool] = True   # there is one; if not, the hood's angle is the count of its screw since homing

    @property
    def zero_deg(self) -> float | None:
        """Its reading at launch elevation 0; None: it counts from 0, and homing determines it."""
        return 0.0

    @property
    def direction(self) -> int:
        """+1 if its reading grows with the elevation, else -1."""
        return 1


def driver_of(axis: Axis | HoodEncoder) -> str:
    """Return the `driver` of the table."""
    return str(axis.__struct_config__.tag or getattr(axis, "driver"))  # noqa: B009


class Bounds(NamedTuple):
    """Bounds of one axis, at the motor's shaft, from the rest of the configuration; None: unknown.

    top_rad_s, top_nm: the largest speed and torque in normal operation.
    brakes: whether it brakes when released, rather than coasts.
    """

    top_rad_s: float | None = None
    top_nm: float | None = None
    brakes: bool | None = None


def speed_limit_rad_s(bounds: Bounds) -> float | None:
    """Return the controller's own limit; None if the axis has none."""
    return None if bounds.top_rad_s is None else SPEED_SPARE * bounds.top_rad_s


def current_limit_a(bounds: Bounds, torque_nm_a: float) -> float | None:
    """Return the controller's own limit for a motor with this torque per A; None if that is 0, for unknown."""
    if bounds.top_nm is None or not torque_nm_a:
        return None
    asked_a = CURRENT_SPARE * bounds.top_nm / torque_nm_a
    return float(math.ceil(asked_a)) if math.isfinite(asked_a) else asked_a


# --- motor controllers

Reading = TypeVar("Reading")
LOOK_NS = 5_000_000                   # between looks at the bus
AxisKind = TypeVar("AxisKind", bound=Axis)


ASKED_AT = (0.0, 0.25, 0.6)           # share of the time listened; uneven, so that a late answer is no early one thrice


class Heard(NamedTuple):
    """Everything that the bus carried in `seconds`, and the queries sent, with timestamps."""

    frames: tuple[Frame, ...]
    seconds: float
    asked: tuple[Frame, ...] = ()

    def of(self, frame_id: int, extended: bool = False) -> list[Frame]:
        """Return devices' frames with one id, oldest first."""
        return [frame for frame in self.frames
                if frame.arbitration_id == frame_id and frame.is_extended == extended and not frame.is_remote]

    def answering(self, question: Frame) -> int:
        """Return how many devices answer a remote frame."""
        answers = len(self.of(question.arbitration_id, question.is_extended))
        return math.ceil(answers / max(1, len(self._askings(question))))

    def answer_s(self, question: Frame, answer_id: int | None = None) -> float | None:
        """Return the median time of the answers to a question, which have another id than it or, to a remote frame, the
        same; None without any answer."""
        came_ns = [frame.t_ns for frame in self.of(answer_id or question.arbitration_id, question.is_extended)]
        took_ns = [min(later) - asked_ns for asked_ns in self._askings(question)
                   if (later := [t_ns for t_ns in came_ns if t_ns >= asked_ns])]
        return statistics.median(took_ns) / NS_PER_S if took_ns else None

    def _askings(self, question: Frame) -> list[int]:
        return [asked.t_ns for asked in self.asked if asked == question._replace(t_ns=asked.t_ns)]

    def read(self, keys: Iterable[tuple[int, bool]], parse: Callable[[Frame, Reading], Reading],
             reading: Reading) -> tuple[Reading, list[BadFrame]]:
        """Return `reading` updated by the frames of these ids, and what was wrong with the other frames."""
        wanted, refused = set(keys), []
        for frame in self.frames:
            if (frame.arbitration_id, frame.is_extended) in wanted and not frame.is_remote:
                try:
                    reading = parse(frame, reading)
                except BadFrame as error:
                    refused.append(error)
        return reading, refused


def listen(bus: Bus, clock: Clock, questions: Iterable[Frame], seconds: float) -> Heard:
    """Listen, and send the queries, none of which may change anything, three times; LinkLost when the adapter is
    lost."""
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
    """Check whether positions and speeds, two 32-bit floats per frame, can come from one encoder, and whether it
    turns."""
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
                return failure(check, reason.render(fault, BY_NAME), "look at the encoder, its plug and its settings")
    if abs(reading.velocity_rad_s) > MOVING_RAD_S:
        return warning(check, f"turns at {reading.velocity_rad_s:.0f} rad/s, and nothing drives it",
                       "check it at rest; a speed that stays is not its encoder's")
    return ok(check, f"at rest at {reading.position_rad:.4g} rad; whether they follow the motor, --move tells")


class Endpoints(Struct, frozen=True):
    """Parameter numbers of one firmware version (the doctor's --endpoints)."""

    firmware: str
    ids: dict[str, int]


class AxisCheck(NamedTuple):
    """What the doctor knows of an axis, besides its table."""

    name: str                         # "flywheel motor 1", "hood motor", "feeder motor"
    tick_hz: int
    endpoints: Endpoints | None       # None: no table was given


class Stored(NamedTuple):
    """One setting that a device keeps without power: a second line of defence, which holds when no robot code runs.

    name: as in the manufacturer's tool. low, high: accepted values. read: from the answers; None: no answer.
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
    """The stored settings of one axis.

    refuse: why nothing may be written, from the answers to `ask`; "" if it may. save: stores what was written.
    restart_s: how long the device is then away.
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
    make_rules: Callable[[AxisKind, int], bus_rules.Rules]
    errors: Callable[[AxisKind, MotorReading], tuple[reason.Reason, ...]]
    is_driven: Callable[[AxisKind, MotorReading], bool]
    questions: Callable[[AxisKind, Endpoints | None], Sequence[Frame]]
    examine: Callable[[AxisKind, AxisCheck, Heard], Iterable[Finding]]
    make_node: Callable[[AxisKind, AttachedMotor], Node]
    messages: tuple[reason.Message, ...] = ()
    signs_current: bool = True
    stored_settings: Callable[[AxisKind, Bounds, Endpoints], StoredSettings] | None = None


# --- hood encoders

CHECK = "hood encoder"                # as the doctor and reasons name it


Table = TypeVar("Table", bound=HoodEncoder)


class Encoder:
    """A hood encoder in operation; this base class is an absent one. It never waits: `take` is given the received
    frames."""

    reading: AngleReading | None = None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        """Return (arbitration id, is extended) of every frame that `take` understands."""
        return ()

    def take(self, frame: Frame) -> None:
        """Update `reading` by one frame that is not remote; BadFrame leaves it unchanged."""

    def read(self, t_ns: int) -> AngleReading | None:
        """Return the newest angle, once a tick; None before the first."""
        return self.reading

    def faults(self, t_ns: int) -> tuple[reason.Reason, ...]:
        """Return faults of its device, named "motor", that the reading does not contain and that prevent firing."""
        return ()

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        """Return the frames to send, once a tick, while there is a bus."""
        return ()


def aged(reading: AngleReading | None, by_ns: int) -> AngleReading | None:
    """Return a reading whose device was found to be later by this much than was known."""
    if reading is None or not by_ns:
        return reading
    faults_t_ns = reading.faults_t_ns and reading.faults_t_ns - by_ns       # 0 and absent stay so
    return replace(reading, t_ns=reading.t_ns - by_ns, faults_t_ns=faults_t_ns)


def trip_faults(trip: RoundTrip, t_ns: int) -> tuple[reason.Reason, ...]:
    """Return, once a tick, why the encoder cannot be trusted, judged by its delay."""
    trip.tick(t_ns)
    fault = trip.fault()
    return () if fault is None else (fault.about(motor=CHECK),)


class Around(NamedTuple):
    """The part of the rest of the configuration that an encoder may need."""

    longest_age_s: float              # of an angle that may still fire
    readings: Mapping[str, Mapping[str, Any]]     # tables of other distributions, by name


class EncoderFamily(Struct, Generic[Table], frozen=True, kw_only=True, eq=False):
    """One kind of hood encoder.

    driver: its name, `driver` in launcher.toml.
    table: struct of [hood_encoder].
    example: such a table, for tests.
    least_sigma_deg: [rig.noise] hood_deg may not be smaller, which is how well a dataset says the angle is known.
    make: what reads it on the robot.
    make_rules: frames of it, and how often within WINDOW_NS one may be sent that each tick sends once.
    questions: what the doctor asks; no answer may need a change of the device.
    answer_id: of the answers to the first question, which tell how late readings come; None where it has none.
    errors: why a reading with these `faults` (of AngleReading) is not to be believed, about a "motor".
    examine: the doctor's findings from what was heard.
    make_node: the emulated device, given those of the motors by name; None where one of them has it on board.
    make_off_bus: for one that is not on the bus, what reads it on the emulated robot. It is not replayed from frames.
    """

    driver: str
    table: type[Table]
    example: Table
    least_sigma_deg: float
    make: Callable[[Table, Around], Encoder]
    make_rules: Callable[[Table, int], Sequence[bus_rules.Rules]]
    questions: Callable[[Table], Sequence[Frame]]
    examine: Callable[[Table, Around, Heard], Iterable[Finding]]
    make_node: Callable[[Table, Plant, Mapping[str, Node]], Node | None]
    answer_id: Callable[[Table], int | None] = lambda table: None
    errors: Callable[[Table, int], Sequence[reason.Reason]] = lambda table, faults: ()
    make_off_bus: Callable[[Table, Plant], Encoder] | None = None
