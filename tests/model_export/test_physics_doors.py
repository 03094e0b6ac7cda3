"""The gate with physics through its doors: train -> export -> verify -> predict-gate, for someone with a folder."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc.cli.main as truearc
from tests.sim.gate.worlds import BELIEF, make_shots
from truearc.robot.gate import load_gate
from truearc.sim.data.files import load_dataset, save_dataset


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("physics")
    save_dataset(home / "real", make_shots(1, 80))
    replace(BELIEF, provenance={"method": "by hand"}).save(home / "coefficients.toml")
    assert truearc.main(["train", "--quiet", "--real", f"{home}/real", "--coefficients", f"{home}/coefficients.toml",
                         "--reliability", f"{home}/weights.png", "-o", f"{home}/weights"]) == 0
    assert truearc.main(["export", f"{home}/weights", "-o", f"{home}/weights.onnx"]) == 0
    assert (home / "weights.png").read_bytes()[:4] == b"\x89PNG"
    return home


def test_verify_passes_and_says_what_it_compared(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert truearc.main(["verify", f"{home}/weights.onnx", "--weights", f"{home}/weights", "--data",
                         f"{home}/real"]) == 0
    said = capsys.readouterr().out
    assert said.count("max |dp|") == 2 and "outside the domain left out" in said and "FAILED" not in said


def test_the_robot_takes_it_and_rates_as_the_rows_say(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert truearc.main(["predict", "--gate", f"{home}/weights.onnx", f"{home}/real"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    shots, gate = load_dataset(home / "real").shots, load_gate(home / "weights.onnx")
    assert gate.provenance["kind"] == "physics" and gate.provenance["surrogate"]["p_error"] < 0.005
    for number, row in enumerate(rows):
        one = gate.rate(*(float(shots.number(name)[number]) for name in ("distance_m", "motor_ratio", "hood_deg")))
        assert (float(row["p_two"]), float(row["p_three"])) == pytest.approx((one.p_two, one.p_three), abs=1e-5)
        assert one.p_three is not None and one.p_two is not None and one.p_three <= one.p_two + 1e-6
    inside = np.mean([row["in_domain"] == "true" for row in rows])
    assert inside >= 0.97
    far = gate.rate(19.0, 0.9, 80.0)
    assert not far.in_domain and far.novelty is not None and far.novelty > 1.0


def test_what_is_missing_is_named(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train = ["train", "--quiet", "--real", f"{home}/real", "-o", f"{tmp_path}/w"]
    assert truearc.main(train) == 2
    assert "--coefficients" in capsys.readouterr().err
    for words, named in ((["--coefficients", "nowhere.toml"], "nowhere.toml"),
                         (["--coefficients", f"{home}/coefficients.toml", "--seed", "-1"], "--seed")):
        assert truearc.main([*train, *words]) == 2
        assert named in capsys.readouterr().err
