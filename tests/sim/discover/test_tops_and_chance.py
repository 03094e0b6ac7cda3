"""Fits of made worlds: one top wherever a climb begins, one belief by fit and discover, alarms at their rate."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

import truearc as ta
from truearc.sim.discover.investigate import detect, discover, make_search
from truearc.sim.discover.select.terms import one_step
from truearc.sim.infer.fit import climb, fit_believed, newton_step
from truearc.sim.infer.launcher import Launcher, LauncherFit, coefficients_of, covariance_of, scatter_of
from truearc.sim.physics.catalogue import find_parameter
from truearc_proof.importers.set_points import import_254, import_971
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import World, make_world

SHOTS = 100


def fit_world(world: World, slow: float = 1.0) -> LauncherFit:
    """`slow`: by how much longer all flights seem to take."""
    dataset = shoot(world)
    if dataset.tracks is not None:
        dataset = replace(dataset, tracks=replace(dataset.tracks, t_s=slow * dataset.tracks.t_s))
    return fit_believed(Launcher.of(dataset, dataset.facts.believe.terms))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, 16])
def test_no_climb_from_the_truth_or_the_priors_middle_ends_a_nat_higher(seed: int) -> None:
    """Sixteen balls with effects of their own and 100 outcomes: a likelihood of several tops."""
    world = make_world({"battery_sag": 0.5}, "L1", SHOTS, seed)
    fitted = fit_world(world)
    bare, middle = fitted.model.shared_only(), fitted.model.middle()
    true = middle.values.copy()
    for name, value in (("drag", world.cd), ("magnus", world.lift_slope * 3.0 / 32.0),
                        ("exit_efficiency", 1.0 - world.efficiency)):
        true[next(k for k, slot in enumerate(fitted.model.layout.chain.slots) if slot[0] == name)] = value
    for values in (true, middle.values):
        for factor in (1.0, 4.0):
            start = type(middle)(values, middle.log_scatter + np.log(factor), middle.deviates, middle.effects)
            assert fitted.without_terms().log_posterior >= climb(bare, start).log_posterior - 1.0


@pytest.mark.slow
def test_where_one_number_comes_to_its_limit_the_others_still_climb_to_their_best() -> None:
    """A clock that is wrong by more than is believed of any: it stays at its limit, and no step of all else promises
    anything there."""
    fitted = fit_world(make_world({}, "L2", 24, 3), 0.9)
    evidence = fitted.scores.shared_only()
    clock = np.array([column.name == "track_clock.share" for column in evidence.columns])
    assert fitted.values["track_clock.share"] == find_parameter("track_clock.share").high
    assert newton_step(evidence)[1] > 10.0 and newton_step(evidence, ~clock)[1] < 1.0


BELIEVED = ("gravity", "exit_efficiency", "drag", "magnus")


@pytest.mark.slow
def test_scores_are_slopes_of_the_likelihood_when_all_is_flown_anew() -> None:
    model = Launcher.of(shoot(make_world({}, "L0", 60, 5)), BELIEVED)
    layout, middle = model.layout, model.middle()
    evidence, _ = model.linearise(middle)
    slots = np.flatnonzero(layout.in_slot)
    for k in slots.tolist():
        step = np.zeros(len(layout.columns))
        step[k] = 1e-4 * layout.columns[k].usual
        ahead, behind = (model.linearise(model.moved(middle, sign * step))[0] for sign in (1.0, -1.0))
        travelled = ahead.point[k] - behind.point[k]
        slope = (ahead.log_score - behind.log_score) / travelled
        name, size = layout.columns[k].name, layout.columns[k].usual
        assert evidence.own_score[:, k] * size == pytest.approx(slope * size, rel=1e-3, abs=1e-4), name


WORLDS, TRACKED = 24, range(200, 205)


def p_of(seed: int) -> float:
    world = make_world({}, "L0", 64, seed)
    return detect(fit_world(world), make_search(shoot(world), seed=seed), lambda done, note: None)[1].p_any


@pytest.mark.slow
def test_false_alarms_come_at_their_rate() -> None:
    found = np.array([p_of(seed) for seed in range(100, 100 + WORLDS)])
    for level in (0.05, 0.2, 0.5):
        low, high = binom.interval(0.999, WORLDS, level)
        assert low <= (found <= level).sum() <= high, (level, np.sort(found))


@pytest.mark.slow
def test_scores_of_tracks_lean_to_no_side_under_the_truth() -> None:
    """Slopes taken at a track's own deviations go with its noise, and what bends with them would seem to be there."""
    found = []
    for seed in TRACKED:
        fitted = fit_world(make_world({}, "L2", 32, seed))
        found.append({one.name.partition(".")[0]: one.z for one in one_step(fitted.scores)[0]})
    mean = {name: float(np.mean([one[name] for one in found])) for name in found[0]}
    bound = 3.5 / np.sqrt(len(TRACKED))
    for name in ("lift_saturation", "spin_decay", "drag_reynolds", "spin_drag", "wind_x", "wind_z", "added_mass"):
        assert abs(mean[name]) < bound, mean


TERMS = ("gravity", "drag", "magnus", "exit_efficiency")
REAL: dict[str, Callable[[Path], ta.Dataset]] = {
    "971": lambda home: import_971(home / "frc971_wheel_to_ball_speed.csv"),
    "254": lambda home: import_254(home / "frc_shot_tables.csv")}


def _check(dataset: ta.Dataset, terms: tuple[str, ...]) -> None:
    """The belief that `fit` writes is what discovery starts from, and adopts where it finds nothing."""
    by_fit = ta.fit(dataset, terms).belief
    found = discover(dataset, terms, false_alarm=0.0)         # nothing is missing surely enough to be named
    assert found.fitted is not None
    evidence, among = found.fitted.scores.shared_only(), found.catalogue
    assert coefficients_of(evidence, terms, among) == {
        name: pytest.approx(values, rel=1e-9, abs=1e-12) for name, values in by_fit.coefficients.items()}
    assert scatter_of(evidence) == pytest.approx(by_fit.scatter, rel=1e-9)
    names, covariance = covariance_of(evidence, among)
    assert names == by_fit.names
    np.testing.assert_allclose(covariance, by_fit.covariance, rtol=1e-6, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(("level", "seed"), [("L0", 3), ("L1", 4), ("L2", 5)])
def test_made_shots_have_one_belief(level: str, seed: int) -> None:
    _check(shoot(make_world({}, level, 32, seed)), TERMS)


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("name", list(REAL))
def test_real_shots_have_one_belief(data_dir: Path, name: str) -> None:
    dataset = REAL[name](data_dir / "real")
    _check(dataset, tuple(dataset.rig.believe.terms))
