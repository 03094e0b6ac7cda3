"""`truearc advise` beside a stand-in robot program on a real NetworkTables server, in processes of their own."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from tests.frc.nt_server import free_port
from tests.frc.test_doctor import GATE, MAP
from truearc.cli.main import main

pytestmark = pytest.mark.slow
SECONDS, AFTER_S = 6.5, 3.5


class Beside(NamedTuple):
    """(time in s, verdict) of what the robot heard; ages in s; the session's folder."""

    heard: list[tuple[float, str]]
    ages: list[float]
    session: Path


def beside(folder: Path, missing: str = "") -> Beside:
    """Both programs in processes of their own; missing: the key that is gone after AFTER_S."""
    port = free_port()
    (folder / "shots.toml").write_text(MAP.partition("[outcome")[0], encoding="utf-8")
    robot = subprocess.Popen([sys.executable, str(Path(__file__).with_name("stand_in_robot.py")), str(port),
                              str(SECONDS), *([missing, str(AFTER_S)] if missing else [])],
                             stdout=subprocess.PIPE, text=True)
    advice = subprocess.Popen([sys.executable, "-m", "truearc", "advise", "--nt", f"127.0.0.1:{port}", "--map",
                               str(folder / "shots.toml"), "--gate", str(GATE), "--out", str(folder / "sessions")],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said = json.loads(robot.communicate(timeout=SECONDS + 60.0)[0])
    finally:
        advice.send_signal(signal.SIGTERM)
        out, err = advice.communicate(timeout=30)
    if advice.returncode != 0:
        raise RuntimeError(out + err)
    (session,) = (folder / "sessions").iterdir()
    return Beside([(at, word) for at, word in said["heard"]], said["ages"], session)


def test_advice_comes_at_twenty_hertz_with_its_age_and_replays(tmp_path: Path) -> None:
    heard, ages, session = beside(tmp_path)
    times = np.array([at for at, _ in heard])
    steady = times[times > times[0] + 1.0]
    assert len(steady) / (steady[-1] - steady[0]) >= 20.0
    words = [word for at, word in heard if at > times[0] + 1.0]
    assert words.count("FIRE") > 0.5 * len(words)             # a busy machine may be late now and then
    assert np.nanmedian(ages) < 0.2
    assert main(["session", "replay", str(session), "--check"]) == 0


def test_no_advice_to_fire_when_a_key_is_gone(tmp_path: Path) -> None:
    heard, _, _ = beside(tmp_path, "/Shooter/RPM")      # other troubles: test_advice.py
    assert "FIRE" in [word for at, word in heard if at < AFTER_S]
    assert "FIRE" not in [word for at, word in heard if at > AFTER_S + 1.0]
