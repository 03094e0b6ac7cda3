"""Feedback that comes late as a whole looks fresh, since frames are stamped when they come: the answer to a question
tells. And a device that has another with its id, before anything can be fired."""

import itertools
import os
from collections import Counter, deque

import pytest
from msgspec.structs import replace

from tests.hw.spinning_plant import SpinningPlant, closed_after
from tests.robot.encoders import COUNTING, SPARK_OWN
from tests.robot.good_tick import CONFIG
from tests.robot.sparks import ALL_SPARK
from tests.robot.test_rig import rig_on
from truearc.hw import fault_codes as hw
from truearc.hw.devices.canandmag import CanandmagNode
from truearc.hw.devices.drivers import LATE_NS, SILENT_NS, RoundTrip
from truearc.hw.emulated.nodes import StepClock, Twin
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import Frame
from truearc.hw.real.can_bus import open_can
from truearc.robot.config.schema import Config
from truearc.robot.motors import guard
from truearc.robot.tick import step
from truearc.robot.types import Command, Memory
from truearc.sim.world.emulated_robot import make_nodes

LATE_MS = 200
TICK_NS = 5 * MS
ASKED, RELEASED = Command(True, True, True, 0.1, 0.02, 0.1), Command(False, False, False, 0.0, 0.0, 0.0)
CONFIGS = {"odrive and canandmag": CONFIG, "spark and its encoder": replace(SPARK_OWN, axes=ALL_SPARK.axes),
           "encoder of a motor": COUNTING}
CHANNELS = itertools.count()


class LateBus:
    """A bus whose frames come after `late_ns` more, all of them, stamped when they come; None: those are lost."""

    def __init__(self, bus, clock) -> None:
        self._bus, self._clock, self.late_ns = bus, clock, 0
        self._waiting: deque[tuple[int, Frame]] = deque()
        self.write, self.faults = bus.write, bus.faults

    def read(self) -> list[Frame]:
        now_ns = self._clock.now_ns()
        self._waiting += [(now_ns + self.late_ns, frame) for frame in self._bus.read()]
        frames = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            frames.append(self._waiting.popleft()[1]._replace(t_ns=now_ns))
        return frames


class Robot:
    """A rig whose devices are emulated, on a wire that may be late."""

    def __init__(self, config: Config, wire: str, extra=()) -> None:
        self.config, self.plant, self.tally = config, SpinningPlant(), Counter()
        self.nodes = make_nodes(config, self.plant)
        self.clock = StepClock(lambda t_ns: self.twin.advance(t_ns))
        if wire == "slcan":
            from truearc.hw.emulated.serial_link import PtyCable, SlcanAdapter
            self.far = SlcanAdapter(PtyCable())
            self.near = open_can("slcan", self.far.port, 1_000_000, self.clock)
        else:
            channel = f"late-{next(CHANNELS)}"
            self.near, self.far = (open_can("virtual", channel, 1_000_000, self.clock) for _ in range(2))
        self.twin = Twin(self.plant, self.far, (*self.nodes.values(), *(make(self.plant) for make in extra)))
        self.late = LateBus(self.near, self.clock)
        self.rig = rig_on(guard(self.late, config, self.clock, self.tally), self.clock, config)
        self.torques = []

    def run(self, seconds: float, command: Command):
        """Ticks with one command; the last one's inputs."""
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            self.inputs = self.rig.read()
            self.sent = self.rig.write(command)
            self.torques += [node.torque_nm() for node in self.nodes.values() if node.motor is not None]
        return self.inputs

    def close(self) -> None:
        self.near.close()
        self.far.close()

    def faults(self, code) -> list[str]:
        return [fault.params["motor"] for fault in self.inputs.faults if fault.code == code.name]


make = closed_after(Robot)


NAMED = {"flywheel motor 1", "flywheel motor 2", "hood motor", "feeder motor", "hood encoder"}
WIRES = ["virtual", pytest.param("slcan", marks=pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal"))]


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("name", CONFIGS)
def test_feedback_that_is_late_from_the_start_drives_nothing_and_says_so(make, wire, name) -> None:
    robot = make(CONFIGS[name], wire)
    robot.late.late_ns = LATE_MS * MS
    for seconds in (0.15, 1.0, 1.0, 4.0):                  # before the first answer, and long after it
        inputs = robot.run(seconds, ASKED)
        verdict = step(inputs, Memory(armed=True, homed=True), robot.config, None).verdict
        assert not verdict.fire and {fault.params["motor"] for fault in inputs.faults
                                     if "motor" in fault.params} == NAMED
    assert set(robot.faults(hw.FEEDBACK_LATE)) == NAMED
    late_s = [fault.params["delay_s"] for fault in verdict.reasons if fault.code == hw.FEEDBACK_LATE.name]
    assert len(late_s) == 5 and all(LATE_MS <= 1e3 * delay_s <= LATE_MS + 15 for delay_s in late_s)
    assert set(robot.torques) == {0.0} and robot.sent.flywheel_torque_nm == 0.0
    assert robot.tally["frames not allowed"] == 0


@pytest.mark.parametrize("name", CONFIGS)
def test_feedback_that_becomes_late_is_named_within_two_seconds(make, name) -> None:
    robot = make(CONFIGS[name], "virtual")
    robot.run(1.0, RELEASED)
    inputs = robot.run(1.0, ASKED)
    assert not [fault for fault in inputs.faults if "motor" in fault.params] and robot.sent.flywheel_torque_nm > 0.0
    robot.late.late_ns = LATE_MS * MS
    robot.run(1.7, ASKED)                                  # a second or more to the next question, and two answers
    assert set(robot.faults(hw.FEEDBACK_LATE)) == NAMED and robot.sent.flywheel_torque_nm == 0.0
    robot.torques.clear()
    robot.run(1.0, ASKED)
    assert max(robot.torques) <= 0.0                       # the hood's SPARK brakes it
    robot.late.late_ns = 0
    robot.run(5.5, ASKED)                                  # four answers in time
    assert not robot.faults(hw.FEEDBACK_LATE) and robot.sent.flywheel_torque_nm > 0.0


@pytest.mark.parametrize("late_ms", [0, 35])
def test_every_stamp_is_earlier_by_the_whole_round_trip(make, late_ms: int) -> None:
    robot = make(CONFIG, "virtual")
    robot.late.late_ns = late_ms * MS
    robot.run(1.0, RELEASED)
    inputs = robot.run(0.5, ASKED)
    assert robot.sent.flywheel_torque_nm > 0.0
    for motor, period_ms in ((inputs.flywheels[0], 10), (inputs.hood_motor, 10), (inputs.feeder, 50)):
        age_ms = (inputs.t_ns - motor.t_ns) / MS
        assert late_ms + 5 <= age_ms <= late_ms + period_ms + 15
    assert late_ms + 5 <= (inputs.t_ns - inputs.hood_angle.t_ns) / MS <= late_ms + 25
    beat_ms = (inputs.t_ns - inputs.flywheels[0].heartbeat_t_ns) / MS
    assert late_ms + 5 <= beat_ms <= late_ms + 115


@pytest.mark.parametrize("delay_ms", range(105, 4000, 55))
def test_no_delay_hides_between_questions(delay_ms: int) -> None:
    trip, coming, timely_ns = RoundTrip("it"), deque(), 0
    for t_ns in range(0, 20_000 * MS, TICK_NS):
        while coming and coming[0] <= t_ns:
            trip.answered(coming.popleft())
        trip.tick(t_ns)
        if trip.is_due:
            trip.asked()
            coming.append(t_ns + delay_ms * MS)
        timely_ns += TICK_NS * trip.is_timely
        assert timely_ns <= (0 if delay_ms < 350 else 350 * MS)         # at the very start
    assert trip.late_ns >= LATE_NS


def test_lost_questions_and_answers_make_nothing_late_and_nobody_silent() -> None:
    """Three of four, for two hours; every answer that comes, comes at once."""
    trip, asked = RoundTrip("it"), 0
    for t_ns in range(0, 7_200_000 * MS, 50 * MS):
        trip.tick(t_ns)
        if trip.is_due:
            trip.asked()
            asked += 1
            if asked * 2654435761 % 2**32 < 2**30:
                trip.answered(t_ns + 4 * MS)
        assert trip.late_ns <= 5 * MS and (not trip.is_measured or trip.fault() is None)
    assert asked > 10_000


def test_one_that_no_longer_answers_is_named() -> None:
    trip = RoundTrip("it")
    trip.tick(MS)
    trip.asked()
    trip.answered(5 * MS)
    for t_ns in range(TICK_NS, SILENT_NS + 1000 * MS, TICK_NS):
        trip.tick(t_ns)
        if trip.is_due:
            trip.asked()
        if t_ns < SILENT_NS:
            assert trip.fault() is None
    assert trip.fault() == hw.CONTROLLER_NOT_ANSWERING(controller="it", silence_s=pytest.approx(31.0, abs=0.1))
    assert not trip.is_timely
    while not trip.is_due:
        t_ns += TICK_NS
        trip.tick(t_ns)
    trip.asked()
    trip.answered(t_ns + MS)
    assert trip.fault() is None


def test_answers_that_waited_or_were_not_asked_for_measure_nothing() -> None:
    trip = RoundTrip("it")
    trip.tick(MS)
    trip.asked()
    trip.answered(5 * MS)
    trip.tick(1000 * MS)
    trip.asked()
    assert trip.answered(1300 * MS) == 0 and trip.fault() is None and trip.late_ns == 5 * MS
    trip.tick(1700 * MS)
    assert trip.is_due                                     # asked again without waiting a second
    trip = RoundTrip("it")
    assert trip.answered(1) == 0 and trip.fault() == hw.FEEDBACK_UNMEASURED(controller="it")


def test_what_was_held_up_once_is_asked_again_and_does_not_count() -> None:
    trip = RoundTrip("it")
    for t_ms in (1, 1001):
        trip.tick(t_ms * MS)
        trip.asked()
        trip.answered((t_ms + 4) * MS)
    trip.tick(2200 * MS)
    trip.asked()
    for t_ms in range(2205, 2275, 5):
        trip.tick(t_ms * MS)
    trip.answered(2274 * MS)                               # a gap of 70 ms
    trip.tick(2275 * MS)
    assert trip.is_due and trip.late_ns == 5 * MS
    trip.asked()
    trip.answered(2279 * MS)
    assert trip.late_ns == 5 * MS and trip.fault() is None


# --- letting go

@pytest.mark.parametrize("lost", [0, 1], ids=["every frame arrives", "those of the first tick are lost"])
@pytest.mark.parametrize("blind", [False, True], ids=["readings", "no readings"])
@pytest.mark.parametrize("name", CONFIGS)
def test_released_axes_have_no_torque_within_two_ticks_whatever_is_heard(make, name: str, blind: bool, lost) -> None:
    """Or, where the frames that say so are lost, when they are said again."""
    robot = make(CONFIGS[name], "virtual")
    robot.run(1.0, RELEASED)
    robot.run(0.8, ASKED)
    assert min(robot.torques[-4:]) > 0.0                   # all four drive
    if blind:
        robot.late.read = list
    robot.near.write, write = (lambda frame: True) if lost else robot.near.write, robot.near.write
    robot.late.write = robot.rig._bus._bus._bus.write = robot.near.write
    robot.run(0.005, RELEASED)
    robot.late.write = write
    robot.run(0.105 if lost else 0.005, RELEASED)
    assert max(robot.torques[-4:]) <= 0.0                  # the hood's SPARK brakes it


# --- two devices with one id

TWINS = {"odrive": (CONFIG, lambda plant: make_nodes(CONFIG, plant)["flywheel_b"]),
         "spark": (ALL_SPARK, lambda plant: make_nodes(ALL_SPARK, plant)["flywheel_b"]),
         "canandmag": (CONFIG, lambda plant: CanandmagNode(CONFIG.hood_encoder.device, plant, 0.0, 1))}


@pytest.mark.parametrize("name", TWINS)
def test_two_devices_with_one_id_are_named_within_the_first_second(make, name: str) -> None:
    config, twin = TWINS[name]
    robot = make(config, "virtual", extra=[twin])
    named_ns = 0
    while not named_ns and robot.clock.now_ns() < 2_000 * MS:
        inputs = robot.run(0.005, RELEASED)
        named_ns = inputs.t_ns * any(fault.code == hw.DUPLICATE_ID.name for fault in inputs.faults)
    assert 0 < named_ns <= 1_000 * MS


def test_an_encoder_that_hears_another_with_its_number_is_not_believed(make) -> None:
    robot = make(CONFIG, "virtual")
    robot.run(0.5, RELEASED)
    robot.far.write(Frame(0, 0x070E0185, bytes([0x02, 0x02, 25, 0, 0, 0, 0, 0]), True))
    inputs = robot.run(0.01, RELEASED)
    reasons = step(inputs, Memory(), CONFIG, None).verdict.reasons
    (reason,) = [one for one in reasons if one.params.get("errors") == (hw.ERROR_ID_CONFLICT(),)]
    assert reason.params["motor"] == "hood encoder"
