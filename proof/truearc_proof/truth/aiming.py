"""How the operator aims: off the centre on purpose, by what the robot believes of itself, then corrected as a whole."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearc_proof.truth.air import make_law, start_of
from truearc_proof.truth.flight import COARSE_S, STEP_S, Arrival, Path, arrive, fly
from truearc_proof.truth.launch import Luck, draw_luck, leave, no_luck, wheel_speeds
from truearc_proof.truth.plan import Floats, Plan, tile_plan
from truearc_proof.truth.world import World

RATIOS = np.geomspace(0.28, 0.98, 24)  # tried for every shot; heights between them by straight lines, within 2 mm
NEAREST_SD, FARTHEST_SD = 1.5, 2.5    # off the centre, in standard deviations of a shot's height
CORRECTIONS = 2
FAR_BELOW_M = -100.0                  # a ball that does not get there


class Flown(NamedTuple):
    """Paths and where they cross their planes, and how the balls left."""

    path: Path
    arrival: Arrival
    exit_speed_m_s: Floats
    exit_elevation_deg: Floats
    exit_backspin_rad_s: Floats


def fly_shots(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats], luck: Luck, gust_from_s: Floats,
              step_s: float = STEP_S) -> Flown:
    """Launch and fly every shot to its true distance."""
    launch = leave(world, plan, wheels_rad_s, luck)
    position, velocity, spin = start_of(launch)
    path = fly(make_law(world, plan, spin, gust_from_s), position, velocity, plan.distance_m, step_s)
    return Flown(path, arrive(path, plan.distance_m), launch.speed_m_s, launch.elevation_deg, launch.backspin_rad_s)


def shoot_all(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats], flight_s: Floats) -> Flown:
    """Fly the shots themselves, with their random deviations.

    flight_s: of the aimed shots, whose last third the late gust has.
    """
    return fly_shots(world, plan, wheels_rad_s, draw_luck(world), flight_s * 2.0 / 3.0)


def aim(world: World, plan: Plan, seen_distance_m: Floats, seen_hood_deg: Floats) -> tuple[Floats, Floats]:
    """(motor ratios [n], flight time of the aimed shots [n]).

    Every shot is meant to pass 1.5 to 2.5 of its own standard deviations above or below the centre, by the physics
    that is believed and what the sensors say; then all speeds are scaled alike until the shots really do on average.
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
    """Flight times [n] by the physics that is believed, of a plan as the sensors see it."""
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
