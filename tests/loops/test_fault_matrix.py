"""The fault matrix: some of its rows on the virtual bus, a few in real time; `make faults` plays all of them."""

import re
import sys
from pathlib import Path

import pytest

import truearc.robot.advice
import truearc.robot.tick
from benchmarks.matrix.fault import Both, Device, Inside, Key, Row, Wire
from benchmarks.matrix.judge import Result, judge
from benchmarks.matrix.keys import POSE, WELL
from benchmarks.matrix.play import play
from benchmarks.matrix.rows import ROWS
from tests.hw.host_speed import excuse_stalls

FAST_VCAN = (pytest.mark.socketcan, pytest.mark.fast_bus)
posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals and signals")
NAMES = {row.name: row for row in ROWS}
# at least one of each way to break, and each that truearc once did not stand
QUICK = ("flywheel motor 1: no frames", "hood encoder: frames too long", "flywheel motor 2: speed is not a number",
         "feeder motor: frames held back, then all at once", "flywheel motor 1: encoder stuck",
         "hood motor: loses its power", "another host stops a motor", "the transmit queue is full",
         "camera: two targets", "camera: images half a second old", "button box: presses lost", "model: gives NaN",
         "model: takes 0.3 s a tick", "ticks stand still for 0.6 s", "wall clock set forward by an hour",
         "SPARK, flywheel motor 1: encoder stuck", "SPARK, hood motor: firmware 27 from the start, then exchanged",
         "SPARKs: a competition controller on the bus locks them all",
         "advice only, feeder motor: gate driver fault", "camera: another place, reached while fire is asked for",
         "both flywheel motors: say the speed that is wanted, and turn at another")
ON_VCAN = [name for name in QUICK if isinstance(NAMES[name].breaking, Device | Inside | Wire | Both)]      # on the bus
FIRST = ("flywheel motor 1: no frames", "flywheel motor 2: speed is not a number", "hood motor: loses its power",
         "camera: two targets", "model: gives NaN", "ticks stand still for 0.6 s",
         "SPARK, flywheel motor 1: encoder stuck")       # in `make test`
KEYS = [row.name for row in ROWS if isinstance(row.breaking, Key)]      # quick: all of them
REAL = ["flywheel motor 1: no frames", "adapter pulled out, and in again",
        "control process stopped for 0.6 s (SIGSTOP)", "camera: the same image again and again",
        "vision process killed, which starts again", "the receive queue overruns (64 frames), the tick stalls"]


def run(row: Row, bus: str, folder: Path, stepped: bool | None = None) -> Result:
    stepped = bus == "virtual" and not row.real if stepped is None else stepped
    play(row, bus, folder / "run", stepped)
    return judge(row, bus, stepped, folder / "run")


@pytest.mark.parametrize("name", [*(pytest.param(
    name, marks=posix if name in FIRST else (posix, pytest.mark.slow)) for name in QUICK), *KEYS])
def test_a_fault_on_the_virtual_bus(name: str, tmp_path: Path) -> None:
    result = run(NAMES[name], "virtual", tmp_path)
    assert not result.wrong and result.stale == 0, result


@posix
@pytest.mark.slow
@pytest.mark.socketcan
@pytest.mark.parametrize("name", ON_VCAN)
def test_a_fault_on_vcan0_in_stepped_time(name: str, tmp_path: Path) -> None:
    """Frames cross the kernel, and no host is too slow: time goes on when a tick is over."""
    result = run(NAMES[name], "socketcan", tmp_path, stepped=True)
    assert not result.wrong and result.stale == 0, result


def test_each_key_that_advice_needs_freezes_jumps_and_disappears(monkeypatch, tmp_path):
    troubles = {(row.breaking.key, row.breaking.what) for row in ROWS if isinstance(row.breaking, Key)}
    for key in (*WELL, POSE, "/Drive/Speeds"):
        assert {what for named, what in troubles if named == key} >= {"freezes", "jumps", "disappears"}
    monkeypatch.setattr(truearc.robot.advice, "_stale", lambda inputs, config: [])
    result = run(NAMES["advise: hood angle freezes"], "virtual", tmp_path)
    assert result.stale > 0 and "while it stood" in "; ".join(result.wrong)       # the judge sees who believes it


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("bus", ["slcan", pytest.param("socketcan", marks=FAST_VCAN)])
def test_a_fault_in_real_time(name: str, bus: str, tmp_path: Path) -> None:
    results = []
    with excuse_stalls():
        for tries in range(3):                    # a machine that stalls is not a robot
            results.append(run(NAMES[name], bus, tmp_path / str(tries)))
            if not results[-1].wrong:
                break
        assert results[-1].stale or not results[-1].wrong, results
    assert results[-1].stale == 0, results        # a shot on an old reading, which no slow host excuses


@posix
def test_the_judge_sees_a_robot_that_fires_on_old_readings(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(truearc.robot.tick, "doubt_axes", lambda inputs, config: ([], [], []))
    result = run(NAMES["flywheel motor 1: no readings, heartbeat goes on"], "virtual", tmp_path)
    assert result.stale > 0
    said = "; ".join(result.wrong)
    assert re.search(r"fired \d+ times while it stood", said) and "too old" in said
