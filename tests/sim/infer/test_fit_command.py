"""truearc fit, as a user with a spreadsheet meets it."""

import numpy as np
import pytest

import truearc.sim.infer.fit
from tests.sim.infer.independent import make_dataset
from truearc.cli.main import main
from truearc.sim.data.files import hash_dataset, load_dataset, save_dataset
from truearc.sim.infer.belief import load_belief

TERMS = "drag,magnus,exit_efficiency"


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    path = tmp_path_factory.mktemp("shots") / "d"
    save_dataset(path, make_dataset(11, 100, side=True))
    return path


def test_a_fit_is_told_in_words_and_written_as_a_belief(directory, tmp_path, capsys):
    out = tmp_path / "coefficients.toml"
    arguments = ["fit", str(directory), "--terms", TERMS, "-o", str(out), "--quiet"]
    assert main(arguments) == 0
    said, errors = capsys.readouterr()
    assert errors == ""
    for words in ("fitted to 100 of 100 shots", "100 outcomes", "drag coefficient", "90 % interval",
                  "from shot to shot the height at", "held out (100 in", "hard to tell apart"):
        assert words in said, words
    belief = load_belief(out)
    assert set(belief.coefficients) == {"drag", "magnus", "exit_efficiency"}
    assert set(belief.scatter) == {"speed", "elevation_deg"}
    assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
    provenance = load_belief(out).provenance
    assert (provenance["method"], provenance["dataset_sha256"]) == ("ml", hash_dataset(load_dataset(directory)))
    low, high = provenance["interval90"]["drag.cd"]
    assert low < belief.coefficients["drag"]["cd"] < high
    assert main(["predict", str(directory), "--coefficients", str(out), "-o", str(tmp_path / "p.csv")]) == 0


@pytest.mark.parametrize(("arguments", "message"), [
    (["--terms", "drag,magnetism"], "--terms: there is no term 'magnetism'"),
    (["--terms", "wind"], "there is no term 'wind' (did you mean 'wind_x' or 'wind_y' or 'wind_z'?)"),
    (["--terms", "drga"], "--terms: there is no term 'drga' (did you mean 'drag'?)"),
    (["--terms", ""], "--terms: got ''; expected at least one entry"),
    (["--terms", "drag,drag"], "--terms: got drag more than once; keep one"),
    (["--terms", " , "], "--terms: got ' , '; expected at least one entry"),
    (["--seed", "1"], "--seed: applies with several datasets only"),
    (["--seed", "-1"], "--seed: got -1"),
    (["-o", "nowhere/at/all.toml"], "nowhere/at/all.toml"),
])
def test_a_users_mistake_is_named(directory, capsys, arguments, message):
    assert main(["fit", str(directory), "--quiet", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_fit_that_does_not_settle_writes_nothing(directory, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(truearc.sim.infer.fit, "ROUNDS", 1)
    out = tmp_path / "coefficients.toml"
    assert main(["fit", str(directory), "--terms", TERMS, "-o", str(out), "--quiet"]) == 1
    assert "did not settle" in capsys.readouterr().err
    assert not out.exists()
