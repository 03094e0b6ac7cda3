"""Axes, their drivers and limits; the screw's linkage; frames allowed on the bus; the PID loop."""

import math
import re
import struct
import tomllib
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from tests.robot.sparks import ALL_SPARK, SPARK_HOOD, SPARK_WHEELS, only_advice
from tests.robot.test_rig import ASKED, Time, Wire, rig_on
from truearc.errors import InputError
from truearc.hw import fault_codes as hw
from truearc.hw.bus_rules import Allowed
from truearc.hw.devices.family import Axis, Bounds
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.family import OdriveConfig
from truearc.hw.devices.registry import AdvisoryConfig
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.family import SparkConfig
from truearc.hw.fault_codes import FOREIGN_HOST, FRAME_RATE_EXCEEDED
from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason
from truearc.robot import motors
from truearc.robot.config.schema import Config, PidGains, read_axis
from truearc.robot.control import step_pid
from truearc.robot.estimate import estimate
from truearc.robot.reasons import MOTOR_ERROR, MOTOR_NOT_DRIVEN, text
from truearc.robot.types import Command, Pid, Sent
from truearc.robot.verdict import judge

STATUS_0, STATUS_1, STATUS_2 = 0x0205B800, 0x0205B840, 0x0205B880


class Bench:
    """A rig whose SPARKs are answered for by hand."""

    def __init__(self, config: Config) -> None:
        self.bus, self.clock = Wire(), Time()
        self.rig = rig_on(self.bus, self.clock, config)

    def hear(self, base: int, device: int, data: bytes) -> None:
        self.bus.frames.append(Frame(self.clock.t_ns, base + device, data, True))

    def tick(self, command: Command, *devices: int, major: int = 26, status_0: bytes = b"") -> Sent:
        """One tick in which every device has said all that it can, and answers what it was asked in the last."""
        asked, self.bus.sent = self.bus.sent, []
        for frame in asked:
            base, device = frame.arbitration_id & ~0x3F, frame.arbitration_id & 0x3F
            if frame.is_remote:
                self.hear(base, device, bytes([major, 0, 0, 0, 0, 0, 0, 0]))
            elif base == 0x02050400:
                self.hear(base + 0x40, device, bytes([0, 7, 0, 7, 0]))
            elif base == 0x02053800:
                self.hear(base + 0x40, device, frame.data[:1] + b"\x02" + frame.data[1:] + b"\x00")
        for device in devices:
            self.hear(STATUS_0, device, status_0 or struct.pack("<HH4B", 0, 1638, 0, 25, 0, 0))     # 12.0 V
            self.hear(STATUS_1, device, bytes(8))
            self.hear(STATUS_2, device, bytes(8))
        self.inputs = self.rig.read()
        return self.rig.write(command)


def test_what_a_spark_was_sent_is_recorded_once_it_is_set_up() -> None:
    bench = Bench(SPARK_HOOD)
    for _ in range(5):
        sent = bench.tick(ASKED, 3)
    hood = sent.duties[2]
    assert sent.duties == (None, None, hood, None) and hood == pytest.approx(-0.02 / 2.6, rel=2e-3)
    assert sent.hood_torque_nm == pytest.approx(-0.02) and sent.flywheel_torque_nm == 0.1
    duty = [frame for frame in bench.bus.sent if frame.arbitration_id == 0x02050083]
    assert all(struct.unpack("<fI", frame.data)[0] == pytest.approx(hood) for frame in duty)
    bench = Bench(ALL_SPARK)
    sent = bench.tick(ASKED, 3, 11, 12, 14)
    assert sent == Sent(True, True, True, 0.0, 0.0, 0.0) and isinstance(sent.duties, msgspec.UnsetType)
    assert b"duties" not in msgspec.json.encode(sent)
    for _ in range(5):
        sent = bench.tick(ASKED, 3, 11, 12, 14)
    assert sent.flywheel_torque_nm == pytest.approx(0.1) and None not in sent.duties


def verdict_of(config: Config, inputs) -> tuple[Reason, ...]:
    memory = good_memory()
    return judge(inputs, estimate(inputs, memory, config), memory.aim, memory, config, None).reasons


def with_hood(bench: Bench):
    """A tick in which all is well, except the bench's hood motor and the rig's faults."""
    inputs, good = bench.inputs, good_inputs()
    hood = replace(inputs.hood_motor, t_ns=good.t_ns, heartbeat_t_ns=good.t_ns, errors_t_ns=good.t_ns,
                   velocity_rad_s=0.0, position_rad=good.hood_motor.position_rad)
    faults = tuple(fault for fault in inputs.faults if not fault.code.startswith("box_"))
    return replace(good, hood_motor=hood, faults=faults)


def test_a_spark_that_is_driven_may_fire() -> None:
    bench = Bench(SPARK_HOOD)
    for _ in range(5):
        bench.tick(ASKED, 3)
    assert bench.inputs.hood_motor.axis_state == spark.DRIVEN
    inputs = with_hood(bench)
    assert verdict_of(SPARK_HOOD, inputs) == ()
    for state in (spark.UNKNOWN, spark.IDLE):
        released = replace(inputs, hood_motor=replace(inputs.hood_motor, axis_state=state))
        assert verdict_of(SPARK_HOOD, released)[0] == MOTOR_NOT_DRIVEN(motor="hood motor", state=state)


@pytest.mark.parametrize(("spoilt", "reason"), [
    ({"major": 24}, "hood motor: spark 3 runs firmware 24.0.0, expected 25 to 26: update it"),
    ({"status_0": struct.pack("<HH4B", 0, 1638, 0, 25, 0x20, 0)}, "hood motor: locked to a competition controller")])
def test_what_it_refuses_is_a_hold_that_says_so_and_nothing_is_driven(spoilt, reason: str) -> None:
    bench = Bench(SPARK_HOOD)
    for _ in range(50):
        sent = bench.tick(ASKED, 3, **spoilt)
        assert not [frame for frame in bench.bus.sent if frame.arbitration_id in (0x02050083, 0x02052C80)]
    assert any(text(one).startswith(reason) for one in verdict_of(SPARK_HOOD, with_hood(bench)))
    assert sent.hood_torque_nm == 0.0 and isinstance(sent.duties, msgspec.UnsetType)


@pytest.mark.parametrize("listens_to", ["odrive", "spark"])
def test_advice_is_silent_on_the_bus_whatever_is_commanded(listens_to: str) -> None:
    bench = Bench(only_advice(listens_to))
    for number in range(200):
        sent = bench.tick(Command(*[number % 3 > 0] * 3, 1.0, -0.3, 0.2), 3, 11, 12, 14)
        assert sent == Sent(*[number % 3 > 0] * 3, 0.0, 0.0, 0.0)
        assert bench.bus.sent == []
    bench.rig.release()
    assert bench.bus.sent == []


def test_advice_fires_on_what_another_controller_does() -> None:
    config = only_advice("spark")
    inputs = good_inputs()
    heard = [replace(motor, axis_state=0, axis_error=spark.LOCKED | spark.HAS_RESET)
              for motor in (*inputs.flywheels, inputs.hood_motor, inputs.feeder)]
    inputs = replace(inputs, flywheels=tuple(heard[:2]), hood_motor=heard[2], feeder=heard[3])
    assert verdict_of(config, inputs) == ()
    hot = replace(inputs, feeder=replace(inputs.feeder, axis_error=0x10))
    assert verdict_of(config, hot) == (MOTOR_ERROR(motor="feeder motor", errors=(hw.ERROR_OVER_TEMPERATURE(),)),)
    idle = replace(inputs, feeder=replace(inputs.feeder, axis_state=1, axis_error=0))
    assert verdict_of(only_advice("odrive"), idle)[-1] == MOTOR_NOT_DRIVEN(motor="feeder motor", state=1)


def test_two_axes_on_one_device_are_named() -> None:
    wrong = replace(CONFIG, axes=replace(CONFIG.axes, feeder=replace(CONFIG.axes.feeder, node=3)))
    with pytest.raises(InputError, match="hood motor and feeder motor are the same device"):
        motors.make_motors(wrong)
    heard = only_advice("spark").axes.hood
    with pytest.raises(InputError, match="hood motor and feeder motor"):
        motors.make_motors(replace(SPARK_HOOD, axes=replace(SPARK_HOOD.axes, feeder=heard)))
    assert len(motors.make_motors(SPARK_WHEELS)) == 4             # node 3 and device 3 would be two things


def test_the_lines_in_the_manual_are_taken() -> None:
    manual = (Path(__file__).parents[2] / "docs" / "how-to" / "motors.md").read_text(encoding="utf-8")
    axes = tomllib.loads(re.search(r"```toml\n(.*?)```", manual, re.DOTALL)[1])["axes"]
    taken = [read_axis(Axis, lines) for lines in (axes["feeder"], axes["hood"], axes["flywheels"][0])]
    assert [type(axis) for axis in taken] == [OdriveConfig, SparkConfig, AdvisoryConfig]


def test_an_axis_is_bounded_by_what_the_rest_of_the_configuration_asks_of_it() -> None:
    """Of the hood: 20 deg/s where its lever is longest, 0.25 m, and half as much again, at which its interlock acts."""
    left, right, hood, feeder = motors.bound_axes(CONFIG)
    assert left == right == Bounds(594.0, 1.2, False) and feeder == Bounds(None, 0.2, None)
    lever_rad_s = math.tau * math.radians(20.0) * 0.25 / 0.005
    assert hood.top_rad_s == pytest.approx(1.5 * max(lever_rad_s, CONFIG.identify.hood.top_rad_s), rel=2e-3)
    assert (hood.top_nm, hood.brakes) == (0.3, True)
    slow = motors.bound_axes(replace(CONFIG, identify=None))[2]
    assert slow.top_rad_s == pytest.approx(1.5 * lever_rad_s, rel=2e-2)


@pytest.mark.parametrize("torque_nm_a", [1e-9, 1e-300, 10.0])
def test_limits_that_no_frame_can_say_are_none_and_no_error(torque_nm_a: float) -> None:
    flywheels = tuple(replace(axis, torque_nm_a=torque_nm_a) for axis in CONFIG.axes.flywheels)
    hood = replace(CONFIG.hood, screw_lead_m=1e-8)
    assert len(motors.make_motors(replace(CONFIG, hood=hood, axes=replace(CONFIG.axes, flywheels=flywheels)))) == 4
    wheels = tuple(replace(axis, torque_nm_a=torque_nm_a) for axis in SPARK_WHEELS.axes.flywheels)
    assert len(motors.make_motors(replace(SPARK_WHEELS, axes=replace(SPARK_WHEELS.axes, flywheels=wheels)))) == 4


def test_screw_encoder_and_elevation_are_inverse_by_the_linkage():
    hood = CONFIG.hood
    for elevation in np.linspace(hood.low_deg, hood.high_deg, 25):
        travel = motors.screw_length_m(elevation, hood) - motors.screw_length_m(hood.low_deg, hood)
        turned = travel / hood.screw_lead_m * 2 * math.pi / hood.screw_gear
        assert motors.elevation_from_screw_deg(turned, hood) == pytest.approx(elevation, abs=1e-9)
    hood = CONFIG.hood
    angle = math.radians(hood.included_deg + 40.0)
    nut = hood.pivot_to_nut_m * np.array([math.cos(angle), math.sin(angle)])
    apart_m = np.hypot(*(nut - [hood.pivot_to_motor_m, 0.0]))
    assert motors.screw_length_m(40.0, hood) == pytest.approx(apart_m, rel=1e-12)
    assert motors.elevation_from_screw_deg(1e4, CONFIG.hood) is None
    zero = CONFIG.hood_encoder.zero_deg
    for elevation in (-30.0, 0.0, 15.0, 75.0, 179.0):
        angle = math.radians((zero + elevation) % 360.0)
        assert motors.elevation_from_encoder_deg(angle, CONFIG.hood_encoder, zero) == pytest.approx(elevation, abs=1e-9)


# ODrive CANSimple: node << 5 | command; the hood, node 3, has a limit switch to ask for, command 0x04
ADDRESS = 0x06                        # with a serial number: two devices with one id give two
ESTOP, AXIS_STATE, CONTROLLER_MODE, TORQUE, LIMITS, CLEAR_ERRORS = 0x02, 0x07, 0x0B, 0x0E, 0x0F, 0x18
ENCODER_SETTING, ENCODER_ASKED = 0x070E00C0 + 5, 0x070E0080 + 5


def allowed_of(config: Config) -> list[Allowed]:
    return [kind for one in motors.make_rules(config) for kind in one.allowed]


def limits_of(config: Config) -> dict[tuple[int, bool, bool, int], int]:
    return {(kind.arbitration_id, kind.is_extended, kind.is_remote, kind.length): kind.most
            for kind in allowed_of(config)}


@pytest.fixture
def bench():
    wire, clock, tally = Wire(), Time(), Counter()
    return wire, clock, tally, motors.guard(wire, CONFIG, clock, tally)


def test_frames_by_length_and_how_often_at_every_tick_rate() -> None:
    """A set point 31 times in 0.1 s: at 200 Hz 20 are due, half as many again may come early, and one begins; as often
    the limit switch is asked that does not answer."""
    commands = {ESTOP: (0, 5), AXIS_STATE: (8, 31), CONTROLLER_MODE: (8, 5), TORQUE: (8, 31), CLEAR_ERRORS: (1, 5)}
    expected = {(node << 5 | command, False, False, length): most for node in (1, 2, 3, 4)
                for command, (length, most) in commands.items()}
    expected |= {(node << 5 | asked, False, True, 0): 5 for node in (1, 2, 3, 4) for asked in (0, ADDRESS)}
    expected |= {(node << 5 | LIMITS, False, False, 8): 5 for node in (1, 2, 3)}
    assert limits_of(CONFIG) == expected | {(3 << 5 | 0x04, False, False, 8): 31, (ENCODER_SETTING, True, False, 8): 5,
                                            (ENCODER_ASKED, True, False, 8): 5}
    fast = allowed_of(replace(CONFIG, tick_hz=2 * CONFIG.tick_hz))
    assert max(kind.most for kind in fast) > 1.8 * max(kind.most for kind in allowed_of(CONFIG))
    limits = limits_of(SPARK_HOOD)
    assert {key: most for key, most in limits.items() if key[0] >> 16 == 0x0205} == {
        (0x02050083, True, False, 8): 31, (0x02052C80, True, False, 8): 31, (0x02053803, True, False, 5): 22,
        (0x02050403, True, False, 4): 5, (0x02051B83, True, False, 0): 5, (0x02052603, True, True, 8): 5}
    assert limits_of(SPARK_WHEELS)[0x0205380B, True, False, 5] == 22


def test_a_loop_gone_wild_is_cut_off(bench) -> None:
    wire, clock, tally, bus = bench
    torque = odrive.make_torque(odrive.OdriveAxis(1, 1), 1.2)
    for _ in range(1000):
        bus.write(torque)
        clock.t_ns += 100_000
    assert len(wire.sent) <= 2 * CONFIG.tick_hz / 10 and tally["frames not allowed"] == 1000 - len(wire.sent)
    assert any(fault.code == FRAME_RATE_EXCEEDED.name and fault.params["frame"] == "0x02e" for fault in bus.faults())


def test_another_host_is_a_fault_of_the_very_tick_that_hears_it(bench) -> None:
    wire, clock, _, bus = bench
    rig = rig_on(bus, clock)
    wire.frames = [Frame(clock.t_ns, 0x2E, bytes(8))]
    assert FOREIGN_HOST.name in codes(rig.read().faults)


SPARK_SENDS = (0x0205BC03, 0x0205B803, 0x0205B843, 0x0205B883, 0x0205B943, 0x0205B983, 0x02050443, 0x02052603,
               0x02053843)
SPARK_IS_SENT = (0x02050003, 0x02050083, 0x02050403, 0x02051B83, 0x02053803, 0x02052C80)
ODRIVE_SENDS = tuple(3 << 5 | command for command in (0x00, 0x01, 0x03, 0x05, ADDRESS, 0x09, 0x14, 0x15, 0x17))
ODRIVE_IS_SENT = tuple(3 << 5 | command for command in (0x02, 0x04, 0x07, 0x0B, 0x0D, 0x0E, 0x0F, 0x18))
ENCODER_SENDS, ENCODER_IS_SENT = (0x070E07C5, 0x070E0785, 0x070E0185, 0x070E0105), (0x070E0145, 0x070E00C5, 0x070E0085)


@pytest.mark.parametrize(("config", "sends", "is_sent", "pulse"), [
    (CONFIG, ODRIVE_SENDS, ODRIVE_IS_SENT, {(3 << 5 | 0x01, False, False): 100_000_000}),
    (only_advice("odrive"), ODRIVE_SENDS, ODRIVE_IS_SENT, {(3 << 5 | 0x01, False, False): 100_000_000}),
    (SPARK_HOOD, SPARK_SENDS, SPARK_IS_SENT, {(0x0205B803, True, False): 10_000_000}),
    (only_advice("spark"), SPARK_SENDS, SPARK_IS_SENT, {(0x0205B803, True, False): 10_000_000})])
def test_whose_frames_they_are(config, sends, is_sent, pulse) -> None:
    """Of the hood's axis, and of its encoder; by the tables of their makers."""
    encoder, hood = motors.make_rules(config)[0], motors.make_rules(config)[3]
    extended = sends is SPARK_SENDS
    assert set(hood.by_device) == {(frame_id, extended, False) for frame_id in sends}
    assert set(hood.by_host) == {(frame_id, extended, False) for frame_id in is_sent}
    assert hood.pulse == pulse
    assert set(encoder.by_device) == {(frame_id, True, False) for frame_id in ENCODER_SENDS}
    assert set(encoder.by_host) == {(frame_id, True, False) for frame_id in ENCODER_IS_SENT}
    advised = not hood.allowed
    assert encoder.pulse == ({(0x070E0185, True, False): 100_000_000} if advised else {
        (ENCODER_SENDS[0], True, False): 10_000_000})
    assert bool(encoder.allowed) != advised


def test_what_devices_and_other_hosts_say_is_known_and_what_only_we_may_say_is_not() -> None:
    """Questions about our axes that another host asks are ours, too; unknown frames are counted without a fault."""
    wire, clock, tally = Wire(), Time(), Counter()
    bus = motors.guard(wire, CONFIG, clock, tally)
    wire.frames = [Frame(clock.t_ns, 1 << 5 | 0x09, bytes(8)), Frame(clock.t_ns, 0x070E0185, bytes(8), True)]
    assert len(bus.read()) == 2 and bus.faults() == [] and not tally
    wire.frames = [Frame(clock.t_ns, 0x7FE, bytes(8)), Frame(clock.t_ns, 1 << 5, b"", is_remote=True)]
    bus.read()
    assert tally == {"unknown frames 0x7fe": 1, "frames of another host": 1}
    assert bus.faults() == [FOREIGN_HOST(frame="0x020")]


def test_an_axis_of_another_controller_may_be_sent_nothing_and_is_commanded_by_it() -> None:
    wire, clock, tally = Wire(), Time(), Counter()
    config = only_advice("odrive")
    bus = motors.guard(wire, config, clock, tally)
    assert allowed_of(config) == []
    torque = odrive.make_torque(odrive.OdriveAxis(11, 1), 0.1)
    assert not bus.write(torque) and wire.sent == []
    wire.frames.append(torque._replace(t_ns=1))
    bus.faults()
    assert bus.read() and bus.faults() == [] and set(tally) == {"frames not allowed"}


DT = 0.005


def gains(kp=0.0, ki=0.0, kd=0.0, tau=0.0, limit=10.0):
    return PidGains(kp=kp, ki=ki, kd=kd, derivative_tau_s=tau, integral_limit=limit, output_low=-1.0, output_high=1.0)


def test_first_order_plants_settle_where_algebra_says():
    # dx/dt = u - x with u = kp (r - x): x -> kp/(1+kp) r
    pid, x = Pid(), 0.0
    for _ in range(4000):
        u, pid = step_pid(gains(kp=4.0), pid, 0.5, x, 0.0, -10.0, 10.0, DT)
        x += DT * (u - x)
    assert math.isclose(x, 0.5 * 4.0 / 5.0, rel_tol=1e-6)
    pid, x = Pid(), 0.0
    for _ in range(8000):
        u, pid = step_pid(gains(kp=2.0, ki=1.0), pid, 0.5, x, 0.0, -10.0, 10.0, DT)
        x += DT * (u - x)
    assert math.isclose(x, 0.5, abs_tol=1e-6)


def test_the_derivative_is_filtered_and_has_no_kick():
    _, pid = step_pid(gains(kd=1.0), Pid(), 0.0, 1.0, 0.0, -10.0, 10.0, DT)
    output, _ = step_pid(gains(kd=1.0), pid, 100.0, 1.0, 0.0, -10.0, 10.0, DT)
    assert output == 0.0
    pid, tau, x = Pid(), 0.05, 0.0
    _, pid = step_pid(gains(tau=tau), pid, 0.0, x, 0.0, -1.0, 1.0, DT)
    for _ in range(round(tau / DT)):
        x += 3.0 * DT
        _, pid = step_pid(gains(tau=tau), pid, 0.0, x, 0.0, -1.0, 1.0, DT)
    assert math.isclose(pid.rate / 3.0, 1.0 - math.exp(-1.0), abs_tol=0.03)


def test_the_integral_does_not_wind_up_while_the_output_is_clamped():
    pid = Pid()
    for _ in range(2000):
        output, pid = step_pid(gains(kp=1.0, ki=1.0), pid, 10.0, 0.0, 0.0, -1.0, 1.0, DT)
        assert output == 1.0
    assert pid.integral == 0.0


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-5, 5), st.floats(-5, 0), st.floats(0, 5))
def test_the_output_never_leaves_its_limits(setpoint, measurement, feedforward, low, high):
    output, pid = step_pid(gains(kp=3.0, ki=2.0, kd=0.1, tau=0.01, limit=0.4), Pid(0.2, 0.0, 0.0, True), setpoint,
                           measurement, feedforward, low, high, DT)
    assert low <= output <= high
    assert abs(pid.integral) <= 0.4
