"""Data as people bring them in their first hour, simulated alike: sound ones are read, slips are named."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from numpy.random import default_rng

from benchmarks.plausibility import aim, fly, height_at
from tests.sim.check.foam import numbers
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel
from truearc.sim.check.believable import judged_shots
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.data.files import load_dataset, save_rig

FOAM, BASKETBALL, BASEBALL = Ball(0.142, 0.0889), Ball(0.6, 0.12), Ball(0.145, 0.0366)


def thrown(ball: Ball, speed: np.ndarray, deg: np.ndarray, from_m: float, times: tuple[float, int], cd: float = 0.5,
           cl: float = 0.0, rev_s: np.ndarray | float = 0.0) -> np.ndarray:
    """Places [samples, throws, 2] (x, z); times: step in s and number of steps."""
    angle, area = np.radians(deg), np.pi * ball.radius_m**2 * 1.2 / ball.mass_kg
    start = np.column_stack([0.0 * speed, 0.0 * speed + from_m, speed * np.cos(angle), speed * np.sin(angle)])
    lift = 16.0 / 3.0 * np.pi * cl * ball.radius_m * area + 0.0 * speed
    return fly(start, 0.5 * cd * area + 0.0 * speed, lift, rev_s + 0.0 * speed, *times)[..., :2]


def table(seed: int, steep: bool) -> Dataset:
    """98 shots of a foam ball at 8 to 20 feet with lift 0.065, aimed at the middle of the target."""
    rng = default_rng(seed)
    distance = rng.uniform(8.0, 20.0, 98) * 0.3048
    hood = np.maximum(rng.uniform(*((42.0, 55.0) if steep else (22.0, 32.0)), 98),
                      np.degrees(np.arctan2(1.0, distance)) + 6.0)
    turn = rng.uniform(0.3, 0.8) / 2.0 / np.pi / FOAM.radius_m

    def heights(speed: np.ndarray, deg: np.ndarray) -> np.ndarray:
        return height_at(thrown(FOAM, speed, deg, 0.8, (0.02, 110), 0.5, 0.065, turn * speed), distance) - 1.8
    high = aim(lambda speed: heights(speed, hood), 98)
    off = np.abs(heights(high * np.exp(0.02 * rng.standard_normal(98)), hood + 0.3 * rng.standard_normal(98)))
    outcome = tuple("three" if one < 0.07 else "two" if one < 0.3 else "miss" for one in off)
    ratio = (1.0 - np.pi * turn * FOAM.radius_m) / (1.0 + np.pi * turn * FOAM.radius_m)
    lower = 2.0 * high / 0.82 / (1.0 + ratio) / 0.05
    rig = Rig(FOAM, LauncherFacts(0.8, None, (Wheel("upper", 0.05, 1.0, 0.0), Wheel("lower", 0.05, 1.0, 180.0))),
              Target(1.8, 0.07, 0.3))
    return Dataset("table", rig, Shots(tuple(map(str, range(98))), {
        "distance_m": distance, "hood_deg": hood, "wheel_upper_rad_s": ratio * lower, "wheel_lower_rad_s": lower},
        {"outcome": outcome}, written={"distance_m": ("Dist (ft)", 0.3048, 0.0)}))


def filmed(ball: Ball, places: np.ndarray, step_s: float, from_m: float, target: Target | None = None) -> Dataset:
    """Tracks of those places with a centimetre of noise."""
    samples, throws, _ = places.shape
    x, z = (places[..., axis].T.ravel() + 0.01 * default_rng(axis).standard_normal(samples * throws) for axis in (0, 1))
    rig, shots = Rig(ball, LauncherFacts(from_m, None, ()), target), tuple(map(str, range(throws)))
    return Dataset("film", rig, Shots(shots, {"distance_m": np.full(throws, 4.2)} if target else {}, {}), Tracks(
        np.repeat(np.arange(throws), samples), np.tile(step_s * np.arange(samples), throws), x,
        0.01 * default_rng(5).standard_normal(x.size), z))


@pytest.mark.parametrize("steep", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_sound_tables_in_feet_are_read(seed: int, steep: bool) -> None:
    assert check_plausible(table(seed, steep)).accepted == ()


def test_what_no_cause_explains_is_warned_of_and_a_wide_scatter_is_not() -> None:
    sound = table(2, steep=False)
    speeds = {name: sound.shots.number(name) for name in ("wheel_upper_rad_s", "wheel_lower_rad_s")}
    worse = np.exp(0.04 * default_rng(5).standard_normal(98))
    assert check_plausible(numbers(sound, **{name: one * worse for name, one in speeds.items()})).accepted == ()
    mixed = default_rng(6).permutation(98)
    said = check_plausible(numbers(sound, **{name: one[mixed] for name, one in speeds.items()})).accepted
    assert any("no believable drag, lift, slip or hood explains these" in one for one in said), said


DIST, HOOD = "Dist (ft)", "Hood angle"


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda own: own, ""),
    (lambda own: {DIST: 12.0 * own[DIST]}, r"Dist \(ft\): these look like inches: rename the column to Dist \(in\);"),
    (lambda own: {DIST: 0.3048 * own[DIST]}, r"Dist \(ft\): these look like metres: rename the column to Dist \(m\);"),
    (lambda own: {DIST: own[HOOD], HOOD: own[DIST]}, r"Dist \(ft\), Hood angle: these look exchanged")])
def test_what_was_imported_is_said_by_its_own_headings_with_the_command(wrong, said, tmp_path):
    sound = table(0, steep=True)
    shots, out, mine = sound.shots, tmp_path / "out", tmp_path / "mine.csv"
    own = {DIST: shots.number("distance_m") / 0.3048, HOOD: shots.number("hood_deg"),
           **{f"wheel_{name}_rpm": shots.number(f"wheel_{name}_rad_s") * 30.0 / np.pi for name in ("upper", "lower")}}
    written = own | wrong(own)
    rows = [[*(f"{column[row]:.3f}" for column in written.values()), word]
            for row, word in enumerate(shots.text("outcome"))]
    mine.write_text("".join(",".join(row) + "\n" for row in [[*written, "Result"], *rows]))
    save_rig(tmp_path / "rig.toml", sound.facts)
    command = ["import", "csv", str(mine), "--guess", "--rig", str(tmp_path / "rig.toml"), "-o", str(out)]
    assert main(command) == 0
    imported = load_dataset(out)
    if not said:
        assert check_plausible(imported).accepted == ()
        return
    with pytest.raises(InputError, match=said) as refused:
        check_plausible(imported)
    assert str(refused.value).endswith(f"truearc import csv {mine} --rig {tmp_path}/rig.toml -o {out} --guess --force")


def sided(one: Dataset, faster: float, higher: float) -> Dataset:
    """With sides of all but threes, which were so much faster in logs if high; heights have that sign or the other."""
    word = np.array(one.shots.text("outcome"))
    up = np.where(word == "three", 0.0, default_rng(3).choice([1.0, -1.0], len(word)))
    side = tuple({1.0: "high", -1.0: "low", 0.0: ""}[sign] for sign in up)
    speeds = {name: column * np.exp(faster * up) for name, column in one.shots.numbers.items() if "wheel" in name}
    high = replace(one, shots=replace(one.shots, texts={**one.shots.texts, "side": side}))
    return numbers(high, **speeds, miss_height_m=np.select(
        [word == "miss", word == "two"], [0.5 * higher * up, 0.2 * higher * up], np.nan))


def some(one: Dataset, name: str, factor: float, every: int, missed: bool = False) -> Dataset:
    """One number in so many otherwise, of the misses, or of all that are not judged together with others."""
    word = np.array(one.shots.text("outcome"))
    rows = np.flatnonzero(word == "miss") if missed else np.setdiff1d(np.arange(len(word)), judged_shots(one))
    column = one.shots.number(name).copy()
    column[rows[::every]] *= factor
    return numbers(one, **{name: column})


def geared(one: Dataset, exchanged: bool) -> Dataset:
    """With the gears that give the wheels their speeds, or each other's."""
    ratio = float(np.median(one.shots.number("wheel_upper_rad_s") / one.shots.number("wheel_lower_rad_s")))
    gears = (1.0, ratio) if exchanged else (ratio, 1.0)
    turning = [changed(wheel, gear=gear) for wheel, gear in zip(one.rig.launcher.wheel, gears, strict=True)]
    return replace(one, facts=changed(one.rig, launcher=changed(one.rig.launcher, wheel=tuple(turning))))


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda one: some(one, "distance_m", 12.0, 4, missed=True), "3 of 98 shots look like inches; make sure of"),
    (lambda one: some(one, "hood_deg", np.pi / 180.0, 12), "4 of 98 shots look like radians; make sure of these: "),
    (lambda one: some(one, "distance_m", 12.0, 99), ""),
    (lambda one: sided(one, 0.04, 1.0), ""), (lambda one: sided(one, 0.04, -1.0), "heights have another sign than the"),
    (lambda one: sided(one, -0.04, 1.0), "balls that passed high were slower than the others"),
    (lambda one: geared(one, exchanged=False), ""),
    (lambda one: geared(one, exchanged=True), "differ as the wheels' gears do, but the other way round")])
def test_misses_sides_and_wheels_that_are_odd_are_warned_of(wrong: Callable[[Dataset], Dataset], said: str) -> None:
    accepted = check_plausible(wrong(table(1, steep=True))).accepted
    assert (any(said in one for one in accepted) if said else accepted == ()), accepted


@pytest.mark.parametrize("cl", [0.0, 0.2])
def test_tracks_whose_drag_is_as_strong_as_gravity_are_read(cl: float) -> None:
    rng = default_rng(2)
    speed, deg = rng.uniform(36.0, 42.0, 15), rng.uniform(-1.0, 3.0, 15)
    places = thrown(BASEBALL, speed, deg, 1.8, (1.0 / 60.0, 26), 0.4, cl, 37.0)
    assert check_plausible(filmed(BASEBALL, places, 1.0 / 60.0, 1.8)).accepted == ()


def test_frames_in_the_hand_and_touches_are_named() -> None:
    rng, hoop = default_rng(7), Target(3.05, 0.07, 0.2)
    speed, deg = rng.uniform(8.5, 9.5, 12), rng.uniform(48.0, 56.0, 12)
    places = thrown(BASKETBALL, speed, deg, 2.1, (1.0 / 30.0, 25))
    assert check_plausible(filmed(BASKETBALL, places, 1.0 / 30.0, 2.1, hoop)).accepted == ()
    # from rest to the speed of the throw in a sixth of a second
    along = np.array([np.cos(np.radians(deg)), np.sin(np.radians(deg))]).T
    pushed = ((np.arange(-5, 0) / 5.0 + 1.0)**2 - 1.0)[:, None] * speed / 12.0
    held = np.concatenate([places[0] + pushed[:, :, None] * along, places])
    with pytest.raises(InputError, match=r"begin before the ball is free, as in a hand .* \(check 'bounce'"):
        check_plausible(filmed(BASKETBALL, held, 1.0 / 30.0, 2.1, hoop))
    hit = places.copy()
    hit[..., 0] = np.where(hit[..., 0] > 3.5, 3.5 - 0.4 * (hit[..., 0] - 3.5), hit[..., 0])
    with pytest.raises(InputError, match=r"12 tracks turn at once, as a ball does that touches something"):
        check_plausible(filmed(BASKETBALL, hit, 1.0 / 30.0, 2.1, hoop))


def test_few_of_many_tracks_that_turn_at_once_are_warned_of() -> None:
    rng, hoop = default_rng(8), Target(3.05, 0.07, 0.2)
    places = thrown(BASKETBALL, rng.uniform(8.5, 9.5, 200), rng.uniform(48.0, 56.0, 200), 2.1, (1.0 / 30.0, 25))
    back = places.copy()
    back[..., 0] = np.where(places[..., 0] > 3.5, 3.5 - 0.4 * (places[..., 0] - 3.5), places[..., 0])
    seen = [filmed(BASKETBALL, np.concatenate([back[:, :count], places[:, count:]], axis=1), 1.0 / 30.0, 2.1, hoop)
            for count in (2, 3)]
    assert any("2 tracks turn at once" in one for one in check_plausible(seen[0]).accepted)
    with pytest.raises(InputError, match=r"3 tracks turn at once"):
        check_plausible(seen[1])
