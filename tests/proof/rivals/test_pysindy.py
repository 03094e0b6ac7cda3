"""Sparse regressions by PySINDy on tracks of known laws."""

import numpy as np
import pytest

from truearc_proof.rivals import sindy
from truearc_proof.rivals.claim import COLUMNS, Flights, Moments, accelerations, end_errors, gravity
from truearc_proof.rivals.sindy import Rows, Tuning, claim_by, fit
from truearc_proof.truth.world import make_world

FACTS = make_world().facts
FRAMES, STEP_S = 40, 1.0 / 60.0
KNOWN = ("drag", "magnus")


def constant(push: float, shots: int = 30, noise_m: float = 0.0, seed: int = 0) -> Flights:
    """Balls in vacuum with `push` usual buoyancies."""
    rng = np.random.default_rng(seed)
    time_s = np.tile(STEP_S * np.arange(FRAMES), (shots, 1))
    pull = gravity(FACTS) + push * column("buoyancy")
    start = np.stack([rng.uniform(4.0, 9.0, shots), rng.normal(0.0, 0.1, shots), rng.uniform(2.0, 7.0, shots)], axis=1)
    position = start[:, None] * time_s[..., None] + 0.5 * pull * time_s[..., None]**2
    position += noise_m * rng.normal(size=position.shape)
    return Flights(FACTS, time_s, position, np.ones(time_s.shape, dtype=bool), rng.uniform(2.0, 8.0, shots),
                   rng.uniform(0.0, 1.0, shots), rng.normal(0.0, 0.02, shots), *sizes(np.ones(shots)))


def column(name: str) -> np.ndarray:
    """[3] for a ball that flies straight ahead."""
    one = np.ones(())
    return accelerations(FACTS, (name,), Moments(np.array([8.0, 0.0, 0.0]), one, one, one, one, *sizes(one)))[..., 0]


def sizes(one: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(radius_m, mass_kg) of the rig's ball."""
    return FACTS.ball.radius_m * one, FACTS.ball.mass_kg * one


CANDIDATES = tuple(name for name in COLUMNS if name not in KNOWN)


def rows_by(form: str, flights) -> Rows:
    pytest.importorskip("pysindy", reason="pysindy comes with the extra `field`")
    if form == "strong":
        return sindy.ensemble_rows(flights, KNOWN)
    return sindy.weak_rows(flights, KNOWN, 0)


@pytest.mark.parametrize("form", ["strong", "weak"])
def test_a_constant_push_is_recovered_exactly_and_alone(form: str) -> None:
    flights = constant(1.0)
    rows = rows_by(form, flights)
    model = fit(rows, Tuning(0.3, 0.0))
    wanted = np.array([1.0 if name == "buoyancy" else 0.0 for name in CANDIDATES])
    np.testing.assert_allclose(model.candidates, wanted, atol=1e-6)
    np.testing.assert_allclose(model.believed, 0.0, atol=1e-6)


@pytest.mark.parametrize("form", ["strong", "weak"])
def test_a_claim_names_the_push(form: str) -> None:
    flights = constant(2.0, noise_m=0.001)
    claim = claim_by(rows_by(form, flights), KNOWN, 0)
    assert claim.says_something and claim.names[:2] == ("buoyancy", "added_mass")


@pytest.mark.parametrize("form", ["strong", "weak"])
def test_where_there_is_nothing_nothing_is_said(form: str) -> None:
    flights = constant(0.0)
    claim = claim_by(rows_by(form, flights), KNOWN, 0)
    assert not claim.says_something and claim.names == ()


def test_a_law_that_is_the_true_one_foretells_without_error() -> None:
    flights = constant(1.5)
    weights = np.zeros((len(flights), len(COLUMNS)))
    weights[:, COLUMNS.index("buoyancy")] = 1.5
    np.testing.assert_allclose(end_errors(flights, COLUMNS, weights), 0.0, atol=1e-9)
