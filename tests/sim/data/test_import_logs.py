"""Sessions and a team's log under its own names become the shots that were recorded; what is wrong is named."""

import csv
import itertools
import math
import shutil
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

import truearc as ta
from tests.sim.data import stranger_log
from tests.sim.data.stranger_log import write_stranger_log
from truearc import robot
from truearc.cli.main import main
from truearc.robot.config.schema import load_config
from truearc.robot.config.shot_map import load_map
from truearc.robot.recording.session import TRIALS, load_trials
from truearc.sim.data.log import Series, state_or_pulse
from truearc.sim.data.recordings import label_by_repeatability, rule, shots_from_sessions
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.options import Options
from truearc_frc.wpilog import WpilogWriter, read_wpilog

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")


@pytest.fixture(scope="module")
def practice(tmp_path_factory):
    """(folder, balls) of the emulated robot."""
    folder = tmp_path_factory.mktemp("practice") / "monday"
    config = replace(CONFIG, collect=replace(CONFIG.collect, repeats=3))
    return folder, emulate(config, folder, trials=12, seed=11)


def test_shots_say_what_the_robot_measured_and_the_driver_marked(practice):
    folder, results = practice
    shots = shots_from_sessions([folder], "d").shots
    by_trial = {trial.outcome.trial: trial for trial in load_trials(folder) if trial.outcome.outcome != "rejected"}
    assert len(shots) == len(by_trial)
    for row, trial in enumerate(by_trial.values()):
        result = min(results, key=lambda ball: abs(ball.fed_t_ns - trial.shot.t_ns))
        kind, _, side = result.outcome.partition("-")
        assert (shots.text("outcome")[row], shots.text("side")[row]) == (kind, side)
        assert shots.number("distance_m")[row] == pytest.approx(result.distance_m, abs=0.06)
        assert shots.number("motor_ratio")[row] * 594.0 == pytest.approx(result.wheel_before_rad_s, rel=0.01)


def test_traces_show_the_wheel_droop_that_the_world_had(practice):
    folder, results = practice
    dataset = shots_from_sessions([folder], "d")
    traces = dataset.traces
    signal = np.array(traces.signal)
    for row in range(len(dataset.shots)):
        mine = (traces.shot == row) & (signal == "wheel_lower_rad_s")
        t_s, value = traces.t_s[mine], traces.value[mine]
        assert np.all(np.diff(t_s) > 0) and t_s[0] >= -0.11 and t_s[-1] <= 0.71
        droop = 1.0 - value[(t_s > 0)].min() / value[t_s <= 0].mean()
        truth = 1.0 - results[row].wheel_after_rad_s / results[row].wheel_before_rad_s
        assert droop == pytest.approx(truth, abs=0.025)


@pytest.mark.parametrize(("r2", "r3", "label"), [
    (1.0, 1.0, "three"), (1.0, 0.8, "three"), (1.0, 0.79, "two"), (0.95, 0.0, "two"), (0.8, 0.5, "two"),
    (0.74, 0.7, None), (0.5, 0.0, None), (0.0, 0.0, "miss")])
def test_the_papers_rule(r2, r3, label):
    assert rule(r2, r3) == label


def test_labelling_groups_by_configuration(practice, tmp_path):
    dataset = shots_from_sessions([practice[0]], "d")
    labelled = label_by_repeatability(dataset)
    groups = {}
    for config_id, outcome in zip(dataset.shots.text("config_id"), dataset.shots.text("outcome"), strict=True):
        groups.setdefault(config_id, []).append(outcome)
    expected = [rule(1.0 - said.count("miss") / len(said), said.count("three") / len(said)) for said in groups.values()]
    assert list(labelled.shots.text("outcome")) == [label for label in expected if label is not None]
    assert len(labelled.shots) + sum("not repeatable" in line for line in labelled.left_out) == len(groups)
    ta.save_dataset(tmp_path / "labelled", labelled)
    assert len(ta.load_dataset(tmp_path / "labelled").shots) == len(labelled.shots)


def test_session_without_a_marked_shot_is_refused(practice, tmp_path):
    held = shutil.copytree(practice[0], tmp_path / "held")
    rows = [replace(trial, outcome=replace(trial.outcome, outcome="rejected")) for trial in load_trials(held)]
    (held / TRIALS).write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in rows))
    with pytest.raises(ta.InputError, match="no marked shots"):
        shots_from_sessions([held], "d")


def test_what_is_no_session_is_named(tmp_path, capsys):
    assert main(["shots", str(tmp_path), "-o", str(tmp_path / "d")]) == 2
    assert "session.json" in capsys.readouterr().err


def test_two_sessions_of_one_name_are_refused(practice, tmp_path):
    with pytest.raises(ta.InputError, match="unique"):
        shots_from_sessions([practice[0], practice[0]], "d")


def test_why_no_ball_was_launched_is_said(tmp_path):
    """The hood's encoder is off by more than the screw's count allows: the robot holds every shot."""
    played = ta.emulate(CONFIG, tmp_path / "held", 1, 1, Options(hood_offset_deg=2.0))
    assert played.balls == () and set(played.held.values()) == {1}
    assert any(line.startswith("held 1 time: hood encoder ") for line in played.lines())


def test_trials_that_are_cut_short_are_said_to_be_missing(practice, tmp_path, capsys):
    cut = shutil.copytree(practice[0], tmp_path / "cut")
    rows = (cut / TRIALS).read_bytes()
    (cut / TRIALS).write_bytes(rows[:len(rows) * 2 // 3])
    assert main(["shots", str(cut), "-o", str(tmp_path / "d")]) == 0
    assert "trials.jsonl: cut short: trials after that are missing; truearc session recover" in capsys.readouterr().err
    assert "cut short" in ta.load_dataset(tmp_path / "d").left_out[0]


COMPARED = ("distance_m", "hood_deg", "motor_ratio", "battery_v", "t_s", "since_last_shot_s")


@pytest.fixture(scope="module")
def session(practice: Any) -> Path:
    pytest.importorskip("wpiutil")
    return practice[0]


@pytest.fixture(scope="module")
def recorded(session: Path) -> ta.Dataset:
    return ta.shots_from_sessions([session], "monday")


@pytest.fixture(scope="module")
def rig(recorded: ta.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig")
    ta.save_dataset(path / "data", recorded)
    return path / "data" / "rig.toml"


@pytest.fixture(scope="module")
def log(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "monday.wpilog"
    write_stranger_log(session, path)
    return path


def same(found: ta.Dataset, recorded: ta.Dataset, columns: tuple[str, ...] = COMPARED, rtol: float = 1e-12) -> None:
    assert found.shots.text("outcome") == recorded.shots.text("outcome")
    assert found.shots.text("side") == recorded.shots.text("side")
    for column in columns:
        np.testing.assert_allclose(found.shots.number(column), recorded.shots.number(column), rtol=rtol, atol=1e-9)


def test_a_strangers_log_is_guessed_to_the_shots_that_were_recorded(log, rig, recorded, tmp_path, capsys):
    assert main(["import", "wpilog", str(log), "--guess", "--rig", str(rig), "-o", str(tmp_path / "found")]) == 0
    assert "distance_m: /RealOutputs/Vision/DistanceToHubMeters" in capsys.readouterr().out
    same(ta.load_dataset(tmp_path / "found"), recorded)
    again = ta.import_shots([log], rig=rig, shot_map=tmp_path / "found" / "shots.toml")      # what was written is a map
    same(again, recorded)


@pytest.mark.parametrize("feeder", [True, False])
def test_a_speed_that_is_no_number_is_left_out_and_a_distance_is_unknown(
        feeder: bool, session: Path, rig: Path, recorded: ta.Dataset, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch) -> None:
    plain_values, count = stranger_log._values, itertools.count()
    first_s, odd = float(recorded.shots.number("t_s")[0]), {5: math.nan, 300: math.inf}

    def damaged(tick: Any, free: float) -> dict[str, Any]:
        found, number = plain_values(tick, free), next(count)
        found["/Shooter/FlywheelVelocityRadPerSec"] = odd.get(number, found["/Shooter/FlywheelVelocityRadPerSec"])
        if abs(tick.inputs.t_ns * 1e-9 - first_s) < 0.3:
            found["/RealOutputs/Vision/DistanceToHubMeters"] = math.inf
        return found

    monkeypatch.setattr(stranger_log, "_values", damaged)
    write_stranger_log(session, tmp_path / "monday.wpilog", feeder)
    found = ta.import_shots([tmp_path / "monday.wpilog"], rig=rig)
    same(found, recorded, ("hood_deg",))
    assert [line for line in found.left_out if "finite" in line] == [
        "monday.wpilog: /Shooter/FlywheelVelocityRadPerSec: samples that are not finite: 2"]
    assert np.isnan(found.shots.number("distance_m")[0])
    assert np.isfinite(found.shots.number("distance_m")[1:]).all()


@pytest.mark.parametrize(("runs", "shots", "meant"), [
    ([(1.0, 1.5), (9.0, 9.5)], [0.0, 4.0, 8.0], {"true": "hit"}),
    ([(1.0, 5.0), (9.0, 13.0)], [0.0, 4.0, 8.0, 12.0], {"true": "hit", "false": "miss"}),
    ([(1.0, 5.0)], [0.0, 4.0], {}),                         # once may be by chance
    ([(1.0, 2.5), (3.0, 4.5)], [0.0, 2.0, 4.0], {}),        # a fast stream: the pulse lasts beyond the next shot
    ([(1.0, 4.1), (9.0, 12.1)], [0.0, 4.0, 8.0, 12.0], {}), # cleared as the next ball is fed
    ([(1.0, 5.0), (9.0, 9.5)], [0.0, 4.0, 8.0], {}), ([], [0.0, 4.0], {})])
def test_what_a_boolean_means_is_left_open_in_doubt(runs, shots, meant):
    edges = [(-1.0, 0.0), *(edge for up, down in runs for edge in ((up, 1.0), (down, 0.0)))]
    series = Series("Scored", np.array([t_s for t_s, _ in edges]), np.array([value for _, value in edges]))
    values, said = state_or_pulse(series, np.array(shots))
    assert values == meant and ("left out:" in said) == (not meant)


def test_without_a_feeder_every_shot_is_found_from_its_dip_at_fifty_hertz(session, rig, recorded, tmp_path):
    write_stranger_log(session, tmp_path / "monday.wpilog", feeder=False, every=4)
    found = ta.import_shots([tmp_path / "monday.wpilog"], rig=rig)
    same(found, recorded, ("hood_deg",))
    assert np.abs(found.shots.number("distance_m") - recorded.shots.number("distance_m")).max() < 0.1
    assert np.abs(found.shots.number("motor_ratio") / recorded.shots.number("motor_ratio") - 1.0).max() < 0.01
    waited = found.shots.number("t_s") - recorded.shots.number("t_s")
    assert (waited > 0.0).all() and (waited < 0.3).all()             # a ball needs a moment from feeder to wheels


def as_list(log: Path, path: Path) -> None:
    """The same log as AdvantageScope exports it: a line a value."""
    rows = sorted((float(t_s), name, value) for name, series in read_wpilog(log).items()
                  for t_s, value in zip(series.t_s, series.values, strict=True))
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("Timestamp", "Key", "Value"), *((repr(t_s), name, value)
                                                                      for t_s, name, value in rows)])


def test_a_csv_list_of_values_gives_the_same(log: Path, rig: Path, recorded: ta.Dataset, tmp_path: Path) -> None:
    as_list(log, tmp_path / "monday.csv")
    same(ta.import_shots([tmp_path / "monday.csv"], rig=rig), recorded)


def test_a_csv_table_of_loops_gives_the_same(log: Path, rig: Path, recorded: ta.Dataset, tmp_path: Path) -> None:
    """A row a loop of 50 Hz, every value in every row: a mark counts once, where it appears."""
    signals = read_wpilog(log)
    times = np.arange(0.0, max(series.t_s[-1] for series in signals.values()) + 1.0, 0.02)
    with (tmp_path / "monday.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["Timestamp", *signals])
        for t_s in times:
            fresh = {name: series.before(t_s) for name, series in signals.items()}
            mark = signals["/RealOutputs/ShotResult"]
            if mark.before(t_s) is not None and not ((t_s - mark.t_s[mark.t_s <= t_s].max()) < 0.5):
                fresh["/RealOutputs/ShotResult"] = ""                # the program clears it
            writer.writerow([f"{t_s:.3f}", *("" if value is None else value for value in fresh.values())])
    found = ta.import_shots([tmp_path / "monday.csv"], rig=rig)
    same(found, recorded, ("hood_deg",))


@pytest.mark.parametrize(("text", "said"), [
    ("", "shots.toml: is an empty file; a map of columns (shots.toml) is expected"),
    ('about = "mine"', "schema: missing key"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhod_deg = "x"', "columns.hod_deg: there is no such column"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhood_deg = { key = "/Hood/PivotPositionRad", unit = "V" }',
     "columns.hood_deg.unit: 'V' is not a unit of hood_deg"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhood_deg = "/Hood/Pivot"', "no signal /Hood/Pivot; did you mean"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhood_deg = "/Hood/PivotPositionRad"', "name no wheel"),
    ('schema = "truearc.shot-map/1"\n[columns]\nmotor_rad_s = "/SystemStats/BatteryVoltage"',
     "'V' is not a unit of motor_rad_s"),
    ('schema = "truearc.shot-map/1"\n[outcome.values]\nin = "goal"', "outcome: in = 'goal': is none of")])
def test_a_wrong_map_is_named_by_file_and_key(text, said, log, rig, tmp_path, capsys):
    (tmp_path / "shots.toml").write_text(text)
    assert main(["import", "wpilog", str(log), "--map", str(tmp_path / "shots.toml"), "--rig", str(rig), "-o",
                 str(tmp_path / "found")]) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "found").exists()


def test_what_is_no_log_is_refused(rig: Path, tmp_path: Path) -> None:
    (tmp_path / "a.wpilog").write_bytes(b"no log at all")
    with pytest.raises(ta.InputError, match="is not a WPILOG"):
        ta.import_shots([tmp_path / "a.wpilog"], rig=rig)
    loops = "".join(f"{k / 50},1\n" for k in range(30))
    (tmp_path / "a.csv").write_text(f"Timestamp,v\n0,1\nx,2\n{loops}")
    with pytest.raises(ta.InputError, match=r"a\.csv:3: 'x' is not a time"):
        ta.import_shots([tmp_path / "a.csv"], rig=rig)
    (tmp_path / "b.csv").write_text(f"Timestamp,v\n{loops}")
    with pytest.raises(ta.InputError, match="no signal's name, unit and numbers look like distance_m, hood_deg, "):
        ta.import_shots([tmp_path / "b.csv"], rig=rig)


@pytest.mark.parametrize("name", ["advantagekit", "wpilib", "viking-2928", "ftc-csv", "tracker", "kinovea", "truearc"])
def test_a_map_that_comes_with_truearc_can_be_read_and_says_what_it_is_for(name: str) -> None:
    assert load_map(name).columns and len(load_map(name).about) > 20


def test_a_session_that_was_exported_is_read_with_its_poses_and_its_shots(session, rig, recorded, tmp_path):
    out = tmp_path / "monday.wpilog"
    assert main(["session", "convert", str(session), "--to", "wpilog", "-o", str(out), "--quiet"]) == 0
    log, ticks = read_wpilog(out), list(ta.Recording(session))
    at_s = ticks[-1].inputs.t_ns * 1e-9
    assert log["/pose/translation/x"].before(at_s) == ticks[-1].estimate.distance_m is not None
    assert log["/pose/translation/y"].before(at_s) == 0.0 and log["DS:enabled"].before(at_s) == ticks[-1].memory.armed
    assert log["/estimate/hood_deg"].unit == "deg" and "systemTime" not in log
    assert main(["import", "wpilog", str(out), "--guess", "--rig", str(rig), "-o", str(tmp_path / "found"),
                 "--quiet"]) == 0
    same(ta.load_dataset(tmp_path / "found"), recorded)
    assert load_map(tmp_path / "found" / "shots.toml") == load_map("truearc")


def test_json_has_its_parts_and_what_is_none_is_a_text(tmp_path: Path) -> None:
    pytest.importorskip("wpiutil")
    with (tmp_path / "a.wpilog").open("wb") as file:
        log = WpilogWriter(file, "")
        number = log.start("/J", "json", "", 0)
        for t_us, text in enumerate(('{"a": {"b": [1, true, null, "x"]}}', "{", '{"a": {"b": [2]}}')):
            log.append(number, t_us, text.encode())
    found = read_wpilog(tmp_path / "a.wpilog")
    assert set(found) == {"/J", "/J/a/b/0", "/J/a/b/1", "/J/a/b/3"} and len(found["/J"].values) == 3
    assert list(found["/J/a/b/0"].values) == [1.0, 2.0] and found["/J/a/b/3"].values == ("x",)
