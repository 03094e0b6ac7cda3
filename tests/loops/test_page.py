"""The emulated robot with a browser on its page: as fast as the clock, and otherwise the same session."""

import json
import threading
import time
from http.client import HTTPConnection
from pathlib import Path

import pytest

from truearc import robot
from truearc.cli.gate import make_command
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import load_config
from truearc.robot.operator_ui.server import open_page
from truearc.robot.recording.reader import TickReader
from truearc.sim.world.emulated_robot import emulate

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")
GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"


@pytest.mark.slow
def test_session_is_the_same_while_the_page_asks_the_gate(tmp_path):
    """Every tick, its verdict by the gate included, is what it is without a question."""
    page = open_page("0", CONFIG, "first", MonotonicClock(), make_command(GATE, CONFIG))
    over, answered = threading.Event(), []

    def ask():
        body = json.dumps({"distance_m": [2.0, 5.0, 8.0], "motor_ratio": [0.5] * 100, "hood_deg": 50.0})
        while not over.wait(0.02):
            line = HTTPConnection("127.0.0.1", int(page.url.rstrip("/").rpartition(":")[2]), timeout=20)
            line.request("POST", "/predict", body, {"Content-Type": "application/json"})
            answered.append(line.getresponse().status)
            line.close()

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    began = time.monotonic()
    emulate(CONFIG, tmp_path / "first", trials=1, seed=3, gate_path=GATE, page=page)
    took_s = time.monotonic() - began
    over.set()
    asking.join()
    page.close()
    emulate(CONFIG, tmp_path / "second", trials=1, seed=3, gate_path=GATE)
    shown, alone = ([row for _, row in TickReader(tmp_path / name)] for name in ("first", "second"))
    assert shown == alone and answered.count(200) > 10 and set(answered) <= {200, 429}
    assert took_s > len(shown) / CONFIG.tick_hz - 0.1        # at the clock's pace
