"""Planned shots, where everything is linear: chances against exact likelihoods; what a plan says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import multivariate_normal

import truearc.cli.main as truearc
from tests.sim.discover.made import at_least_squares
from tests.sim.discover.straight import ASKED, NAMES, SHARED, fit_straight, slopes_and_y
from tests.sim.discover.straight import FACTS as STRAIGHT
from tests.sim.discover.worlds import FACTS
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import save_dataset
from truearc.sim.discover.decide import Search, Step, decide
from truearc.sim.discover.next_steps import (
    PACES,
    SURE,
    Contest,
    at_paces,
    chance_of_name,
    choose_blocks,
    contest_of,
    make_design,
    separation,
    within_reach,
    worth,
)
from truearc.sim.discover.report.pages import design_lines, design_table
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import lay_out
from truearc.sim.physics.simulate import predict
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

PLANTED = {"spin_drag.share": 0.45}
SHOTS, SEED = 30, 5


def step_of(shots: int = SHOTS, planted: dict[str, float] = PLANTED) -> Step:
    fitted = fit_straight(planted, SEED, shots=shots)
    step = decide(fitted, None, Search(len(fitted.scores.rows), (), (), 0.05, 0), lambda done, note: None)[0]
    return replace(step, unknown=False)          # so few shots hardly say that anything is there at all


def doubtful() -> tuple[Contest, tuple[str, ...]]:
    step = step_of()
    names = tuple(step.chosen[:4])
    assert len(names) >= 2
    return contest_of(step, names), names


def chosen_rows(contest: Contest, block: int, count: int) -> list[int]:
    options = [(row, 1.0) for row in range(len(contest.scores.rows))]
    return [row for row, _ in choose_blocks(contest, block, options, count,
                                            lambda option: contest.scores.told_by([option[0]]))]


def test_separations_are_least_squares_misfits() -> None:
    """Data that name j makes exactly, fitted by name k and the shared ones with their priors: the chi-squared left."""
    contest, names = doubtful()
    slopes = slopes_and_y(PLANTED, SEED, SHOTS, {})[0]
    found = separation(contest, 0.0)
    assert np.diag(found) == pytest.approx(np.zeros(len(names)), abs=1e-9)
    for j, truth in enumerate(names):
        for k, rival in enumerate(names):
            if j == k:
                continue
            data = slopes[:, NAMES.index(truth)] * contest.amplitude[j]
            x = slopes[:, [NAMES.index(name) for name in (rival, *SHARED)]]
            stacked = np.vstack([x, np.diag([0.0, 0.5, 0.5])])
            padded = np.concatenate([data, np.zeros(3)])
            left = padded - stacked @ np.linalg.lstsq(stacked, padded, rcond=None)[0]
            own = np.concatenate([data, np.zeros(2)])
            shared = np.vstack([x[:, 1:], np.diag([0.5, 0.5])])
            bare = own - shared @ np.linalg.lstsq(shared, own, rcond=None)[0]
            assert found[j, k] <= bare @ bare + 1e-6
            assert found[j, k] == pytest.approx(left @ left, rel=0.02)


def test_of_a_confounded_pair_100_chosen_shots_are_worth_300_random_ones() -> None:
    """Drag that goes with x or with x^2, shots about one distance: only the far and the near ones tell."""
    x = np.random.default_rng(1).normal(1.0, 0.12, 200)
    evidence = at_least_squares(0.5 * x, np.stack([x, x**2], axis=1), np.ones((200, 1)))
    contest = Contest(evidence, np.array([0, 1]), np.array([0.5, 0.25]), np.ones(2), np.array([0.5, 0.5]), np.zeros(2))
    rows = chosen_rows(contest, 20, 5)
    assert set(rows) <= set(np.argsort(x)[[0, 1, 2, -3, -2, -1]]) | set(np.argsort(np.abs(x - 1.0))[:40])
    designed, random = 20.0 * evidence.info[rows].sum(0), evidence.info.mean(0)
    assert worth(contest, designed) > worth(contest, 300.0 * random) > worth(contest, 100.0 * random)
    # the first block is the best single one
    assert rows[0] == int(np.argmax([worth(contest, 20.0 * info) for info in evidence.info]))


def test_chances_are_those_of_shots_really_taken() -> None:
    """Truths and results drawn again, judged by the exact marginal likelihood of old and new shots together."""
    contest, names = doubtful()
    slopes, y = slopes_and_y(PLANTED, SEED, SHOTS, {})
    rows = chosen_rows(contest, 2, 3)
    said = chance_of_name(contest, 2.0 * contest.scores.info[rows].sum(0), 1)
    repeated = np.repeat(rows, 2)
    rng = np.random.default_rng(2)
    every = np.vstack([slopes, slopes[repeated]])
    sd = {name: 0.3 for name in ASKED} | dict.fromkeys(SHARED, 2.0)
    law = {}
    for name in names:
        mine = every[:, [NAMES.index(one) for one in (name, *SHARED)]] * [sd[one] for one in (name, *SHARED)]
        law[name] = multivariate_normal(np.zeros(len(every)), np.eye(len(every)) + mine @ mine.T)
    right = []
    for _ in range(400):
        j = rng.choice(len(names), p=contest.probability)
        # the shared ones as the old shots have them with this name in
        x = slopes[:, [NAMES.index(one) for one in (names[j], *SHARED)]]
        top = np.linalg.solve(x.T @ x + np.diag([1.0 / 0.09, 0.25, 0.25]), x.T @ y)
        come = slopes[repeated][:, [NAMES.index(one) for one in (names[j], *SHARED)]] @ top
        both = np.concatenate([y, come + rng.normal(size=len(repeated))])
        chance = softmax([law[name].logpdf(both) for name in names])
        right.append(chance[j] >= SURE)
    assert said == pytest.approx(np.mean(right), abs=0.1)


def test_a_measurement_of_the_true_term_settles_it_when_it_is_sharp() -> None:
    step = step_of(planted={"release_height.above_m": 0.45})
    plan = make_design(step, 60, 3)
    tape = next((one for one in plan.measurements if "release_height" in one.terms), None)
    assert tape is not None and tape.instrument.id == "exit_height_tape"
    # an amplitude of 0.45 m against a tape good to 1 cm: sure whenever this is the truth
    share = plan.probability[[name.startswith("release_height") for name in plan.names]].sum()
    assert share - 0.03 < tape.probability


def test_one_name_leaves_nothing_to_design() -> None:
    with pytest.raises(ValueError, match="fewer than two"):
        make_design(step_of(400, {"spin_drag.share": 0.9}))


def test_slower_and_faster_wheels_are_foretold_as_the_simulator_has_them() -> None:
    """Expected heights at another pace, against another code's flights at those motor ratios."""
    dataset = shoot(make_world({}, "L0", 60, 3))
    fitted = fit_believed(Launcher(take_in(dataset), lay_out(take_in(dataset), dataset.facts.believe.terms)))
    coefficients = {name: {} for name in dataset.facts.believe.terms if name != "gravity"}
    for name, value in fitted.values.items():
        term, _, parameter = name.partition(".")
        if term in coefficients:
            coefficients[term][parameter] = value
    there, ratio = at_paces(fitted), dataset.shots.number("motor_ratio")
    assert set(there) == set(PACES)
    for pace, evidence in there.items():
        shots = Shots(dataset.shots.shot_id, {**dataset.shots.numbers, "motor_ratio": pace * ratio},
                      dataset.shots.texts)
        height_m = predict(dataset.facts, coefficients, shots).height_m - dataset.facts.target.centre_height_m
        assert evidence.plane is not None
        near = evidence.plane.mean_m > -5.0
        assert near.sum() > 30
        flown_m = height_m[evidence.rows[evidence.plane.rows]]
        assert evidence.plane.mean_m[near] == pytest.approx(flown_m[near], abs=2e-3)
    options = within_reach(fitted, there)
    assert {row for row, pace in options if pace == 1.0} == set(range(len(ratio)))
    asked = np.array([pace * ratio[fitted.scores.rows[row]] for row, pace in options])
    assert ratio.min() - 1e-9 <= asked.min() and asked.max() <= ratio.max() + 1e-9
    assert len(options) > 3 * len(ratio)


def test_a_plan_names_configurations_that_were_shot() -> None:
    fitted = fit_straight({"spin_drag.share": 0.45}, 5, shots=30)
    (step, *_) = decide(fitted, None, Search(len(fitted.scores.rows), (), (), 0.05, 0), lambda done, note: None)
    step = replace(step, unknown=False)
    distance_m = np.linspace(2.0, 6.0, 30)
    shots = Shots(tuple(f"s{k}" for k in range(30)), {"distance_m": distance_m, "hood_deg": np.full(30, 45.0)}, {})
    table = design_table(make_design(step, 40, 4), Dataset("d", STRAIGHT, shots), step)
    shoot = [one for one in table["next"] if one["do"] == "shoot"]
    assert sum(one["shots"] for one in shoot) == 40
    assert all(one["distance_m"] == pytest.approx(distance_m[int(one["like"][1:])], abs=1e-4) for one in shoot)
    assert json.loads(json.dumps(table)) == table
    lines = design_lines(table)
    assert lines[0].startswith("To tell apart: ") and "hood_deg 45" in lines[1]
    assert any(line.startswith("After these 40 shots") for line in lines)


def test_nothing_to_tell_apart_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shots = Shots(tuple(map(str, range(20))), {"distance_m": np.linspace(2.0, 6.0, 20)}, {})
    save_dataset(tmp_path / "mute", Dataset("mute", FACTS, shots))
    out = tmp_path / "next.json"
    assert truearc.main(["design", str(tmp_path / "mute"), "--json", str(out), "--quiet"]) == 0
    assert "no names to tell apart" in capsys.readouterr().out
    assert json.loads(out.read_text()) == {"schema": "truearc.design/1", "verdict": "none", "next": []}
