"""The likelihood against other code: Monte Carlo of its flights, and the normal law."""

import numpy as np
from scipy import stats

from tests.sim.infer import independent
from tests.sim.infer.independent import Truth
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.launcher import USUAL_SCATTER
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import Point, lay_out, only_shared
from truearc.sim.infer.likelihood.linearization import linearise
from truearc.sim.infer.likelihood.noise import EXIT_SPEED_M_S, LAPSE
from truearc.sim.infer.likelihood.observations import class_chances
from truearc.sim.infer.likelihood.score_table import ScoreTable

TRUTH = Truth(speed_sd=0.02, elevation_sd_deg=0.5)


def _at_truth(shots: Shots) -> tuple[ScoreTable, np.ndarray]:
    """(evidence, most likely deviates) where the coefficients and scatters are the truth's."""
    intake = take_in(Dataset("d", GUPPY, shots), fewest=1)
    layout = only_shared(lay_out(intake, ("gravity", "drag", "magnus", "exit_efficiency")))
    values, log_scatter = layout.usual.copy(), USUAL_SCATTER.copy()
    log_scatter[:2] = np.log([TRUTH.speed_sd, np.radians(TRUTH.elevation_sd_deg)])
    for slot, value in {("drag", "cd"): TRUTH.cd, ("magnus", "cl"): TRUTH.cl,
                        ("exit_efficiency", "loss"): TRUTH.loss}.items():
        values[layout.chain.slots.index(slot)] = value
    return linearise(intake, layout, Point.still(layout, len(intake.rows), values, log_scatter))


def test_outcomes_are_those_of_many_real_shots():
    """20 000 shots at each of six configurations by other code; the model's normal heights are not theirs exactly."""
    rng = np.random.default_rng(5)
    configuration = independent.configurations(rng, TRUTH, 6)
    shots = Shots(tuple("abcdef"), dict(zip(("distance_m", "hood_deg", "motor_ratio"), configuration, strict=True)),
                  {"outcome": ("miss",) * 6})
    plane = _at_truth(shots)[0].plane
    said = class_chances(plane.seen, plane.mean_m, plane.spread_m)
    many = 20_000
    for row in range(6):
        columns = [np.full(many, column[row]) for column in configuration]
        words = np.array(independent.outcomes(independent.fired(rng, TRUTH, *columns)))
        share = np.array([(words == word).mean() for word in ("miss", "two", "three")])
        clean = (said[row] - LAPSE / 3) / (1 - LAPSE)
        np.testing.assert_allclose(clean, share, atol=0.015 + 4 * 0.5 / np.sqrt(many))
    assert said.max() - said.min() > 0.5             # the six are different enough to mean something


def test_a_measured_exit_speed_is_a_normal_reading_of_the_launch():
    ratio, seen = np.array([0.6, 0.6]), np.array([9.0, 9.1])      # two: what is constant says nothing
    shots = Shots(("a", "b"), {"motor_ratio": ratio, "hood_deg": np.full(2, 45.0), "exit_speed_m_s": seen}, {})
    evidence, deviates = _at_truth(shots)
    speed = reference.exit_of(ratio[0])[0] * (1 - TRUTH.loss)
    wheels = 0.5 * np.hypot(reference.LOWER_RADIUS_M, reference.UPPER_RADIUS_M) / 2 / reference.exit_of(ratio[0])[0]
    scatter, noise = TRUTH.speed_sd**2 + wheels**2, (EXIT_SPEED_M_S / seen)**2
    off = np.log(seen / speed)
    np.testing.assert_allclose(evidence.log_score, stats.norm.logpdf(off, 0.0, np.sqrt(scatter + noise)), rtol=1e-9)
    np.testing.assert_allclose(deviates[:, 0], off * scatter / (scatter + noise), rtol=1e-9)
