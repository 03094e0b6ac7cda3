"""Devices and robot on one virtual bus: rates, quantisation, safety, all seen through the drivers; and their clocks."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hw.spinning_plant import TORQUE_NM_A
from truearc.hw import fault_codes as hw
from truearc.hw.devices import canandmag
from truearc.hw.devices.canandmag import CanandmagNode
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.emulator import OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.frames import CLOSED_LOOP, IDLE, PASSTHROUGH, TORQUE, OdriveAxis
from truearc.hw.emulated.nodes import StepClock, Twin
from truearc.hw.protocols import Frame, MotorReading
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.clock import MonotonicClock

MS = 1_000_000
LEFT, RIGHT, HOOD, ENCODER = OdriveAxis(1, 1), OdriveAxis(2, -1), OdriveAxis(3, 1, 596), 5


def limits(velocity_rad_s: float, current_a: float) -> Frame:
    """What another program may have told the left wheel's drive; the robot never does."""
    values = {"velocity_rev_s": velocity_rad_s / (2.0 * math.pi), "current_a": current_a}
    return odrive.make(LEFT, "Set_Limits", values)


class Bench:
    """A robot's end of the bus, with the devices at the other."""

    def __init__(self, plant, settings: OdriveSettings | None = None, period_ns: int = 5 * MS) -> None:
        self.clock = StepClock(lambda t_ns: self.twin.advance(t_ns))
        self.far, self.bus = (open_can("virtual", "test_twin", 1_000_000, self.clock) for _ in range(2))
        self.nodes = (OdriveNode(LEFT, "flywheel_a", plant, settings), OdriveNode(RIGHT, "flywheel_b", plant, settings),
                      OdriveNode(HOOD, "hood", plant, settings, plant.hood_at_limit),
                      CanandmagNode(ENCODER, plant, 40.0, -1))
        self.steps: list[int] = []
        self.twin = Twin(plant, self.far, self.nodes, (self.steps.append,))
        self.period_ns = period_ns
        self.log: list[Frame] = []
        self.readings = {axis: MotorReading() for axis in (LEFT, RIGHT, HOOD)}
        self.angle = None

    def send(self, *frames: Frame) -> None:
        assert all(self.bus.write(frame) for frame in frames)

    def run(self, ticks: int, *each_tick: Frame) -> None:
        for _ in range(ticks):
            self.send(*each_tick)
            self.clock.sleep_until_ns(self.clock.now_ns() + self.period_ns)
            for frame in self.bus.read():
                self.hear(frame)

    def hear(self, frame: Frame) -> None:
        self.log.append(frame)
        for axis, reading in self.readings.items():
            if frame.arbitration_id in odrive.frame_ids(axis):
                self.readings[axis] = odrive.parse(axis, frame, reading)
        if frame.arbitration_id in canandmag.frame_ids(ENCODER):
            self.angle = canandmag.parse(ENCODER, frame, self.angle)

    def arm(self, axis: OdriveAxis = LEFT) -> None:
        self.send(odrive.make_controller_mode(axis, TORQUE, PASSTHROUGH), odrive.make_state(axis, CLOSED_LOOP))

    def count(self, frame_id: int) -> int:
        return sum(frame.arbitration_id == frame_id for frame in self.log)


@pytest.fixture
def bench(plant):
    bench = Bench(plant)
    yield bench
    bench.bus.close()
    bench.far.close()


def test_documented_rates(bench) -> None:
    bench.run(400)                                          # 2 s
    assert [bench.count(1 << 5 | command) for command in (0x01, 0x09, 0x14, 0x17, 0x03)] == [20, 200, 200, 20, 0]
    assert bench.count(0x070E07C5) == 101 and bench.count(0x070E0185) == 21      # both ends of the interval
    assert bench.steps == list(range(5 * MS, 2001 * MS, 5 * MS))


def test_the_encoders_period_is_a_setting(bench) -> None:
    bench.send(canandmag.make_position_period(ENCODER, 10))
    bench.run(200)
    assert bench.count(0x070E07C5) == pytest.approx(101, abs=1)
    report = next(frame for frame in bench.log if frame.arbitration_id == 0x070E0105)
    assert report.data == bytes([253, 10, 0, 0, 0, 0, 0, 1])


@pytest.mark.parametrize("hood_rad", [0.0, 0.5, 1.2, -0.7])
def test_hood_angle_within_half_a_count(bench, plant, hood_rad: float) -> None:
    plant.hood_rad = hood_rad
    bench.run(5)
    wrong_rad = (bench.angle.angle_rad - (math.radians(40.0) - hood_rad) + math.pi) % math.tau - math.pi
    assert abs(wrong_rad) <= math.pi / 16384 + 1e-12 and bench.angle.magnet_ok
    bench.nodes[3].magnet_ok = False
    bench.run(5)
    assert not bench.angle.magnet_ok


def test_a_lost_magnet_sticks_until_cleared(bench) -> None:
    bench.nodes[3].magnet_ok = False
    bench.run(21)
    bench.nodes[3].magnet_ok = True
    bench.run(21)
    status = [frame.data[:2] for frame in bench.log if frame.arbitration_id == 0x070E0185]
    assert status[0] == bytes([0x20, 0x21]) and status[-1] == bytes([0x00, 0x21])
    bench.send(canandmag.make(ENCODER, "CLEAR_STICKY_FAULTS", {}))
    bench.run(21)
    assert [frame.data[:2] for frame in bench.log if frame.arbitration_id == 0x070E0185][-1] == bytes(2)


@pytest.mark.parametrize(("axis", "motor"), [(LEFT, "flywheel_a"), (RIGHT, "flywheel_b")])
def test_torque_turns_the_motor_the_robots_way_whatever_the_devices_sign(bench, plant, axis, motor):
    bench.arm(axis)
    bench.run(100, odrive.make_torque(axis, 0.4))           # 0.5 s at 400 rad/s2, from the first advance on
    assert plant.velocity_rad_s[motor] == pytest.approx(200.0)
    reading = bench.readings[axis]
    sampled_s = 0.493                                       # when its newest report was due
    assert reading.velocity_rad_s == pytest.approx(400.0 * sampled_s, rel=1e-6)
    assert reading.position_rad == pytest.approx(200.0 * sampled_s**2, rel=1e-6)
    assert reading.current_a == pytest.approx(0.4 / TORQUE_NM_A, rel=1e-6) and reading.bus_v == 12.25
    device_rev_s = float(np.float32(axis.direction * plant.velocity_rad_s[motor] / math.tau))
    sent = [frame for frame in bench.log if frame.arbitration_id == axis.node << 5 | 0x09][-1]
    assert struct.unpack("<ff", sent.data)[1] == pytest.approx(device_rev_s * sampled_s / 0.5, rel=1e-5)


def test_a_new_device_is_not_in_torque_mode(bench, plant) -> None:
    bench.send(odrive.make_state(LEFT, CLOSED_LOOP))
    bench.run(20, odrive.make_torque(LEFT, 0.4))
    assert bench.nodes[0].state == CLOSED_LOOP and plant.velocity_rad_s["flywheel_a"] == 0.0


@pytest.mark.parametrize("watchdog_ms", [100, 37])
def test_watchdog_trips_exactly_when_it_is_due(plant, watchdog_ms: int) -> None:
    bench = Bench(plant, OdriveSettings(watchdog_ms=watchdog_ms), period_ns=1 * MS)
    bench.arm()
    bench.run(10, odrive.make_torque(LEFT, 0.1))            # the last one is heard at 9 ms
    bench.run(watchdog_ms - 2)
    assert bench.nodes[0].state == CLOSED_LOOP
    bench.run(1)
    assert bench.nodes[0].state == IDLE and bench.nodes[0].errors == odrive.WATCHDOG_EXPIRED
    # the motor has been driven from 0 to the trip: a closed form
    assert plant.velocity_rad_s["flywheel_a"] == pytest.approx(0.1 / 0.001 * (9 + watchdog_ms) * 1e-3)
    bench.run(150)
    assert odrive.errors_of(bench.readings[LEFT].axis_error) == (hw.ERROR_WATCHDOG_EXPIRED(),)
    assert bench.readings[LEFT].axis_state == IDLE
    assert plant.velocity_rad_s["flywheel_a"] == pytest.approx(0.1 / 0.001 * (9 + watchdog_ms) * 1e-3)
    bench.bus.close()
    bench.far.close()


def test_malformed_setpoints_neither_drive_nor_feed_the_watchdog(bench, plant) -> None:
    bench.arm()
    nan, short = struct.pack("<fI", math.nan, 0), bytes(3)
    bench.run(30, Frame(0, 0x2E, nan), Frame(0, 0x2E, short))
    assert bench.nodes[0].errors == odrive.WATCHDOG_EXPIRED and bench.nodes[0].bad_frames == 60
    assert plant.velocity_rad_s["flywheel_a"] == 0.0


def test_an_error_latches_until_cleared(bench, plant) -> None:
    bench.arm()
    bench.run(30)
    bench.arm()
    bench.run(30, odrive.make_torque(LEFT, 0.1))
    assert bench.nodes[0].state == IDLE and plant.velocity_rad_s["flywheel_a"] == 0.0
    assert [frame.data[5] for frame in bench.log if frame.arbitration_id == 0x21][-1] == 3      # disarmed
    bench.send(odrive.make_clear_errors(LEFT))
    bench.run(30, odrive.make_torque(LEFT, 0.1))
    assert bench.nodes[0].state == IDLE                    # clearing does not arm
    assert bench.readings[LEFT].axis_error == 0
    bench.arm()
    bench.run(30, odrive.make_torque(LEFT, 0.1))
    assert bench.readings[LEFT].axis_state == CLOSED_LOOP and plant.velocity_rad_s["flywheel_a"] > 10.0


def test_estop_takes_the_torque_away_at_once(bench, plant) -> None:
    bench.arm()
    bench.run(10, odrive.make_torque(LEFT, 0.1))
    speed = plant.velocity_rad_s["flywheel_a"]
    bench.run(30, odrive.make_estop(LEFT), odrive.make_torque(LEFT, 0.1))
    assert plant.velocity_rad_s["flywheel_a"] == speed and bench.nodes[0].state == IDLE
    assert odrive.errors_of(bench.readings[LEFT].axis_error) == (hw.ERROR_ESTOP_REQUESTED(),)


def test_current_and_velocity_limits_bound_torque_and_speed(bench, plant) -> None:
    bench.arm()
    bench.send(limits(1000.0, 10.0))      # 10 A x 0.02 Nm/A
    bench.run(20, odrive.make_torque(LEFT, 5.0))
    assert plant.velocity_rad_s["flywheel_a"] == pytest.approx(0.2 / 0.001 * 0.1)
    bench.arm()
    bench.send(limits(50.0, 100.0))
    bench.run(400, odrive.make_torque(LEFT, 0.5))
    assert plant.velocity_rad_s["flywheel_a"] == pytest.approx(50.0, rel=0.01) and bench.nodes[0].errors == 0


def test_overspeed_disarms(bench, plant) -> None:
    bench.arm()
    plant.velocity_rad_s["flywheel_a"] = 1300.0
    bench.run(20, odrive.make_torque(LEFT, 0.0))
    assert odrive.errors_of(bench.nodes[0].errors) == (hw.ERROR_VELOCITY_LIMIT(),) and bench.nodes[0].state == IDLE


def test_limit_switch_is_read_through_its_endpoint(bench, plant) -> None:
    bench.run(1, odrive.make_endstop_query(HOOD), odrive.make_endstop_query(OdriveAxis(1, 1, 596)))
    assert bench.readings[HOOD].endstop_t_ns == 5 * MS and not bench.readings[HOOD].endstop
    assert bench.readings[LEFT].endstop_t_ns == 0           # nothing is wired to that one
    plant.limit = True
    bench.run(1, odrive.make_endstop_query(HOOD))
    assert bench.readings[HOOD].endstop


@given(times=st.lists(st.integers(0, 10**12), max_size=20))
def test_a_step_clock_advances_the_world_only_forward(times) -> None:
    seen: list[tuple[int, int]] = []
    clock = StepClock(lambda t_ns: seen.append((clock.now_ns(), t_ns)))
    for t_ns in times:
        clock.sleep_until_ns(t_ns)
        assert clock.now_ns() >= t_ns
    assert clock.now_ns() == max(times, default=0)
    assert all(before < after for before, after in seen)
    assert [after for _, after in seen] == [before for before, _ in seen[1:]] + [clock.now_ns()] * bool(seen)


@pytest.mark.parametrize("ahead_ns", [-1_000_000_000, 0, 3_000_000])
def test_the_machines_clock_keeps_absolute_deadlines(ahead_ns: int) -> None:
    clock = MonotonicClock()
    start_ns = clock.now_ns()
    clock.sleep_until_ns(start_ns + ahead_ns)
    assert clock.now_ns() >= start_ns + ahead_ns
    assert clock.now_ns() - start_ns < 500_000_000          # a deadline that is past costs nothing
