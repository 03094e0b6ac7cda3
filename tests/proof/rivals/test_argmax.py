"""The best in-sample fit, on linear-Gaussian evidence whose likelihoods are known in closed form."""

import numpy as np
import pytest

from tests.sim.discover.made import at_least_squares, column, gaussian
from tests.sim.discover.straight import ASKED, NAMES, lay_straight, take_straight
from truearc.sim.discover.select.terms import Refit
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.layout import LinearizationPoint
from truearc.sim.infer.likelihood.noise import SCATTERS
from truearc_proof.rivals import argmax
from truearc_proof.rivals.claim import RivalBelief

N = 200


def believed(signal: float, seed: int = 0) -> RivalBelief:
    """Two terms at right angles and a shared constant; `signal` of the second is true. Refits are least squares."""
    rng = np.random.default_rng(seed)
    slopes = np.linalg.qr(np.column_stack([np.ones(N), rng.normal(size=(N, 2))]))[0][:, 1:]
    y = signal * slopes[:, 1] + rng.normal(size=N)
    evidence = at_least_squares(y, slopes, np.ones((N, 1)))
    intake, layout = take_straight(np.zeros(N)), lay_straight(np.full(len(ASKED), 0.3))
    spot = LinearizationPoint.still(layout, N, np.zeros(len(NAMES)), np.zeros(len(SCATTERS)))
    refits = {}
    for k in range(2):
        amplitude = slopes[:, k] @ y
        made = gaussian(y - y.mean() - amplitude * slopes[:, k], np.column_stack([slopes[:, k], np.ones(N)]),
                        (column("t", "shared"), column("s0", "shared")))
        name = f"t{k}.amplitude"
        here = np.array([amplitude])
        refits[name] = Refit((name,), layout, spot, made, here, here, here, np.ones(1), 0.0)
    return RivalBelief(BaselineFit(intake, layout, spot, evidence), refits)


def test_the_true_term_of_two_at_right_angles_fits_best() -> None:
    claim = argmax.answer(None, believed(8.0))
    assert claim.says_something and claim.names == ("t1", "t0") and claim.after_m is None
    scores = [float(one.evidence.log_score.sum()) for one in believed(8.0).refits.values()]
    null = float(believed(8.0).fitted.evidence.log_score.sum())
    assert claim.figures["gain"] == pytest.approx(max(scores) - null)


def test_it_says_something_of_nothing_too() -> None:
    assert argmax.answer(None, believed(0.0)).says_something
