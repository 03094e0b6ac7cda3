"""What residuals may depend on, and the free correction on evidence whose answer is known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.discover.made import column, gaussian
from tests.sim.discover.worlds import FACTS
from truearc.sim.data.dataset import Dataset, Shots, Traces
from truearc.sim.discover.detect import covariates as cov
from truearc.sim.discover.detect.battery import Test
from truearc.sim.discover.detect.localization import (
    Correction,
    amplitude_of,
    contrast_of,
    correct,
    size_weights,
)
from truearc.sim.infer.likelihood.score_table import ScoreTable

N, MANY = 40, 300


def dataset(numbers: dict[str, np.ndarray], texts: dict[str, tuple[str, ...]] | None = None,
            traces: Traces | None = None) -> Dataset:
    return Dataset("d", FACTS, Shots(tuple(map(str, range(N))), numbers, texts or {}), None, traces)


def named(found: tuple[cov.Covariate, ...], name: str) -> cov.Covariate:
    return next(covariate for covariate in found if name in covariate.names)


def test_launch_state_follows_the_paper_and_is_one_with_the_motor_ratio() -> None:
    ratio = np.linspace(0.3, 0.9, N)
    found = named(cov.gather_covariates(dataset({"motor_ratio": ratio})), "motor_ratio")
    assert found.names[0] == "motor_ratio"                 # speed and spin both go with it: neither is the one
    assert {"exit_speed_m_s", "exit_spin_rev_s"} <= set(found.names)
    speed = dict(found.columns)["exit_speed_m_s"]
    assert np.allclose(speed, ratio * 594.0 * (0.0508 + 0.5625 * 0.0349) / 2.0, atol=1e-8)


def test_traces_give_their_value_at_feeding_and_their_dip() -> None:
    shot = np.repeat(np.arange(N), 4)
    depth = np.repeat(np.arange(N) / 10.0, 4)
    value = 12.0 + np.repeat(np.sin(np.arange(N)), 4) - depth * np.tile([0.0, 0.0, 1.0, 0.5], N)
    traces = Traces(shot, np.tile([-0.1, 0.0, 0.1, 0.2], N), ("battery_v",) * len(shot), value)
    found = cov.gather_covariates(dataset({}, traces=traces))
    assert np.allclose(dict(named(found, "dip_battery_v").columns)["dip_battery_v"], np.arange(N) / 10.0)
    assert np.allclose(named(found, "fed_battery_v").values, 12.0 + np.sin(np.arange(N)))


def test_what_terms_follow_is_there_to_be_asked_about() -> None:
    balls = tuple(f"b{k % 4}" for k in range(N))
    hood_deg = 45.0 + np.tile([0.0, 2.0, 1.0, 3.0], N // 4)
    dip = 0.01 * (1.0 + np.arange(N) % 7)
    values = np.stack([np.full(N, 200.0), 200.0 * (1.0 - dip)], axis=1).ravel()
    traces = Traces(np.repeat(np.arange(N), 2), np.tile([0.0, 0.1], N), ("wheel_lower_rad_s",) * (2 * N), values)
    found = cov.gather_covariates(dataset({"hood_deg": hood_deg, "t_s": np.arange(N)**2.0}, {"ball_id": balls}, traces))
    assert np.allclose(named(found, "wheel_dip").values, dip / dip.mean())
    assert np.allclose(dict(named(found, "shots_of_ball").columns)["shots_of_ball"], (np.arange(N) // 4) / 9.0)
    assert named(found, "hood_change").values[1:].tolist() == [1.0, -1.0, 1.0, -1.0] * 9 + [1.0, -1.0, 1.0]
    assert cov.followed_column("age", found) == "shots_of_ball" and cov.followed_column("droop", found) == "wheel_dip"
    without = cov.gather_covariates(dataset({"t_s": np.arange(N) * 1.0}))
    assert cov.followed_column("age", without) == "t_s"
    assert cov.followed_column("droop", without) is None and cov.followed_column("speed_in_flight_m_s", found) is None


def test_results_and_constants_are_no_covariates() -> None:
    found = cov.gather_covariates(dataset({"miss_height_m": np.arange(N) * 1.0, "phi": np.full(N, 0.5)}))
    assert found == ()
    factors = cov.gather_factors(dataset({}, {"outcome": ("two", "miss") * 20, "rig": ("a", "b") * 20}).shots)
    assert [factor.name for factor in factors] == ["rig"]


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 9999), holes=st.integers(0, 10), levels=st.integers(2, 40))
def test_shapes_are_centred_over_the_known_and_zero_elsewhere(seed: int, holes: int, levels: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.integers(0, levels, N).astype(float)
    values[rng.permutation(N)[:holes]] = np.nan
    look = cov.Look(N, lambda what: values)
    shapes = cov.number_shapes(cov.Covariate((("x", values),)), look)
    weights, names = (cov.weights_of(shapes, look) if shapes else np.zeros((N, 0))), [shape.name for shape in shapes]
    known = np.isfinite(values)
    assert weights.shape == (N, len(names))
    assert (weights[~known] == 0.0).all()
    assert np.allclose(weights.sum(0), 0.0, atol=1e-9)
    for k, name in enumerate(names):
        if name.startswith("step"):
            assert min((weights[known, k] > 0.0).sum(), (weights[known, k] < 0.0).sum()) >= cov.FEWEST


def test_a_covariate_that_a_session_fixes_is_said_to_go_with_it() -> None:
    session = ("a",) * 20 + ("b",) * 20
    factors = cov.gather_factors(dataset({}, {"session": session}).shots)
    assert cov.carried_by(cov.Covariate((("spin", np.repeat([0.0, 50.0], 20)),)), factors) == ("session",)
    assert cov.carried_by(cov.Covariate((("t", np.arange(40.0)),)), factors) == ()


def test_shapes_have_the_units_of_the_session_that_is_asked_wherever_they_are_laid() -> None:
    """Nothing is centred or scaled again over another session, and what is unknown there weighs nothing."""
    rng = np.random.default_rng(4)
    x, y = rng.normal(5.0, 2.0, N), rng.normal(size=N)
    columns = {"x": x, "y": y}
    rig = cov.Factor("rig", ("a", "b"), np.arange(N) % 2)
    one, other = cov.Covariate((("x", x),)), cov.Covariate((("y", y),))
    own = cov.Look(N, lambda what: rig.codes if isinstance(what, cov.Factor) else columns[what.name])
    there = np.array([7.0, np.nan, 3.0])
    away = cov.Look(3, lambda what: np.array([1, -1, 0]) if isinstance(what, cov.Factor) else
                there if what.name == "x" else np.array([0.5, 0.5, np.nan]))
    shapes = cov.number_shapes(one, own) + cov.group_shapes(rig, own) + cov.pair_shapes([one, other], own)
    found = dict(zip([shape.name for shape in shapes], cov.weights_of(shapes, away).T, strict=True))
    scaled = (there - x.mean()) / x.std()
    assert np.allclose(found["straight"], np.nan_to_num(scaled))
    assert np.allclose(found["b"], [0.5, 0.0, -0.5])
    place = np.nan_to_num(np.clip([scaled, [(0.5 - y.mean()) / y.std()] * 2 + [np.nan]], -2.5, 2.5))
    middle = np.prod(np.clip([(x - x.mean()) / x.std(), (y - y.mean()) / y.std()], -2.5, 2.5), axis=0).mean()
    assert np.allclose(found["product"], place[0] * place[1] - middle)
    assert all((found[name][1] == 0.0) for name in found if name.startswith(("step", "bent", "straight")))


def evidence_of(effect: np.ndarray, noise: np.ndarray) -> ScoreTable:
    """One unit of information a shot and no shared parameters: the score is what was seen."""
    return gaussian(effect + noise, np.ones((len(effect), 1)), (column("push"),))


def asked(what: cov.Covariate | cov.Factor | None) -> Test:
    return Test("free", 0, what, "straight", np.ones(MANY))


def test_the_same_in_every_shot_is_the_mean_and_gains_half_its_square() -> None:
    noise = np.random.default_rng(0).normal(size=MANY)
    found = correct(evidence_of(np.full(MANY, 0.8), noise), asked(None))
    assert found.amplitude == pytest.approx(np.full(MANY, 0.8 + noise.mean()), rel=1e-4)
    # held out: half the square of the truth, less about 1 / (2 n) for not knowing it
    assert found.gain.mean() == pytest.approx(0.5 * 0.8**2, abs=0.1)
    assert np.allclose(found.log_after - found.log_before, found.gain)


def test_a_step_is_a_step_and_no_bend() -> None:
    rng = np.random.default_rng(2)
    x = np.arange(MANY) / MANY
    after = (x > 0.4) * 1.0
    evidence = evidence_of(0.6 * after, rng.normal(size=MANY))
    bent, found = (correct(evidence, Test("free", 0, cov.Covariate((("x", x),)), shape, after - after.mean()))
                   for shape in ("straight", f"{cov.STEP}0.4"))
    jump = found.amplitude[121] - found.amplitude[119]
    assert jump == pytest.approx(0.6, abs=3.0 * np.sqrt(1.0 / 120 + 1.0 / 180))
    assert abs(bent.amplitude[121] - bent.amplitude[119]) < 0.05
    assert found.gain.sum() > bent.gain.sum()


def test_pure_noise_is_not_followed_far() -> None:
    gains = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise, x = rng.normal(size=(2, MANY))
        found = correct(evidence_of(np.zeros(MANY), noise), asked(cov.Covariate((("x", x),))))
        gains.append(found.gain.mean())
    assert np.mean(gains) < 0.0                            # on unseen shots a correction of nothing costs
    assert np.mean(gains) > -3.0 / MANY                       # ... about as much as its two firm coefficients


def test_groups_take_their_means() -> None:
    rng = np.random.default_rng(3)
    codes = np.arange(MANY) % 3
    y = np.array([0.0, 1.0, -1.0])[codes] + rng.normal(size=MANY)
    what = cov.Factor("rig", ("a", "b", "c"), codes)
    found = correct(evidence_of(y, np.zeros(MANY)), asked(what))
    means = np.array([y[codes == k].mean() for k in range(3)])
    assert np.allclose(found.amplitude, means[codes], atol=1e-3)
    assert amplitude_of(found) == pytest.approx(np.ptp(means), abs=1e-3)


def test_the_size_of_what_has_no_name_has_an_interval_that_holds_it() -> None:
    """The mean's is known in closed form; a slope's and a step's hold the truth as often as they promise."""
    noise = np.random.default_rng(5).normal(size=MANY)
    found = correct(evidence_of(np.full(MANY, 0.8), noise), asked(None))
    size, sd = contrast_of(found, size_weights(found))
    assert size == pytest.approx(0.8 + noise.mean(), rel=1e-4) and sd == pytest.approx(MANY**-0.5, rel=1e-4)
    held = {"straight": 0, cov.STEP: 0}
    for seed in range(100):
        rng = np.random.default_rng(seed)
        x = rng.permutation(np.arange(MANY) / (MANY - 1.0))
        after = (x > 0.4) * 1.0
        for shape, effect, truth in (("straight", 2.0 * x, 1.8), (f"{cov.STEP}0.4", after, 1.0)):
            asks = Test("free", 0, cov.Covariate((("x", x),)), shape, after - after.mean())
            size, sd = _size(correct(evidence_of(effect, rng.normal(size=MANY)), asks))
            held["straight" if shape == "straight" else cov.STEP] += abs(size - truth) < 1.645 * sd
    assert all(82 <= count <= 96 for count in held.values()), held


def _size(found: Correction) -> tuple[float, float]:
    size, sd = contrast_of(found, size_weights(found))
    assert size == pytest.approx(amplitude_of(found), rel=1e-6)
    return size, sd
