"""From wheels to a ball in the air: rolling without slip, what the launcher loses, and how shots scatter."""

from typing import NamedTuple

import numpy as np

from truearc_proof.truth.plan import Floats, Plan
from truearc_proof.truth.world import World

BELT_INERTIA_KG_M2 = 1.2e-3           # of all that turns, at the first wheel
SOLID_BALL = 0.4                      # moment of inertia / (m r^2)
RAPID_FIRE_S = 1.0
CELSIUS_K = 273.15


class Launch(NamedTuple):
    """Balls as they leave; angles in degrees, azimuth to the left; backspin positive; height above the floor."""

    speed_m_s: Floats
    elevation_deg: Floats
    azimuth_deg: Floats
    backspin_rad_s: Floats
    height_m: Floats


class Luck(NamedTuple):
    """What differs from shot to shot, standard normal [n] each."""

    speed: Floats
    elevation: Floats
    azimuth: Floats
    spin: Floats


def draw_luck(world: World) -> Luck:
    """Draw the random deviations of every shot's launch."""
    return Luck(*world.rng(2).normal(size=(4, world.shots)))


def no_luck(n: int) -> Luck:
    """Shots as they are on average."""
    return Luck(*np.zeros((4, n)))


def wheel_speeds(world: World, motor_ratio: Floats) -> tuple[Floats, Floats]:
    """(lower, upper) in rad/s that encoders would read without noise; upper and lower share a belt."""
    lower, upper = world.facts.launcher.wheel
    free = world.facts.launcher.free_speed_rad_s or 0.0
    return motor_ratio * free * lower.gear, motor_ratio * free * upper.gear


def leave(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats], luck: Luck) -> Launch:
    """How each ball leaves. wheels_rad_s: (lower, upper) by their encoders."""
    surface = surface_speeds(world, wheels_rad_s)
    speed, spin = roll(world, surface)
    speed = speed * _kept(world, plan, wheels_rad_s)
    elevation = plan.hood_deg + world.amount("hood_flex") * (wheels_rad_s[0] - 250.0) / 100.0
    scatter = world.scatter
    return Launch(speed * (1.0 + scatter.speed * luck.speed), elevation + scatter.elevation_deg * luck.elevation,
                  scatter.azimuth_deg * luck.azimuth, spin * (1.0 + scatter.spin * luck.spin),
                  np.full(world.shots, world.facts.launcher.release_height_m + world.amount("release_height")))


def surface_speeds(world: World, wheels_rad_s: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """True speeds of the (lower, upper) wheels' skins."""
    lower, upper = world.facts.launcher.wheel
    faster = 1.0 + world.amount("encoder_scale")
    return (wheels_rad_s[0] * lower.radius_m * faster * (1.0 + world.amount("worn_wheel")),
            wheels_rad_s[1] * upper.radius_m * faster)


def roll(world: World, surface_m_s: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """(speed, backspin in rad/s) of a ball between two opposed wheels.

    It touches them at v + r w = lower and v - r w = upper. Slip adds to the slowness 1/v, a squeezed ball has a
    smaller r while it rolls, and a share of the speed is lost in squeezing.
    """
    lower, upper = surface_m_s
    middle = 0.5 * (lower + upper)
    arm = world.facts.ball.radius_m * (1.0 - world.amount("ball_compression"))
    speed = world.efficiency / (1.0 / middle + world.amount("wheel_slip"))
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
    """Share of their speed that the wheels lose to a ball, by energy: what it flies and spins with, and its squeezing.

    Taken at the speed by the wheels, so that a dip does not depend on a shot's random deviation.
    """
    ball = world.facts.ball
    speed, spin = roll(world, surface_speeds(world, wheels_rad_s))
    energy_j = 0.5 * ball.mass_kg * (speed**2 + SOLID_BALL * (ball.radius_m * spin)**2) * plan.squeeze
    return 1.0 - np.sqrt(1.0 - np.minimum(energy_j / (0.5 * BELT_INERTIA_KG_M2 * wheels_rad_s[0]**2), 0.9))


def air_density(world: World, plan: Plan) -> Floats:
    """kg/m3: the believed one, times the ideal gas's changes about their median as far as they are real."""
    gas = plan.pressure_pa / (plan.temperature_c + CELSIUS_K)
    change = gas / np.median(gas) - 1.0
    return world.facts.air.density_kg_m3 * (1.0 + world.amount("air_density") * change)
