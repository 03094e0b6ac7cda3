"""One code, three worlds: what the emulated robot records replays to the bit, and what breaks ends in HOLD."""

import filecmp
import shutil
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from benchmarks.matrix.fault import find, says
from tests.faulty_robot import parts_with
from truearc import robot
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot import reasons as bot
from truearc.robot.aim_file import with_plan
from truearc.robot.config.schema import Prescribed, config_hash, load_config
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import Difference, replay
from truearc.robot.recording.session import CONFIG, load_trials
from truearc.sim.data.recordings import shots_from_sessions
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.world.faults import SILENT, Fault

CONFIGURATION = load_config(Path(robot.__file__).parent / "launcher.toml")
SECOND = 1_000_000_000
@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loops") / "first"
    results = emulate(CONFIGURATION, folder, trials=4, seed=3)
    return folder, results


def test_balls_are_marked_as_the_world_saw_them_from_where_it_was(session):
    folder, results = session
    marks = [trial.outcome.outcome for trial in load_trials(folder)]
    assert len(results) == 4
    for mark, result in zip(marks, results, strict=True):
        assert mark in (result.outcome, "rejected")
    folder, results = session
    for trial, result in zip(load_trials(folder), results, strict=True):
        assert trial.shot.distance_m == pytest.approx(result.distance_m, abs=0.06)
        assert trial.shot.hood_deg == pytest.approx(result.hood_deg, abs=0.15)
    with pytest.raises(InputError, match="already exists"):
        emulate(CONFIGURATION, session[0], trials=1, seed=0)


def test_the_same_seed_gives_the_same_files_and_another_seed_does_not(session, tmp_path):
    emulate(CONFIGURATION, tmp_path / "again", trials=4, seed=3)
    emulate(CONFIGURATION, tmp_path / "other", trials=4, seed=4)
    for name in ("telemetry.mcap", "can0.log", "trials.jsonl", "session.json", "config.json"):
        assert filecmp.cmp(session[0] / name, tmp_path / "again" / name, shallow=False), name
    assert not filecmp.cmp(session[0] / "telemetry.mcap", tmp_path / "other" / "telemetry.mcap", shallow=False)


def test_a_replay_with_another_gain_names_the_first_field_that_differs(session, tmp_path, capsys):
    folder = tmp_path / "changed"
    shutil.copytree(session[0], folder)
    changed = replace(CONFIGURATION, flywheel=replace(CONFIGURATION.flywheel, ks_nm=0.03))
    (folder / CONFIG).write_bytes(msgspec.json.encode(changed))
    with pytest.raises(InputError, match="changed since the recording"):
        replay(folder)
    header = folder / "session.json"
    header.write_text(header.read_text().replace(config_hash(CONFIGURATION), config_hash(changed)))
    with pytest.raises(Difference, match=r"cycle \d+: tick\.(command|memory)\..* was .*, is now"):
        replay(folder)
    assert main(["session", "replay", str(folder), "--check"]) == 1
    assert "is now" in capsys.readouterr().err


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_truncated_recording_gives_its_whole_chunks_and_says_so(session, tmp_path, share, capsys):
    folder = tmp_path / "cut"
    shutil.copytree(session[0], folder)
    file = folder / "telemetry.mcap"
    whole = sum(1 for _ in TickReader(folder))
    file.write_bytes(file.read_bytes()[:int(file.stat().st_size * share)])
    ticks, cut_short = replay(folder)
    assert 0.7 * share * whole < ticks < whole and "cut short" in cut_short
    assert main(["session", "replay", str(folder), "--check"]) == 1
    dataset = shots_from_sessions([folder], "cut")
    assert any("cut short" in line for line in dataset.left_out)


def test_a_disk_that_fills_up_is_a_hold_and_the_session_can_be_recovered(tmp_path, capsys):
    resource = pytest.importorskip("resource")             # POSIX
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))     # some two seconds' worth
    try:
        code = main(["emulate", "--trials", "2", "--seed", "3", "--out", str(tmp_path / "s"), "--quiet"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == 2 and "File too large" in capsys.readouterr().err
    assert main(["session", "replay", str(tmp_path / "s"), "--check"]) == 1
    assert main(["session", "recover", str(tmp_path / "s")]) == 0
    assert replay(tmp_path / "s")[1] is None
    for tick, _ in TickReader(tmp_path / "s"):
        assert not (tick.verdict.fire and find(says(bot.NOT_RECORDING), tick.inputs.faults))
    held = [reason for trial in load_trials(tmp_path / "s") for reason in trial.outcome.reasons]
    assert bot.NOT_RECORDING(cause=bot.DISK_ERROR(detail="File too large")) in held


def test_a_device_that_comes_back_is_fired_with_again(tmp_path):
    fault = Fault(SILENT, 1 * SECOND, 6 * SECOND)
    results = emulate(CONFIGURATION, tmp_path / "s", trials=3, seed=5, **parts_with({"flywheel_a": (fault,)}))
    assert results and all(result.fed_t_ns > 6 * SECOND for result in results)


def test_prescribed_shots_are_shot_as_they_stand_and_replay_to_the_bit(tmp_path):
    rows = (Prescribed(3.2, 0.45, 50.0), Prescribed(6.0, 0.62, 40.0), Prescribed(6.0, 0.40, 60.0))
    results = emulate(with_plan(CONFIGURATION, rows, repeats=2), tmp_path / "s", trials=6, seed=9)
    assert len(results) == 6
    for number, (trial, result) in enumerate(zip(load_trials(tmp_path / "s"), results, strict=True)):
        row = rows[number // 2]
        assert trial.shot.config_id == f"c{number // 2:04d}"
        assert trial.shot.motor_ratio == pytest.approx(row.motor_ratio, abs=0.006)
        assert trial.shot.hood_deg == pytest.approx(row.hood_deg, abs=0.35)
        assert result.distance_m == pytest.approx(row.distance_m, abs=1e-6)
    assert replay(tmp_path / "s")[1] is None
