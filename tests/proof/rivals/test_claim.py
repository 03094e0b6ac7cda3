"""Who enters, what becomes of truearc's own finding, and the best in-sample fit."""

import numpy as np
import pytest

from benchmarks.compare import claim_of
from tests.sim.discover.made import at_least_squares, column, gaussian
from tests.sim.discover.straight import ASKED, NAMES, lay_straight, take_straight
from truearc.errors import InputError
from truearc.sim.infer.fit import Fit
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.layout import Point
from truearc.sim.infer.likelihood.noise import SCATTERS
from truearc_proof import rivals as entrants
from truearc_proof.rivals.claim import RivalBelief, answer_argmax

FINDING = {"mismatch": {"found": True, "p_value": 0.001}, "verdict": "set",
           "what": [{"term": "wind_x", "probability": 0.2}, {"term": "spin_decay", "probability": 0.7}],
           "fit": {"height_rmse_before_m": 0.05, "height_rmse_after_m": 0.04}}
N = 200


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


def believed(signal: float, seed: int = 0) -> RivalBelief:
    """Two terms at right angles and a shared constant; `signal` of the second is true. Refits are least squares."""
    rng = np.random.default_rng(seed)
    slopes = np.linalg.qr(np.column_stack([np.ones(N), rng.normal(size=(N, 2))]))[0][:, 1:]
    y = signal * slopes[:, 1] + rng.normal(size=N)
    evidence = at_least_squares(y, slopes, np.ones((N, 1)))
    model = Launcher(take_straight(np.zeros(N)), lay_straight(np.full(len(ASKED), 0.3)))
    point = Point.still(model.layout, N, np.zeros(len(NAMES)), np.zeros(len(SCATTERS)))
    refits = {}
    for k in range(2):
        amplitude = slopes[:, k] @ y
        made = gaussian(y - y.mean() - amplitude * slopes[:, k], np.column_stack([slopes[:, k], np.ones(N)]),
                        (column("t", "shared"), column("s0", "shared")))
        name = f"t{k}.amplitude"
        refits[name] = Fit(model, point, made, (name,), np.zeros(1), np.ones(1))
    return RivalBelief(Fit(model, point, evidence), refits)


def test_the_true_term_of_two_at_right_angles_fits_best() -> None:
    claim = answer_argmax(None, believed(8.0))
    assert claim.says_something and claim.names == ("t1", "t0") and claim.after_m is None
    scores = [float(one.scores.log_score.sum()) for one in believed(8.0).refits.values()]
    null = float(believed(8.0).fitted.scores.log_score.sum())
    assert claim.figures["gain"] == pytest.approx(max(scores) - null)


def test_it_says_something_of_nothing_too() -> None:
    assert answer_argmax(None, believed(0.0)).says_something
