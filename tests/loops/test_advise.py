"""`truearc advise` beside a stand-in robot program on a real NetworkTables server, in processes of their own."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.advise import Beside, play_beside
from truearc.cli.main import main

pytest.importorskip("ntcore")
pytestmark = pytest.mark.slow
GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"
SECONDS, AFTER_S = 6.5, 3.5


def beside(tmp_path: Path, *trouble: str) -> Beside:
    return play_beside(GATE, tmp_path, SECONDS, *trouble, after_s=AFTER_S)


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
    heard, _, _ = beside(tmp_path, "disappears", "/Shooter/RPM")      # other troubles: tests/robot/test_advice.py
    assert "FIRE" in [word for at, word in heard if at < AFTER_S]
    assert "FIRE" not in [word for at, word in heard if at > AFTER_S + 1.0]
