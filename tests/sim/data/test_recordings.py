"""Sessions to shots, and the paper's labelling rule."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

import truearc as ta
from truearc import robot
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.config.schema import load_config
from truearc.robot.recording.session import TRIALS, load_trials
from truearc.sim.data.files import load_dataset, save_dataset
from truearc.sim.data.recordings import label_by_repeatability, rule, shots_from_sessions
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.options import Options

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings") / "monday"
    config = replace(CONFIG, collect=replace(CONFIG.collect, repeats=3))
    return folder, emulate(config, folder, trials=6, seed=11)


def test_shots_say_what_the_robot_measured_and_the_driver_marked(session):
    folder, results = session
    shots = shots_from_sessions([folder], "d").shots
    by_trial = {trial.outcome.trial: trial for trial in load_trials(folder) if trial.outcome.outcome != "rejected"}
    assert len(shots) == len(by_trial)
    for row, trial in enumerate(by_trial.values()):
        result = min(results, key=lambda ball: abs(ball.fed_t_ns - trial.shot.t_ns))
        kind, _, side = result.outcome.partition("-")
        assert (shots.text("outcome")[row], shots.text("side")[row]) == (kind, side)
        assert shots.number("distance_m")[row] == pytest.approx(result.distance_m, abs=0.06)
        assert shots.number("motor_ratio")[row] * 594.0 == pytest.approx(result.wheel_before_rad_s, rel=0.01)


def test_traces_show_the_wheel_droop_that_the_world_had(session):
    folder, results = session
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
    (0.74, 0.7, None), (0.5, 0.0, None), (0.0, 0.0, "miss"),
])
def test_the_papers_rule(r2, r3, label):
    assert rule(r2, r3) == label


def test_labelling_groups_by_configuration(session, tmp_path):
    dataset = shots_from_sessions([session[0]], "d")
    labelled = label_by_repeatability(dataset)
    groups = {}
    for config_id, outcome in zip(dataset.shots.text("config_id"), dataset.shots.text("outcome"), strict=True):
        groups.setdefault(config_id, []).append(outcome)
    expected = [rule(1.0 - said.count("miss") / len(said), said.count("three") / len(said)) for said in groups.values()]
    assert list(labelled.shots.text("outcome")) == [label for label in expected if label is not None]
    assert len(labelled.shots) + sum("not repeatable" in line for line in labelled.left_out) == len(groups)
    save_dataset(tmp_path / "labelled", labelled)
    assert len(load_dataset(tmp_path / "labelled").shots) == len(labelled.shots)


def test_session_without_a_marked_shot_is_refused(session, tmp_path):
    held = shutil.copytree(session[0], tmp_path / "held")
    rows = [replace(trial, outcome=replace(trial.outcome, outcome="rejected")) for trial in load_trials(held)]
    (held / TRIALS).write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in rows))
    with pytest.raises(InputError, match="no marked shots"):
        shots_from_sessions([held], "d")


def test_what_is_no_session_is_named(tmp_path, capsys):
    assert main(["shots", str(tmp_path), "-o", str(tmp_path / "d")]) == 2
    assert "session.json" in capsys.readouterr().err


def test_two_sessions_of_one_name_are_refused(session, tmp_path):
    with pytest.raises(InputError, match="unique"):
        shots_from_sessions([session[0], session[0]], "d")


def test_why_no_ball_was_launched_is_said(tmp_path):
    """The hood's encoder is off by more than the screw's count allows: the robot holds every shot."""
    played = ta.emulate(CONFIG, tmp_path / "held", 2, 1, Options(hood_offset_deg=2.0))
    assert played.balls == () and set(played.held.values()) == {2}
    assert any(line.startswith("held 2 times: hood encoder ") for line in played.lines())


def test_trials_that_are_cut_short_are_said_to_be_missing(session, tmp_path, capsys):
    cut = shutil.copytree(session[0], tmp_path / "cut")
    rows = (cut / TRIALS).read_bytes()
    (cut / TRIALS).write_bytes(rows[:len(rows) * 2 // 3])
    assert main(["shots", str(cut), "-o", str(tmp_path / "d")]) == 0
    assert "trials.jsonl: cut short: trials after that are missing; truearc session recover" in capsys.readouterr().err
    assert "cut short" in load_dataset(tmp_path / "d").left_out[0]
