"""Simulated shots against other code's flights, and the sweep: who is trained on what, what the table says."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_1samp

import truearc.cli.main as truearc
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from tests.sim.training_rows import some_rows
from truearc.api.paper import _sentence
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, Rig
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import save_dataset
from truearc.sim.infer.belief import point_belief
from truearc.sim.paper import sweep, synthetic
from truearc.sim.paper.network import Rows, load_weights

CD, CL = 0.91, 0.06                               # the paper's own estimate
BELIEF = {"drag": {"cd": CD}, "magnus": {"cl": CL}}
CONFIGURATIONS = 468_236


@pytest.fixture(scope="module")
def outcomes() -> np.ndarray:
    return synthetic.label_grid(GUPPY, BELIEF)


def paper_outcome(height_m: float) -> str:
    deviation = abs(height_m - 2.44)
    return "three" if deviation <= 0.07 else "two" if deviation <= 0.35 else "miss"


def test_labels_are_those_of_an_independent_flight(outcomes: np.ndarray) -> None:
    rng = np.random.default_rng(11)
    chosen = np.concatenate([rng.choice(np.flatnonzero(outcomes == outcome), 60) for outcome in
                             ("miss", "two", "three")] + [rng.integers(0, CONFIGURATIONS, 60)])
    shots = synthetic.grid_shots(chosen)
    compared = 0
    for row, outcome in enumerate(outcomes[chosen]):
        configuration = (float(shots.number(name)[row]) for name in ("distance_m", "motor_ratio", "hood_deg"))
        height = reference.integrate(*configuration, CD, CL).height_m
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
    shots = synthetic.synthesise(GUPPY, point_belief(BELIEF), 90, synthetic.grid_shots(first), 5)
    assert len(shots) == 90
    assert not set(shots.shot_id) & set(synthetic.grid_shots(first).shot_id)
    assert sorted(map(shots.text("outcome").count, ("miss", "two", "three"))) == [30, 30, 30]
    places = np.array([int(name.removeprefix("sim-")) for name in shots.shot_id])
    assert shots.text("outcome") == tuple(outcomes[places].tolist())


REAL, SIMULATED = some_rows(60, 1), some_rows(90, 2)


def test_every_size_goes_with_every_weight_and_nothing_simulated_goes_once() -> None:
    assert sweep.settings_of([0, 30], [0.01, 0.1]) == [(0, 0.0), (30, 0.01), (30, 0.1)]
    for sizes, weights, option in (([-1], [0.1], "--sizes"), ([1], [-0.1], "--lambdas"),
                                   ([1], [math.nan], "--lambdas")):
        with pytest.raises(InputError, match=option):
            sweep.settings_of(sizes, weights)


def test_settings_of_one_seed_differ_in_simulated_shots_alone() -> None:
    networks = sweep.plan(REAL, SIMULATED, sweep.settings_of([0, 30, 60], [0.01]), [3, 4], 0.2, 0.25)
    assert [(network.setting.size, network.seed) for network in networks] == [
        (0, 3), (30, 3), (60, 3), (0, 4), (30, 4), (60, 4)]
    none, small, large = (network.job for network in networks[:3])
    assert none.simulated is None and none.seed == small.seed == 3
    for part in range(2):
        assert np.array_equal(none.real[part], large.real[part])
        assert np.array_equal(small.simulated[part], large.simulated[part][:30])
    assert not np.array_equal(none.real.features, networks[3].job.real.features)
    sets = [none.real.features, none.validation.features, networks[0].heldout.features]
    assert sorted(np.concatenate(sets)[:, 0]) == sorted(REAL.features[:, 0])         # nothing lost, nothing twice


@given(st.integers(0, 20), st.integers(0, 20), st.integers(1, 20), st.integers(0, 2**32))
def test_every_beginning_of_the_order_is_evenly_mixed(misses: int, twos: int, threes: int, seed: int) -> None:
    labels = np.array([[0.0, 0.0]] * misses + [[1.0, 0.0]] * twos + [[1.0, 1.0]] * threes)
    order = sweep.balanced_order(Rows(np.zeros((len(labels), 3)), labels), seed)
    assert sorted(order) == list(range(len(labels)))
    level, limit = labels.sum(axis=1)[order], min(count for count in (misses, twos, threes) if count)
    kinds = len(np.unique(level))
    for size in range(1, kinds * limit + 1):
        counts = np.unique(level[:size], return_counts=True)[1]
        assert counts.max() - (counts.min() if len(counts) == kinds else 0) <= 1


def test_the_interval_is_that_of_the_t_test() -> None:
    values = np.random.default_rng(0).normal(1.0, 2.0, 12)
    low, high = ttest_1samp(values, 0.0).confidence_interval(0.95)
    mean = sweep.mean_of(values)
    assert (mean.value - mean.half, mean.value + mean.half) == pytest.approx((low, high), rel=1e-12)
    assert math.isnan(sweep.mean_of([3.0]).half)


def make_score(setting: sweep.SweepSetting, seed: int, validation: float, heldout: float) -> sweep.SweepScore:
    return sweep.SweepScore(*setting, seed, 100, validation, heldout, 0.5, 0.5, 0.5)


def test_validation_alone_says_which_is_best_and_seeds_are_paired() -> None:
    settings = [sweep.SweepSetting(0, 0.0), sweep.SweepSetting(30, 0.01), sweep.SweepSetting(60, 0.01)]
    rng = np.random.default_rng(1)
    level = rng.normal(0.0, 5.0, 8)                                  # a hard split is hard for every setting
    gains = rng.normal(0.3, 0.05, 8)
    scores = [make_score(settings[0], seed, 0.9, level[seed]) for seed in range(8)]
    scores += [make_score(settings[1], seed, 0.5, level[seed] - gains[seed]) for seed in reversed(range(8))]
    scores += [make_score(settings[2], seed, 0.7, -99.0) for seed in range(8)]     # held out says this: no say
    verdict = sweep.compare(scores, settings)
    assert (verdict.best, verdict.rival) == (settings[1], settings[0])
    assert verdict.gain == pytest.approx(sweep.mean_of(gains), rel=1e-9)
    assert verdict.gain.half < 0.1
    assert sweep.compare(scores[8:], settings[1:]).rival == settings[2]    # without a plain one: the next best
    assert sweep.compare(scores[:8], settings[:1]) is None


def save_rows(directory: Path, rows: Rows) -> None:
    numbers = dict(zip(("distance_m", "motor_ratio", "hood_deg"), rows.features.T, strict=True))
    outcomes = tuple(("miss", "two", "three")[int(level)] for level in rows.labels.sum(axis=1))
    ids = tuple(f"s{row}" for row in range(len(outcomes)))
    save_dataset(directory, Dataset("rows", Rig(Ball(0.14, 0.0889)), Shots(ids, numbers, {"outcome": outcomes})))


def test_the_door_writes_tables_picture_and_weights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_rows(tmp_path / "real", REAL)
    save_rows(tmp_path / "sim", SIMULATED)
    words = ["paper", "sweep", "--quiet", "--real", f"{tmp_path}/real", "--sim", f"{tmp_path}/sim",
             "--sizes", "0,30,90", "--seeds", "4", "--steps", "6000", "--patience", "5000", "--learning-rate", "0.003"]
    assert truearc.main([*words, "-o", f"{tmp_path}/out"]) == 0
    said = capsys.readouterr().out
    assert "best on the validation shots" in said
    with (tmp_path / "out" / "networks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    with (tmp_path / "out" / "settings.csv").open() as file:
        table = list(csv.DictReader(file))
    for line in table:
        mine = [float(row["heldout_loss"]) for row in rows if row["size"] == line["size"]]
        assert float(line["heldout_loss"]) == pytest.approx(np.mean(mine))
        assert 0.0 < float(line["outcome"]) <= 1.0
    assert (tmp_path / "out" / "sweep.png").read_bytes().startswith(b"\x89PNG")
    _, record = load_weights(tmp_path / "out" / "best")
    best = min(table, key=lambda line: float(line["validation_loss"]))
    assert (record["sim_shots"], record["lambda"]) == (int(best["size"]), float(best["weight"]))
    assert truearc.main(["export", f"{tmp_path}/out/best", "-o", f"{tmp_path}/gate.onnx"]) == 0


@pytest.mark.parametrize(("words", "named"), [
    (["--real", "nowhere"], "nowhere"), (["--sizes", "0,x"], "--sizes: 'x' is not a whole number"),
    (["--lambdas", "0.1,-"], "--lambdas: '-' is not a number"), (["--seeds", "0"], "--seeds: got 0"),
    (["--sizes", "5"], "--sim has 0"), (["--patience", "0"], "--patience")])
def test_bad_options_are_named(words, named, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_rows(tmp_path / "real", REAL)
    assert truearc.main(["paper", "sweep", "--quiet", "--real", "real", "-o", "out", *words]) == 2
    assert named in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(("value", "half", "said"), [
    (0.02, 0.01, "by +0.020 +- 0.010, which is beyond chance and better"), (-0.02, 0.01, "beyond chance and WORSE"),
    (0.01, 0.02, "by +0.010 +- 0.020, which is within what the draw of seeds does by chance"),
    (0.0, 0.0, "within what the draw of seeds does by chance"), (0.02, math.nan, "for the one seed tried")])
def test_verdict_of_a_sweep_says_what_chance_can_do(value: float, half: float, said: str) -> None:
    best, rival = sweep.SweepSetting(1000, 0.5), sweep.SweepSetting(0, 0.0)
    text = _sentence(sweep.Verdict(best, rival, sweep.Mean(value, half)))
    assert said in text and text.startswith("best on the validation shots: 1000 simulated shots, lambda 0.5; ")
