"""Simulated shots against a DOP853 flight written from the paper alone, and the sample's own promises."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import point_belief
from truearc.sim.paper import synthetic

RIG = Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, (Wheel("lower", 0.0508, 1.0, 180.0),
                                                            Wheel("upper", 0.0349, 0.5625, 0.0))), Target(2.44))
CD, CL = 0.91, 0.06                               # the paper's own estimate
BELIEF = {"drag": {"cd": CD}, "magnus": {"cl": CL}}
CONFIGURATIONS = 468_236


@pytest.fixture(scope="module")
def outcomes() -> np.ndarray:
    return synthetic.label_grid(RIG, BELIEF)


def paper_height_m(distance_m: float, motor_ratio: float, hood_deg: float) -> float:
    """Eq. 1-12 in the plane; nan if the ball meets the floor or turns back before the target."""
    mass, radius, rho = 0.14, 0.0889, 1.2
    lower, upper = motor_ratio * 594.0 * 0.0508, motor_ratio * 594.0 * 9 / 16 * 0.0349
    speed, spin = (lower + upper) / 2, (lower - upper) / (2 * math.pi * radius)
    drag = 0.5 * CD * math.pi * radius**2 * rho / mass
    lift = CL * 4 / 3 * 4 * math.pi**2 * radius**3 * spin * rho / mass

    def rates(_: float, state: np.ndarray) -> list[float]:
        _, _, vx, vy = state
        v = math.hypot(vx, vy)
        return [vx, vy, -lift * vy - drag * v * vx, lift * vx - drag * v * vy - 9.81]

    ends = [lambda t, s: s[0] - distance_m, lambda t, s: s[1], lambda t, s: s[2]]
    for end in ends:
        end.terminal = True                       # type: ignore[attr-defined]
    theta = math.radians(hood_deg)
    start = [0.0, 0.75, speed * math.cos(theta), speed * math.sin(theta)]
    if start[2] <= 0.0:
        return math.nan
    flight = solve_ivp(rates, (0.0, 60.0), start, "DOP853", rtol=1e-11, atol=1e-12, events=ends, max_step=0.05)
    return float(flight.y_events[0][0][1]) if len(flight.t_events[0]) else math.nan


def paper_outcome(height_m: float) -> str:
    deviation = abs(height_m - 2.44)
    return "three" if deviation <= 0.07 else "two" if deviation <= 0.35 else "miss"


def test_the_grid_is_the_one_that_the_seed_states() -> None:
    shots = synthetic.grid_shots(np.arange(CONFIGURATIONS))
    assert math.prod(synthetic.SHAPE) == CONFIGURATIONS == len(shots)
    for name, low, high, step, count in (("motor_ratio", 0.0, 1.0, 0.01, 101), ("hood_deg", 15.0, 75.0, 1.0, 61),
                                         ("distance_m", 1.0, 16.0, 0.2, 76)):
        values = np.unique(shots.number(name))
        assert len(values) == count and values[0] == low and values[-1] == high
        np.testing.assert_allclose(np.diff(values), step, rtol=1e-12)
        assert [repr(float(value)) for value in values] == [repr(round(float(value), 2)) for value in values]
    assert len(set(zip(*(shots.number(axis.name) for axis in synthetic.AXES), strict=True))) == CONFIGURATIONS


def test_labels_are_those_of_an_independent_flight(outcomes: np.ndarray) -> None:
    rng = np.random.default_rng(11)
    chosen = np.concatenate([rng.choice(np.flatnonzero(outcomes == outcome), 60) for outcome in
                             ("miss", "two", "three")] + [rng.integers(0, CONFIGURATIONS, 60)])
    shots = synthetic.grid_shots(chosen)
    compared = 0
    for row, outcome in enumerate(outcomes[chosen]):
        height = paper_height_m(*(float(shots.number(name)[row]) for name in ("distance_m", "motor_ratio", "hood_deg")))
        if min(abs(abs(height - 2.44) - 0.07), abs(abs(height - 2.44) - 0.35), 1.0) < 1e-4:
            continue                              # on the very edge either is right
        assert outcome == paper_outcome(height), shots.shot_id[row]
        compared += 1
    assert compared > 230


@given(st.integers(3, 90), st.integers(0, 2**32), st.sets(st.integers(0, 299), max_size=120))
def test_the_sample_is_balanced_and_avoids_what_is_taken(count: int, seed: int, taken: set[int]) -> None:
    outcomes = np.array(["miss", "two", "three"] * 100)
    left = [sum(outcomes[place] == outcome for place in set(range(300)) - taken) for outcome in
            ("miss", "two", "three")]
    forbidden = np.array(sorted(taken), np.int64)
    if min(left) < math.ceil(count / 3):
        return
    chosen = synthetic.sample_balanced(outcomes, count, forbidden, seed)
    counts = [int((outcomes[chosen] == outcome).sum()) for outcome in ("miss", "two", "three")]
    assert sum(counts) == count == len(set(chosen.tolist()))
    assert max(counts) - min(counts) <= 1
    assert not set(chosen.tolist()) & taken
    assert np.array_equal(chosen, synthetic.sample_balanced(outcomes, count, forbidden, seed))


def test_another_seed_is_another_sample() -> None:
    outcomes = np.array(["miss", "two", "three"] * 1000)
    one, two = (synthetic.sample_balanced(outcomes, 300, np.zeros(0, np.int64), seed) for seed in (0, 1))
    assert not np.array_equal(one, two)


def test_a_rare_outcome_is_named_and_so_is_a_sample_too_small() -> None:
    outcomes = np.array(["miss"] * 50 + ["two"] * 50 + ["three"] * 4)
    assert len(synthetic.sample_balanced(outcomes, 12, np.zeros(0, np.int64), 0)) == 12
    with pytest.raises(InputError, match="only 3 configurations of the grid are a 'three'"):
        synthetic.sample_balanced(outcomes, 12, np.array([103]), 0)
    with pytest.raises(InputError, match="-n is 2"):
        synthetic.sample_balanced(outcomes, 2, np.zeros(0, np.int64), 0)
    with pytest.raises(InputError, match="--seed is -1"):
        synthetic.sample_balanced(outcomes, 12, np.zeros(0, np.int64), -1)


@given(st.lists(st.integers(0, CONFIGURATIONS - 1), min_size=1, max_size=30, unique=True), st.integers(0, 2**32))
def test_a_recorded_configuration_takes_the_nearest_on_the_grid(places: list[int], seed: int) -> None:
    shots = synthetic.grid_shots(np.array(places))
    rng = np.random.default_rng(seed)
    measured = {axis.name: shots.number(axis.name) + rng.uniform(-0.49, 0.49, len(places)) / axis.per_unit
                for axis in synthetic.AXES}
    assert synthetic.taken_configurations(Shots(shots.shot_id, measured, {})).tolist() == sorted(places)


def test_shots_beside_the_grid_or_with_gaps_take_nothing() -> None:
    shots = Shots(("beyond", "gap", "on"), {"motor_ratio": np.array([0.5, 0.5, 0.5]),
                                            "hood_deg": np.array([45.0, np.nan, 45.0]),
                                            "distance_m": np.array([16.2, 5.0, 5.0])}, {})
    assert synthetic.taken_configurations(shots).tolist() == [50 * 61 * 76 + 30 * 76 + 20]


def test_recorded_configurations_are_replaced(outcomes: np.ndarray) -> None:
    first = synthetic.sample_balanced(outcomes, 90, np.zeros(0, np.int64), 5)
    shots = synthetic.synthesise(RIG, point_belief(BELIEF), 90, synthetic.grid_shots(first), 5)
    assert len(shots) == 90
    assert not set(shots.shot_id) & set(synthetic.grid_shots(first).shot_id)
    assert sorted(map(shots.text("outcome").count, ("miss", "two", "three"))) == [30, 30, 30]
    places = np.array([int(name.removeprefix("sim-")) for name in shots.shot_id])
    assert shots.text("outcome") == tuple(outcomes[places].tolist())


def test_provenance_is_optional_but_not_rubbish(tmp_path) -> None:
    assert synthetic.load_provenance(tmp_path) == {}
    for text in ("{", "[]"):
        (tmp_path / "synth.json").write_text(text)
        with pytest.raises(InputError, match=r"synth\.json"):
            synthetic.load_provenance(tmp_path)
