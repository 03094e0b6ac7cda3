"""Who enters, and what becomes of truearc's own finding."""

import pytest

from benchmarks.compare import claim_of
from truearc.errors import InputError
from truearc_proof.rivals import registry as entrants

FINDING = {"mismatch": {"found": True, "p_value": 0.001}, "verdict": "set",
           "what": [{"term": "wind_x", "probability": 0.2}, {"term": "spin_decay", "probability": 0.7}],
           "fit": {"height_rmse_before_m": 0.05, "height_rmse_after_m": 0.04}}


def test_a_finding_is_a_claim() -> None:
    claim = claim_of(FINDING)
    assert (claim.says_something, claim.names) == (True, ("spin_decay", "wind_x"))
    assert (claim.before_m, claim.after_m) == (0.05, 0.04)


def test_an_unknown_effect_has_no_names_and_no_better_forecast() -> None:
    claim = claim_of({**FINDING, "verdict": "unknown", "fit": {"height_rmse_before_m": 0.05,
                                                               "height_rmse_after_m": None}})
    assert claim.says_something and claim.names == () and claim.after_m == 0.05


def test_who_cannot_enter_is_told_why() -> None:
    with pytest.raises(InputError, match="no rival 'nobody'"):
        entrants.check_rivals(["argmax", "nobody"])
    with pytest.raises(InputError, match="needs pysindy"):
        entrants.check_rivals(["pysindy-weak"], lambda name: None)
    assert entrants.check_rivals(["argmax", "argmax"]) == ("argmax",)
