"""Machine-code flights against DOP853; labels by interpolation against flying every point."""

import os

import numpy as np
import pytest

from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY, weightless
from truearc.sim.paper import grid_labels
from truearc.sim.paper.grid_labels import LONG, SHORT, find_hits, fly_pairs, label_launches, make_flyer
from truearc.sim.physics.term import Exit
from truearc_proof.reproduce.collect import exit_seed

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


def test_without_forces_it_is_a_line_and_without_speed_nowhere():
    """Weightless in no air: z = z0 + d tan(theta)."""
    exit = Exit(np.array([7.0, 0.0]), np.radians([30.0, 30.0]), np.array([0.0, 0.0]))
    height_m = fly_pairs(make_flyer(weightless(0.4), exit, np.array([3.0, 3.0])), np.zeros(1), np.zeros(1))[0]
    assert height_m[0] == pytest.approx(0.4 + 3.0 * np.tan(np.radians(30.0)), abs=1e-9)
    assert np.isnan(height_m[1])


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


def test_long_steps_are_near_enough_for_what_they_decide():
    """A label is DOUBTFUL within SURE_M of a bound: there long steps must be nearer than that to short ones."""
    flyer = _flyer(40, 40)
    rng = np.random.default_rng(41)
    which, cd, cl = rng.integers(40, size=64_000), rng.uniform(0, 3, 64_000), rng.uniform(0, 0.4, 64_000)
    (long_m, gap, _), (short_m, exact_gap, _) = (flyer.fly(which, cd, cl, steps) for steps in (LONG, SHORT))
    near = (gap <= 0.0) & (exact_gap <= 0.0) & (np.abs(short_m - TARGET[0]) < 0.5)
    assert near.sum() > 1000
    assert np.abs(long_m - short_m)[near].max() < grid_labels.SURE_M
