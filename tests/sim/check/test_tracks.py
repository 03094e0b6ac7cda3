"""Tracks in other units, with other axes or of other shots are refused by name; short or noisy ones pass."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace as changed

import truearc as ta
from tests.sim.check.foam import RIG, fly, numbers, scaled, tracks
from truearc.errors import InputError
from truearc.sim.check.believable import measure_motion
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, Tracks


def test_gravity_is_measured_without_being_believed(filmed: Dataset) -> None:
    motion = measure_motion(filmed.tracks)
    assert motion is not None and motion.vectors[:, 3].mean(axis=0) == pytest.approx([-1.2, 0.0, -10.0], abs=0.8)
    assert check_plausible(filmed).accepted == ()


def turned(seen: Tracks, turn_deg: float) -> dict[str, np.ndarray]:
    along = (seen.x_m + 1j * seen.y_m) * np.exp(1j * np.radians(turn_deg))
    return {"x_m": along.real, "y_m": along.imag}


@pytest.mark.parametrize(("changed", "said"), [
    (lambda seen: {"x_m": seen.x_m + 2.0}, r"tracks: z_m: balls leave at -\d.* m by their tracks, at 0.6 m .* x_m the "
     r"distance from the exit.*\(check 'release'"),
    (lambda seen: {"x_m": seen.x_m - 2.0}, r"tracks: x_m: balls are first seen [12]\.\d+ m behind the exit; .* "
     r"subtract where the exit is.*\(check 'release'"),
    (lambda seen: {"y_m": seen.y_m + 1.5},
     r"tracks: y_m: balls leave at y = 1\.5\d? m; y_m is measured from the exit.*\(check 'release'"),
    (lambda seen: {"z_m": seen.z_m + 0.5},
     r"tracks: z_m: balls leave at 1\.\d+ m by their tracks, at 0.6 m.*\(check 'release'"),
    (lambda seen: turned(seen, 60.0), "balls travel .*60 degrees to the left of x"),
    (lambda seen: turned(seen, -35.0), "balls travel .*to the right of x"),
    (lambda seen: {"x_m": 0.0 * seen.x_m}, "tracks: x_m: is 0 in every sample; it is the distance from the exit"),
    (lambda seen: {"z_m": 0.0 * seen.z_m}, "tracks: z_m: is 0 in every sample; it is the height above"),
    *((lambda seen, every=every: {"x_m": np.where(seen.shot % every == 0, -1.0, 1.0) * seen.x_m},
       r"x_m: \d+ of 12 judged look like those .* travel backwards.*accept") for every in (2, 3)),
    (lambda seen: {"t_s": 1e6 * seen.t_s}, "t_s: these look like microseconds: rename the column to t_us"),
    (lambda seen: {"t_s": 180.0 * seen.t_s}, "t_s: these look like numbers of pictures, about 1[789]. per second"),
    (lambda seen: {"t_s": 0.5 * seen.t_s}, "t_s: times look like half of what they were"),
    (lambda seen: {"z_m": np.where(seen.shot == 7, -seen.z_m, seen.z_m)},
     r"tracks: .* 1 of 12 judged look like upside down: convert these: 07;.* \(check 'axes'"),
    (lambda seen: {"shot": (seen.shot + 5) % 12},
     r"tracks: shot_id: the tracks do not rise as .* \(check 'track-shots'"),
    (lambda seen: {"y_m": seen.z_m, "z_m": seen.y_m}, r"z_m must point up and x_m to the target: exchange z_m and y_m"),
    (lambda seen: {"z_m": -seen.z_m}, r"tracks: x_m, y_m, z_m: z points down"),
    (lambda seen: {"x_m": seen.y_m, "y_m": seen.x_m},
     r"tracks: x_m, y_m: z_m must point up .* exchange y_m and x_m"),
    (lambda seen: {"x_m": -seen.x_m}, r"tracks: x_m: balls travel backwards; .* change its sign"),
    (lambda seen: {"t_s": seen.t_s * 1000.0}, r"tracks: t_s: these look like milliseconds")])
def test_other_origins_axes_shots_and_times_are_refused(filmed: Dataset, changed: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_plausible(tracks(filmed, **changed(filmed.tracks)))


@pytest.mark.parametrize("bounce", [0.4, 0.8])
def test_tracks_that_go_on_after_a_bounce_are_refused(filmed: Dataset, bounce: float) -> None:
    t_s = np.arange(0.0, 1.6, 0.01)
    points = np.concatenate([fly(8.0, 40.0 + shot, 0.03, t_s) for shot in range(12)])
    low = (points[:, 0] > 2.5) & (points[:, 2] < 0.5)
    points[:, 2] = np.where(low, 0.5 + bounce * (0.5 - points[:, 2]), points[:, 2])
    flown = replace(filmed, tracks=Tracks(np.repeat(np.arange(12), len(t_s)), np.tile(t_s, 12), *points.T))
    with pytest.raises(InputError, match=r"12 tracks turn at once, .* at t_s = .*: keep of each .* \(check 'bounce'"):
        check_plausible(numbers(flown, distance_m=np.full(12, 9.0)))


def test_topspin_that_is_called_backspin_is_warned_of_and_so_is_a_spin_that_is_not_read() -> None:
    flights = ta.load_dataset(Path(__file__).parents[3] / "examples" / "tracks")
    assert check_plausible(flights).accepted == ()
    spin = flights.shots.number("exit_spin_rev_s")
    (said,) = check_plausible(numbers(flights, exit_spin_rev_s=-spin)).accepted
    assert said.startswith("spin: ") and "if this is topspin, multiply it by -1" in said
    named = {name: column for name, column in flights.shots.numbers.items() if name != "exit_spin_rev_s"}
    other = replace(flights, shots=replace(flights.shots, numbers={**named, "topspin_rps": -spin}))
    (said,) = check_plausible(other).accepted
    assert "topspin_rps: is not read as the ball's spin" in said


@pytest.mark.parametrize("seed", range(4))
def test_noisy_tracks_that_begin_late_or_are_short_are_plausible(seed: int) -> None:
    """2 cm at 60 Hz: what a track says of its own fall is then hardly known."""
    rng = np.random.default_rng(seed)
    t_s, parts = np.arange(0.0, 0.7, 1.0 / 60.0), []
    for shot in range(24):
        points = fly(rng.uniform(7.0, 11.0), rng.uniform(35.0, 60.0), 0.03, t_s) + 0.02 * rng.standard_normal((42, 3))
        seen = np.arange(42)[slice(21, None) if seed % 2 else slice(0, 10)]
        parts.append(np.column_stack([np.full(len(seen), shot), t_s[seen], points[seen]]))
    shot, *columns = np.concatenate(parts).T
    shots = Shots(tuple(map(str, range(24))), {"distance_m": np.full(24, 6.0)}, {})
    assert check_plausible(Dataset("late", RIG, shots, Tracks(shot.astype(int), *columns))).accepted == ()


@pytest.mark.parametrize(("factor", "unit", "suffix"), [
    (1000.0, "millimetres", "mm"), (100.0, "centimetres", "cm"), (1 / 0.0254, "inches", "in"),
    (1 / 0.3048, "feet", "ft")])
def test_tracks_in_another_unit_are_refused(filmed: Dataset, factor: float, unit: str, suffix: str) -> None:
    with pytest.raises(InputError, match=rf"tracks: x_m, y_m, z_m: these look like {unit}: rename x_m to "
                       rf"x_{suffix}, y_m to y_{suffix}, z_m to z_{suffix}"):
        ta.discover(scaled(filmed, factor), believe=("gravity",))
    upright = tracks(filmed, z_m=filmed.tracks.z_m * factor)
    flown = replace(upright, shots=replace(upright.shots, numbers={"distance_m": np.full(12, 6.0)}))
    for one in (upright, flown):      # with the angle of the hood, and without
        with pytest.raises(InputError, match=rf"tracks: z_m: these look like {unit}: rename z_m to z_{suffix};"):
            ta.fit(one, ("gravity",))


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "millimetres"), (100.0, "centimetres"), (1 / 0.3048, "feet")])
@pytest.mark.parametrize("count", [1, 5])
def test_some_tracks_in_another_unit_are_named(filmed: Dataset, factor: float, unit: str, count: int) -> None:
    points = {name: np.where(filmed.tracks.shot < count, factor, 1.0) * getattr(filmed.tracks, name)
              for name in ("x_m", "y_m", "z_m")}
    with pytest.raises(InputError, match=rf"{count} of 12 judged look like {unit}: convert these: 00"):
        check_plausible(replace(filmed, tracks=replace(filmed.tracks, **points)))


def test_a_coordinate_that_never_varies_is_said_to_be_unmeasured(filmed: Dataset) -> None:
    flat = replace(filmed, tracks=replace(filmed.tracks, y_m=np.zeros_like(filmed.tracks.y_m)))
    (said,) = check_plausible(flat).accepted
    assert said.startswith("axes: tracks: y_m: is 0 in every sample, so it is taken as not measured")


def test_a_release_height_that_is_not_stated_is_asked_for(filmed: Dataset) -> None:
    rig = changed(filmed.rig, launcher=changed(filmed.rig.launcher, release_height_m=0.0))
    with pytest.raises(InputError, match=r"balls leave at 0\.6. m by their tracks.*: state that height there"):
        check_plausible(replace(filmed, facts=rig))


def test_angles_from_the_vertical_beside_tracks_are_called_so(filmed: Dataset) -> None:
    with pytest.raises(InputError, match=r"hood_deg: the angle is from the vertical"):
        check_plausible(numbers(filmed, hood_deg=90.0 - filmed.shots.number("hood_deg")))


def test_distances_of_half_are_warned_of(filmed: Dataset) -> None:
    flown_m = np.array([np.ptp(filmed.tracks.x_m[filmed.tracks.shot == row]) for row in range(len(filmed.shots))])
    assert not check_plausible(numbers(filmed, distance_m=flown_m)).accepted
    said, = check_plausible(numbers(filmed, distance_m=flown_m / 2.0)).accepted
    assert re.search(r"track-length: .*distance_m: make sure that it is not half", said)


@pytest.mark.parametrize(("low_m", "said"), [(0.6, "measured from the exit; add that height"), (0.3, "above the floor"),
                                             (-0.6, "above the floor"), (0.1, None), (-0.1, None)])
def test_heights_that_are_not_above_the_floor_are_refused(filmed: Dataset, low_m: float, said: str | None) -> None:
    lower = replace(filmed, tracks=replace(filmed.tracks, z_m=filmed.tracks.z_m - low_m))
    late = replace(lower, tracks=replace(filmed.tracks, **{name: getattr(lower.tracks, name)[filmed.tracks.t_s > 0.05]
                                                           for name in ("shot", "t_s", "x_m", "y_m", "z_m")}))
    for dataset in (lower, late):     # late: seen from half a metre on
        if said is None:
            check_plausible(dataset)
        else:
            with pytest.raises(InputError, match=rf"tracks: z_m: balls leave at .* at 0\.6 m by .*{said}"):
                check_plausible(dataset)


def test_a_table_of_tracks_without_samples_has_no_shots() -> None:
    none = np.zeros(0)
    assert Tracks(np.zeros(0, dtype=int), none, none, none, none).by_shot() == []
