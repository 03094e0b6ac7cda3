"""Outcomes of openings that face up, against a Monte Carlo of the geometry and of flights by other code."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.robot.config.rig_spec import Rig, Target
from truearc.robot.config.targets import Backboard, Ring
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.launcher import USUAL_SCATTER
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.ground import CELLS, USUAL_PLANE, GroundOutcomes, see_landings
from truearc.sim.infer.likelihood.layout import Point, lay_out, only_shared
from truearc.sim.infer.likelihood.linearization import fly, linearise
from truearc.sim.infer.likelihood.noise import FLOOR_M, LAPSE
from truearc.sim.infer.likelihood.score_table import PlaneScores
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.facing_up import land
from truearc.sim.physics.term import Exit, Opening

RADIUS_M, G, MANY = reference.RADIUS_M, reference.GRAVITY_M_S2, 1_000_000
HUB = Target(1.83, facing="up", shape="polygon", across_flats_m=1.06, sides=6)
RINGED = Target(1.83, facing="up", shape="circle", radius_m=0.4, lip_m=0.03, points=1.0, ring=Ring(0.15, 3.0))
BASKET = Target(1.83, facing="up", shape="rectangle", length_m=0.6, width_m=0.5, backboard=Backboard(0.4, 0.5))
SPEED_SD, ELEVATION_SD, AZIMUTH_SD = 0.02, math.radians(0.5), math.radians(0.7)


def outline(target: Target, y: np.ndarray) -> np.ndarray:
    """Half the length at y, nan beside the opening; from the shapes' definitions."""
    with np.errstate(invalid="ignore"):
        if target.shape == "circle":
            return np.sqrt(target.radius_m**2 - y**2)
        if target.shape == "rectangle":
            return np.where(np.abs(y) <= target.width_m / 2, target.length_m / 2, np.nan)
        flat, side = target.across_flats_m / 2, target.across_flats_m / 2 / math.sqrt(3.0)       # a hexagon
        half = np.where(np.abs(y) <= side, flat, (2 * side - np.abs(y)) * math.sqrt(3.0))
        return np.where(half >= 0.0, half, np.nan)


def words(target: Target, x, y, ahead, down, front) -> np.ndarray:
    """The cell [n] of balls that come down at (x, y), if no board were there, with these speeds; gravity alone."""
    half, lip = outline(target, y), target.lip_m if isinstance(target.lip_m, float) else 0.0
    begin, steep = x - ahead * 2 * down / G, np.hypot(ahead, down)   # where it rose through the plane
    rises = (-begin - half) * down / steep - lip * ahead / steep >= RADIUS_M
    if isinstance(target.backboard, Backboard):
        wall = target.backboard.behind_m - RADIUS_M
        early = (x - wall) / ahead
        above = down * early - G * early**2 / 2
        bounces = (early > 0) & (above > 0) & (above < target.backboard.height_m) & (early < down / G)
        up = G * early - down
        up = up - 2 / 7 * (up + front)
        fall = (up + np.sqrt(up**2 + 2 * G * np.maximum(above, 0))) / G
        x = np.where(bounces, wall - 0.6 * ahead * fall, x)
        ahead, down = np.where(bounces, -0.6 * ahead, ahead), np.where(bounces, G * fall - up, down)
    steep = np.hypot(ahead, down)
    with np.errstate(invalid="ignore"):
        # distance from the edge that it passes over, to the straight path through (x, 0)
        passed = np.where(ahead > 0, x + half, half - x) * down / steep - lip * np.abs(ahead) / steep
        inside = np.where(ahead > 0, x <= half, x >= -half) & (passed >= RADIUS_M)
        ring = isinstance(target.ring, Ring) and x**2 + y**2 <= target.ring.radius_m**2
        near = np.where(ahead > 0, passed < RADIUS_M, x < -half)
    beside = np.isnan(half)
    return np.select([beside & (y > 0), beside, ~rises | near, inside & ring, inside],
                     [CELLS.index(word) for word in ("left", "right", "short", "ring", "hit")], CELLS.index("long"))


def seen_of(target: Target, rows: list[tuple[str, str]] = [("two", "")]) -> GroundOutcomes:       # noqa: B006
    rig = msgspec.structs.replace(GUPPY, target=target)
    outcome, side = zip(*rows, strict=True)
    shots = Shots(tuple(map(str, range(len(rows)))), {}, {"outcome": outcome, "side": side})
    return see_landings(shots, rig, target)[1]


def agrees(target: Target, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(6):
        mean, middle, spread, across = rng.normal(0.0, 0.3), rng.normal(0.0, 0.2), *rng.uniform(0.05, 0.3, 2)
        ahead, down, front = rng.uniform(1.0, 3.0), rng.uniform(1.5, 5.0), rng.uniform(0.0, 2.0)
        plane = np.array([USUAL_PLANE])
        plane[:, 2:4] = target.three_half_height_m, target.two_half_height_m
        plane[:, [4, 5, 8]] = ahead, down, front
        seen = seen_of(target).at(plane, np.array([[middle, across]]))
        cells = seen.cells(np.array([mean]), np.array([spread]))[0]
        assert cells.sum() == pytest.approx(1.0, abs=1e-6)
        drawn = words(target, rng.normal(mean, spread, count), rng.normal(middle, across, count), np.full(count, ahead),
                      np.full(count, down), front)
        share = np.bincount(drawn, minlength=len(CELLS)) / count
        np.testing.assert_allclose(cells, share, atol=2e-6 + 5.0 * math.sqrt(0.25 / count))


@pytest.mark.parametrize("target", [HUB, RINGED, BASKET], ids=["hub", "ringed", "basket"])
def test_chances_are_those_of_a_million_landings(target):
    agrees(target, MANY, 3)


@pytest.mark.slow
@pytest.mark.parametrize("target", [HUB, RINGED, BASKET], ids=["hub", "ringed", "basket"])
def test_chances_are_those_of_ten_million_landings(target):
    agrees(target, 10 * MANY, 4)


def test_slopes_and_information_are_those_of_what_can_happen():
    rows = [("two", ""), ("three", ""), ("miss", "short"), ("miss", "long"), ("miss", "left"), ("miss", "right")]
    seen = seen_of(RINGED, rows)
    n, rng = len(rows), np.random.default_rng(1)
    seen = seen.moved(np.tile(rng.normal(0.0, 0.02, 6), (n, 1)))
    mean, spread = np.full(n, 0.12), np.full(n, 0.15)
    each, information = seen.slopes_and_information(mean, spread)
    slopes = np.stack(each, axis=1)
    up, down = (seen.log_likelihood(mean + step, spread) for step in (1e-4, -1e-4))
    np.testing.assert_allclose(slopes[:, 0], (up - down) / 2e-4, rtol=1e-4)
    up, down = (seen.log_likelihood(mean, spread * np.exp(step)) for step in (1e-4, -1e-4))
    np.testing.assert_allclose(slopes[:, 1], (up - down) / 2e-4, rtol=1e-4)
    for number in range(3):          # edges farther out, mean and log spread across
        step = np.zeros((n, 6))
        step[:, number] = 1e-4
        up, down = (seen.moved(sign * step).log_likelihood(mean, spread) for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, 2 + number], (up - down) / 2e-4, rtol=1e-3, atol=1e-6)
    chance = np.exp(seen.log_likelihood(mean, spread))
    assert chance.sum() == pytest.approx(1.0 + LAPSE * (n / 3.0 - 1.0), abs=1e-6)
    expected = np.einsum("k,ki,kj->ij", chance, slopes, slopes)
    np.testing.assert_allclose(information[0], expected, rtol=1e-6, atol=1e-9)


def plane_of(rig: Rig, distance_m, speed_m_s, hood_deg) -> PlaneScores:
    """The observables of shots in still air, at the middle of nothing: gravity alone."""
    n = len(distance_m)
    numbers = {"distance_m": distance_m, "hood_deg": hood_deg, "exit_speed_m_s": speed_m_s}
    shots = Shots(tuple(map(str, range(n))), numbers, {"outcome": ("miss",) * n})
    intake = take_in(Dataset("d", rig, shots), fewest=1)
    layout = only_shared(lay_out(intake, ("gravity",)))
    log_scatter = USUAL_SCATTER.copy()
    log_scatter[:4] = np.log([1e-9, ELEVATION_SD, AZIMUTH_SD, 1.0])
    intake = replace(intake, noise_var=np.where(np.arange(intake.noise_var.shape[1]) == 0, SPEED_SD**2,
                                                intake.noise_var))
    plane = linearise(intake, layout, Point.still(layout, n, layout.usual.copy(), log_scatter))[0].plane
    assert plane is not None
    return plane


def fired(rng, target: Target, distance_m, speed_m_s, hood_deg, count: int) -> np.ndarray:
    """Shares of the cells for one configuration, by closed forms."""
    speed = speed_m_s * np.exp(rng.normal(0.0, SPEED_SD, count))
    angle = np.radians(hood_deg + rng.normal(0.0, 0.2, count)) + rng.normal(0.0, ELEVATION_SD, count)
    heading = rng.normal(0.0, AZIMUTH_SD, count)
    rise = target.centre_height_m - reference.RELEASE_M
    ahead, up = speed * np.cos(angle), speed * np.sin(angle)
    square = up**2 - 2 * G * rise
    time = (up + np.sqrt(np.maximum(square, 0.0))) / G
    x = ahead * np.cos(heading) * time - distance_m + rng.normal(0.0, 0.05, count) + rng.normal(0.0, FLOOR_M, count)
    y = ahead * np.sin(heading) * time + rng.normal(0.0, FLOOR_M, count)
    cell = words(target, x, y, ahead * np.cos(heading), np.maximum(np.sqrt(np.maximum(square, 0.0)), 1e-9), 0.0)
    cell = np.where(square > 0.0, cell, CELLS.index("short"))
    return np.bincount(cell, minlength=len(CELLS)) / count


def configurations() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Well above the rim, then with the highest point 0 to 20 cm above it."""
    distance_m, hood_deg, speed_m_s = [2.5, 3.5, 4.5], [66.0, 62.0, 55.0], []
    for far, deg in zip(distance_m, hood_deg, strict=True):
        over = (far + 0.05) * math.tan(math.radians(deg)) - HUB.centre_height_m + reference.RELEASE_M
        speed_m_s.append((far + 0.05) / math.cos(math.radians(deg)) * math.sqrt(G / 2 / over))
    for top in (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4):
        up = math.sqrt(2 * G * (HUB.centre_height_m - reference.RELEASE_M + top))
        for deg in (55.0, 68.0):
            speed_m_s.append(up / math.sin(math.radians(deg)))
            hood_deg.append(deg)
            ahead = speed_m_s[-1] * math.cos(math.radians(deg))
            distance_m.append(ahead * (up + math.sqrt(2 * G * top)) / G + 0.05)
    return np.array(distance_m), np.array(speed_m_s), np.array(hood_deg)


def test_landings_of_the_likelihood_are_those_of_fine_steps():
    rng, n = np.random.default_rng(8), 40
    distance_m, hood_deg, speed_m_s = rng.uniform(2.0, 5.0, n), rng.uniform(50.0, 75.0, n), rng.uniform(6.0, 9.0, n)
    rig = msgspec.structs.replace(GUPPY, target=HUB, launcher=msgspec.structs.replace(GUPPY.launcher, wheel=()))
    numbers = {"distance_m": distance_m, "hood_deg": hood_deg, "exit_speed_m_s": speed_m_s,
               "exit_spin_rev_s": rng.uniform(0.0, 6.0, n)}
    shots = Shots(tuple(map(str, range(n))), numbers, {"outcome": ("miss",) * n})
    intake = take_in(Dataset("d", rig, shots))
    layout = only_shared(lay_out(intake, ("gravity", "drag", "magnus")))
    values = layout.usual.copy()
    for slot, value in {("drag", "cd"): 0.6, ("magnus", "cl"): 0.1}.items():
        values[layout.chain.slots.index(slot)] = value
    seen = fly(intake, layout, Point.still(layout, n, values, USUAL_SCATTER)).seen.plane
    fine = land(rig, flight_terms(("gravity", "drag", "magnus")), {"drag": {"cd": 0.6}, "magnus": {"cl": 0.1}},
                Exit(speed_m_s, np.radians(hood_deg), numbers["exit_spin_rev_s"]), distance_m, Opening(1.83, 0.0, 0.53))
    clear = np.nan_to_num(np.asarray(fine.rise_m) - fine.along_m, nan=0.0) < -0.6
    assert clear.sum() > 20
    np.testing.assert_allclose(seen[clear, 0], np.asarray(fine.along_m)[clear], atol=1e-3)
    angle = np.arctan2(seen[clear, 5], seen[clear, 4])
    np.testing.assert_allclose(angle, np.asarray(fine.angle_rad)[clear], atol=1e-3)
    # a ball that never rises to the rim is short, and the shorter the more it lacks
    never = np.isnan(fine.along_m)
    assert (seen[never, 0] <= -0.53).all() and (seen[never, 6] < 0.0).all()


def test_chances_are_those_of_many_flights_even_where_they_graze_the_rim():
    rng, (distance_m, speed_m_s, hood_deg) = np.random.default_rng(6), configurations()
    rig = msgspec.structs.replace(GUPPY, target=HUB, launcher=msgspec.structs.replace(GUPPY.launcher, wheel=()))
    plane = plane_of(rig, distance_m, speed_m_s, hood_deg)
    cells = plane.seen.cells(plane.mean_m, plane.spread_m)
    assert np.isfinite(plane.seen.rise[3:11]).all()
    off = np.array([cells[row] - fired(rng, HUB, *one, MANY)
                    for row, one in enumerate(zip(distance_m, speed_m_s, hood_deg, strict=True))])
    assert np.abs(off[:3]).max() < 0.02 and np.abs(off[3:]).max() < 0.01
