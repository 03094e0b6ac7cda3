"""`truearc serve`: a page for a gate without a robot, and what it refuses to serve."""

import json
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import ask, serving
from truearc import robot
from truearc.cli.gate import make_server
from truearc.cli.main import NAMES, main, make_parser
from truearc.robot.gate import load_gate

GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"
LAUNCHER = Path(robot.__file__).parent / "launcher.toml"


def test_serves_page_and_gate_until_ctrl_c(tmp_path):
    """As docs/how-to/operator-page.md prints it, on a free port."""
    shutil.copy(GATE, tmp_path / "gate.onnx")
    command = [sys.executable, "-m", "truearc", "serve", "gate.onnx", "--threshold", "0.5", "--port", "0"]
    with subprocess.Popen(command, cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as served:
        try:
            port = int(served.stdout.readline().partition("/  (")[0].rpartition(":")[2])
            status, _, page = ask(port, "/")
            assert status == 200 and b'data-robot="none"' in page and b"whatIf" in page
            facts = json.loads(ask(port, "/gate")[2])
            assert facts["threshold"] == 0.5 and facts["free_speed_rad_s"] is None
            assert facts["sha256"] == load_gate(GATE).sha256
            status, _, said = ask(port, "/predict", "POST", '{"distance_m": 3.2, "motor_ratio": 0.5, "hood_deg": 50}',
                                  {"Content-Type": "application/json"})
            assert status == 200 and json.loads(said)["p_three"] == load_gate(GATE).rate(3.2, 0.5, 50.0).p_three
            assert ask(port, "/events")[0] == 404
            served.send_signal(signal.SIGINT)
            try:
                _, errors = served.communicate(timeout=20)
            except subprocess.TimeoutExpired:         # a busy machine's interpreter can lose one; users press it again
                served.send_signal(signal.SIGINT)
                _, errors = served.communicate(timeout=20)
        finally:
            served.kill()
    assert served.returncode == 0 and not errors


@pytest.mark.parametrize(("words", "threshold"), [([], 0.3), (["--threshold", "0.7"], 0.7)])
def test_threshold_and_free_speed_are_the_configurations(words, threshold):
    args = make_parser(NAMES["serve"]).parse([str(GATE), "--config", str(LAUNCHER), "--port", "0", *words])
    with serving(make_server(args)) as server:
        facts = json.loads(ask(server.server_port, "/gate")[2])
    assert (facts["threshold"], facts["free_speed_rad_s"]) == (threshold, 594.0)


@pytest.mark.parametrize(("change", "words"), [
    (lambda data: data[:-1] + bytes([data[-1] ^ 1]), ""), (lambda data: b"", "gate.onnx"),
    (lambda data: data.replace(b'"shots":400', b'"shots":401'), "damaged or altered")])
def test_gate_that_the_robot_would_refuse_is_not_served(tmp_path, capsys, change, words):
    path = tmp_path / "gate.onnx"
    path.write_bytes(change(GATE.read_bytes()))
    assert main(["serve", str(path), "--port", "0"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("truearc serve: ") and str(path) in err and words in err and err.count("\n") == 1


def test_port_that_is_taken_is_named(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert main(["serve", str(GATE), "--port", port]) == 2
    assert f"--port {port}: " in capsys.readouterr().err
