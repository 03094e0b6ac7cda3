"""A team's log under its own names becomes the shots that were recorded, and what is wrong with it is named."""

import csv
import itertools
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

import truearc as ta
from tests.sim.data import stranger_log
from tests.sim.data.stranger_log import write_stranger_log
from truearc.cli.main import main
from truearc.robot.config.shot_map import load_map
from truearc.robot.recording.session import load_trials
from truearc.sim.data.guess_map import _meaning
from truearc.sim.data.log import Series, read_csv_log
from truearc_frc.wpilog import WpilogWriter, make_payload, read_wpilog

pytest.importorskip("wpiutil")
COMPARED = ("distance_m", "hood_deg", "motor_ratio", "battery_v", "t_s", "since_last_shot_s")
TRIALS = 24


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Practice of the emulated robot."""
    path = tmp_path_factory.mktemp("practice") / "monday"
    assert main(["emulate", "--trials", str(TRIALS), "--seed", "5", "--out", str(path), "--quiet"]) == 0
    return path


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


def test_a_strangers_log_is_guessed_to_the_shots_that_were_recorded(log: Path, rig: Path, recorded: ta.Dataset,
                                                                    tmp_path: Path,
                                                                    capsys: pytest.CaptureFixture[str]) -> None:
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


HITS = ("two", "three")


@pytest.fixture(scope="module")
def hit_rig(rig: Path) -> Path:
    """The same of a target at which every hit counts alike."""
    path = rig.with_name("hit.toml")
    path.write_text("".join(line for line in rig.read_text().splitlines(keepends=True) if "three_half_h" not in line))
    return path


def write_scored(session: Path, path: Path, monkeypatch: pytest.MonkeyPatch, scored: Callable[[float], bool]) -> None:
    """The log with a boolean of outcomes in place of the text."""
    signals = {name: said for name, said in stranger_log.SIGNALS.items() if "ShotResult" not in name}
    plain_values = stranger_log._values
    monkeypatch.setattr(stranger_log, "SIGNALS", {**signals, "/RealOutputs/Scored": ("bool", "")})
    monkeypatch.setattr(stranger_log, "load_trials", lambda session: [])
    monkeypatch.setattr(stranger_log, "_values", lambda tick, free: {
        **plain_values(tick, free), "/RealOutputs/Scored": scored(tick.inputs.t_ns * 1e-9)})
    write_stranger_log(session, path)
    monkeypatch.undo()


def hit_times(session: Path) -> tuple[list[float], list[tuple[float, bool]]]:
    """(when hits were marked, [(when a trial was marked, whether it hit)])."""
    marks = [trial.outcome for trial in load_trials(session) if trial.outcome.outcome != "rejected"]
    trials = sorted((mark.t_ns * 1e-9, mark.outcome.startswith(HITS)) for mark in marks)
    return [t_s for t_s, hit in trials if hit], trials


def test_a_boolean_that_is_true_for_a_moment_after_a_hit_makes_no_miss_of_its_fall(
        session: Path, hit_rig: Path, recorded: ta.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    hits, _ = hit_times(session)
    write_scored(session, tmp_path / "monday.wpilog", monkeypatch,
                 lambda now: any(0.0 <= now - t_s < 0.5 for t_s in hits))
    assert main(["import", "wpilog", str(tmp_path / "monday.wpilog"), "--guess", "--rig", str(hit_rig), "-o",
                 str(tmp_path / "found")]) == 0
    assert "true for a moment after a hit; shots without it are left out" in capsys.readouterr().out
    found = ta.load_dataset(tmp_path / "found").shots
    truth = [text.startswith(HITS) for text in recorded.shots.text("outcome")]
    assert 4 < len(found) == sum(truth) < len(truth) and set(found.text("outcome")) == {"two"}
    text = (tmp_path / "found" / "shots.toml").read_text()
    (tmp_path / "all.toml").write_text(text.replace("[outcome]", '[outcome]\notherwise = "miss"'))
    every = ta.import_shots([tmp_path / "monday.wpilog"], rig=hit_rig, shot_map=tmp_path / "all.toml").shots
    at = [int(np.abs(every.number("t_s") - t_s).argmin()) for t_s in recorded.shots.number("t_s")]
    assert [every.text("outcome")[row] == "two" for row in at] == truth


@pytest.mark.parametrize(("runs", "shots", "meant"), [
    ([(1.0, 1.5), (9.0, 9.5)], [0.0, 4.0, 8.0], {"true": "hit"}),
    ([(1.0, 5.0), (9.0, 13.0)], [0.0, 4.0, 8.0, 12.0], {"true": "hit", "false": "miss"}),
    ([(1.0, 5.0)], [0.0, 4.0], {}),                         # once may be by chance
    ([(1.0, 2.5), (3.0, 4.5)], [0.0, 2.0, 4.0], {}),        # a fast stream: the pulse lasts beyond the next shot
    ([(1.0, 4.1), (9.0, 12.1)], [0.0, 4.0, 8.0, 12.0], {}), # cleared as the next ball is fed
    ([(1.0, 5.0), (9.0, 9.5)], [0.0, 4.0, 8.0], {}), ([], [0.0, 4.0], {})])
def test_what_a_boolean_means_is_left_open_in_doubt(runs: list[tuple[float, float]], shots: list[float],
                                                    meant: dict[str, str]) -> None:
    edges = [(-1.0, 0.0), *(edge for up, down in runs for edge in ((up, 1.0), (down, 0.0)))]
    series = Series("Scored", np.array([t_s for t_s, _ in edges]), np.array([value for _, value in edges]))
    values, said = _meaning(series, np.array(shots))
    assert values == meant and ("left out:" in said) == (not meant)


def test_without_a_feeder_every_shot_is_found_from_its_dip_at_fifty_hertz(session: Path, rig: Path,
                                                                          recorded: ta.Dataset, tmp_path: Path) -> None:
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


def test_arrays_and_structs_have_their_parts(tmp_path: Path) -> None:
    with (tmp_path / "a.wpilog").open("wb") as file:
        log = WpilogWriter(file, "")
        speeds = log.start("Speeds", "floats", "", 0)
        log.append(speeds, 10, make_payload("floats", [1.0, 2.0]) or b"")
        pose = log._signals + 1
        log._record(0, 0, struct.pack("<BI", 0, pose) + b"".join(struct.pack("<I", len(text)) + text
                                                                 for text in (b"Pose", b"struct:Pose2d", b"")))
        log.append(pose, 20, struct.pack("<3d", 3.0, 4.0, 5.0))
    found = read_wpilog(tmp_path / "a.wpilog")
    assert {name: float(series.values[0]) for name, series in found.items()} == {
        "Speeds/0": 1.0, "Speeds/1": 2.0, "Pose/translation/x": 3.0, "Pose/translation/y": 4.0,
        "Pose/rotation/value": 5.0}


@pytest.mark.parametrize(("text", "said"), [
    ("", "schema: missing key"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhod_deg = "x"', "columns.hod_deg: there is no such column"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhood_deg = { key = "/Hood/PivotPositionRad", unit = "V" }',
     "columns.hood_deg.unit: 'V' is not a unit of hood_deg"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhood_deg = "/Hood/Pivot"', "no signal /Hood/Pivot; did you mean"),
    ('schema = "truearc.shot-map/1"\n[columns]\nhood_deg = "/Hood/PivotPositionRad"', "name no wheel"),
    ('schema = "truearc.shot-map/1"\n[columns]\nmotor_rad_s = "/SystemStats/BatteryVoltage"',
     "'V' is not a unit of motor_rad_s"),
    ('schema = "truearc.shot-map/1"\n[outcome.values]\nin = "goal"', "outcome: in = 'goal': is none of"),
])
def test_a_wrong_map_is_named_by_file_and_key(text: str, said: str, log: Path, rig: Path, tmp_path: Path,
                                              capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "shots.toml").write_text(text)
    assert main(["import", "wpilog", str(log), "--map", str(tmp_path / "shots.toml"), "--rig", str(rig), "-o",
                 str(tmp_path / "found")]) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "found").exists()


@pytest.mark.parametrize(("arguments", "said"), [
    (["--guess"], "--rig RIG.toml is needed"), (["--rig", "RIG"], "--map MAP is needed, or --guess"),
    (["--rig", "RIG", "--map", "wpilab"], "an installed map (advantagekit, ftc-csv"),
])
def test_what_is_missing_is_said(arguments: list[str], said: str, log: Path, rig: Path, tmp_path: Path,
                                 capsys: pytest.CaptureFixture[str]) -> None:
    words = [str(rig) if word == "RIG" else word for word in arguments]
    assert main(["import", "wpilog", str(log), *words, "-o", str(tmp_path / "found")]) == 2
    assert said in capsys.readouterr().err


def test_what_is_no_log_is_refused(rig: Path, tmp_path: Path) -> None:
    (tmp_path / "a.wpilog").write_bytes(b"no log at all")
    with pytest.raises(ta.InputError, match="is not a WPILOG"):
        ta.import_shots([tmp_path / "a.wpilog"], rig=rig)
    (tmp_path / "a.csv").write_text("Timestamp,v\n0,1\nx,2\n")
    with pytest.raises(ta.InputError, match=r"a\.csv:3: 'x' is not a time"):
        ta.import_shots([tmp_path / "a.csv"], rig=rig)
    (tmp_path / "b.csv").write_text("Timestamp,v\n0,1\n1,2\n")
    with pytest.raises(ta.InputError, match="no signal's name, unit and numbers look like distance_m, hood_deg, "):
        ta.import_shots([tmp_path / "b.csv"], rig=rig)


def test_times_in_milliseconds_are_seconds(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("ms,v\n0,1\n500,true\n1000,\n")
    series = read_csv_log(tmp_path / "a.csv", "ms", 1000.0)["v"]
    assert series.t_s.tolist() == [0.0, 0.5] and np.asarray(series.values).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("name", ["advantagekit", "wpilib", "viking-2928", "ftc-csv", "tracker", "kinovea", "truearc"])
def test_a_map_that_comes_with_truearc_can_be_read_and_says_what_it_is_for(name: str) -> None:
    assert load_map(name).columns and len(load_map(name).about) > 20


def test_a_session_that_was_exported_is_read_with_its_poses_and_its_shots(session: Path, rig: Path,
                                                                          recorded: ta.Dataset, tmp_path: Path) -> None:
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
    assert load_map(tmp_path / "found" / "shots.toml") == structs.replace(load_map("truearc"), about="")


def test_json_has_its_parts_and_what_is_none_is_a_text(tmp_path: Path) -> None:
    with (tmp_path / "a.wpilog").open("wb") as file:
        log = WpilogWriter(file, "")
        number = log.start("/J", "json", "", 0)
        for t_us, text in enumerate(('{"a": {"b": [1, true, null, "x"]}}', "{", '{"a": {"b": [2]}}')):
            log.append(number, t_us, text.encode())
    found = read_wpilog(tmp_path / "a.wpilog")
    assert set(found) == {"/J", "/J/a/b/0", "/J/a/b/1", "/J/a/b/3"} and len(found["/J"].values) == 3
    assert list(found["/J/a/b/0"].values) == [1.0, 2.0] and found["/J/a/b/3"].values == ("x",)
