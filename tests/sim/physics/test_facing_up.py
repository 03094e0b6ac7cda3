"""Openings that face up: landings against DOP853 of other code, closed forms, and what goes in by its geometry."""

import math

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target
from truearc.robot.config.targets import Backboard, Ring
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.facing_up import Landing, clearance, half_along, land, outcome_of
from truearc.sim.physics.term import Exit, Opening

MASS_KG, RADIUS_M, RELEASE_M, DENSITY, G = 0.215, 0.075, 0.55, 1.2, 9.81
TERMS = flight_terms(("gravity", "drag", "magnus"))
HUB = Target(1.83, facing="up", shape="polygon", across_flats_m=1.06, sides=6)
LEANING = Target(1.0, facing="up", shape="rectangle", length_m=0.5, width_m=0.6, tilt_deg=12.0)
BASKET = Target(1.6, facing="up", shape="circle", radius_m=0.3, backboard=Backboard(0.4, 0.8))


def rig_of(target: Target) -> Rig:
    return Rig(Ball(MASS_KG, RADIUS_M), LauncherFacts(RELEASE_M), target)


def opening_of(target: Target, bounce: float = 0.6) -> Opening:
    return Opening(target.centre_height_m, target.three_half_height_m, target.two_half_height_m, bounce)


def reference(target: Target, speed, elevation, spin, cd, cl, distance, share=0.6) -> tuple[float, ...]:
    """(along, angle, time, bounced) by SciPy, nan where the ball never comes down through the plane."""
    tilt = math.radians(target.tilt_deg) if isinstance(target.tilt_deg, float) else 0.0
    area = math.pi * RADIUS_M**2
    spins = [spin]

    def rates(_, state):
        _, _, vx, vz = state
        v = math.hypot(vx, vz)
        drag = 0.5 * cd * area * DENSITY * v / MASS_KG
        lift = cl * 16 / 3 * math.pi**2 * RADIUS_M**3 * spins[0] * DENSITY / MASS_KG
        return [vx, vz, -drag * vx - lift * vz, -drag * vz + lift * vx - G]

    def above(_, state):
        return (state[1] - target.centre_height_m) * math.cos(tilt) - (state[0] - distance) * math.sin(tilt)
    above.direction = -1

    def floor(_, state):
        return state[1]
    floor.terminal, floor.direction = True, -1
    events = [above, floor]
    board = target.backboard if isinstance(target.backboard, Backboard) else None
    if board is not None:
        def wall(_, state):
            return state[0] - (distance + board.behind_m - RADIUS_M)
        wall.direction = 1
        events.append(wall)
    def fly(state, begin):
        return solve_ivp(rates, (begin, 60.0), state, method="DOP853", rtol=1e-12, atol=1e-12, events=events,
                         max_step=0.02)
    done = fly([0.0, RELEASE_M, speed * math.cos(elevation), speed * math.sin(elevation)], 0.0)
    bounced = False
    if board is not None and len(done.t_events[2]):
        x, z, vx, vz = done.y_events[2][0]
        if 0.0 <= above(0.0, [x, z]) <= board.height_m * math.cos(tilt):
            slip = vz + 2 * math.pi * RADIUS_M * spins[0]            # backspin turns the front of the ball up
            spins[0] -= 5 / 2 * 2 / 7 * slip / RADIUS_M / (2 * math.pi)
            done, bounced = fly([x, z, -share * vx, vz - 2 / 7 * slip], done.t_events[2][0]), True
    if not len(done.t_events[0]):
        return math.nan, math.nan, math.nan, bounced
    x, z, vx, vz = done.y_events[0][-1]
    along = (x - distance) * math.cos(tilt) + (z - target.centre_height_m) * math.sin(tilt)
    down = -(vz * math.cos(tilt) - vx * math.sin(tilt))
    return along, math.atan2(down, vx * math.cos(tilt) + vz * math.sin(tilt)), done.t_events[0][-1], bounced


def agrees(target: Target, count: int, seed: int) -> dict[str, int]:
    rng = np.random.default_rng(seed)
    speed, elevation = rng.uniform(3.0, 11.0, count), np.radians(rng.uniform(30.0, 80.0, count))
    spin, cd, cl = rng.uniform(-5.0, 15.0, count), rng.uniform(0.0, 1.0, count), rng.uniform(0.0, 0.2, count)
    distance = rng.uniform(1.0, 7.0, count)
    landing = land(rig_of(target), TERMS, {"drag": {"cd": cd}, "magnus": {"cl": cl}}, Exit(speed, elevation, spin),
                   distance, opening_of(target))
    expected = np.array([reference(target, *row) for row in zip(speed, elevation, spin, cd, cl, distance, strict=True)])
    never = np.isnan(expected[:, 0])
    np.testing.assert_array_equal(np.isnan(landing.along_m), never)
    np.testing.assert_allclose(landing.along_m, expected[:, 0], atol=1e-6, rtol=0, equal_nan=True)
    np.testing.assert_allclose(landing.angle_rad, expected[:, 1], atol=1e-6, rtol=0, equal_nan=True)
    np.testing.assert_allclose(landing.time_s, expected[:, 2], atol=1e-6, rtol=0, equal_nan=True)
    assert not np.asarray(landing.across_m)[~never].any()
    np.testing.assert_array_equal(np.asarray(landing.bounced)[~never], expected[~never, 3] > 0)
    return {"never": int(never.sum()), "bounced": int(np.asarray(landing.bounced).sum())}


@pytest.mark.parametrize("target", [HUB, LEANING, BASKET], ids=["hub", "leaning", "basket"])
def test_landings_agree_with_dop853(target):
    counts = agrees(target, 40, 1)
    assert counts["never"] < 30 and (counts["bounced"] > 0) == (target is BASKET)


@pytest.mark.slow
@pytest.mark.parametrize("target", [HUB, LEANING, BASKET], ids=["hub", "leaning", "basket"])
def test_a_thousand_landings_agree_with_dop853(target):
    agrees(target, 1000, 2)


def test_slopes_of_landings_are_those_of_differences():
    def along(x):
        exit = Exit(x[0:1], x[1:2], x[2:3])
        landing = land(rig_of(BASKET), TERMS, {"drag": {"cd": x[3]}, "magnus": {"cl": x[4]}}, exit, x[5:6],
                       opening_of(BASKET)._replace(centre_m=x[6], bounce=x[7]))
        return landing.along_m[0]
    moved = jax.jit(along)
    for speed, distance in ((6.2, 2.6), (6.8, 2.4)):              # into the opening, and off the board
        x = np.array([speed, math.radians(62.0), 4.0, 0.4, 0.1, distance, 1.6, 0.6])
        slopes = np.asarray(jax.jit(jax.jacfwd(along))(x))
        for k in range(len(x)):
            step = 1e-5 * np.eye(len(x))[k]
            assert slopes[k] == pytest.approx(float(moved(x + step) - moved(x - step)) / 2e-5, rel=1e-4, abs=1e-6), k
    assert slopes[7] < -0.05                                      # the livelier the board, the shorter


def test_half_lengths_are_those_of_the_shapes():
    y = np.linspace(-0.7, 0.7, 141)
    corners = 0.53 / math.cos(math.pi / 6) * np.exp(1j * np.radians(30.0 + 60.0 * np.arange(6)))
    def inside(x, y):       # the hexagon by its corners, a flat toward the launcher
        ahead = np.roll(corners, -1)
        return all((b.real - a.real) * (y - a.imag) - (b.imag - a.imag) * (x - a.real) >= -1e-9
                   for a, b in zip(corners, ahead, strict=True))
    half = half_along(HUB, y)
    for at, far in zip(y, half, strict=True):
        assert inside(0.0, at) == np.isfinite(far)
        assert not np.isfinite(far) or (inside(far - 1e-6, at) and not inside(far + 1e-6, at))
    assert half_along(BASKET, 0.18) == pytest.approx(0.24) and half_along(BASKET, 0.31) == -np.inf
    assert half_along(LEANING, 0.29) == 0.25 and half_along(LEANING, 0.29, 0.02) == 0.27
    assert half_along(Target(1.0, facing="up", shape="polygon", across_flats_m=1.0, sides=4), 0.4) == pytest.approx(0.5)
    octagon = Target(1.0, facing="up", shape="polygon", across_flats_m=1.0, sides=8)
    assert half_along(octagon, 0.5) == pytest.approx(0.5 * math.tan(math.pi / 8))


def test_outcome_is_that_of_a_ball_of_its_size():
    ringed = Target(1.6, facing="up", shape="circle", radius_m=0.3, ring=Ring(0.1, 2.0), lip_m=0.02)
    steep, flat = math.radians(80.0), math.radians(30.0)
    rows = [(0.0, 0.0, steep, -2.0, 2, ""), (0.2, 0.0, steep, -2.0, 1, ""), (-0.2, 0.0, steep, -2.0, 1, ""),
            (-0.2, 0.0, flat, -2.0, 0, "short"),        # the same place, but it would pass through the lip
            (0.31, 0.0, steep, -2.0, 0, "long"), (np.nan, 0.0, np.nan, -np.inf, 0, "short"),
            (0.0, 0.31, steep, -2.0, 0, "left"), (0.0, -0.31, steep, -2.0, 0, "right"),
            (0.1, 0.0, steep, -0.1, 0, "short"),        # it came up through the opening
            (0.25, 0.0, math.pi - flat, -2.0, 0, "long"), (0.15, 0.0, math.pi - steep, -2.0, 1, "")]
    along, across, angle, rise, level, side = map(np.array, zip(*rows, strict=True))
    landing = Landing(along, across, angle, np.ones(len(rows)), rise, np.zeros(len(rows), bool))
    found = outcome_of(ringed, RADIUS_M, landing, opening_of(ringed))
    assert found[0].tolist() == level.tolist() and found[1].tolist() == side.tolist()
    # a straight path through (along, 0) at that angle passes the edge at exactly the ball's radius, above a lip
    touch = -0.3 + clearance(ringed, RADIUS_M, flat)
    assert (touch + 0.3) * math.sin(flat) - 0.02 * math.cos(flat) == pytest.approx(RADIUS_M)
