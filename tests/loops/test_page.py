"""The emulated robot with a browser on its page: as fast as the clock, and otherwise the same session."""

import time
from pathlib import Path

import pytest

from truearc import robot
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import load_config
from truearc.robot.operator_ui.server import OperatorPage
from truearc.robot.recording.reader import TickReader
from truearc.sim.world.emulated_robot import emulate

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")


@pytest.mark.slow
def test_the_same_session_at_the_clock_s_pace(tmp_path):
    page = OperatorPage(CONFIG, "first", "127.0.0.1", 0, MonotonicClock())
    began = time.monotonic()
    emulate(CONFIG, tmp_path / "first", trials=1, seed=3, page=page)
    took_s = time.monotonic() - began
    page.close()
    emulate(CONFIG, tmp_path / "second", trials=1, seed=3)
    shown, alone = ([row for _, row in TickReader(tmp_path / name)] for name in ("first", "second"))
    assert shown == alone and page.newest()[0] == len(shown)
    assert took_s > len(shown) / CONFIG.tick_hz - 0.1
