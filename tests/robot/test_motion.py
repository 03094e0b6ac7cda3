"""Interlocks of motion: the tick drives a launcher of its own, whose sensors then go wrong, and is judged on the truth;
and the PID loop against closed forms.

The launcher is two integrators with friction; that the emulated robot's devices and world agree is for
tests/loops/test_motion_faults.py.
"""

import math
import random
from collections.abc import Callable
from copy import copy, deepcopy
from typing import Any

import pytest
from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.encoders import COUNTING, NONE
from tests.robot.good_tick import CONFIG, good_inputs
from truearc.hw import fault_codes as hw
from truearc.hw.devices.drivers import OWN_LAG_S, Agreement
from truearc.hw.devices.odrive.frames import CLOSED_LOOP
from truearc.hw.protocols import AngleReading, ButtonEvent, MotorReading
from truearc.hw.reason import FAULT, Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config, Prescribed, config_hash
from truearc.robot.motion import RECOVER_NS
from truearc.robot.motors import elevation_from_screw_deg, elevation_per_rad, screw_rad, screw_travel_rad
from truearc.robot.operator_ui.view import tell
from truearc.robot.tick import step
from truearc.robot.types import Inputs, Memory, Sighting, Tick

TICK_S = 0.005
SET_RAD_S, HOOD_DEG, PLACE_M = 358.0, 45.0, 5.0
WHEEL_KG_M2, WHEEL_NM, HOOD_KG_M2, HOOD_NM = 2.6e-3, 0.04, 6e-5, 0.02     # inertia and friction at the motor's shaft
ROW = Prescribed(PLACE_M, SET_RAD_S / 594.0, HOOD_DEG)
AIMED: Config = replace(CONFIG, collect=replace(CONFIG.collect, repeats=1000, prescribed=(ROW,)))


class Launcher:
    """Wheels and hood under the tick's torques, their sensors, and what breaks them."""

    def __init__(self, config: Config = AIMED, hood_kg_m2: float = HOOD_KG_M2, hood_deg: float = 0.0) -> None:
        self.config, self.memory, self.hood_kg_m2 = config, Memory(), hood_kg_m2
        self.t_s = 10.0
        self.wheel_rad_s = self.wheel_rad = self.hood_rad_s = 0.0
        self.screw_rad = screw_rad(hood_deg, config.hood) if hood_deg else 0.5 * screw_travel_rad(config.hood)
        self.start_rad = self.screw_rad
        self.jammed, self.stop_rad = False, 0.0
        self.seen = True
        self.spoil: Callable[[Inputs], Inputs] = lambda inputs: inputs
        self.faults: tuple[Reason, ...] = ()
        self.agreements = [(Agreement(OWN_LAG_S), MotorReading()) for _ in range(3)]
        self.ticks: list[Tick] = []
        self.press: str | None = None

    @property
    def hood_deg(self) -> float:
        deg = elevation_from_screw_deg(self.screw_rad, self.config.hood)
        assert deg is not None
        return deg

    def run(self, seconds: float) -> Tick:
        for _ in range(round(seconds / TICK_S)):
            self._tick()
        return self.ticks[-1]

    def arm(self, after_s: float = 0.0) -> None:
        if after_s:
            self.run(after_s)
        self.press = "arm"

    def _tick(self) -> None:
        self.t_s += TICK_S
        stamp = round(self.t_s * 1e9) - 2_000_000
        wheel = MotorReading(stamp, self.wheel_rad, self.wheel_rad_s, stamp, CLOSED_LOOP, 0, stamp, 0.0, stamp, 12.0)
        closed = self.hood_deg <= self.config.hood.low_deg + 0.1
        hood = replace(wheel, position_rad=self.screw_rad - self.start_rad, velocity_rad_s=self.hood_rad_s,
                       endstop_t_ns=stamp, endstop=closed)
        encoder = self.config.hood_encoder
        angle = AngleReading(stamp, math.radians((self.hood_deg + (encoder.zero_deg or 0.0)) % 360.0), True, 0, stamp)
        sighting = (Sighting(stamp, True, None, PLACE_M + self.config.camera.behind_exit_m, 0.02, 0.0) if self.seen
                    else None)
        presses = () if self.press is None else (ButtonEvent(stamp, len(self.ticks) % 65536, self.press),)
        self.press = None
        inputs = replace(good_inputs(), t_ns=stamp + 2_000_000, flywheels=(wheel, wheel), hood_motor=hood,
                         feeder=replace(wheel, velocity_rad_s=0.0), hood_angle=angle, sighting=sighting,
                         buttons=presses, faults=self.faults)
        inputs = self._with_agreement(self.spoil(inputs))
        tick = step(inputs, self.memory, self.config, None)
        self.memory = tick.memory
        self.ticks.append(tick)
        self._move(tick)

    def _with_agreement(self, inputs: Inputs) -> Inputs:
        """The faults that the drivers would tell."""
        found = []
        for number, (name, reading) in enumerate((
                ("flywheel motor 1", inputs.flywheels[0]), ("flywheel motor 2", inputs.flywheels[1]),
                ("hood motor", inputs.hood_motor))):
            agreement, before = self.agreements[number]
            agreement.take(before, reading)
            self.agreements[number] = agreement, reading
            fault = agreement.fault("it", reading)
            if fault is not None and (number < 2 or fault.code != hw.SPEED_JUMPED.name):
                found.append(fault.about(motor=name))
        return replace(inputs, faults=(*inputs.faults, *found))

    def _move(self, tick: Tick) -> None:
        command = tick.command
        self.wheel_rad_s, turned = _turn(self.wheel_rad_s, 2.0 * command.flywheel_torque_nm, WHEEL_NM, WHEEL_KG_M2)
        self.wheel_rad += turned
        if self.jammed:
            self.hood_rad_s = 0.0
            return
        self.hood_rad_s, turned = _turn(self.hood_rad_s, command.hood_torque_nm, HOOD_NM, self.hood_kg_m2)
        wanted = self.screw_rad + turned
        self.screw_rad = min(max(wanted, self.stop_rad), screw_travel_rad(self.config.hood))
        self.hood_rad_s = self.hood_rad_s if wanted == self.screw_rad else 0.0


def _turn(speed: float, torque_nm: float, friction_nm: float, inertia_kg_m2: float) -> tuple[float, float]:
    """Speed and angle after one tick, in fine steps: Coulomb friction, which holds what stands still."""
    turned, parts = 0.0, 20
    for _ in range(parts):
        push = torque_nm - math.copysign(friction_nm, speed if speed else torque_nm)
        if speed == 0.0 and abs(torque_nm) <= friction_nm:
            return 0.0, turned
        after = speed + push / inertia_kg_m2 * TICK_S / parts
        after = 0.0 if after * speed < 0.0 and abs(torque_nm) <= friction_nm else after
        turned += 0.5 * (speed + after) * TICK_S / parts
        speed = after
    return speed, turned


RUN: dict[tuple[str, float], Launcher] = {}


def running(config: Config = AIMED, hood_kg_m2: float = HOOD_KG_M2) -> Launcher:
    """Armed, homed, at its set points; run up once for each configuration."""
    key = config_hash(config), hood_kg_m2
    if key not in RUN:
        RUN[key] = launcher = Launcher(config, hood_kg_m2)
        launcher.arm(after_s=0.2)
        tick = launcher.run(6.0)
        assert abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0 and abs(launcher.hood_deg - HOOD_DEG) < 0.5
        assert codes(tick.verdict.reasons) == ["fire_not_requested"]
    launcher = copy(RUN[key])
    launcher.agreements, launcher.ticks = deepcopy(launcher.agreements), [*launcher.ticks]
    return launcher


def rise(launcher: Launcher) -> None:
    """Until the hood is homed and on its way up."""
    for _ in range(2000):
        launcher.run(TICK_S)
        if launcher.memory.homed and launcher.hood_deg > 25.0:
            return
    raise AssertionError(f"the hood is at {launcher.hood_deg:.1f} degrees: {launcher.ticks[-1].verdict.reasons}")


def released_after_s(launcher: Launcher, axis: str, seconds: float = 2.0) -> float:
    """How long until the axis gets no torque for good, and is not enabled; the longest that was seen."""
    first, began_s = len(launcher.ticks), launcher.t_s
    launcher.run(seconds)
    last_s = began_s
    for number, tick in enumerate(launcher.ticks[first:], 1):
        if getattr(tick.command, f"{axis}_torque_nm") != 0.0 or getattr(tick.command, f"enable_{axis}"):
            last_s = began_s + number * TICK_S
    return last_s - began_s


def wheels(**changed: Any) -> Callable[[Inputs], Inputs]:
    return lambda inputs: replace(inputs, flywheels=tuple(replace(one, **changed) for one in inputs.flywheels))


def silent_wheels(launcher: Launcher) -> Callable[[Inputs], Inputs]:
    kept = launcher.ticks[-1].inputs.flywheels
    return lambda inputs: replace(inputs, flywheels=kept)


def hood(**changed: Any) -> Callable[[Inputs], Inputs]:
    return lambda inputs: replace(inputs, hood_motor=replace(inputs.hood_motor, **changed))


def frozen(launcher: Launcher, *names: str) -> Callable[[Inputs], Inputs]:
    """Values stand still from now on, stamps go on."""
    kept = launcher.ticks[-1].inputs

    def spoil(inputs: Inputs) -> Inputs:
        changed: dict[str, Any] = {}
        for name in names:
            old, new = getattr(kept, name), getattr(inputs, name)
            changed[name] = (tuple(replace(one, t_ns=new[0].t_ns, heartbeat_t_ns=new[0].heartbeat_t_ns) for one in old)
                             if name == "flywheels" else replace(old, t_ns=new.t_ns))
        return replace(inputs, **changed)
    return spoil


def latched(launcher: Launcher, tick: Tick | None = None) -> list[str]:
    """Codes of the causes for which axes are released until they are armed again."""
    told = [one for one in (tick or launcher.ticks[-1]).verdict.reasons if one.code == because.AXIS_LATCHED.name]
    assert all(one.kind == FAULT for one in tell(told))
    return [cause.code for reason in told if isinstance(cause := reason.params["cause"], Reason)]


# --- readings that are missing

def test_stale_wheels_are_released_and_taken_up_again_with_empty_integrals() -> None:
    launcher = running()
    launcher.spoil = silent_wheels(launcher)
    assert released_after_s(launcher, "flywheel", 0.5) <= 0.105
    assert launcher.ticks[-1].command.enable_hood
    launcher.spoil = lambda inputs: inputs
    first = len(launcher.ticks)
    launcher.run(1.0)
    again = next(tick for tick in launcher.ticks[first:] if tick.command.enable_flywheel)
    good_ns = launcher.ticks[first].inputs.t_ns
    assert RECOVER_NS <= again.inputs.t_ns - good_ns <= RECOVER_NS + 10_000_000
    assert abs(again.memory.flywheel.integral) < 0.01
    launcher.run(1.0)
    assert abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0 and not latched(launcher)


def test_old_errors_are_cleared_also_where_readings_are_good_long_after_arming_only() -> None:
    launcher = Launcher()
    cleared: list[float] = []

    def spoil(inputs: Inputs) -> Inputs:
        if not cleared and launcher.ticks and launcher.ticks[-1].command.enable_flywheel:
            cleared.append(launcher.t_s)
        stamp = {} if launcher.t_s > 11.7 else {"t_ns": 9_000_000_000}
        return wheels(axis_error=0 if cleared else 1, **stamp)(inputs)
    launcher.run(0.2)
    launcher.spoil = spoil
    launcher.arm()
    launcher.run(1.4)
    assert not cleared and set(tick.command.flywheel_torque_nm for tick in launcher.ticks) == {0.0}
    launcher.run(4.0)
    assert cleared and abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0 and not latched(launcher)


def test_wheels_that_coast_are_armed_again_at_a_lower_set_point() -> None:
    launcher = running()
    launcher.arm()
    launcher.run(0.5)
    lower = (replace(ROW, motor_ratio=ROW.motor_ratio * 0.6),)
    launcher.config = replace(AIMED, collect=replace(AIMED.collect, prescribed=lower))
    launcher.arm()
    launcher.run(1.0)
    assert launcher.memory.armed and not latched(launcher) and launcher.wheel_rad_s > 0.7 * SET_RAD_S


def test_noise_and_a_hand_without_a_set_point_are_no_overspeed() -> None:
    launcher, noise = Launcher(), random.Random(1)
    launcher.seen = False
    launcher.spoil = lambda inputs: wheels(velocity_rad_s=launcher.wheel_rad_s + noise.gauss(0.0, 0.3))(inputs)
    launcher.arm()
    launcher.run(1.0)
    launcher.wheel_rad_s, launcher.seen = 15.0, True
    launcher.run(6.0)
    assert not latched(launcher) and abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0


def test_three_releases_in_ten_seconds_latch_and_those_in_a_stall_do_not_count() -> None:
    for stalled in (False, True):
        launcher = running()
        for _ in range(3):
            launcher.spoil = silent_wheels(launcher)
            launcher.faults = (because.TICKS_STALLED(stall_s=0.2),) if stalled else ()
            launcher.run(0.2)
            launcher.spoil, launcher.faults = (lambda inputs: inputs), ()
            launcher.run(1.0)
        assert latched(launcher) == ([] if stalled else [because.RELEASED_REPEATEDLY.name])


@pytest.mark.parametrize("fault", [hw.FOREIGN_HOST(frame="0x02e"), because.CAN_LOST(cause=hw.CAN_BUS_OFF(bus="CAN")),
                                   hw.DUPLICATE_ID(frame="0x021", most=16, window_s=1.0, usual=10)])
def test_a_bus_that_cannot_be_trusted_releases_every_axis_at_once(fault: Reason) -> None:
    launcher = running()
    launcher.faults = (fault,)
    command = launcher.run(TICK_S).command
    assert not (command.enable_flywheel or command.enable_hood or command.enable_feeder)


# --- wheels

@pytest.mark.parametrize("rad_s", [0.0, -SET_RAD_S, 3.6e-41], ids=["zero", "reversed", "swapped"])
def test_a_jump_under_torque_releases_within_80_ms(rad_s: float) -> None:
    launcher = running()
    launcher.spoil = wheels(velocity_rad_s=rad_s)
    assert released_after_s(launcher, "flywheel") <= 0.08 and "speed_jumped" in latched(launcher)
    assert launcher.wheel_rad_s <= 1.15 * SET_RAD_S


def test_wheels_that_freeze_under_torque_are_released_within_80_ms() -> None:
    launcher = Launcher()
    launcher.arm(after_s=0.2)
    launcher.run(0.3)
    assert 100.0 < launcher.wheel_rad_s < 300.0
    launcher.spoil = frozen(launcher, "flywheels")
    assert released_after_s(launcher, "flywheel") <= 0.08
    assert latched(launcher)[0] in ("encoder_stuck", "encoder_mismatch")


@pytest.mark.parametrize(("spoil", "code"), [
    (wheels(velocity_rad_s=0.0, position_rad=0.0), "joint_not_turning"),
    (lambda inputs: replace(inputs, flywheels=(inputs.flywheels[0], replace(
        inputs.flywheels[1], velocity_rad_s=0.0, position_rad=0.0))), "joint_not_turning"),
    (lambda inputs: wheels(velocity_rad_s=0.5 * inputs.flywheels[0].velocity_rad_s)(inputs), "encoder_mismatch"),
    (lambda inputs: wheels(velocity_rad_s=-inputs.flywheels[0].velocity_rad_s)(inputs), "joint_backwards")],
    ids=["zero", "one zero", "half", "reversed"])
def test_wrong_speeds_since_rest_release_within_250_ms(spoil: Callable[[Inputs], Inputs], code: str) -> None:
    launcher = Launcher()
    launcher.spoil = spoil
    launcher.arm(after_s=0.2)
    assert released_after_s(launcher, "flywheel", 3.0) <= 0.25 + 2 * TICK_S
    assert latched(launcher) == [code] and launcher.wheel_rad_s <= 1.15 * SET_RAD_S


def test_wheels_driven_above_their_set_point_are_released() -> None:
    launcher = running()
    first = len(launcher.ticks)
    launcher.spoil = wheels(velocity_rad_s=1.12 * SET_RAD_S, current_a=20.0)
    launcher.run(0.05)
    assert any("joint_overspeed" in latched(launcher, tick) for tick in launcher.ticks[first:])


def test_wheels_turned_above_their_free_speed_are_released() -> None:
    """Near it, where 1.1 times the set point is more."""
    launcher = running()
    fast = (replace(ROW, motor_ratio=0.97),)
    launcher.config = replace(AIMED, collect=replace(AIMED.collect, prescribed=fast))
    launcher.run(2.5)
    assert not latched(launcher) and launcher.wheel_rad_s > 0.95 * 594.0
    while not (causes := latched(launcher)) and launcher.wheel_rad_s < 1.1 * 594.0:
        launcher.wheel_rad_s += 3.0                        # something else turns them
        launcher.run(TICK_S)
    assert causes == ["joint_overspeed"] and 1.05 * 594.0 < launcher.wheel_rad_s < 1.07 * 594.0


def test_a_latched_axis_stays_released_until_it_is_disarmed_and_armed() -> None:
    launcher = running()
    launcher.spoil = wheels(velocity_rad_s=0.0)
    launcher.run(0.2)
    launcher.spoil = lambda inputs: inputs
    assert not any(tick.command.enable_flywheel for tick in launcher.ticks[-200:][199:])
    launcher.run(2.0)
    assert latched(launcher) == ["speed_jumped"]
    launcher.arm()
    launcher.run(0.5)
    assert not launcher.memory.armed
    launcher.arm()
    launcher.run(6.0)
    assert abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0 and not latched(launcher)


def test_wheels_run_down_without_target_and_request_and_come_back_with_it() -> None:
    launcher = running()
    launcher.seen = False
    launcher.run(AIMED.flywheel.idle_s - 0.5)
    assert abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0
    tick = launcher.run(3.0)
    assert launcher.wheel_rad_s < 0.95 * SET_RAD_S and because.WHEELS_IDLE() in tick.verdict.reasons
    launcher.seen = True
    launcher.run(3.0)
    assert abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0
    never = running(replace(AIMED, flywheel=replace(AIMED.flywheel, idle_s=0.0)))
    never.seen = False
    never.run(15.0)
    assert abs(never.wheel_rad_s - SET_RAD_S) < 5.0


def test_a_feed_ends_at_the_first_doubt_about_the_feeder() -> None:
    launcher = running(replace(AIMED, feeder=replace(AIMED.feeder, feed_s=2.0, clear_s=2.0)))
    launcher.press, began = "fire", len(launcher.ticks)
    launcher.run(0.1)
    launcher.spoil = lambda inputs: replace(inputs, feeder=replace(inputs.feeder, axis_error=1, t_ns=0))
    launcher.run(0.1)
    launcher.spoil = lambda inputs: inputs
    launcher.run(2.0)
    driven = [tick.command.feeder_torque_nm > 0.0 for tick in launcher.ticks[began:]]
    assert 15 <= sum(driven) == driven.index(False) <= 20 and launcher.memory.feed_t_ns == 0


@pytest.mark.parametrize("sd_rad_s", [6.0, 10.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_noise_of_dead_wheel_encoders_does_not_pass_for_motion(sd_rad_s: float, seed: int) -> None:
    launcher, rng = Launcher(), random.Random(seed)

    def spoil(inputs: Inputs) -> Inputs:
        return replace(inputs, flywheels=tuple(replace(one, position_rad=0.0, velocity_rad_s=rng.gauss(0.0, sd_rad_s))
                                               for one in inputs.flywheels))
    launcher.spoil = spoil
    launcher.arm(after_s=0.1)
    launcher.run(0.6)
    assert latched(launcher) and launcher.wheel_rad_s <= 1.15 * SET_RAD_S


def test_wheels_whose_stated_friction_is_below_zero_run() -> None:
    running(replace(AIMED, flywheel=replace(AIMED.flywheel, ks_nm=-0.01)))


# --- hood

def turned(launcher: Launcher, change: Callable[[float], float]) -> Callable[[Inputs], Inputs]:
    """The hood encoder says so much of its change since rest."""
    began_rad = math.radians(launcher.hood_deg + (launcher.config.hood_encoder.zero_deg or 0.0))
    return lambda inputs: replace(inputs, hood_angle=replace(inputs.hood_angle, angle_rad=(
        began_rad + change(inputs.hood_angle.angle_rad - began_rad))))


def most_moved_deg(launcher: Launcher, seconds: float) -> float:
    began_deg, most = launcher.hood_deg, 0.0
    for _ in range(round(seconds / TICK_S)):
        launcher.run(TICK_S)
        most = max(most, abs(launcher.hood_deg - began_deg))
    return most


@pytest.mark.parametrize("what", ["frozen", "reversed", "jumps", "motor zero"])
@pytest.mark.parametrize("config", [AIMED, replace(AIMED, hood_encoder=COUNTING.hood_encoder, rig=COUNTING.rig)],
                         ids=["absolute", "counting"])
def test_a_hood_that_homes_with_a_wrong_encoder_goes_no_further_than_five_degrees(what: str, config: Config) -> None:
    launcher = Launcher(config, hood_deg=60.0)
    launcher.spoil = {"frozen": turned(launcher, lambda rad: 0.0), "reversed": turned(launcher, lambda rad: -rad),
                      "jumps": turned(launcher, lambda rad: rad - math.radians(10.0) * (rad < -0.01)),
                      "motor zero": hood(position_rad=0.0, velocity_rad_s=0.0)}[what]
    launcher.arm(after_s=0.1)
    assert most_moved_deg(launcher, 1.0) <= 5.0
    assert latched(launcher) == ["hood_encoders_disagree"] and not launcher.memory.homed


def test_sound_hoods_home_on_a_noisy_encoder_and_without_one() -> None:
    launcher = Launcher(replace(AIMED, hood_encoder=COUNTING.hood_encoder, rig=COUNTING.rig), hood_deg=70.0)
    rng = random.Random(1)
    launcher.spoil = lambda inputs: replace(inputs, hood_angle=replace(inputs.hood_angle, angle_rad=(
        inputs.hood_angle.angle_rad + math.radians(rng.gauss(300.0, 0.2))) % math.tau))
    launcher.arm(after_s=0.1)
    launcher.run(6.0)
    assert launcher.memory.homed and not latched(launcher)
    launcher = Launcher(BLIND, hood_deg=40.0)
    launcher.arm(after_s=0.1)
    launcher.run(6.0)
    assert abs(launcher.hood_deg - HOOD_DEG) < 0.5 and not latched(launcher)


BLIND = replace(AIMED, hood_encoder=NONE.hood_encoder, rig=NONE.rig)


@pytest.mark.parametrize("hood_deg", [60.0, 15.05])
def test_without_hood_encoder_a_motor_whose_encoder_is_dead_moves_little_and_not_again_and_again(hood_deg):
    launcher = Launcher(BLIND, hood_deg=hood_deg)
    launcher.spoil = hood(position_rad=0.0, velocity_rad_s=0.0)
    launcher.run(0.1)
    moved = []
    for _ in range(5):
        launcher.arm()
        moved.append(most_moved_deg(launcher, 0.8))
        launcher.arm()
        launcher.run(0.05)
    assert max(moved) <= 5.0 and moved[3:] == [0.0, 0.0]
    launcher.arm()
    launcher.run(0.1)
    assert latched(launcher) == [because.HOOD_GIVEN_UP.name]


@pytest.mark.parametrize("hood_kg_m2", [1.5e-5, HOOD_KG_M2])
def test_the_hood_keeps_to_its_speed_limit_homing_too(hood_kg_m2: float) -> None:
    """The lighter of the screws coasts 34 degrees from full rate."""
    launcher = running(hood_kg_m2=hood_kg_m2)
    rates = [abs(tick.inputs.hood_motor.velocity_rad_s * elevation_per_rad(tick.estimate.hood_deg or 45.0, CONFIG.hood))
             for tick in launcher.ticks]
    assert 15.0 < max(rates) < 1.3 * CONFIG.hood.max_deg_s
    assert sum(rate > 1.1 * CONFIG.hood.max_deg_s for rate in rates) * TICK_S < 0.2


@pytest.mark.parametrize("what", ["frozen", "off", "silent", "screw frozen"])
def test_a_hood_whose_encoder_and_screw_disagree_goes_no_further_than_five_degrees(what: str) -> None:
    launcher = Launcher()
    launcher.arm(after_s=0.2)
    rise(launcher)
    at_deg = launcher.hood_deg
    if what == "silent":
        stamp = launcher.ticks[-1].inputs.hood_angle
        launcher.spoil = lambda inputs: replace(inputs, hood_angle=stamp)
    elif what == "off":
        launcher.spoil = lambda inputs: replace(inputs, hood_angle=replace(
            inputs.hood_angle, angle_rad=inputs.hood_angle.angle_rad - math.radians(10.0)))
    else:
        launcher.spoil = frozen(launcher, "hood_angle" if what == "frozen" else "hood_motor")
    assert released_after_s(launcher, "hood") < 0.25
    assert abs(launcher.hood_deg - at_deg) <= 5.0
    assert latched(launcher) == {"silent": [], "screw frozen": ["encoder_stuck"]}.get(what, ["hood_encoders_disagree"])


def test_a_jam_is_pushed_twice_and_then_latches() -> None:
    launcher = Launcher()
    launcher.arm(after_s=0.2)
    rise(launcher)
    launcher.jammed = True
    first = len(launcher.ticks)
    launcher.run(5.0)
    pushes = [tick.command.hood_torque_nm != 0.0 for tick in launcher.ticks[first:]]
    lengths = [len(one) * TICK_S for one in "".join("x" if push else " " for push in pushes).split()]
    assert len(lengths) == 2 and max(lengths) <= 0.5 and latched(launcher) == ["hood_jammed"]


def test_a_small_push_that_moves_nothing_is_dropped_until_the_set_point_changes() -> None:
    launcher = running()
    launcher.jammed = True
    launcher.config = replace(AIMED, collect=replace(AIMED.collect, prescribed=(
        replace(AIMED.collect.prescribed[0], hood_deg=HOOD_DEG + 0.4),)))
    first = len(launcher.ticks)
    tick = launcher.run(2.0)
    assert sum(one.command.hood_torque_nm != 0.0 for one in launcher.ticks[first:]) * TICK_S <= 0.5
    assert because.HOOD_PUSH_DROPPED.name in codes(tick.verdict.reasons) and tick.command.enable_hood
    launcher.jammed, launcher.config = False, replace(launcher.config, collect=AIMED.collect)
    launcher.run(2.0)
    launcher.config = replace(AIMED, collect=replace(AIMED.collect, prescribed=(
        replace(AIMED.collect.prescribed[0], hood_deg=HOOD_DEG + 3.0),)))
    launcher.run(2.0)
    assert abs(launcher.hood_deg - HOOD_DEG - 3.0) < 0.3


def test_homing_ends_where_the_switch_never_closes_and_waits_for_one_that_never_answered() -> None:
    launcher = Launcher()
    launcher.spoil = hood(endstop=False)
    launcher.arm(after_s=0.2)
    launcher.run(12.0)
    assert latched(launcher) == ["switch_not_reached"]
    silent = Launcher()
    silent.spoil = hood(endstop_t_ns=0)
    at_deg = silent.hood_deg
    silent.arm(after_s=0.2)
    tick = silent.run(3.0)
    assert silent.hood_deg == at_deg and not silent.memory.homed
    assert because.AXIS_RELEASED.name in codes(tick.verdict.reasons)


@pytest.mark.parametrize(("hood_kg_m2", "past_deg"), [(HOOD_KG_M2, 1.0), (2.0 * HOOD_KG_M2, 1.5)])
def test_a_switch_that_answers_every_50_ms_homes_a_hood_that_coasts(hood_kg_m2: float, past_deg: float) -> None:
    """From the first answer that says closed on nothing drives the hood, which the second one then homes."""
    launcher, answers = Launcher(hood_kg_m2=hood_kg_m2), list[MotorReading]()

    def answered(inputs: Inputs) -> Inputs:
        motor = inputs.hood_motor
        if not answers or motor.endstop_t_ns - answers[-1].endstop_t_ns >= 50_000_000:
            answers.append(replace(motor, endstop=launcher.hood_deg <= AIMED.hood.low_deg))
        return replace(inputs, hood_motor=replace(motor, endstop=answers[-1].endstop,
                                                  endstop_t_ns=answers[-1].endstop_t_ns))

    launcher.spoil, launcher.stop_rad = answered, -20.0
    launcher.arm(after_s=0.2)
    while not launcher.memory.homed and launcher.t_s < 30.0:
        tick = launcher.run(TICK_S)
        assert tick.command.hood_torque_nm == 0.0 or launcher.memory.homed or not answers[-1].endstop
    assert launcher.memory.homed and not latched(launcher)
    assert AIMED.hood.low_deg - past_deg < launcher.hood_deg < AIMED.hood.low_deg


def test_a_switch_that_stays_closed_is_told_once_the_hood_has_left_it() -> None:
    config = replace(AIMED, hood=replace(AIMED.hood, crosscheck_deg=15.0))
    launcher = running(config)
    launcher.spoil = hood(endstop=True)
    launcher.run(0.1)
    assert latched(launcher) == ["switch_stuck"]


@pytest.mark.parametrize("wrong_deg", [-0.8, 0.8])
def test_the_nearer_of_encoder_and_screw_counts_at_a_soft_limit(wrong_deg: float) -> None:
    high_deg = AIMED.hood.high_deg - 10.0
    row = replace(AIMED.collect.prescribed[0], hood_deg=high_deg)
    config = replace(AIMED, hood=replace(AIMED.hood, high_deg=high_deg), collect=replace(
        AIMED.collect, prescribed=(row,)))
    launcher = Launcher(config)
    launcher.spoil = lambda inputs: replace(inputs, hood_angle=replace(
        inputs.hood_angle, angle_rad=inputs.hood_angle.angle_rad + math.radians(wrong_deg)))
    launcher.arm(after_s=0.2)
    launcher.run(8.0)
    assert high_deg - 3.0 < max(launcher.hood_deg, 0.0) <= high_deg + 1.0


def test_devices_that_are_not_under_control_yet_get_no_torque_and_stay_enabled() -> None:
    launcher = Launcher()
    launcher.spoil = wheels(axis_state=1)
    launcher.arm(after_s=0.2)
    tick = launcher.run(3.0)
    assert tick.command.enable_flywheel and tick.command.flywheel_torque_nm == 0.0
    assert not latched(launcher)
    launcher.spoil = lambda inputs: inputs
    launcher.run(3.0)
    assert abs(launcher.wheel_rad_s - SET_RAD_S) < 5.0
