"""The paper's search and its labels against brute force with DOP853."""

import os

import numpy as np
import pytest

from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.grid_fit import fit_grid, make_axis, map_deviation, score
from truearc.sim.paper.grid_labels import find_hits, fly_pairs, label_launches, make_flyer
from truearc_proof.reproduce.collect import exit_seed

TRUTH = (0.9, 0.05)
CENTRE_M, THREE_M, TWO_M = 2.44, 0.07, 0.35


def _shots(rows: list[tuple[float, float, float]], outcomes: list[str]) -> Shots:
    columns = dict(zip(("distance_m", "motor_ratio", "hood_deg"), np.array(rows).T, strict=True))
    return Shots(tuple(f"s{row}" for row in range(len(rows))), columns, {"outcome": tuple(outcomes)})


def _recorded(seed: int, count: int) -> Shots:
    """Configurations with the outcome that DOP853 gives them at TRUTH, as many of each kind."""
    rng = np.random.default_rng(seed)
    found: dict[str, list] = {"miss": [], "two": [], "three": []}
    while min(map(len, found.values())) < count:
        row = (rng.uniform(1, 8), rng.uniform(0.2, 1), rng.uniform(15, 75))
        off_m = abs(reference.integrate(*row, *TRUTH).height_m - CENTRE_M)
        found["three" if off_m <= THREE_M else "two" if off_m <= TWO_M else "miss"].append(row)
    rows = [(row, outcome) for outcome, all_rows in found.items() for row in all_rows[:count]]
    return _shots([row for row, _ in rows], [outcome for _, outcome in rows])


@pytest.fixture(scope="module")
def recorded() -> Shots:
    return _recorded(21, 6)


def test_the_map_is_that_of_brute_force(recorded):
    """Every pair of a coarse grid by DOP853: shares, mean deviation, ties and choice."""
    fit = fit_grid(GUPPY, recorded, 1.0)
    axis = np.arange(6.0)
    outcome = np.array(recorded.text("outcome"))
    rows = [recorded.number(name) for name in ("distance_m", "motor_ratio", "hood_deg")]
    off_m = np.array([[[abs(reference.integrate(*row, cd, cl).height_m - CENTRE_M) for row in zip(*rows, strict=True)]
                       for cl in axis] for cd in axis])
    off_m[np.isnan(off_m)] = np.inf
    three, scoring = outcome == "three", outcome != "miss"
    np.testing.assert_array_equal(fit.axis, axis)
    np.testing.assert_allclose(fit.share_three, (off_m[..., three] <= THREE_M).mean(-1))
    np.testing.assert_allclose(fit.share_two, (off_m[..., scoring] <= TWO_M).mean(-1))
    every_cd, every_cl = np.meshgrid(axis, axis, indexing="ij")
    mean_m = map_deviation(GUPPY, recorded, every_cd, every_cl)
    np.testing.assert_allclose(mean_m, off_m[..., three].mean(-1), atol=1e-4)
    key = fit.share_three + 1e-3 * fit.share_two
    np.testing.assert_array_equal(fit.tied, key == key.max())
    at = np.searchsorted(axis, fit.ties[:, 0]), np.searchsorted(axis, fit.ties[:, 1])
    assert len(fit.ties) == fit.tied.sum() == fit.tied[at].sum()
    np.testing.assert_allclose(fit.ties[:, 2], off_m[..., three].mean(-1)[at], atol=1e-4)
    np.testing.assert_allclose(fit.ties[:, 3], np.median(off_m[..., three], axis=-1)[at], atol=1e-4)


def test_finds_the_truth_on_a_finer_grid(recorded):
    """At the truth's own grid point every three is hit, and no pair may do better."""
    said = []
    fit = fit_grid(GUPPY, recorded, 0.05, lambda done, note: said.append(done))
    at = tuple(int(np.argmin(np.abs(fit.axis - part))) for part in TRUTH)
    assert fit.tied[at]
    assert fit.share_three[at] == fit.share_two[at] == 1.0
    assert abs(fit.cd - TRUTH[0]) <= 0.15
    assert abs(fit.cl - TRUTH[1]) <= 0.05
    assert fit.mean_m == fit.ties[:, 2].min()
    assert list(fit.ties[:, 2]) == sorted(fit.ties[:, 2])
    assert list(TRUTH) in np.round(fit.ties[:, :2], 9).tolist()
    assert fit.median_pair in [tuple(pair) for pair in fit.ties[fit.ties[:, 3] == fit.ties[:, 3].min(), :2]]
    assert said[-1] == 1.0
    scored = score(GUPPY, fit.coefficients, recorded)
    assert (scored.three, scored.two) == (1.0, 1.0)
    assert scored.mean_m == pytest.approx(fit.mean_m, abs=1e-4)
    assert scored.median_m == pytest.approx(fit.median_m, abs=1e-4)


def test_score_counts_as_table_1_does():
    """Three-point accuracy among threes, two-point accuracy among twos and threes; misses count only in `all`."""
    rows, outcomes = [], []
    for recorded_outcome, kind in (("three", "three"), ("three", "two"), ("two", "two"), ("two", "miss"),
                                   ("miss", "three"), ("", "three")):
        one = _recorded(22, 1)
        rows.append([one.number(name)[one.text("outcome").index(kind)]
                     for name in ("distance_m", "motor_ratio", "hood_deg")])
        outcomes.append(recorded_outcome)
    scored = score(GUPPY, {"drag": {"cd": TRUTH[0]}, "magnus": {"cl": TRUTH[1]}}, _shots(rows, outcomes))
    assert scored.three == pytest.approx(1 / 2)
    assert scored.two == pytest.approx(3 / 4)
    assert scored.all == pytest.approx(2 / 5)
    assert scored.shots == 5


@pytest.mark.parametrize("step", [0.0, -1.0, 0.3, 7.0])
def test_a_step_that_does_not_fit_is_refused(step):
    with pytest.raises(InputError, match="--step"):
        make_axis(step)


def test_shots_that_no_pair_explains_are_refused_in_words():
    """Eight metres with the slowest wheels."""
    with pytest.raises(InputError, match="no pair of coefficients"):
        fit_grid(GUPPY, _shots([(8.0, 0.05, 50.0)], ["three"]), 0.5)


TARGET = (2.44, 0.07, 0.35)


def _launches(seed, count):
    rng = np.random.default_rng(seed)
    return rng.uniform(1, 16, count), rng.uniform(0.05, 1, count), rng.uniform(15, 75, count)


def _flyer(seed, count):
    distance_m, ratio, hood_deg = _launches(seed, count)
    return make_flyer(GUPPY, exit_seed(GUPPY, ratio, hood_deg), distance_m)


@pytest.mark.parametrize("most", [5.0, 0.5], ids=["whole grid", "where balls are"])
def test_flights_are_those_of_dop853(most):
    count = 60
    distance_m, ratio, hood_deg = _launches(31, count)
    rng = np.random.default_rng(32)
    cd, cl = rng.uniform(0, most, count), rng.uniform(0, most / 2, count)
    height_m = np.diagonal(fly_pairs(_flyer(31, count), cd, cl))
    wanted = [reference.integrate(*row) for row in zip(distance_m, ratio, hood_deg, cd, cl, strict=True)]
    wanted_m = np.array([row.height_m for row in wanted])
    np.testing.assert_array_equal(np.isnan(height_m), np.isnan(wanted_m))
    np.testing.assert_allclose(height_m, wanted_m, atol=1e-5)
    if most < 1.0:
        assert np.isfinite(wanted_m).sum() > 15


def _dense(flyer, axis):
    cl, cd = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    off_m = np.abs(fly_pairs(flyer, cd, cl) - TARGET[0]).T.reshape(-1, axis.size, axis.size)
    return (off_m <= TARGET[2]).astype(int) + (off_m <= TARGET[1])


@pytest.mark.parametrize(("points", "seed"), [(251, 33), (64, 34), (9, 35), (8, 36), (2, 37)])
def test_labels_are_those_of_flying_every_point(points, seed):
    """At least 99.999 % of them; on a grid that few flights can stand in for, or hardly any."""
    flyer, axis = _flyer(seed, 12), np.linspace(0, 5, points)
    labels = label_launches(flyer, axis, TARGET, range(12))
    dense = _dense(flyer, axis)
    assert (labels != dense).sum() <= 1e-5 * dense.size
    if points > 200:
        assert (dense > 0).sum() > 500


def test_hits_do_not_depend_on_how_many_threads_find_them(monkeypatch):
    flyer, axis = _flyer(38, 9), np.linspace(0, 5, 201)
    said = []
    found = [find_hits(flyer, axis, TARGET, lambda done, note: said.append(done))]
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2})
    found.append(find_hits(flyer, axis, TARGET, lambda done, note: None))
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    found.append(find_hits(flyer, axis, TARGET, lambda done, note: None))
    for other in found[1:]:
        for name in ("launch", "pair", "label"):
            np.testing.assert_array_equal(getattr(found[0], name), getattr(other, name))
    assert said[-1] == 1.0
