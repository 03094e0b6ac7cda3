"""What residuals may depend on: derived columns, names that cannot be told apart, shapes."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.discover.worlds import FACTS
from truearc.sim.data.dataset import Dataset, Shots, Traces
from truearc.sim.discover.detect.covariates import (
    FEWEST,
    Covariate,
    Factor,
    Look,
    carried_by,
    followed_column,
    gather_covariates,
    gather_factors,
    group_shapes,
    number_shapes,
    pair_shapes,
    weights_of,
)

N = 40


def dataset(numbers: dict[str, np.ndarray], texts: dict[str, tuple[str, ...]] | None = None,
            traces: Traces | None = None) -> Dataset:
    return Dataset("d", FACTS, Shots(tuple(map(str, range(N))), numbers, texts or {}), None, traces)


def named(found: tuple[Covariate, ...], name: str) -> Covariate:
    return next(covariate for covariate in found if name in covariate.names)


def test_launch_state_follows_the_paper_and_is_one_with_the_motor_ratio() -> None:
    ratio = np.linspace(0.3, 0.9, N)
    found = named(gather_covariates(dataset({"motor_ratio": ratio})), "motor_ratio")
    assert found.names[0] == "motor_ratio"                 # speed and spin both go with it: neither is the one
    assert {"exit_speed_m_s", "exit_spin_rev_s"} <= set(found.names)
    speed = dict(found.columns)["exit_speed_m_s"]
    assert np.allclose(speed, ratio * 594.0 * (0.0508 + 0.5625 * 0.0349) / 2.0, atol=1e-8)


def test_order_and_waiting_time_are_counted_within_a_session() -> None:
    t_s = np.concatenate([np.cumsum(np.arange(1.0, 21.0)), np.cumsum(np.arange(20.0, 0.0, -1.0))])
    found = gather_covariates(dataset({"t_s": t_s}, {"session": ("a",) * 20 + ("b",) * 20}))
    wait = named(found, "since_last_shot_s").values
    assert np.isnan(wait[[0, 20]]).all()
    assert wait[1] == 2.0
    assert named(found, "order_in_session").values[[0, 19, 20]].tolist() == [0.0, 19.0, 0.0]


def test_traces_give_their_value_at_feeding_and_their_dip() -> None:
    shot = np.repeat(np.arange(N), 4)
    depth = np.repeat(np.arange(N) / 10.0, 4)
    value = 12.0 + np.repeat(np.sin(np.arange(N)), 4) - depth * np.tile([0.0, 0.0, 1.0, 0.5], N)
    traces = Traces(shot, np.tile([-0.1, 0.0, 0.1, 0.2], N), ("battery_v",) * len(shot), value)
    found = gather_covariates(dataset({}, traces=traces))
    assert np.allclose(dict(named(found, "dip_battery_v").columns)["dip_battery_v"], np.arange(N) / 10.0)
    assert np.allclose(named(found, "fed_battery_v").values, 12.0 + np.sin(np.arange(N)))


def test_what_terms_follow_is_there_to_be_asked_about() -> None:
    balls = tuple(f"b{k % 4}" for k in range(N))
    hood_deg = 45.0 + np.tile([0.0, 2.0, 1.0, 3.0], N // 4)
    dip = 0.01 * (1.0 + np.arange(N) % 7)
    values = np.stack([np.full(N, 200.0), 200.0 * (1.0 - dip)], axis=1).ravel()
    traces = Traces(np.repeat(np.arange(N), 2), np.tile([0.0, 0.1], N), ("wheel_lower_rad_s",) * (2 * N), values)
    found = gather_covariates(dataset({"hood_deg": hood_deg, "t_s": np.arange(N)**2.0}, {"ball_id": balls}, traces))
    assert np.allclose(named(found, "wheel_dip").values, dip / dip.mean())
    assert np.allclose(dict(named(found, "shots_of_ball").columns)["shots_of_ball"], (np.arange(N) // 4) / 9.0)
    assert named(found, "hood_change").values[1:].tolist() == [1.0, -1.0, 1.0, -1.0] * 9 + [1.0, -1.0, 1.0]
    assert followed_column("age", found) == "shots_of_ball" and followed_column("droop", found) == "wheel_dip"
    without = gather_covariates(dataset({"t_s": np.arange(N) * 1.0}))
    assert followed_column("age", without) == "t_s"
    assert followed_column("droop", without) is None and followed_column("speed_in_flight_m_s", found) is None


def test_results_and_constants_are_no_covariates() -> None:
    found = gather_covariates(dataset({"miss_height_m": np.arange(N) * 1.0, "phi": np.full(N, 0.5)}))
    assert found == ()
    factors = gather_factors(dataset({}, {"outcome": ("two", "miss") * 20, "rig": ("a", "b") * 20}).shots)
    assert [factor.name for factor in factors] == ["rig"]


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 9999), holes=st.integers(0, 10), levels=st.integers(2, 40))
def test_shapes_are_centred_over_the_known_and_zero_elsewhere(seed: int, holes: int, levels: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.integers(0, levels, N).astype(float)
    values[rng.permutation(N)[:holes]] = np.nan
    look = Look(N, lambda what: values)
    shapes = number_shapes(Covariate((("x", values),)), look)
    weights, names = (weights_of(shapes, look) if shapes else np.zeros((N, 0))), [shape.name for shape in shapes]
    known = np.isfinite(values)
    assert weights.shape == (N, len(names))
    assert (weights[~known] == 0.0).all()
    assert np.allclose(weights.sum(0), 0.0, atol=1e-9)
    for k, name in enumerate(names):
        if name.startswith("step"):
            assert min((weights[known, k] > 0.0).sum(), (weights[known, k] < 0.0).sum()) >= FEWEST


def test_a_covariate_that_a_session_fixes_is_said_to_go_with_it() -> None:
    session = ("a",) * 20 + ("b",) * 20
    factors = gather_factors(dataset({}, {"session": session}).shots)
    assert carried_by(Covariate((("spin", np.repeat([0.0, 50.0], 20)),)), factors) == ("session",)
    assert carried_by(Covariate((("t", np.arange(40.0)),)), factors) == ()


def test_shapes_have_the_units_of_the_session_that_is_asked_wherever_they_are_laid() -> None:
    """Nothing is centred or scaled again over another session, and what is unknown there weighs nothing."""
    rng = np.random.default_rng(4)
    x, y = rng.normal(5.0, 2.0, N), rng.normal(size=N)
    columns = {"x": x, "y": y}
    rig = Factor("rig", ("a", "b"), np.arange(N) % 2)
    one, other = Covariate((("x", x),)), Covariate((("y", y),))
    own = Look(N, lambda what: rig.codes if isinstance(what, Factor) else columns[what.name])
    there = np.array([7.0, np.nan, 3.0])
    away = Look(3, lambda what: np.array([1, -1, 0]) if isinstance(what, Factor) else
                there if what.name == "x" else np.array([0.5, 0.5, np.nan]))
    shapes = number_shapes(one, own) + group_shapes(rig, own) + pair_shapes([one, other], own, 1)
    found = dict(zip([shape.name for shape in shapes], weights_of(shapes, away).T, strict=True))
    scaled = (there - x.mean()) / x.std()
    assert np.allclose(found["straight"], np.nan_to_num(scaled))
    assert np.allclose(found["b"], [0.5, 0.0, -0.5])
    place = np.nan_to_num(np.clip([scaled, [(0.5 - y.mean()) / y.std()] * 2 + [np.nan]], -2.5, 2.5))
    middle = np.prod(np.clip([(x - x.mean()) / x.std(), (y - y.mean()) / y.std()], -2.5, 2.5), axis=0).mean()
    assert np.allclose(found["product"], place[0] * place[1] - middle)
    assert all((found[name][1] == 0.0) for name in found if name.startswith(("step", "bent", "straight")))
