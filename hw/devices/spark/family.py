"""The REV SPARK MAX and Flex as a MotorFamily and an EncoderFamily: tables, bus rules and doctor checks."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import replace

from truearc.hw.bus_rules import Rules, allow, allow_seldom, kinds_of
from truearc.hw.codec import DBC
from truearc.hw.devices import drivers, family
from truearc.hw.devices.family import Axis, Finding, Heard, failure, ok, warning
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.frames import SparkAxis
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor, SparkSetup
from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.fault_codes import BY_NAME
from truearc.hw.protocols import NS_PER_MS, AngleReading, BadFrame, Frame, MotorReading
from truearc.hw.reason import Reason, listed

PULSE_NS = 10 * NS_PER_MS             # STATUS_0: its default period


def make_rules(axis: spark.SparkAxis, each_tick: int) -> Rules:
    """Return the rules; `each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once."""
    allowed = (allow(spark.make_duty(axis, 0.0), each_tick), allow(spark.make_heartbeat(()), each_tick),
               # twice: it may have reset
               allow(spark.make_setting(axis, spark.IDLE_MODE, 0.0), 2 * len(spark.PARAMETERS)),
               *allow_seldom([spark.make_statuses(axis, spark.STATUSES), spark.make_clear_faults(axis),
                              spark.make_version_query(axis)]))
    by_host, by_device = (kinds_of(spark.ids_sent_by(axis, node), True) for node in ("Host", "Spark"))
    return Rules(allowed, by_host, by_device, {(spark.frame_id(axis, "STATUS_0"), True, False): PULSE_NS})


LOOK = "look at its power and plug, and at its CAN id in REV's hardware client"


def questions(axis: SparkAxis, endpoints: family.Endpoints | None) -> list[Frame]:
    """Return the version query. The run itself turns on STATUS_1 and STATUS_2 and sets the parameters."""
    return [spark.make_version_query(axis)]


def examine(axis: SparkAxis, check: family.AxisCheck, heard: Heard) -> Iterator[Finding]:
    """Return all findings about the axis."""
    yield check_firmware(check.name, axis, heard)
    yield check_status(check.name, axis, heard)
    if estimates := heard.of(spark.frame_id(axis, "STATUS_2"), extended=True):     # off before the first run
        yield family.check_estimates(check.name, estimates, partial(spark.parse, axis))


def check_firmware(name: str, axis: SparkAxis, heard: Heard) -> Finding:
    """Check who answered the version query."""
    check = f"{name}, firmware"
    answers = heard.of(spark.frame_id(axis, "GET_FIRMWARE_VERSION"), extended=True)
    if not answers:
        return failure(check, f"device {axis.device} does not answer", LOOK)
    unique = {frame.data for frame in heard.of(spark.frame_id(axis, "UNIQUE_ID_BROADCAST"), extended=True)}
    if (count := max(heard.answering(spark.make_version_query(axis)), len(unique))) > 1:
        return failure(check, f"{count} devices answer as {axis.device}", "give each a CAN id of its own")
    try:
        version = spark.parse_version(axis, answers[0])
    except BadFrame as error:
        return failure(check, f"sends an unreadable answer ({error})", "is it a SPARK MAX or Flex?")
    said = ".".join(map(str, version))
    if not spark.OLDEST_FIRMWARE <= version[0] <= spark.NEWEST_FIRMWARE:
        return failure(check, f"has firmware {said}; its frames are not known to be those of "
                       f"{spark.OLDEST_FIRMWARE} and {spark.NEWEST_FIRMWARE}", "update it with REV's hardware client")
    return ok(check, f"firmware {said}")


def check_status(name: str, axis: SparkAxis, heard: Heard) -> Finding:
    """Check what its status frames report; whether it obeys another controller is a separate check."""
    check = f"{name}, status"
    keys = [(frame_id, True) for frame_id in spark.frame_ids(axis)]
    reading, refused = heard.read(keys, partial(spark.parse, axis), MotorReading())
    if refused:
        return failure(check, f"sends impossible values ({refused[0]})",
                       "look at the wiring and at whether another device has its CAN id")
    if not any(heard.of(*key) for key in keys):
        return failure(check, f"device {axis.device} is silent", LOOK)
    if errors := spark.errors_of(reading.axis_error & spark.FAULTS):
        return warning(check, listed(errors, BY_NAME),
                       "arming clears faults that have ended; one that returns has a cause")
    switch = f"; its limit switch is {'closed' if reading.endstop else 'open'}" if axis.has_endstop else ""
    return ok(check, f"active, no fault reported{switch}")


class SparkConfig(spark.SparkAxis, Axis, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                  tag_field="driver", tag="spark"):
    """A REV SPARK MAX or Flex driven by duties, which follow from the motor's data sheet; see
    truearc.hw.devices.drivers."""

    has_endstop: bool                 # a limit switch on its data port ends the negative direction
    stall_torque_nm: Annotated[float, Meta(gt=0.0, le=100.0)]     # at the shaft that is counted, at the rated voltage
    free_speed_rad_s: Annotated[float, Meta(gt=1.0, le=10_000.0)]
    rated_v: Annotated[float, Meta(ge=1.0, le=60.0)]
    torque_nm_a: family.TorquePerAmp = 0.0    # of the motor; 0: not known, its stall current limit stays as stored


def make_motors(axes: Sequence[SparkConfig], bounds: Sequence[family.Bounds]) -> tuple[SparkMotor, ...]:
    heartbeat = SparkHeartbeat()
    return tuple(SparkMotor(axis, drivers.DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v), heartbeat,
                            spark.settings(axis, one, axis.torque_nm_a))
                 for axis, one in zip(axes, bounds, strict=True))


def make_node(axis: spark.SparkAxis, motor: family.AttachedMotor) -> SparkNode:
    return SparkNode(axis, motor.name, motor.plant, SparkSettings(motor.kt_nm_a, motor.resistance_ohm),
                     motor.endstop if axis.has_endstop else None)


SPARK = family.MotorFamily(
    driver="spark", axis=SparkConfig, signs_current=False, example=SparkConfig(3, 1, True, 2.6, 594.0, 12.0),
    dbc=DBC / "spark.dbc",
    is_commanded=True, make_motors=make_motors, make_rules=make_rules,
    errors=lambda axis, motor: spark.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == spark.DRIVEN, questions=questions, examine=examine,
    make_node=make_node)


# --- an absolute (duty-cycle) encoder on the data port; the SPARK may be a motor's as well

LONGEST_MS = 50                       # later ones would be too old to fire with, and to tell a reset by
# Of one that signals its turn in 1024 steps: a step's standard deviation is 0.1 deg, and its ends are as far off
SIGMA_DEG = 0.2


class SparkEncoderConfig(Struct, family.HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver",
                         tag="spark"):
    """A through-bore encoder that turns with the hood, on the data port of a SPARK MAX or Flex."""

    device: family.CanNode                   # the SPARK's
    period_ms: Annotated[int, Meta(ge=0, le=LONGEST_MS)]    # set in the device; 0: no frame is sent to it
    zero_deg: family.Finite                  # encoder reading when the launch elevation is 0
    direction: family.Direction              # +1 if the reading grows with elevation


class SparkEncoder(family.Encoder):
    """Angles count only once the device has confirmed that one turn is 1, which it forgets in a reset.

    They are older by the device's answer time; if nothing may be sent to it, that time is unknown.
    """

    def __init__(self, table: SparkEncoderConfig) -> None:
        self._axis = _axis(table)
        self._setup = SparkSetup(self._axis, spark.ENCODER_STATUSES, _settings(table)) if table.period_ms else None
        self._trip = drivers.RoundTrip(spark.name_of(self._axis)) if table.period_ms else None
        # a setting of its own, confirmed once more: its device may be a motor's, which is asked something else
        self._question = spark.make_setting(self._axis, spark.DUTY_FACTOR, 1.0)
        takers = {} if self._setup is None else {**self._setup.takers, "PARAMETER_WRITE_RESPONSE": self._take_setting}
        self._takers = {spark.frame_id(self._axis, name): take for name, take in takers.items()}

    def ids(self) -> tuple[tuple[int, bool], ...]:
        angles = (spark.frame_id(self._axis, name) for name in spark.ENCODER_READINGS)
        return tuple((frame_id, True) for frame_id in (*self._takers, *angles))

    def take(self, frame: Frame) -> None:
        if (taker := self._takers.get(frame.arbitration_id)) is not None:
            taker(frame)
        elif self._setup is None or self._setup.is_ready:
            late_ns = 0 if self._trip is None else self._trip.late_ns
            self.reading = spark.parse_angle(self._axis, drivers.older(frame, late_ns), self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        if self._setup is None or self._trip is None:
            return ()
        fault = self._setup.fault()
        return family.trip_faults(self._trip, t_ns) if fault is None else (fault.about(motor=family.CHECK),)

    def frames(self, t_ns: int) -> tuple[Frame, ...]:
        if self._setup is None or self._trip is None:
            return ()
        heard_ns = 0 if self.reading is None else self.reading.t_ns + self._trip.late_ns
        frames = self._setup.frames(t_ns, heard_ns)
        if self._setup.is_ready and self._trip.is_due:
            frames = [self._question]
        if self._question in frames:
            self._trip.asked()
        return tuple(frames)

    def _take_setting(self, frame: Frame) -> None:
        assert self._setup is not None and self._trip is not None
        answer = self._setup.take_setting(frame)
        if answer is not None and answer[0] == spark.DUTY_FACTOR:
            self.reading = family.aged(self.reading, self._trip.answered(frame.t_ns))


def make_encoder_rules(table: SparkEncoderConfig, each_tick: int) -> tuple[Rules]:
    """Return rules of the SPARK with the encoder; nothing is sent to one that reports to another controller."""
    axis, settings = _axis(table), _settings(table)
    allowed = (allow(spark.make_setting(axis, spark.DUTY_FACTOR, 1.0), 2 * len(settings)),
               *allow_seldom([spark.make_statuses(axis, spark.ENCODER_STATUSES), spark.make_version_query(axis)]))
    return (replace(make_rules(axis, each_tick), allowed=allowed if table.period_ms else ()),)


def examine_encoder(table: SparkEncoderConfig, around: family.Around, heard: family.Heard) -> Iterator[Finding]:
    """Check its SPARK's firmware, and its angle if that is on; a run turns it on by itself."""
    axis = _axis(table)
    if table.period_ms:
        yield check_firmware(family.CHECK, axis, heard)
    ids = [(spark.frame_id(axis, name), True) for name in spark.ENCODER_READINGS]
    start: AngleReading | None = None
    reading, refused = heard.read(ids, partial(spark.parse_angle, axis), start)
    if refused:
        yield failure(family.CHECK, f"sends impossible values ({refused[0]})", "is its conversion factor 1?")
    elif reading is None and not table.period_ms:
        yield failure(family.CHECK, f"device {table.device} does not report it",
                      "have its controller turn status 5 and 6 on")
    elif reading is not None and reading.faults:
        yield failure(family.CHECK, "gives no signal", "look at its plug and at the SPARK's data port")
    else:
        yield ok(family.CHECK, "gives an angle" if reading is not None else "is reported once the robot runs")


def make_encoder_node(table: SparkEncoderConfig, plant: Plant, nodes: Mapping[str, Node]) -> Node | None:
    def turns() -> float:
        return (table.zero_deg + table.direction * math.degrees(plant.hood_encoder_rad())) / 360.0

    for motor in nodes.values():
        if isinstance(motor, SparkNode) and motor.device == table.device:
            motor.absolute_rev = turns
            return None
    node = SparkNode(_axis(table), None, plant)
    node.absolute_rev = turns
    return node


def _axis(table: SparkEncoderConfig) -> spark.SparkAxis:
    return spark.SparkAxis(table.device, 1)


def _settings(table: SparkEncoderConfig) -> dict[int, float]:
    return {spark.DUTY_FACTOR: 1.0, spark.STATUS_5_PERIOD: float(table.period_ms)}


SPARK_ENCODER = family.EncoderFamily(
    driver="spark", table=SparkEncoderConfig, example=SparkEncoderConfig(3, 10, 40.0, 1), least_sigma_deg=SIGMA_DEG,
    make=lambda table, around: SparkEncoder(table), make_rules=make_encoder_rules,
    questions=lambda table: (spark.make_version_query(_axis(table)),) if table.period_ms else (),
    examine=examine_encoder, make_node=make_encoder_node)
