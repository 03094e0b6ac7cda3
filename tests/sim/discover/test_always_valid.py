"""The e-values against sums over all that could have happened, written out, and Ville's bound in simulated sessions."""

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from tests.sim.discover.made import column
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Shots
from truearc.sim.discover.detect import always_valid
from truearc.sim.discover.detect.always_valid import AT_ONCE, HAZARD, SIZES, drawn, test_change
from truearc.sim.infer.likelihood.heights import see_heights
from truearc.sim.infer.likelihood.noise import LAPSE
from truearc.sim.infer.likelihood.score_table import PlaneScores, ScoreTable, make_evidence

THREE_M, TWO_M = 0.07, 0.3
TARGET = Target(2.44, three_half_height_m=THREE_M, two_half_height_m=TWO_M)
OUTCOMES = ("miss", "two", "three")
SPREAD_M = 0.1


def make_table(outcome: tuple[str, ...], by: np.ndarray, sd_m: float = 0.05, wider_m: float = 0.0) -> ScoreTable:
    """Heights [n] about the centre; columns: two terms by `by` [n, 2], and an error that all share, of which the belief
    says N(0, 1), in units of sd_m. wider_m: by how much the first term moves the borders outwards."""
    n = len(outcome)
    shots = Shots(tuple(map(str, range(n))), {"miss_height_m": np.full(n, np.nan)},
                  {"outcome": outcome, "side": ("",) * n})
    slopes = np.column_stack([by, np.full(n, sd_m)])
    plane = PlaneScores(np.arange(n), see_heights(shots, TARGET)[1], np.zeros(n), np.full(n, SPREAD_M), slopes,
                        wider_m * np.array([[[1.0, 0.0, 0.0]]] * n), np.zeros_like(slopes))
    columns = (column("wind.speed", "term"), column("hood.angle", "term"), column("speed", "shared"))
    return make_evidence(np.arange(n), columns, np.zeros(3), np.zeros((n, 3)), np.zeros((n, 3, 3)), plane, np.eye(1),
                         np.zeros(1), np.zeros(n))


def chance(outcome: str, mean_m: float) -> float:
    """Of an outcome of a height N(mean, SPREAD_M)."""
    inside = [norm.cdf(half, mean_m, SPREAD_M) - norm.cdf(-half, mean_m, SPREAD_M) for half in (THREE_M, TWO_M)]
    clean = {"three": inside[0], "two": inside[1] - inside[0], "miss": 1.0 - inside[1]}[outcome]
    return float((1.0 - LAPSE) * clean + LAPSE / 3.0)


def likelihoods(outcome: tuple[str, ...], by: np.ndarray, errors_m: np.ndarray) -> tuple[float, float]:
    """(probability of the outcomes if nothing changed, and if something did), all of it written out as loops."""
    n = len(outcome)
    start = [AT_ONCE, *((1.0 - AT_ONCE) * HAZARD * (1.0 - HAZARD)**k for k in range(n - 1))]
    same = other = 0.0
    for error_m in errors_m:
        plain = [chance(one, error_m) for one in outcome]
        same += float(np.prod(plain)) / len(errors_m)
        later = (1.0 - sum(start)) * float(np.prod(plain))
        sizes = [sign * size for sign in (-1.0, 1.0) for size in SIZES]
        for direction, size in itertools.product(range(2), sizes):
            moved = [chance(one, error_m + size * by[k, direction]) for k, one in enumerate(outcome)]
            later += sum(start[k] * np.prod(plain[:k]) * np.prod(moved[k:]) for k in range(n)) / (2 * len(sizes))
        other += float(later) / len(errors_m)
    return same, other


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(always_valid, "DRAWS", 4)


@pytest.mark.usefixtures("few_draws")
def test_e_values_are_ratios_of_probabilities_written_out() -> None:
    rng = np.random.default_rng(1)
    by = rng.normal(0.0, 0.1, (5, 2))
    outcome = ("three", "miss", "two", "miss", "miss")
    table = make_table(outcome, by)
    found = test_change(table, seed=3)
    errors_m = 0.05 * drawn(table, 3)[:, 0]
    for shot in range(5):
        same, other = likelihoods(outcome[:shot + 1], by, errors_m)
        assert found.e_value[shot] == pytest.approx(other / same, rel=1e-9)
    assert found.directions == ("wind.speed", "hood.angle")


@pytest.mark.usefixtures("few_draws")
def test_e_values_have_mean_one_over_all_outcomes_if_nothing_changed() -> None:
    by = np.random.default_rng(2).normal(0.0, 0.2, (3, 2))
    total = mean = 0.0
    for outcome in itertools.product(OUTCOMES, repeat=3):
        table = make_table(outcome, by)
        same, _ = likelihoods(outcome, by, 0.05 * drawn(table, 5)[:, 0])
        total += same
        mean += same * float(test_change(table, seed=5).e_value[-1])
    assert total == pytest.approx(1.0, rel=1e-9) and mean == pytest.approx(1.0, rel=1e-9)


@pytest.mark.usefixtures("few_draws")
def test_a_target_that_shrinks_to_nothing_keeps_the_mean_at_one() -> None:
    """Borders that crossed would make probabilities negative, and their sum another than one."""
    by, total = np.zeros((2, 2)), 0.0
    for outcome in itertools.product(OUTCOMES, repeat=2):
        table = make_table(outcome, by, wider_m=0.1)
        e_value = test_change(table, seed=5).e_value
        assert (e_value > 0.0).all()
        total += likelihoods(outcome, by, 0.05 * drawn(table, 5)[:, 0])[0] * float(e_value[-1])
    assert total == pytest.approx(1.0, rel=1e-9)


def simulate(n: int, by: np.ndarray, shift_m: np.ndarray, rng: np.random.Generator) -> tuple[str, ...]:
    """Outcomes of a launcher whose error is drawn from the belief; shift_m [n]: what changed."""
    off_m = np.abs(0.05 * rng.normal() + shift_m + SPREAD_M * rng.normal(size=n))
    return tuple(np.where(off_m <= THREE_M, "three", np.where(off_m <= TWO_M, "two", "miss")).tolist())


def test_alarms_of_unchanged_sessions_stay_within_the_promised_rate_at_any_look(monkeypatch):
    monkeypatch.setattr(always_valid, "DRAWS", 64)
    rng = np.random.default_rng(7)
    alarms, sessions, rate = 0, 300, 0.1
    for _ in range(sessions):
        by = rng.normal(0.0, 0.15, (40, 2))
        table = make_table(simulate(40, by, np.zeros(40), rng), by)
        alarms += test_change(table).alarm(rate) is not None
    assert alarms <= sessions * rate + 2.0 * np.sqrt(sessions * rate * (1.0 - rate))


def test_a_change_is_found_with_its_first_shot() -> None:
    rng = np.random.default_rng(11)
    by = rng.normal(0.0, 0.15, (80, 2))
    shift_m = np.where(np.arange(80) >= 30, 2.0 * by[:, 1], 0.0)
    found = test_change(make_table(simulate(80, by, shift_m, rng), by))
    alarm = found.alarm(0.05)
    assert alarm is not None and 30 <= alarm < 75
    start, likely = found.since(79)
    assert abs(start - 30) <= 6 and likely[25:46].sum() > 0.9
