"""Flight from the wheels to the target: launch, air, trajectory, and the operator's aim.

Balls roll without slip; the launcher loses speed, and shots scatter. Flights use classical Runge-Kutta steps on one
time grid with cubic Hermite interpolation. The operator deliberately aims off the centre according to the robot's
belief, then corrects all speeds by a common factor.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearc_proof.truth.world import Floats, Plan, World, tile_plan

BELT_INERTIA_KG_M2 = 1.2e-3           # of all that turns, at the first wheel
SOLID_BALL = 0.4                      # moment of inertia / (m r^2)
RAPID_FIRE_S = 1.0
CELSIUS_K = 273.15
Law = Callable[[float, Floats], Floats]          # (time_s, velocity [3, n]) -> acceleration [3, n]
STEP_S = 0.02
COARSE_S = 0.04                       # for aiming
LONGEST_S = 4.0
REFERENCE_M_S = 10.0
CRISIS_M_S = 9.0
RATIOS = np.geomspace(0.28, 0.98, 24)  # tried for every shot; heights between them by straight lines, within 2 mm
NEAREST_SD, FARTHEST_SD = 1.5, 2.5    # off the centre, in standard deviations of a shot's height
CORRECTIONS = 2
FAR_BELOW_M = -100.0                  # a ball that does not get there


class Launch(NamedTuple):
    """Balls at the exit; angles in degrees, azimuth to the left; backspin positive; height above the floor."""

    speed_m_s: Floats
    elevation_deg: Floats
    azimuth_deg: Floats
    backspin_rad_s: Floats
    height_m: Floats


class Luck(NamedTuple):
    """Deviations from shot to shot, standard normal [n] each."""

    speed: Floats
    elevation: Floats
    azimuth: Floats
    spin: Floats


def draw_luck(world: World) -> Luck:
    """Draw the random deviations of every shot's launch."""
    return Luck(*world.rng(2).normal(size=(4, world.shots)))


def no_luck(n: int) -> Luck:
    """Return average shots, without deviations."""
    return Luck(*np.zeros((4, n)))


def wheel_speeds(world: World, motor_ratio: Floats) -> tuple[Floats, Floats]:
    """Return (lower, upper) in rad/s that encoders would read without noise; upper and lower share a belt."""
    lower, upper = world.facts.launcher.wheel
    free = world.facts.launcher.free_speed_rad_s or 0.0
    return motor_ratio * free * lower.gear, motor_ratio * free * upper.gear


def leave(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats], luck: Luck) -> Launch:
    """Return how each ball leaves. wheels_rad_s: (lower, upper) by their encoders."""
    surface = surface_speeds(world, wheels_rad_s)
    speed, spin = roll(world, surface)
    speed = speed * _kept(world, plan, wheels_rad_s)
    elevation = (plan.hood_deg + world.amount("hood_flex") * (wheels_rad_s[0] - 250.0) / 100.0
                 + world.amount("hood_gear") * (plan.hood_deg - 45.0)
                 + world.amount("slow_tilt") * ((250.0 / wheels_rad_s[0])**2 - 1.0))
    scatter = world.scatter
    return Launch(speed * (1.0 + scatter.speed * luck.speed), elevation + scatter.elevation_deg * luck.elevation,
                  scatter.azimuth_deg * luck.azimuth, spin * (1.0 + scatter.spin * luck.spin),
                  np.full(world.shots, world.facts.launcher.release_height_m + world.amount("release_height")))


def surface_speeds(world: World, wheels_rad_s: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return the true surface speeds of the (lower, upper) wheels."""
    lower, upper = world.facts.launcher.wheel
    faster = 1.0 + world.amount("encoder_scale")
    return (wheels_rad_s[0] * lower.radius_m * faster * (1.0 + world.amount("worn_wheel")),
            wheels_rad_s[1] * upper.radius_m * faster * (1.0 + world.amount("wheel_gear")))


def roll(world: World, surface_m_s: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return (speed, backspin in rad/s) of a ball between two opposed wheels.

    It touches them at v + r w = lower and v - r w = upper. Slip adds to the slowness 1/v, a squeezed ball has a
    smaller r while it rolls, and a share of the speed is lost in squeezing, a larger one of a soft ball's high speed.
    """
    lower, upper = surface_m_s
    middle = 0.5 * (lower + upper)
    arm = world.facts.ball.radius_m * (1.0 - world.amount("ball_compression"))
    speed = world.efficiency / (1.0 / middle + world.amount("wheel_slip"))
    speed = speed * (1.0 - world.amount("soft_ball") * (middle / REFERENCE_M_S)**2)
    return speed, 0.5 * (lower - upper) / arm


def _kept(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats]) -> Floats:
    """Factor on the speed by what the circumstances do to it."""
    battery = plan.battery_v / np.median(plan.battery_v) - 1.0
    pause = np.nan_to_num(plan.since_last_s, nan=np.inf)
    dip = wheel_dip(world, plan, wheels_rad_s)
    spread = world.amount("ball_spread") + (0.02 if "balls" in world.dirt else 0.0)
    factor: Floats = ((1.0 + world.amount("battery_sag") * battery)
                      * (1.0 - world.amount("rapid_fire") * np.exp(-pause / RAPID_FIRE_S))
                      * (1.0 - world.amount("wheel_droop") * dip / dip.mean())
                      * (1.0 - world.amount("ball_wear") * plan.used)
                      * (1.0 + spread * plan.fresh_ball)
                      * (1.0 + world.amount("far_kick") * (plan.distance_m - 4.5) / 2.5)
                      * (1.0 + world.amount("cold_rubber") * (plan.temperature_c - 20.0) / 10.0))
    return factor


def wheel_dip(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats]) -> Floats:
    """Return the share of their speed that the wheels lose to a ball, by energy: its speed, spin and compression.

    Evaluated at the wheel-based speed, so that a dip does not depend on a shot's random deviation.
    """
    ball = world.facts.ball
    speed, spin = roll(world, surface_speeds(world, wheels_rad_s))
    energy_j = 0.5 * ball.mass_kg * (speed**2 + SOLID_BALL * (ball.radius_m * spin)**2) * plan.squeeze
    return 1.0 - np.sqrt(1.0 - np.minimum(energy_j / (0.5 * BELT_INERTIA_KG_M2 * wheels_rad_s[0]**2), 0.9))


def air_density(world: World, plan: Plan) -> Floats:
    """Return kg/m3: the believed density times the ideal gas's real changes about their median."""
    gas = plan.pressure_pa / (plan.temperature_c + CELSIUS_K)
    change = gas / np.median(gas) - 1.0
    return world.facts.air.density_kg_m3 * (1.0 + world.amount("air_density") * change)


class Path(NamedTuple):
    """States of n flights every step_s from the exit; x toward the target, y left, z up."""

    step_s: float
    position_m: Floats                # [T, 3, n]
    velocity_m_s: Floats              # [T, 3, n]


class Arrival(NamedTuple):
    """Where flights cross their planes; nan height: never. `clear`: above the floor all the way."""

    height_m: Floats
    time_s: Floats
    clear: np.ndarray


def fly(law: Law, position_m: Floats, velocity_m_s: Floats, distance_m: Floats, step_s: float = STEP_S) -> Path:
    """Fly from [3, n] until every ball is past x = distance_m, going back, or LONGEST_S old; the floor stops none."""
    position, velocity = [position_m], [velocity_m_s]
    for k in range(round(LONGEST_S / step_s)):
        p, v = position[-1], velocity[-1]
        if np.all((p[0] >= distance_m) | (v[0] <= 0.0)):
            break
        moved, turned = _step(law, k * step_s, p, v, step_s)
        position.append(moved)
        velocity.append(turned)
    return Path(step_s, np.stack(position), np.stack(velocity))


def _step(law: Law, t: float, p: Floats, v: Floats, h: float) -> tuple[Floats, Floats]:
    a1 = law(t, v)
    v2 = v + (0.5 * h) * a1
    a2 = law(t + 0.5 * h, v2)
    v3 = v + (0.5 * h) * a2
    a3 = law(t + 0.5 * h, v3)
    v4 = v + h * a3
    a4 = law(t + h, v4)
    return p + (h / 6.0) * (v + 2.0 * (v2 + v3) + v4), v + (h / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)


def arrive(path: Path, distance_m: Floats) -> Arrival:
    """Find the first crossing of x = distance_m, by Newton's method on the cubic of its step."""
    beyond = path.position_m[:, 0] >= distance_m
    reached = beyond.any(axis=0)
    last = np.maximum(beyond.argmax(axis=0), 1)
    time = path.step_s * (last - 0.5)
    for _ in range(6):
        p, v = at(path, time, last - 1)
        time = time + (distance_m - p[0]) / np.maximum(v[0], 1e-3)
        time = np.clip(time, path.step_s * (last - 1), path.step_s * last)
    height = at(path, time, last - 1)[0][2]
    before = np.arange(len(beyond))[:, None] < last
    clear = reached & (height > 0.0) & np.all((path.position_m[:, 2] > 0.0) | ~before, axis=0)
    return Arrival(np.where(reached, height, np.nan), np.where(reached, time, np.nan), clear)


def at(path: Path, time_s: Floats, step: np.ndarray | None = None) -> tuple[Floats, Floats]:
    """Return position and velocity [3, n] of each flight at its own time; step: whose cubic, by default that time's."""
    k = np.clip((time_s / path.step_s).astype(int), 0, len(path.position_m) - 2) if step is None else step
    lane = np.arange(len(time_s))
    p0, p1 = path.position_m[k, :, lane].T, path.position_m[k + 1, :, lane].T
    v0, v1 = path.velocity_m_s[k, :, lane].T * path.step_s, path.velocity_m_s[k + 1, :, lane].T * path.step_s
    s = time_s / path.step_s - k
    bend, twist = 3.0 * (p1 - p0) - 2.0 * v0 - v1, 2.0 * (p0 - p1) + v0 + v1
    return p0 + s * (v0 + s * (bend + s * twist)), (v0 + s * (2.0 * bend + 3.0 * s * twist)) / path.step_s


def start_of(launch: Launch) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and spin vector [3, n] at the exit; backspin turns about the right-hand side."""
    up, left = np.radians(launch.elevation_deg), np.radians(launch.azimuth_deg)
    zero = np.zeros_like(up)
    velocity = launch.speed_m_s * np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)])
    spin = launch.backspin_rad_s * np.stack([np.sin(left), -np.cos(left), zero])
    return np.stack([zero, zero, launch.height_m]), velocity, spin


def make_law(world: World, plan: Plan, spin_rad_s: Floats, gust_from_s: Floats) -> Law:
    """Return the acceleration of n balls: weight, drag, lift of the remaining spin, and any hidden effect.

    spin_rad_s [3, n] at the exit; gust_from_s [n]: when the late gust, if there is one, sets in.
    """
    ball = world.facts.ball
    amount = world.amount
    per_m = air_density(world, plan) * (0.5 * math.pi * ball.radius_m**2 / ball.mass_kg)
    cd = world.cd * drag_factor(world, plan)
    rim_m_s = ball.radius_m * spin_rad_s
    displaced = world.facts.air.density_kg_m3 * (4.0 / 3.0) * math.pi * ball.radius_m**3 / ball.mass_kg
    steady = np.zeros_like(spin_rad_s)
    steady[1] = amount("seam_force") * (plan.temperature_c - 20.0) / 10.0
    steady[2] = world.facts.world.gravity_m_s2 * (amount("buoyancy") * displaced - 1.0)
    heavier = 1.0 + amount("added_mass") * 0.5 * displaced
    wind = np.array([[amount("wind_x")], [amount("wind_y")], [amount("wind_z")]])

    def law(t: float, velocity: Floats) -> Floats:
        through = velocity - wind
        if amount("late_gust"):
            through = through - np.stack([amount("late_gust") * (t >= gust_from_s), *np.zeros((2, len(gust_from_s)))])
        speed = np.sqrt(np.einsum("in,in->n", through, through))
        rim = rim_m_s * math.exp(-amount("spin_decay") * t)
        share = np.sqrt(np.einsum("in,in->n", rim, rim)) / speed
        drag = per_m * speed * (cd * _speed_factor(world, speed) + amount("spin_drag") * share**2)
        lift = per_m * world.lift_slope / (1.0 + amount("lift_saturation") * share)
        pulled: Floats = (steady - drag * through + lift * _cross(rim, through)) / heavier
        return pulled

    return law


def drag_factor(world: World, plan: Plan) -> Floats:
    """Return each ball's own drag relative to an ordinary ball's."""
    spread = 0.05 if "balls" in world.dirt else 0.0
    return ((1.0 + world.amount("drag_wear") * plan.used) * (1.0 + spread * plan.drag_of_ball)
            * (1.0 + world.amount("supplier_drag") * plan.supplier))


def _speed_factor(world: World, speed_m_s: Floats) -> Floats | float:
    slope, step = world.amount("drag_reynolds"), world.amount("drag_crisis")
    factor: Floats | float = 1.0 + slope * (speed_m_s / REFERENCE_M_S - 1.0) if slope else 1.0
    power = world.amount("drag_power")
    factor = factor * (speed_m_s / REFERENCE_M_S)**power if power else factor
    return factor * (1.0 + step / (1.0 + np.exp(CRISIS_M_S - speed_m_s))) if step else factor


def _cross(a: Floats, b: Floats) -> Floats:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


class Flown(NamedTuple):
    """Paths, where they cross their planes, and how the balls left."""

    path: Path
    arrival: Arrival
    exit_speed_m_s: Floats


def fly_shots(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats], luck: Luck, gust_from_s: Floats,
              step_s: float = STEP_S) -> Flown:
    """Launch and fly every shot to its true distance."""
    launch = leave(world, plan, wheels_rad_s, luck)
    position, velocity, spin = start_of(launch)
    path = fly(make_law(world, plan, spin, gust_from_s), position, velocity, plan.distance_m, step_s)
    return Flown(path, arrive(path, plan.distance_m), launch.speed_m_s)


def aim(world: World, plan: Plan, seen_distance_m: Floats, seen_hood_deg: Floats) -> tuple[Floats, Floats]:
    """Return (motor ratios [n], flight time of the aimed shots [n]).

    Under the believed physics and the sensor readings, every shot is meant to pass 1.5 to 2.5 of its own standard
    deviations above or below the centre; then all speeds are scaled by one factor until the true average agrees.
    """
    plain = replace(world, effects={}, dirt=())
    seen = replace(plan, distance_m=seen_distance_m, hood_deg=seen_hood_deg)
    heights = _heights(plain, seen)
    centre_m = world.facts.target.centre_height_m if world.facts.target else 0.0
    rng = world.rng(3)
    aside = rng.choice([-1.0, 1.0], world.shots) * rng.uniform(NEAREST_SD, FARTHEST_SD, world.shots)
    wanted = centre_m + aside * _height_sd(plain, seen, _ratio_for(heights, np.full(world.shots, centre_m)))
    ratio = _ratio_for(heights, wanted)
    flight_s = intended_s(world, seen, ratio)
    return _corrected(world, plan, ratio, wanted, flight_s), flight_s


def intended_s(world: World, seen: Plan, ratio: Floats) -> Floats:
    """Return flight times [n] under the believed physics, for a plan as the sensors see it."""
    return np.nan_to_num(_coarse(replace(world, effects={}, dirt=()), seen, ratio).time_s, nan=1.0)


def _coarse(world: World, plan: Plan, ratio: Floats, luck: Luck | None = None,
            gust_from_s: Floats | None = None) -> Arrival:
    luck = no_luck(world.shots) if luck is None else luck
    gust_from_s = np.full(world.shots, np.inf) if gust_from_s is None else gust_from_s
    return fly_shots(world, plan, wheel_speeds(world, ratio), luck, gust_from_s, COARSE_S).arrival


def _heights(world: World, plan: Plan) -> Floats:
    """[ratios, n] heights at the plane at each of RATIOS."""
    many = replace(world, shots=world.shots * len(RATIOS))
    arrival = _coarse(many, tile_plan(plan, len(RATIOS)), np.repeat(RATIOS, world.shots))
    return np.nan_to_num(arrival.height_m, nan=FAR_BELOW_M).reshape(len(RATIOS), -1)


def _ratio_for(heights_m: Floats, wanted_m: Floats) -> Floats:
    """Slowest motor ratio [n] that passes at wanted_m; where none does, the one that comes highest."""
    lane = np.arange(len(wanted_m))
    over = heights_m >= wanted_m
    first = np.maximum(over.argmax(axis=0), 1)
    below, above = heights_m[first - 1, lane], heights_m[first, lane]
    part = np.clip((wanted_m - below) / np.where(above > below, above - below, np.inf), 0.0, 1.0)
    ratio = RATIOS[first - 1] * (RATIOS[first] / RATIOS[first - 1])**part
    chosen: Floats = np.where(over.any(axis=0), ratio, RATIOS[heights_m.argmax(axis=0)])
    return chosen


def _height_sd(world: World, plan: Plan, ratio: Floats) -> Floats:
    """Return the standard deviation of each shot's height: launch deviations and errors of distance and hood."""
    lucky = np.zeros((4, 6, world.shots))             # of the six flights of a shot the first has no random deviation
    lucky[0, 1], lucky[1, 2], lucky[3, 3] = 1.0, 1.0, 1.0
    six = tile_plan(plan, 6)
    farther, steeper = np.zeros((2, 6, world.shots))
    farther[4], steeper[5] = world.noise.distance_m, world.noise.hood_deg
    six = replace(six, distance_m=six.distance_m + farther.ravel(), hood_deg=six.hood_deg + steeper.ravel())
    many = replace(world, shots=6 * world.shots)
    height = _coarse(many, six, np.tile(ratio, 6), Luck(*lucky.reshape(4, -1))).height_m.reshape(6, -1)
    sd = np.sqrt(np.sum((height[1:] - height[0])**2, axis=0))
    filled: Floats = np.where(np.isnan(sd), np.nanmedian(sd), sd)
    return filled


def _corrected(world: World, plan: Plan, ratio: Floats, wanted_m: Floats, flight_s: Floats) -> Floats:
    """All speeds times one factor, so that the median shot of this very world passes where it was meant to."""
    two, gust = replace(world, shots=2 * world.shots), np.tile(flight_s * 2.0 / 3.0, 2)
    for _ in range(CORRECTIONS):
        both = np.concatenate([ratio, 1.01 * ratio])
        here, there = _coarse(two, tile_plan(plan, 2), both, gust_from_s=gust).height_m.reshape(2, -1)
        change = np.nanmedian(wanted_m - here) / np.nanmedian(there - here)
        ratio = ratio * (1.0 + 0.01 * np.clip(change, -10.0, 10.0))
    return np.minimum(ratio, 1.0)
