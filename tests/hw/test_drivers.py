"""Speeds that contradict positions are named, whatever healthy motors do; torque to duty; motors only heard."""

import math
import struct
from functools import partial
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.devices.drivers import LAG_S, OWN_LAG_S, Agreement, DcMotor, HeardMotor, duty_for, torque_of
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.family import OdriveMotor
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor
from truearc.hw.fault_codes import BY_NAME, ENCODER_MISMATCH, ENCODER_STUCK
from truearc.hw.protocols import Frame, MotorReading
from truearc.hw.reason import render

MS = 1_000_000
TOLD, TRUE = 178.0, 9.0
ODRIVE, SPARK = odrive.OdriveAxis(1, -1), spark.SparkAxis(7, -1)
FAMILIES = {
    "odrive": lambda: OdriveMotor(ODRIVE),
    "spark": lambda: SparkMotor(SPARK, DcMotor(2.45, 612.5, 12.25), SparkHeartbeat(), {}),
    "another's odrive": lambda: HeardMotor("its controller", odrive.frame_ids(ODRIVE), False,
                                           partial(odrive.parse, ODRIVE)),
    "another's spark": lambda: HeardMotor("its controller", spark.frame_ids(SPARK), True, partial(spark.parse, SPARK))}


def frame(family, t_ns, position_rad, velocity_rad_s):
    """What its device, which is mounted the other way round, says."""
    position_rev, velocity_rev_s = -position_rad / math.tau, -velocity_rad_s / math.tau
    if "spark" in family:
        data = struct.pack("<ff", 60.0 * velocity_rev_s, position_rev)
        return Frame(t_ns, spark.frame_id(SPARK, "STATUS_2"), data, True)
    return Frame(t_ns, 0x29, struct.pack("<ff", position_rev, velocity_rev_s))


def contradiction(motor):
    return motor._agreement.fault("it", motor.reading)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("told", "true"), [(TOLD, TRUE), (-TOLD, -TRUE), (TOLD, -TOLD), (0.0, 60.0), (TOLD, 300.0)])
def test_a_speed_that_is_not_that_of_the_position_is_named_within_a_fifth_of_a_second(family, told, true):
    motor, named_ns = FAMILIES[family](), None
    for t_ns in range(1000 * MS, 1500 * MS, 10 * MS):
        motor.take(frame(family, t_ns, 5.0 + true * t_ns * 1e-9, told))
        fault = contradiction(motor)
        named_ns = named_ns or (t_ns if fault else None)
    assert fault.code == ENCODER_MISMATCH.name and fault.params["controller"] == "it"
    assert (fault.params["speed_rad_s"], fault.params["turned_rad_s"]) == pytest.approx((told, true), abs=0.5)
    assert named_ns <= 1220 * MS                   # 50 ms to begin, what it compares, and how long it lasts


@pytest.mark.parametrize("family", FAMILIES)
def test_a_speed_that_hangs_while_the_wheel_runs_down_is_named_and_forgiven_when_it_goes_on(family):
    motor, position, named = FAMILIES[family](), 0.0, []
    for number in range(300):
        true = TOLD * math.exp(-max(number - 50, 0) / 50) if number < 200 else TOLD
        position += true * 0.01
        motor.take(frame(family, (100 + number) * 10 * MS, position, TOLD))
        named.append(bool(contradiction(motor)))
    assert not any(named[:50]) and all(named[80:200]) and not any(named[225:])


def test_it_stands_among_a_motors_faults():
    """SPARKs have to be set up first; the fault matrix has them."""
    for family, device in (("odrive", "odrive node 1"), ("another's spark", "its controller")):
        motor = FAMILIES[family]()
        for t_ns in range(1000 * MS, 1300 * MS, 10 * MS):
            motor.take(frame(family, t_ns, TRUE * t_ns * 1e-9, TOLD))
        motor.faults(t_ns)
        motor.order(None, t_ns)
        if family == "odrive":
            motor.take(Frame(t_ns, 0x20, bytes(8)))        # its answer to what it is asked once a second
        (fault,) = motor.faults(t_ns)
        assert render(fault, BY_NAME) == (
            f"{device} reports 178 rad/s, but its position turns at 9: encoder or firmware?")


# --- what is healthy


def listen(stream, lag_s=OWN_LAG_S):
    """Whether any of (stamp in s, position, speed) is thought to contradict what came before."""
    agreement, before = Agreement(lag_s), MotorReading()
    told = None
    for t_s, position_rad, velocity_rad_s in stream:
        reading = MotorReading(round(t_s * 1e9), position_rad, velocity_rad_s)
        agreement.take(before, reading)
        told, before = told or agreement.fault("it", reading), reading
    return told


def motion(speed, seconds=3.0, step=0.01, turned=0.0):
    """(time, position, speed) of a motor whose speed is this function of time."""
    t_s, fine = 1.0, 10
    while t_s < 1.0 + seconds:
        yield t_s, turned, speed(t_s - 1.0)
        for part in range(fine):
            turned += speed(t_s - 1.0 + (part + 0.5) * step / fine) * step / fine
        t_s += step


def wheel(t_s):
    """Spins up, runs, droops by a shot, is braked hard."""
    if t_s < 1.0:
        return 400.0 * t_s
    if t_s > 2.5:
        return 400.0 * math.exp((2.5 - t_s) / 0.05)
    return 400.0 - (90.0 * math.exp((1.5 - t_s) / 0.1) if t_s > 1.5 else 0.0)


def late(stream, lag_s, step=0.01):
    """With speeds smoothed by a filter."""
    smooth = 0.0
    for t_s, position, speed in stream:
        smooth += (speed - smooth) * step / (lag_s + step)
        yield t_s, position, smooth


@pytest.mark.parametrize("step", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.1])
def test_spinning_up_drooping_and_stopping_are_no_contradiction(step, lag_s):
    assert listen(motion(wheel, step=step)) is None
    assert listen(late(motion(wheel, step=step), lag_s, step), LAG_S) is None


@pytest.mark.parametrize("speed_rad_s2", [900.0, 4500.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.008, 0.02])
def test_a_quick_filter_on_wheels_under_full_torque_is_no_contradiction(speed_rad_s2, lag_s):
    """The shipped wheels, and wheels of a fifth of their inertia; the second lag is that which a SPARK is set to."""
    def spin_up(t_s):
        return min(speed_rad_s2 * max(t_s - 0.3, 0.0), 400.0)
    assert listen(late(motion(spin_up, step=0.01), lag_s, 0.01)) is None


@pytest.mark.parametrize("scale", [0.0, 0.5, 0.67, 1.5, -1.0])
def test_a_scaled_speed_is_named_within_a_quarter_of_a_second_from_rest(scale):
    def spin_up(t_s):
        return 900.0 * max(t_s - 0.3, 0.0)
    stream = ((t_s, position, scale * speed) for t_s, position, speed in motion(spin_up, seconds=0.55, step=0.01))
    assert listen(stream) is not None


@pytest.mark.parametrize("after", [0.0, -358.0, 3.6e-41])
def test_a_speed_that_no_motor_reaches_at_once_is_named(after):
    motor = FAMILIES["odrive"]()
    for number in range(60):
        speed = 358.0 if number < 50 else after
        motor.take(frame("odrive", (100 + number) * 10 * MS, 3.58 * number, speed))
        assert (contradiction(motor) is not None) == (number >= 50), number


@pytest.mark.parametrize("amplitude", [20.0, 200.0])
def test_nor_is_a_hood_that_goes_to_and_fro(amplitude):
    """Its speed turns round within 80 ms."""
    assert listen(motion(lambda t_s: amplitude * min(max(4.0 * math.sin(8.0 * t_s), -1.0), 1.0))) is None


@pytest.mark.parametrize("seed", range(4))
def test_nor_is_a_hood_that_hops_where_half_of_the_frames_are_lost(seed):
    """Hops of 40 ms, as small corrections make them, between readings of which most are 0."""
    random = Random(seed)

    def hops(t_s):
        return 80.0 * math.sin(math.pi * (t_s % 0.25) / 0.04) if t_s % 0.25 < 0.04 else 0.0

    assert listen(one for one in motion(hops, seconds=60.0) if random.random() > 0.5) is None


@given(late_ms=st.lists(st.floats(0.0, 20.0), min_size=20, max_size=20),
       lost=st.sets(st.integers(0, 300), max_size=100), speed=st.floats(-600.0, 600.0))
def test_nor_are_stamps_that_come_late_and_frames_that_are_lost(late_ms, lost, speed):
    stamped, newest = [], 0.0
    for number, (t_s, position, told) in enumerate(motion(lambda t_s: speed)):
        if number not in lost:
            newest = max(newest, t_s + late_ms[number % 20] * 1e-3)
            stamped.append((newest, position, told))
    assert listen(stamped) is None


@pytest.mark.parametrize("held_s", [0.03, 0.06, 0.2, 0.6])
def test_nor_are_frames_that_are_held_back_and_then_come_at_once(held_s):
    def held(stream, apart_s):
        burst = 0
        for t_s, position, told in stream:
            inside = 2.0 <= t_s < 2.0 + held_s
            burst += inside
            yield (2.0 + held_s + burst * apart_s if inside else max(t_s, 2.0 + held_s + burst * apart_s)
                   if t_s >= 2.0 else t_s), position, told
    for apart_s in (0.0, 0.0002):
        # what is told in one tick is looked at once
        assert listen(held(motion(lambda t_s: TOLD), apart_s)) is None


@pytest.mark.parametrize("turned_rev", [1e4, 1e6, 4e6])
def test_nor_is_the_grain_of_a_position_that_has_counted_for_long(turned_rev):
    def grained(stream):
        for t_s, position, told in stream:
            yield t_s, struct.unpack("<f", struct.pack("<f", position / math.tau))[0] * math.tau, told
    for speed in (30.0 if turned_rev <= 1e6 else 100.0, 300.0):
        assert listen(grained(motion(lambda t_s, at=speed: at, turned=turned_rev * math.tau))) is None


def test_every_frame_twice_is_none():
    twice = [(t_s + apart, position, told) for t_s, position, told in motion(wheel) for apart in (0.0, 0.001)]
    assert listen(twice) is None


MOTOR = DcMotor(2.6, 594.0, 12.0)
volts = st.floats(6.0, 15.0)


def test_the_ends_of_the_data_sheet() -> None:
    assert torque_of(MOTOR, 1.0, 0.0, 12.0) == pytest.approx(2.6)       # stalled
    assert torque_of(MOTOR, 1.0, 594.0, 12.0) == pytest.approx(0.0)     # free
    assert torque_of(MOTOR, 0.5, 0.0, 12.0) == pytest.approx(1.3)
    assert duty_for(MOTOR, 0.0, 297.0, 12.0) == pytest.approx(0.5)      # coasting: only the back-EMF is met
    assert duty_for(MOTOR, 0.65, 0.0, 6.0) == pytest.approx(2.0 * duty_for(MOTOR, 0.65, 0.0, 12.0))


@given(torque=st.floats(-5.0, 5.0), speed=st.floats(-900.0, 900.0), bus_v=volts)
def test_the_torque_is_met_or_the_duty_is_at_its_end(torque: float, speed: float, bus_v: float) -> None:
    duty = duty_for(MOTOR, torque, speed, bus_v)
    got = torque_of(MOTOR, duty, speed, bus_v)
    if abs(duty) < 1.0:
        assert got == pytest.approx(torque, abs=1e-12)
    else:
        assert abs(duty) == 1.0 and (torque - got) * duty >= -1e-12    # as much as there is, and never too much


THEIRS = spark.SparkAxis(7, 1, has_endstop=True)


def heard() -> HeardMotor:
    return HeardMotor("its controller", spark.frame_ids(THEIRS), True, partial(spark.parse, THEIRS))


@given(ticks=st.lists(st.tuples(st.one_of(st.none(), st.floats(-10.0, 10.0)), st.binary(min_size=8, max_size=8))))
def test_nothing_that_is_asked_or_heard_makes_it_send(ticks) -> None:
    motor = heard()
    for number, (torque_nm, data) in enumerate(ticks):
        motor.take(Frame(number, 0x0205B847, data, True))
        order = motor.order(torque_nm, number * 5_000_000)
        assert order.frames == () and order.torque_nm == 0.0 and order.duty is None
    assert motor.release() == () and motor.faults(0) == ()


def test_a_speed_without_a_change_of_position_is_a_stuck_encoder() -> None:
    motor = heard()
    for number in range(1, 7):
        assert motor.faults(0) == ()
        motor.take(Frame(number * 10_000_000, 0x0205B887, struct.pack("<ff", 1200.0, 5.0), True))
    (fault,) = motor.faults(0)
    assert fault.code == ENCODER_STUCK.name and fault.params["controller"] == "its controller"
    assert fault.params["speed_rad_s"] == pytest.approx(125.7, abs=0.1)
    motor.take(Frame(90_000_000, 0x0205B887, struct.pack("<ff", 1200.0, 5.2), True))
    assert motor.faults(0) == ()


def test_it_hears_what_its_family_says() -> None:
    motor = heard()
    assert motor.ids() == ((0x0205B807, True), (0x0205B847, True), (0x0205B887, True))
    motor.take(Frame(9, 0x0205B807, bytes.fromhex("5D3F662622230200"), True))
    assert motor.reading.heartbeat_t_ns == 9 and motor.reading.endstop
    assert motor.reading.errors_t_ns == 0         # it has said nothing of them, and that is asked
    motor.take(Frame(10, 0x0205B847, bytes(8), True))
    motor.take(Frame(11, 0x0205B807, bytes.fromhex("5D3F662622230200"), True))
    assert (motor.reading.heartbeat_t_ns, motor.reading.errors_t_ns) == (11, 10)
    theirs = odrive.OdriveAxis(2, 1)
    other = HeardMotor("its controller", odrive.frame_ids(theirs), False, partial(odrive.parse, theirs))
    other.take(Frame(9, 0x41, bytes([0, 0, 0, 0, 8, 0, 0, 0])))
    assert other.reading.axis_state == odrive.CLOSED_LOOP
