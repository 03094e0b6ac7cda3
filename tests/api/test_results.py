"""Results of the API: they print what the commands print, write what they write, and can be kept."""

import dataclasses
import json
import re
import shlex
from datetime import UTC, datetime
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from msgspec import structs

import truearc as ta
from tests.sim.discover.worlds import World, make_outcomes
from truearc.api.results import SavedFinding
from truearc.cli.main import main
from truearc.sim.discover.finding import FoundEffect

pytestmark = pytest.mark.slow
BELIEVE = ("gravity", "drag", "magnus")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The launcher slows down over the day, which no believed term models."""
    path = tmp_path_factory.mktemp("api") / "week"
    ta.save_dataset(path, make_outcomes(World(measured=True, speed_by_battery=0.05), 80, 3))
    return path


@pytest.fixture(scope="module")
def week(folder: Path) -> ta.Dataset:
    return ta.load_dataset(folder)


@pytest.fixture(scope="module")
def found(week: ta.Dataset) -> ta.Finding:
    return ta.discover(week, believe=BELIEVE, seed=0)


@pytest.fixture(scope="module")
def gate(week: ta.Dataset, found: ta.Finding) -> ta.GateTraining:
    return ta.train_gate(week, found.adopt(), seed=0)


def test_finding_equals_what_the_command_prints_and_writes(folder, week, found, tmp_path, capsys) -> None:
    out, page, adopted = tmp_path / "f.json", tmp_path / "f.html", tmp_path / "a.toml"
    words = ["discover", str(folder), "--believe", ",".join(BELIEVE), "--json", str(out), "--report", str(page),
             "--adopt", str(adopted), "--quiet"]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"{found}\nadopted: ") and printed.endswith(f" -> {adopted}\n")
    assert out.read_bytes() == found.to_json().encode()
    made_at = re.search(r'<p class="origin">(\S+ \S+) · truearc', page.read_text(encoding="utf-8"))[1]
    assert abs((datetime.now(UTC) - datetime.fromisoformat(made_at)).total_seconds()) < 600.0
    found.to_html(tmp_path / "api.html", made_at=made_at, command=f"truearc {shlex.join(words)}")
    assert page.read_bytes() == (tmp_path / "api.html").read_bytes()
    kept, own = ta.load_belief(adopted), found.adopt()
    new = {str(name).partition(" ")[0] for name in kept.provenance["adopted"]} & set(kept.coefficients)
    assert all(f"{term}.{name} {value:.3g}" in printed.splitlines()[-1]
               for term in new for name, value in kept.coefficients[term].items())
    assert (kept.coefficients, kept.scatter, kept.names) == (own.coefficients, own.scatter, own.names)
    assert kept.provenance == own.provenance | {"dataset": str(folder)}


def test_finding_is_read_back_as_it_was_written(found, tmp_path) -> None:
    path = tmp_path / "finding.json"
    path.write_text(found.to_json())
    kept = ta.load_finding(path)
    assert kept.record == found.record and str(kept) == str(found) and kept._repr_html_() == found._repr_html_()
    assert (kept.verdict, kept.effects, kept.to_json()) == (found.verdict, found.effects, found.to_json())
    path.write_text(found.to_json().replace("truearc.finding/1", "truearc.finding/9"))
    with pytest.raises(ta.InputError, match=r"finding\.json: schema: got 'truearc\.finding/9'"):
        ta.load_finding(path)


def test_finding_says_what_was_planted(found) -> None:
    assert found.verdict in ("named", "set") and found.p_value <= 0.05
    best = found.best
    low, high = best.interval90
    assert low < best.value < high and 0.0 < best.probability <= 1.0 and best.unit
    assert {one.term for one in found.alternatives} <= set(found.record.set)
    last = found.effects[-1].term
    turned = SavedFinding(structs.replace(found.record, verdict="set", set=(last,)))
    assert turned.best is not None and turned.best.term == last and turned.alternatives == ()
    beside = FoundEffect(found.record.what[-1:], (last,), None), FoundEffect(found.record.what[-1:], None, None)
    assert [one.term for one in SavedFinding(structs.replace(found.record, also=beside)).also] == [last]
    assert found.table().column("term") == [one.term for one in found.effects]
    assert json.loads(found.to_json())["schema"] == "truearc.finding/1"
    assert isinstance(found.plot_residuals(), Figure)


def test_shot_plan_equals_what_the_command_prints(folder, week, found, tmp_path, capsys) -> None:
    out = tmp_path / "next.json"
    assert main(["design", str(folder), "--believe", ",".join(BELIEVE), "--shots", "20", "--json", str(out),
                 "--quiet"]) == 0
    plan = ta.design_shots(week, found, shots=20)
    assert plan.verdict == found.verdict
    assert capsys.readouterr().out == f"{plan}\n" and out.read_text() == plan.to_json()
    assert sum(plan.table().column("shots")) == 20 or not plan.plan
    with pytest.raises(ta.InputError, match="at least one shot each"):
        ta.design_shots(week, found, shots=2, configurations=3)


def test_identifiability_equals_what_the_command_prints(folder, week, tmp_path, capsys) -> None:
    out = tmp_path / "sight.json"
    rig = folder / "rig.toml"
    assert main(["identifiability", str(rig), "--shots", "40", "--level", "L1", "--json", str(out), "--quiet"]) == 0
    season = ta.identifiability(week.rig, level="L1", shots=40, name="rig.toml")
    assert capsys.readouterr().out == f"{season}\n" and out.read_text() == season.to_json()
    needed = season.table().column("shots_needed")
    assert len(needed) > 20 and any(shots is None for shots in needed) and any(needed)
    assert len(ta.identifiability(week, believe=BELIEVE).table()) == len(needed)
    with pytest.raises(ta.InputError, match="own shots"):
        ta.identifiability(week, shots=40)


def test_gate_is_exported_as_the_commands_export_it(folder, week, found, gate, tmp_path, capsys) -> None:
    belief = tmp_path / "belief.toml"
    found.adopt().save(belief)
    assert main(["train", "--real", str(folder), "--coefficients", str(belief), "-o",
                 str(tmp_path / "weights"), "--quiet"]) == 0
    assert capsys.readouterr().out.startswith(f"{gate}\n")
    assert main(["export", str(tmp_path / "weights"), "-o", str(tmp_path / "command.onnx")]) == 0
    sha256 = gate.export(tmp_path / "gate.onnx")
    assert sha256 in capsys.readouterr().out
    assert (tmp_path / "gate.onnx").read_bytes() == (tmp_path / "command.onnx").read_bytes()
    assert set(gate.record["recorded"]) == set(week.shots.shot_id)
    assert 0.0 <= gate.holdout.brier < 0.5 and isinstance(gate.plot_reliability(), Figure)
    assert main(["predict", "--gate", str(tmp_path / "gate.onnx"), str(folder)]) == 0
    rated = ta.predict(week, gate=tmp_path / "gate.onnx")
    assert capsys.readouterr().out == rated.to_csv() and len(rated) == len(week.shots)


def test_predictions_equal_what_the_command_prints(folder, week, found, tmp_path, capsys) -> None:
    belief = tmp_path / "belief.toml"
    found.adopt().save(belief)
    assert main(["predict", str(folder), "--coefficients", str(belief)]) == 0
    told = ta.predict(week, found.adopt())
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split(",") == list(told.columns) and len(lines) == len(told) + 1
    for line, (name, height_m, deviation_m, outcome, note) in zip(lines[1:], told.rows, strict=True):
        assert line == (f"{name},{height_m:.9f},{deviation_m:.9f},{outcome},{note}" if height_m is not None
                        else f"{name},,,{outcome},{note}")
    for arguments in ({}, {"belief": found.adopt(), "gate": "gate.onnx"}):
        with pytest.raises(ta.InputError, match="either a belief or gate"):
            ta.predict(week, **arguments)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"believe": ["gravity", "drag", "drag"]}, "believe: names drag more than once; keep one"),
    ({"believe": ["gravity", "magic"]}, "believe: there is no term 'magic'"),
    ({"believe": "gravity"}, "believe: 'gravity' is one string"), ({"believe": []}, "believe: names no term"),
    ({"believe": ["gravity", "free_push"]}, "free_push"), ({"seed": -1}, "seed: -1 is negative"),
    ({"false_alarm": 1.5}, "false_alarm: 1.5 is not between"), ({"measured": {"wind_x": (1.0, 0.0)}}, "wind_x"),
    ({"measured": {"magic": (1.0, 0.1)}}, "'magic'"), ({"terms": []}, "there is no term")])
def test_what_discovery_cannot_do_is_said(week, arguments, message) -> None:
    with pytest.raises(ta.InputError, match=message):
        ta.discover(week, **arguments)


def test_since_needs_the_belief_of_the_same_rig(week, found) -> None:
    with pytest.raises(ta.InputError, match="since goes with belief"):
        ta.discover(week, since=week)
    with pytest.raises(ta.InputError, match="exclude each other"):
        ta.discover(week, belief=found.adopt(), believe=BELIEVE)
    rig = ta.dataset({"shot_id": ["a"]}, rig={"ball": {"mass_kg": 1.0, "radius_m": 1.0}}).rig
    other = dataclasses.replace(week, facts=rig)
    with pytest.raises(ta.InputError, match=r"another rig: rig\.toml: ball\.mass_kg: 1\.0 there, 0\.14 in ") as error:
        ta.discover(week, belief=found.adopt(), since=other)
    assert "free_speed_rad_s: not stated there, 594" in str(error.value) and "Wheel(" not in str(error.value)
