"""Motion in the fault matrix: the judge, a short form of its rows, and of the runs without a false release."""

import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmarks.matrix.fault import REARM, Motion, Row
from benchmarks.matrix.judge import Result, judge
from benchmarks.matrix.motion import COLUMNS, SET_RAD_S, Moved, judge_motion
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


STEP_S = 0.001                        # of the log


def log_of(seconds: float, torque_until_s: float, wheel_rad_s: float = SET_RAD_S, hood_deg: float = 45.0) -> np.ndarray:
    log = np.zeros((round(seconds / STEP_S), len(COLUMNS)))
    log[:, 0] = np.arange(1, len(log) + 1) * STEP_S
    log[:, 1] = log[:, 2] = np.where((log[:, 0] <= torque_until_s) | (log[:, 0] > seconds - 2.0), 0.8, 0.0)
    log[:, 4], log[:, 5] = wheel_rad_s, hood_deg
    return log


def judged(tmp_path: Path, log: np.ndarray, **changes: float) -> Result:
    motion = Motion("frozen", ("flywheel_a",), "spinning", "wheels", "fault", "none")
    row = Row("motion", "motion", motion, (), 0.08, REARM, 3.0)
    moved = Moved(begin_s=2.0, end_s=5.0, rearm_s=6.2, over_s=9.0, true_s=1.99)
    for name, value in changes.items():
        setattr(moved, name, value)
    (tmp_path / "devices.json").write_bytes(msgspec.json.encode(moved))
    np.save(tmp_path / "devices.npy", log)
    result = Result(row.name, row.family, "virtual", bound_s=row.within_s)
    judge_motion(row, motion, tmp_path, result, [])
    return result


def test_the_judge_measures_on_the_plant(tmp_path: Path) -> None:
    good = judged(tmp_path, log_of(9.0, 2.07))
    assert not good.wrong and good.hold_s == pytest.approx(0.07, abs=0.002), good
    assert "driven for 0.12 s, 0.08 allowed" in "; ".join(judged(tmp_path, log_of(9.0, 2.12)).wrong)
    assert "before it was armed again" in "; ".join(judged(tmp_path, log_of(9.0, 5.3)).wrong)
    assert "wheels at 420 rad/s, 1.17" in "; ".join(judged(tmp_path, log_of(9.0, 2.07, 420.0)).wrong)
    assert "pushed for 2.07 s without motion" in "; ".join(judged(tmp_path, log_of(9.0, 2.07, 0.0)).wrong)
    assert "hood 2.0 deg past" in "; ".join(judged(tmp_path, log_of(9.0, 2.07, hood_deg=77.0)).wrong)
    fast = log_of(9.0, 2.07)
    fast[:, 5] += np.clip(fast[:, 0] - 3.0, 0.0, 0.5) * 30.0
    assert "hood at 30 deg/s" in "; ".join(judged(tmp_path, fast).wrong)
    assert "never ready" in "; ".join(judged(tmp_path, log_of(9.0, 2.07), begin_s=0.0, over_s=0.0).wrong)
