"""truearc design as a user types it; what a plan looks like as text."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import truearc.cli.main as truearc
from tests.sim.discover.straight import FACTS as STRAIGHT
from tests.sim.discover.straight import fit_straight
from tests.sim.discover.worlds import FACTS
from truearc.api.discovery import ShotDesign
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import save_dataset
from truearc.sim.discover.decide import Search, Step, decide
from truearc.sim.discover.next_steps import Block, Design, make_design
from truearc.sim.discover.report.pages import design_lines, design_table
from truearc.sim.physics.catalogue import as_catalogue


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


def test_wheels_that_shall_run_otherwise_and_what_must_be_alike_are_said() -> None:
    shots = Shots(("a", "b"), {"distance_m": np.array([3.0, 4.0]), "motor_ratio": np.array([0.4, 0.5])}, {})
    design = Design(("drag_wear.share", "wheel_slip.loss_per_m_s"), np.array([0.5, 0.5]),
                    (Block(1, 20, 1.06), Block(1, 20), Block(1, 20, 1.06)), 0.0, 0.5, None, ())
    step = SimpleNamespace(fitted=SimpleNamespace(scores=SimpleNamespace(rows=np.arange(2))))
    table = design_table(design, Dataset("d", STRAIGHT, shots), cast(Step, step))
    faster, plain = (one for one in table["next"] if one["do"] == "shoot")
    assert (faster["shots"], faster["motor_ratio"], faster["pace"]) == (40, pytest.approx(0.53), 1.06)
    assert (plain["shots"], plain["motor_ratio"]) == (20, 0.5) and "pace" not in plain
    lines = "\n".join(design_lines(table))
    assert "as shot b, wheels 6% faster" in lines and "a ball that has been shot as often" in lines


@pytest.mark.parametrize(("level", "said"), [("L0", False), ("L1", True), ("L2", False)])
def test_planned_shots_are_said_to_be_unproven_with_telemetry(level: str, said: bool) -> None:
    plan = {"names": {"drag": 0.6, "wind_x": 0.4}, "as_then": [], "probability_before": 0.1, "probability_after": 0.5,
            "random_shots_worth_as_much": 300, "next": []}
    lines = ShotDesign("It is one of two.", "set", plan, as_catalogue(None), level).lines()
    assert any("have not shown" in line for line in lines) is said


def test_nothing_to_tell_apart_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shots = Shots(tuple(map(str, range(20))), {"distance_m": np.linspace(2.0, 6.0, 20)}, {})
    save_dataset(tmp_path / "mute", Dataset("mute", FACTS, shots))
    out = tmp_path / "next.json"
    assert truearc.main(["design", str(tmp_path / "mute"), "--json", str(out), "--quiet"]) == 0
    assert "no names to tell apart" in capsys.readouterr().out
    assert json.loads(out.read_text()) == {"schema": "truearc.design/1", "verdict": "none", "next": []}


@pytest.mark.parametrize(("words", "message"), [
    (["nowhere"], "nowhere"), (["d", "--shots", "2", "--configurations", "3"], "--configurations 3"),
    (["d", "--seed", "-1"], "--seed"), (["d", "--false-alarm", "0"], "--false-alarm")])
def test_what_cannot_be_done_is_said(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert truearc.main(["design", *words]) == 2
    assert message in capsys.readouterr().err
