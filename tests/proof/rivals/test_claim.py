"""What entrants get and answer, tracks and laws, and the learner of the residual."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.proof.law import acceleration
from tests.proof.rivals.test_pysindy import sizes
from truearc.errors import InputError
from truearc.sim.discover.detect.covariates import Covariate
from truearc_proof.rivals import claim, find_rival, residual
from truearc_proof.rivals.claim import COLUMNS, Moments, accelerations, middle_of
from truearc_proof.truth.world import make_world


def test_who_cannot_enter_is_told_why() -> None:
    with pytest.raises(InputError, match="no rival 'nobody'"):
        find_rival("nobody")
    assert find_rival("argmax") is claim.answer_argmax


VELOCITY = np.array([[7.0, 0.4, 5.0], [5.0, -0.3, -2.0], [9.0, 0.0, 1.0]])
SPIN_REV_S = 6.0                      # in the seed's convention: twice what the ball turns by
TIME_S = np.array([0.05, 0.3, 0.6])
AGE, DENSITY = 0.4, 0.03


def columns(*names: str) -> np.ndarray:
    one = np.ones(3)
    return accelerations(make_world().facts, names, Moments(VELOCITY, SPIN_REV_S * one, TIME_S, AGE * one,
                                                            DENSITY * one, *sizes(one)))


def truth(effect: str | None, amount: float) -> np.ndarray:
    """[3, 3] by the second law, drag and lift at the middle of the catalogue's priors."""
    cl = middle_of("magnus")
    world = replace(make_world({effect: amount} if effect else {}), cd=middle_of("drag"), lift_slope=cl * 32.0 / 3.0)
    spin = np.array([0.0, -math.pi * SPIN_REV_S, 0.0])
    density = 1.2 * (1.0 + DENSITY * amount) if effect == "air_density" else 1.2
    used = AGE if effect == "drag_wear" else 0.0
    return np.stack([acceleration(t, v, spin, world, density, used) for t, v in zip(TIME_S, VELOCITY, strict=True)])


def test_drag_lift_and_gravity_are_the_whole_law() -> None:
    both = columns("drag", "magnus") @ [middle_of("drag"), middle_of("magnus")] + claim.gravity(make_world().facts)
    np.testing.assert_allclose(both, truth(None, 0.0), atol=1e-9)


@pytest.mark.parametrize("name", [name for name in COLUMNS if name not in ("drag", "magnus", "buoyancy")])
def test_a_column_is_the_slope_of_its_effect(name: str) -> None:
    small = 1e-5
    per = {"spin_drag": 4.0, "lift_saturation": 2.0}.get(name, 1.0)     # the catalogue's spin is twice as fast
    slope = (truth(name, small) - truth(name, 0.0)) / small
    np.testing.assert_allclose(columns(name)[..., 0] / claim.usual_of(name), slope * per, rtol=1e-3, atol=1e-4)


def test_added_mass_is_buoyancy_once_drag_and_lift_are_free() -> None:
    change = truth("added_mass", 1e-4) - truth(None, 0.0)
    library = columns("drag", "magnus", "buoyancy").reshape(-1, 3)
    left = change.ravel() - library @ np.linalg.lstsq(library, change.ravel(), rcond=None)[0]
    assert np.abs(left).max() < 1e-3 * np.abs(change).max()


def test_what_changes_a_force_is_a_candidate_where_the_force_is_believed() -> None:
    assert claim.candidates_of(()) == ("drag", "magnus", "buoyancy")
    assert set(claim.candidates_of(("magnus",))) == {"drag", "buoyancy", "spin_decay", "lift_saturation"}
    assert set(claim.candidates_of(("drag", "magnus"))) == set(COLUMNS) - {"drag", "magnus"}


COUNT, NOISE = 150, 0.1


def made(signal: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(covariates [N, 4], residuals [N, 3]): the third coordinate is a sine of the second covariate."""
    rng = np.random.default_rng(seed)
    table, residuals = rng.uniform(-1.7, 1.7, (COUNT, 4)), NOISE * rng.normal(size=(COUNT, 3))
    residuals[:, 2] += signal * np.sin(2.0 * table[:, 1])
    return table, residuals


def test_a_sine_of_one_covariate_is_learnt_and_leant_on() -> None:
    table, residuals = made(0.5)
    foretold = residual.cross_validate(table, residuals)
    assert residual.gain(residuals, foretold) > 0.2
    assert np.std(residuals[:, 2] - foretold[:, 2]) < 1.3 * NOISE      # of 0.36 before
    assert residual.leaning(residual.learn(table, residuals)).argmax() == 1


def test_noise_about_nothing_is_not_foretold() -> None:
    gains = [residual.gain(made(0.0, seed)[1], residual.cross_validate(*made(0.0, seed))) for seed in range(2)]
    assert max(gains) < 0.02


@pytest.mark.parametrize(("column", "terms"), [("shots_of_ball", ("drag_wear", "ball_wear")), ("distance_m", ())])
def test_only_covariates_that_terms_follow_are_named(column: str, terms: tuple[str, ...]) -> None:
    covariates = [Covariate(((name, np.zeros(3)),)) for name in ("hood_deg", column)]
    assert residual.names_of(covariates, np.array([0.1, 0.7])) == terms


def test_unknown_covariates_stand_at_their_mean() -> None:
    table = residual.table_of([Covariate((("a", np.array([1.0, np.nan, 3.0])),)), Covariate((("b", np.ones(3)),))],
                              np.arange(3))
    np.testing.assert_allclose(table, [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
