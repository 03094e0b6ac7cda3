"""Figures of every model, and their metrics."""

import csv
import json
import math

import numpy as np
import pytest
from scipy import stats
from sklearn.metrics import brier_score_loss, f1_score, recall_score

from tests.proof.reproduce.pools import SMALL, make_pool
from truearc.cli.main import main
from truearc.sim.paper.grid_fit import fit_grid
from truearc.sim.paper.network import LABELS
from truearc_proof.cli import reproduce as command
from truearc_proof.parallel import fan_out
from truearc_proof.reproduce import EVERYTHING, WHERE, models
from truearc_proof.reproduce import collect as door
from truearc_proof.reproduce.page import OURS_NOT_THEIRS, make_tables, save_figures, save_page


@pytest.fixture(scope="module")
def pool():
    return make_pool()


@pytest.fixture(scope="module")
def done(pool):
    repetitions = fan_out(models.run_repetition, models.tasks_of(pool, SMALL), workers=1)
    answers = models.train_networks(repetitions, SMALL, lambda done, note: None)
    return repetitions, answers, models.analyse(repetitions, answers)


def test_everybody_answers_for_the_draws_own_rows(pool, done):
    repetitions, answers, _ = done
    for one, networks in zip(repetitions, answers, strict=True):
        labels = [LABELS[outcome] for outcome in pool.real.shots.take(one.draw.test).text("outcome")]
        labels += [LABELS[outcome] for outcome in pool.launched.shots.take(one.draw.transfer).text("outcome")]
        assert np.array_equal(one.asked.labels, labels) and one.tests == 6
        everybody = [*one.predictions.values(), *(answer.p for answer in networks.values())]
        assert set(one.predictions) == {models.OURS, models.SIMULATOR}
        assert np.bincount(one.simulated[90].labels.sum(axis=1).astype(int)).tolist() == [30, 30, 30]
        for p in everybody:
            assert p.shape == (18, 2) and (p >= 0.0).all() and (p <= 1.0).all()


def test_nobody_learns_from_what_it_is_asked_about(pool, done):
    for one in done[0]:
        known = {tuple(row) for part in (one.learn, one.validation) for row in part.features}
        assert len(known) == 24 and not known & {tuple(row) for row in one.asked.features}
        train = pool.real.shots.take(one.draw.train)
        assert fit_grid(pool.real.facts, train, SMALL.grid_step).coefficients == one.coefficients


def test_a_repetition_is_the_same_every_time(pool, done):
    again, one = models.run_repetition(models.tasks_of(pool, SMALL)[1]), done[0][1]
    assert again.coefficients == one.coefficients and again.scores == one.scores
    for name, p in one.predictions.items():
        assert np.array_equal(p, again.predictions[name]), name


def test_files_say_what_the_analysis_says(pool, done, tmp_path):
    repetitions, _, analysis = done
    tables = make_tables(repetitions, analysis, SMALL)
    save_figures(tmp_path, pool, repetitions, analysis, tables, SMALL)
    save_page(tmp_path / "index.html", pool, repetitions, analysis, tables, SMALL)
    rows = list(csv.DictReader((tmp_path / "figures.csv").open(encoding="utf-8")))
    ours = [float(row["brier"]) for row in rows if row["model"] == models.OURS and row["rows"] == EVERYTHING]
    assert ours == analysis.values(models.OURS, EVERYTHING, "brier").tolist() and len(ours) == SMALL.draws
    p = repetitions[1].predictions[models.SIMULATOR]
    found = next(row for row in rows if row["model"] == models.SIMULATOR and row["rows"] == EVERYTHING
                 and row["repetition"] == "1")
    assert float(found["accuracy"]) == models.measure(p, repetitions[1].asked.labels).accuracy
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary["data"].startswith("The data are ours") and len(summary["repetitions"]) == SMALL.draws
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.index(OURS_NOT_THEIRS.partition(",")[0]) < page.index("<h2>")
    assert page.count("<svg ") == 3 and "not printed in the paper" in page and "44.29%" in page


def test_the_door_prints_paper_and_ours(pool, done, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(door, "collect", lambda *_: pool)
    monkeypatch.setattr(models, "run_repetition", lambda task: done[0][task.number])
    monkeypatch.setattr(command, "_settings", lambda _: SMALL)
    out = tmp_path / "out"
    assert main(["reproduce", "-o", str(out), "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("The data are ours") and "Table I:" in said and "44.29%" in said and "Table II" in said
    assert {"index.html", "figures.csv", "summary.json", "data"} <= {p.name for p in out.iterdir()}
    assert main(["reproduce", "-o", str(out), "--workers", "1", "--quiet"]) == 0       # again over its own


def figure(number, model, accuracy, brier):
    return [models.Figure(number, model, None, None, where, models.Metrics(accuracy, 0, 0, accuracy, 0, brier, brier))
            for where in WHERE]


def made(ours, theirs):
    settings = [models.SweepSetting(900, 0.01), models.SweepSetting(900, 1.0)]
    figures = []
    for number, (a, b) in enumerate(zip(ours, theirs, strict=True)):
        figures += figure(number, models.OURS, a, 1.0 - a)
        for setting, off in zip(settings, (0.0, -0.3), strict=True):
            figures += figure(number, models.network_name(setting), b + off, 1.0 - b - off)
    return models.Analysis(tuple(figures), ()), settings


def test_a_difference_is_paired_and_called_better_only_when_settled():
    steps = np.linspace(0.0, 0.4, 20)
    clear, settings = made(0.5 + steps + np.tile([0.01, 0.03], 10), 0.5 + steps)
    found = next(one for one in models._differences(clear, settings)
                 if one.metric == "accuracy" and one.other == models.BY_TEST and one.where == EVERYTHING)
    assert found.better and found.difference.mean == pytest.approx(0.02)
    assert found.difference.high - found.difference.low < 0.02         # unpaired it would be some 0.16
    open_, settings = made(0.5 + np.tile([0.3, -0.29], 10), np.full(20, 0.5))
    assert not any(one.better for one in models._differences(open_, settings))


def test_best_by_test_is_the_setting_with_the_best_mean_either_way_round():
    analysis, settings = made([0.9, 0.8], [0.7, 0.6])
    assert models.best_by_test(analysis, settings, EVERYTHING, "accuracy") == models.SweepSetting(900, 0.01)
    assert models.best_by_test(analysis, settings, EVERYTHING, "brier") == models.SweepSetting(900, 0.01)
    found = next(one for one in models._differences(analysis, settings) if one.metric == "brier")
    assert found.difference.mean < 0.0


def predictions(seed, n=300):
    rng = np.random.default_rng(seed)
    three = rng.random(n)
    p = np.column_stack([three + (1.0 - three) * rng.random(n), three])
    return p, (rng.random((n, 1)) < p).astype(float)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_they_are_what_scikit_learn_says(seed):
    p, labels = predictions(seed)
    found = models.measure(p, labels)
    said, was = (p >= 0.5).sum(axis=1), labels.sum(axis=1).astype(int)
    assert found.accuracy == pytest.approx(np.mean(said == was))
    for outcome, f1, recall in ((2, found.f1_three, found.class_three), (1, found.f1_two, found.class_two)):
        assert f1 == pytest.approx(f1_score(was == outcome, said == outcome))
        assert recall == pytest.approx(recall_score(was == outcome, said == outcome))
    assert found.brier == pytest.approx(brier_score_loss(labels.ravel(), p.ravel()))


def test_what_is_not_there_is_nan_not_zero():
    found = models.measure(np.array([[0.1, 0.1]]), np.array([[0.0, 0.0]]))
    assert math.isnan(found.class_three) and math.isnan(found.f1_three) and found.accuracy == 1.0
    assert math.isnan(models.measure(np.zeros((0, 2)), np.zeros((0, 2))).brier)
    # a row called three but not two is wrong whatever it was
    assert models.measure(np.tile([0.2, 0.9], (3, 1)), np.tri(3, 2, -1)).accuracy == 0.0


def test_the_interval_is_students():
    values = np.random.default_rng(4).normal(0.7, 0.1, 25)
    found = models.interval(values)
    assert found[1:] == pytest.approx(stats.t.interval(0.95, 24, loc=values.mean(), scale=stats.sem(values)))
