"""An absolute (duty-cycle) encoder on a SPARK's data port as an EncoderFamily. The SPARK may be a motor's as well."""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Annotated

from msgspec import Meta, Struct

from truearc.hw.bus_rules import Rules
from truearc.hw.devices import family
from truearc.hw.devices.drivers import RoundTrip, older
from truearc.hw.devices.family import CHECK, Around, CanNode, Direction, Encoder, EncoderFamily, Finding, failure, ok
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode
from truearc.hw.devices.spark.family import check_firmware, make_encoder_rules
from truearc.hw.devices.spark.motor import SparkSetup
from truearc.hw.emulated.nodes import Node, Plant
from truearc.hw.protocols import AngleReading, Frame
from truearc.hw.reason import Reason

LONGEST_MS = 50                       # later ones would be too old to fire with, and to tell a reset by
# Of one that signals its turn in 1024 steps: a step's standard deviation is 0.1 deg, and its ends are as far off
SIGMA_DEG = 0.2


class SparkEncoderConfig(Struct, family.HoodEncoder, frozen=True, forbid_unknown_fields=True, tag_field="driver",
                         tag="spark"):
    """A through-bore encoder that turns with the hood, on the data port of a SPARK MAX or Flex."""

    device: CanNode                   # the SPARK's
    period_ms: Annotated[int, Meta(ge=0, le=LONGEST_MS)]    # set in the device; 0: no frame is sent to it
    zero_deg: family.Finite                  # encoder reading when the launch elevation is 0
    direction: Direction              # +1 if the reading grows with elevation


class SparkEncoder(Encoder):
    """Angles count only once the device has confirmed that one turn is 1, which it forgets in a reset.

    They are older by the time that an answer of the device takes; of one that is not to be sent anything that is not
    known.
    """

    def __init__(self, table: SparkEncoderConfig) -> None:
        self._axis = _axis(table)
        self._setup = SparkSetup(self._axis, spark.ENCODER_STATUSES, _settings(table)) if table.period_ms else None
        self._trip = RoundTrip(spark.name_of(self._axis)) if table.period_ms else None
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
            self.reading = spark.parse_angle(self._axis, older(frame, late_ns), self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        if self._setup is None or self._trip is None:
            return ()
        fault = self._setup.fault()
        return family.trip_faults(self._trip, t_ns) if fault is None else (fault.about(motor=CHECK),)

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


def make_rules(table: SparkEncoderConfig, each_tick: int) -> tuple[Rules]:
    return (make_encoder_rules(_axis(table), _settings(table) if table.period_ms else None, each_tick),)


def examine(table: SparkEncoderConfig, around: Around, heard: family.Heard) -> Iterator[Finding]:
    """Its SPARK's firmware, and its angle where that is on: a run turns it on by itself."""
    axis = _axis(table)
    if table.period_ms:
        yield check_firmware(CHECK, axis, heard)
    ids = [(spark.frame_id(axis, name), True) for name in spark.ENCODER_READINGS]
    start: AngleReading | None = None
    reading, refused = heard.read(ids, partial(spark.parse_angle, axis), start)
    if refused:
        yield failure(CHECK, f"sends what cannot be ({refused[0]})", "is its conversion factor 1?")
    elif reading is None and not table.period_ms:
        yield failure(CHECK, f"device {table.device} does not report it", "have its controller turn status 5 and 6 on")
    elif reading is not None and reading.faults:
        yield failure(CHECK, "gives no signal", "look at its plug and at the SPARK's data port")
    else:
        yield ok(CHECK, "gives an angle" if reading is not None else "is reported once the robot runs")


def make_node(table: SparkEncoderConfig, plant: Plant, nodes: Mapping[str, Node]) -> Node | None:
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


SPARK_ENCODER = EncoderFamily(
    driver="spark", table=SparkEncoderConfig, example=SparkEncoderConfig(3, 10, 40.0, 1), least_sigma_deg=SIGMA_DEG,
    make=lambda table, around: SparkEncoder(table), make_rules=make_rules,
    questions=lambda table: (spark.make_version_query(_axis(table)),) if table.period_ms else (),
    examine=examine, make_node=make_node)
