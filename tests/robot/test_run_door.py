"""`truearc run` from first line to last on hand-made wires: real time asked for, systemd notified, ticks timed."""

import re
import signal
import socket
import sys
import time
from datetime import datetime
from pathlib import Path

import msgspec
import pytest

import truearc.cli.run_processes
import truearc.cli.run_robot
from tests.robot.good_tick import good_inputs, good_memory
from tests.robot.test_rig import Stream, Time, Wire
from truearc import robot
from truearc.cli.main import main
from truearc.cli.run_processes import make_show
from truearc.hw.devices.button_box import make_heartbeat
from truearc.robot.config.schema import load_config
from truearc.robot.eyes import NoEyes
from truearc.robot.operator_ui import parse_page
from truearc.robot.operator_ui.server import open_page
from truearc.robot.recording.session import LATENESS, load_header
from truearc.robot.tick import step

CONFIG = str(Path(robot.__file__).parent / "launcher.toml")
ONE = ("--layout", "one")             # hand-made wires cannot be handed to another process
TICKS = 450


class Box(Stream):
    def read(self):
        return make_heartbeat(0)


class Stopping(Time):
    """A clock that oversleeps once, by 3 ms, and asks for the end after TICKS ticks."""

    def __init__(self):
        super().__init__()
        self.slept = 0

    def sleep_until_ns(self, t_ns):
        self.slept += 1
        super().sleep_until_ns(t_ns + 3_000_000 * (self.slept == 100))
        if self.slept == TICKS:
            signal.raise_signal(signal.SIGTERM)


@pytest.fixture
def wires(monkeypatch):
    bus = Wire()
    monkeypatch.setattr(truearc.cli.run_robot, "_open_wires", lambda *_: (bus, Box(), NoEyes(), Stopping()))
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield bus
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.skipif(sys.platform == "win32", reason="AF_UNIX datagrams: POSIX only")
def test_a_run_ends_idle_timed_and_announced(wires, tmp_path, monkeypatch, capsys):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        assert main(["run", "--config", CONFIG, "--out", str(tmp_path / "s"), "--priority", "0", *ONE]) == 0
        told = [systemd.recv(200) for _ in range(2)]
    assert told == [b"STATUS=waiting: flywheel motor 1", b"STOPPING=1"]       # no device ever answered: never ready
    idle = [frame.data[0] for frame in wires.sent[-8:] if frame.arbitration_id & 0x1F == 0x07]
    assert idle == [1, 1, 1, 1]                                               # every axis asked to be idle
    out = capsys.readouterr().out
    assert f"{TICKS} ticks" in out and f"3.00 ms (all); 0 of {TICKS - 1} by a whole tick or more" in out
    (session,) = (tmp_path / "s").iterdir()
    header = load_header(session)
    assert abs(header.wall_offset_ns + time.monotonic_ns() - time.time_ns()) < 1e9
    assert abs(datetime.fromisoformat(header.started).timestamp() - time.time()) < 60.0
    rows = [msgspec.json.decode(row) for row in session.joinpath(LATENESS).open("rb")]
    assert sum(sum(row["counts"]) for row in rows) == TICKS - 1 and len(rows) == 3
    assert max(row["worst_us"] for row in rows) == 3000.0


def test_what_is_refused_is_said_loudly_and_is_never_fatal(wires, tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    monkeypatch.setattr(truearc.cli.run_robot, "ask_fifo", lambda priority: (f"priority {priority}", "not allowed"))
    monkeypatch.setattr(truearc.cli.run_robot, "ask_locked_memory", lambda: ("locked memory", ""))
    monkeypatch.setattr(truearc.cli.run_robot, "ask_core", lambda core: (f"core {core}", ""))
    assert main(["run", "--config", CONFIG, "--out", str(tmp_path / "s"), "--core", "3", *ONE]) == 0
    err = capsys.readouterr().err
    assert "priority 50: REFUSED (not allowed)" in err and "core 3: granted" in err and "locked memory: granted" in err


@pytest.mark.parametrize(("policy", "words", "said"), [
    ("model", (), "gate.policy is 'model', so --gate is needed"), ("model", ("--gate", "none.onnx"), "none.onnx"),
    ("model", ("--gate", "file"), "not a usable ONNX"), ("collect", ("--out", "file"), "file")])
def test_without_a_gate_or_a_folder_it_does_not_start(policy, words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("neither a model nor a folder")
    Path("own.toml").write_text(Path(CONFIG).read_text(encoding="utf-8").replace('"collect"', f'"{policy}"', 1))
    assert main(["run", "--config", "own.toml", "--can", "virtual:refused", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--priority", "100"], ["--priority", "-1"], ["--core", "-1"]])
def test_what_cannot_be_asked_for_is_bad_input(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--config", "nowhere.toml", *words]) == 2
    assert words[0] in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_the_page_is_shown_every_tick(wires, tmp_path, monkeypatch, capsys):
    pages = []

    def keep_page(*args, **options):
        pages.append(open_page(*args, **options))
        return pages[-1]

    monkeypatch.setattr(truearc.cli.run_robot, "open_page", keep_page)
    words = ["run", "--config", CONFIG, "--out", str(tmp_path / "s"), "--priority", "0", *ONE]
    assert main([*words, "--page", "0"]) == 0
    assert pages[0].newest()[0] == TICKS and pages[0].url in capsys.readouterr().err
    assert main([*words, "--page", "off"]) == 0
    assert pages[1] is None


def test_the_recorder_process_shows_what_it_writes(wires, tmp_path, capfd):
    config, clock = load_config(CONFIG), Time()
    page = open_page("0", config, "session", clock)
    rows = [(tick.inputs.t_ns, msgspec.json.encode(tick), []) for tick in (step(good_inputs(), good_memory(), config,
                                                                                None),) * 3]
    make_show(page)(rows)
    assert page.newest()[0] == 3 and b'"FIRE"' in page.newest()[1]
    page.close()
    make_show(None)(rows)
    capfd.readouterr()
    assert main(["run", "--config", CONFIG, "--out", str(tmp_path / "s"), "--priority", "0", "--page", "0"]) == 0
    said = capfd.readouterr().err
    assert re.search(r"operator's page: (http://127.0.0.1:\d+/); for the driver: \1#token=\S{24}\n", said)


def test_no_networktables_and_no_page_change_nothing(wires, tmp_path, capfd):
    config = tmp_path / "launcher.toml"
    config.write_text(Path(CONFIG).read_text(encoding="utf-8")
                      + '\n[nt4]\nserver = "127.0.0.1:9"\n[nt4.velocity]\nkey = "/v"\nmost_m_s = 1\npointing_deg = 2\n'
                      '[nt4.vision]\nkind = "limelight"\ncamera = "limelight"\nsigma_m = 0.05\n'
                      '[apriltag]\nids = [4]\nside_m = 0.1651\ncentre_height_m = 1.35\n', encoding="utf-8")
    assert main(["run", "--config", str(config), "--out", str(tmp_path / "s"), "--priority", "0", "--page", "off"]) == 0
    assert f"{TICKS} ticks" in capfd.readouterr().out
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        assert main(["run", "--config", CONFIG, "--out", str(tmp_path / "s"), "--priority", "0", "--page", where]) == 0
    out, err = capfd.readouterr()
    assert f"{TICKS} ticks" in out and f"cannot serve the operator's page on {where}" in err


@pytest.mark.parametrize(("text", "where"), [
    ("5808", ("127.0.0.1", 5808)), ("0.0.0.0:80", ("0.0.0.0", 80)), ("[::1]:5808", ("::1", 5808)), ("off", None)])
def test_where_the_page_is(text, where):
    assert parse_page(text) == where
