"""Motion in the fault matrix: the judge, a short form of its rows, and of the runs without a false release."""

import sys
from pathlib import Path

import pytest

from benchmarks.matrix.fault import Row
from benchmarks.matrix.judge import Result, judge
from benchmarks.matrix.play import play
from benchmarks.matrix.rows import MOTION_ROWS
from benchmarks.motion_soak import CASES, soak
from tests.hw.host_speed import excuse_stalls

posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals and signals")
NAMES = {row.name: row for row in MOTION_ROWS}
# every row of the table and every interlock
QUICK = ("wheels: both encoders read 0, since rest", "wheels: both speeds read 40 % too low, since rest",
         "wheels: both motors turn the other way, since rest", "wheels: no estimates of motor 1 since the start",
         "wheels: both encoders: readings stop, heartbeats go on while spinning up",
         "wheels: both encoders: readings freeze while spinning up",
         "wheels: both encoders: readings jump to 0 while spinning up",
         "wheels: both encoders: readings turn big-endian while spinning up",
         "wheels: motor 2 keeps its torque, whatever it is asked for",
         "wheels: motor 1's readings stop for 0.25 s, again and again",
         "wheels: motor 2 gives up with an error while spinning up",
         "wheels: no target and no request for more than 10 s", "hood: no angles while it rises",
         "hood: its encoder is frozen while it rises", "hood: its encoder jumps by 10 degrees at the set point",
         "hood: is jammed", "hood: is jammed for 0.45 s", "hood: its limit switch never closes",
         "hood: its limit switch never answers", "hood: its screw has come loose of the motor",
         "hood: its screw is stiff", "hood: its encoder reads 0.8 degrees low, set point at the soft limit",
         "hood: rises from its switch to 70 degrees", "hood: its encoder is frozen while it homes from 60 degrees",
         "hood: its encoder is reversed while it homes from 60 degrees",
         "hood: its motor's encoder reads 0 while it homes from 60 degrees",
         "hood: has no encoder, and its motor's reads 0", "hood: has no encoder, homes from 60 degrees and rises")
SPARK = ("wheels: both encoders read 0, since rest", "hood: its encoder is frozen while it rises")
REAL = ("motion, wheels: both encoders read 0, since rest",
        "motion, wheels: both encoders: readings stop, heartbeats go on while spinning up",
        "motion, hood: its encoder is frozen while it rises", "motion, SPARK wheels: both encoders read 0, since rest")
def run(row: Row, bus: str, folder: Path) -> Result:
    stepped = bus == "virtual"
    return judge(row, bus, stepped, folder / "run", play(row, bus, folder / "run", stepped))


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", [*(f"motion, {name}" for name in QUICK), *(f"motion, SPARK {name}" for name in SPARK)])
def test_what_moves_is_released_in_time(name: str, tmp_path: Path) -> None:
    result = run(NAMES[name], "virtual", tmp_path)
    assert not result.wrong, result


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_what_moves_is_released_in_real_time(name: str, tmp_path: Path) -> None:
    with excuse_stalls():
        results = []
        for tries in range(3):                    # a machine that stalls is not a robot
            results.append(run(NAMES[name], "slcan", tmp_path / str(tries)))
            if not results[-1].wrong:
                return
        raise AssertionError(results)


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_no_false_release_in_a_short_run(name: str) -> None:
    result = soak(name, CASES[name], "odrive", 40.0)
    assert not result.wrong, result
