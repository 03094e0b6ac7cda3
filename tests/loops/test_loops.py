"""One code, three worlds: what the emulated robot records, on every bus and beside a page, and what breaks is HOLD."""

import filecmp
import itertools
import json
import os
import re
import shutil
import signal
import threading
import time
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from benchmarks.matrix.fault import find, says
from benchmarks.real_robot import PATIENT, WATCHDOG_MS, begin, save_config
from tests.faulty_robot import parts_with
from tests.hw.host_speed import excuse_stalls
from tests.robot.good_tick import CONFIG as CONFIGURATION
from tests.waiting import SetClock, ask
from truearc.cli.gate import make_command
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.real.clock import MonotonicClock
from truearc.robot import reasons as bot
from truearc.robot.aim_file import with_plan
from truearc.robot.config.schema import Prescribed, config_hash, split_bus, with_ports
from truearc.robot.operator_ui.server import open_page
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import Difference, replay
from truearc.robot.recording.session import CONFIG, Trial, load_trials
from truearc.sim.world.emulated_robot import emulate, keep_time, open_device_bus
from truearc_proof.world.faults import SILENT, Fault

SECOND = 1_000_000_000
LIMIT_S = 240.0
posix = pytest.mark.skipif(os.name != "posix", reason="ends the robot with a signal")
FAST_VCAN = (pytest.mark.socketcan, pytest.mark.fast_bus)
GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loops") / "first"
    results = emulate(CONFIGURATION, folder, trials=4, seed=3)
    return folder, results


def test_balls_are_marked_as_the_world_saw_them_from_where_it_was(session):
    folder, results = session
    marks = [trial.outcome.outcome for trial in load_trials(folder)]
    assert len(results) == 4
    first = next(tick for tick, _ in TickReader(folder))
    assert not first.memory.armed and not first.memory.homed
    for mark, result in zip(marks, results, strict=True):
        assert mark in (result.outcome, "rejected")
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


# --- on every bus

def shoot_in_two(bus: str, folder: Path) -> tuple[Path, str, str]:
    """One trial with the robot and its devices in two processes; the session, and what either has said.

    The emulated world may be slower than the robot: a ball takes longer to feed, but the next comes no sooner."""
    config_path = save_config(folder / "launcher.toml", PATIENT | {"fps = 20.0": "fps = 5.0"})
    devices = begin("-m", "truearc", "emulate", "--trials", 1, "--seed", 3, "--bus", bus, "--config", config_path,
                    "--watchdog-ms", WATCHDOG_MS)
    late = threading.Timer(LIMIT_S, devices.kill)
    late.start()
    try:
        assert devices.stdout is not None and devices.stderr is not None
        devices.stdout.readline()
        command = devices.stdout.readline().split()
        assert command[:2] == ["truearc", "run"], devices.stderr.read()
        near = begin("-m", *command, "--out", folder / "out")
        said, _ = devices.communicate()
        near.send_signal(signal.SIGTERM)
        recorded, complaint = near.communicate(timeout=LIMIT_S)
        assert devices.returncode == 0 and near.returncode == 0, complaint
    finally:
        late.cancel()
        devices.kill()
    return next((folder / "out").iterdir()), said, recorded


def tell(session: Path) -> str:
    """Button events, faults and reasons for a HOLD, for the message of a failed test."""
    ticks = [tick for tick, _ in TickReader(session)]
    heard = [f"{tick.inputs.cycle}: {[event.button for event in tick.inputs.buttons]} {tick.inputs.faults}"
             for tick in ticks if tick.inputs.buttons or tick.inputs.faults]
    return "\n".join([*heard[:50], f"last: {ticks[-1].verdict.reasons}"])


@posix
@pytest.mark.slow
@pytest.mark.parametrize("bus", ["slcan:auto", "slcan:socket", pytest.param("socketcan:vcan0", marks=FAST_VCAN)])
def test_the_same_session_on_every_bus(bus: str, tmp_path: Path, session) -> None:
    with excuse_stalls():
        check_session(*shoot_in_two(bus, tmp_path), load_trials(session[0])[0])


def check_session(session: Path, said: str, recorded: str, reference: Trial) -> None:
    """One ball, launched as in the reference by a robot that was armed and homed, and nothing odd on the bus."""
    assert not re.search("not allowed|unknown|another host|garbled", recorded), recorded
    assert (session / "trials.jsonl").read_bytes(), said + recorded + tell(session)
    (trial,) = load_trials(session)
    assert "1 ball launched (" in said and f"1 {trial.outcome.outcome}" in said      # as the world saw it
    assert trial.shot is not None and reference.shot is not None
    assert trial.shot.distance_m == pytest.approx(reference.shot.distance_m, abs=0.06)
    assert trial.shot.hood_deg == pytest.approx(reference.shot.hood_deg, abs=0.7)      # both within 0.3 of the aim
    assert trial.shot.motor_rad_s == pytest.approx(reference.shot.motor_rad_s, abs=8.0)
    ticks = [tick for tick, _ in TickReader(session)]
    assert [sum(tick.verdict.fire for tick in ticks), ticks[0].memory.armed, ticks[0].memory.homed] == [1, False, False]
    fired = next(tick for tick in ticks if tick.verdict.fire)
    assert fired.memory.armed and fired.memory.homed and not fired.inputs.faults


def test_ports_on_the_command_line_take_the_place_of_the_configurations() -> None:
    config = with_ports(CONFIGURATION, "slcan:socket://127.0.0.1:5000", "/dev/pts/3", "http://127.0.0.1:5001/")
    assert (config.can.interface, config.can.channel) == ("slcan", "socket://127.0.0.1:5000")
    assert (config.buttons.port, config.camera.device) == ("/dev/pts/3", "http://127.0.0.1:5001/")
    assert replace(config, can=CONFIGURATION.can, buttons=CONFIGURATION.buttons,
                   camera=CONFIGURATION.camera) == CONFIGURATION
    assert with_ports(CONFIGURATION, None, None, None) == CONFIGURATION


@pytest.mark.parametrize("bus", ["slcan", "", ":can0", "slcan:"])
def test_a_bus_that_is_no_bus_is_named(bus: str) -> None:
    with pytest.raises(InputError, match=f"--can {bus}: an interface and a channel"):
        split_bus(bus, "--can")


@pytest.mark.parametrize("bus", ["slcan:/dev/ttyACM0", "pcan:0", "socketcan:nosuchcan7"])
def test_a_far_end_that_cannot_be_had_is_named(bus: str) -> None:
    with pytest.raises(InputError, match=f"--bus {bus}"):
        open_device_bus(bus, CONFIGURATION, MonotonicClock())


def test_a_world_keeps_time_and_stands_still_where_the_machine_did() -> None:
    clock, moments = SetClock(), []

    def advance(t_ns: int) -> None:
        moments.append((t_ns, clock.t_ns))
        clock.t_ns += 10_000_000_000 if len(moments) == 100 else 0

    keep_time(clock, advance, lambda: len(moments) == 200)
    steps = {later[0] - sooner[0] for sooner, later in itertools.pairwise(moments)}
    assert steps == {2_000_000}                        # never a leap, for the devices' watchdogs would bite
    assert moments[98][1] == moments[98][0] and moments[-1][1] == moments[-1][0] + 10_000_000_000 - 2_000_000


@pytest.mark.slow
def test_session_is_the_same_while_the_page_asks_the_gate(tmp_path):
    """Every tick, its verdict by the gate included, is what it is without a question."""
    page = open_page("0", CONFIGURATION, "first", MonotonicClock(), make_command(GATE, CONFIGURATION))
    over, answered = threading.Event(), []

    def ask_on():
        body = json.dumps({"distance_m": [2.0, 5.0, 8.0], "motor_ratio": [0.5] * 100, "hood_deg": 50.0})
        port = int(page.url.rstrip("/").rpartition(":")[2])
        while not over.wait(0.02):
            answered.append(ask(port, "/predict", "POST", body, {"Content-Type": "application/json"})[0])

    asking = threading.Thread(target=ask_on, daemon=True)
    asking.start()
    began = time.monotonic()
    emulate(CONFIGURATION, tmp_path / "first", trials=1, seed=3, gate_path=GATE, page=page)
    took_s = time.monotonic() - began
    over.set()
    asking.join()
    page.close()
    emulate(CONFIGURATION, tmp_path / "second", trials=1, seed=3, gate_path=GATE)
    shown, alone = ([row for _, row in TickReader(tmp_path / name)] for name in ("first", "second"))
    assert shown == alone and answered.count(200) > 10 and set(answered) <= {200, 429}
    assert took_s > len(shown) / CONFIGURATION.tick_hz - 0.1        # at the clock's pace
