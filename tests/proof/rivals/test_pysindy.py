"""Sparse regressions on flights whose law is known in closed form; they need the extra `field`."""

import numpy as np
import pytest

from tests.proof.rivals.made import KNOWN, constant
from truearc_proof.rivals import sindy
from truearc_proof.rivals.claim import COLUMNS, end_errors
from truearc_proof.rivals.sindy import Rows, Tuning, claim_by, compress, fit, known_of, rank

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
def test_a_claim_names_the_push_and_foretells_by_it(form: str) -> None:
    flights = constant(2.0, noise_m=0.001)
    claim = claim_by(flights, rows_by(form, flights), KNOWN, 0)
    assert claim.says_something and claim.names[:2] == ("buoyancy", "added_mass")
    assert claim.before_m is not None and claim.after_m is not None and claim.after_m < 0.8 * claim.before_m


@pytest.mark.parametrize("form", ["strong", "weak"])
def test_where_there_is_nothing_nothing_is_said(form: str) -> None:
    flights = constant(0.0)
    claim = claim_by(flights, rows_by(form, flights), KNOWN, 0)
    assert not claim.says_something and claim.names == () and claim.after_m == claim.before_m


@pytest.mark.parametrize("form", ["strong", "weak"])
def test_the_same_seed_says_the_same(form: str) -> None:
    flights = constant(0.5, shots=10, noise_m=0.005)
    before = np.random.get_state()[1].copy()
    once, again = (sindy.ensemble(rows_by(form, flights), Tuning(0.1, 0.05), 3, 5) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    np.testing.assert_array_equal(before, np.random.get_state()[1])


def test_the_weak_form_is_pysindys_own_transform() -> None:
    pytest.importorskip("pysindy", reason="pysindy comes with the extra `field`")
    time_s = np.arange(30) / 60.0
    columns = np.random.default_rng(0).normal(size=(30, 4))
    library = sindy._domains(time_s, 5)
    np.testing.assert_allclose(sindy.integrate(library, columns), library.fit_transform([sindy._axes(columns)])[0])
    # by parts: a straight line's derivative against the test function is its slope times the test function's integral
    line = np.stack([3.0 * time_s, np.ones(30)], axis=1)
    np.testing.assert_allclose(sindy.change(library, line)[:, 0], 3.0 * sindy.integrate(library, line)[:, 1], rtol=1e-9)
    np.testing.assert_allclose(sindy.change(library, line)[:, 1], 0.0, atol=1e-12)


def test_few_rows_have_the_same_least_squares() -> None:
    rng = np.random.default_rng(1)
    rows = Rows(rng.normal(size=200), rng.normal(size=(200, 2)), rng.normal(size=(200, 5)), np.zeros(200, dtype=int))
    small = compress(rows)
    full = [np.linalg.lstsq(np.column_stack([one.believed, one.candidates]), one.target, rcond=None)[0]
            for one in (rows, small)]
    assert len(small.target) == 8
    np.testing.assert_allclose(full[0], full[1], atol=1e-12)


def test_names_are_ranked_by_inclusion_then_size() -> None:
    assert rank(np.array([0.5, 1.0, 1.0, 0.0]), np.array([9.0, 0.1, -2.0, 5.0]), ("a", "b", "c", "d")) == (
        "c", "b", "a")


def test_a_law_that_is_the_true_one_foretells_without_error() -> None:
    flights = constant(1.5)
    weights = np.zeros((len(flights), len(COLUMNS)))
    weights[:, COLUMNS.index("buoyancy")] = 1.5
    np.testing.assert_allclose(end_errors(flights, COLUMNS, weights), 0.0, atol=1e-9)
    # without it the end is off by what the push does beyond what the first samples take for speed
    assert np.abs(end_errors(flights, COLUMNS, np.zeros_like(weights))).min() > 0.02


def test_what_is_believed_is_kept() -> None:
    assert known_of(("gravity", "drag", "exit_efficiency")) == ("drag",)
