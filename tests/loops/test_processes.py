"""`truearc run` in three processes on emulated devices: each of them killed, or stopped for a while."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from benchmarks.real_robot import PATIENT, RealRobot, save_config
from truearc.hw.fault_codes import PROCESS_KILLED
from truearc.hw.reason import Reason
from truearc.robot import reasons as bot
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.upkeep import recover

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")]
PATIENCE_S = 60.0                     # of a loaded machine
LATE_S = 0.5                          # a tick of a busy machine may itself be as late
BEGUN_BYTES = 100_000                 # of telemetry: some hundred ticks
NS_PER_S = 1_000_000_000


@pytest.fixture
def robot(tmp_path):
    yield from run_robot(tmp_path)


@pytest.fixture(scope="module")
def lasting(tmp_path_factory):
    """One that whatever is done to it must survive, and that ends well."""
    robots = run_robot(tmp_path_factory.mktemp("lasting"))
    robot = next(robots)
    try:
        yield robot
        robot.end()
        assert robot.code == 0, robot.said
        cycles = [tick.inputs.cycle for tick in all_ticks(robot)]
        assert cycles == list(range(1, len(cycles) + 1))       # and nothing is lost
    finally:
        robots.close()


def run_robot(folder):
    robot = RealRobot(save_config(folder / "launcher.toml", PATIENT | {"fps = 20.0": "fps = 5.0"}), folder / "out")
    try:
        until(lambda: any(path.stat().st_size > BEGUN_BYTES for path in robot.out.glob("*/telemetry.mcap")))
        yield robot
    finally:
        robot.kill()


def all_ticks(robot):
    return (tick for tick, _ in TickReader(robot.session))


def until(true, limit_s=PATIENCE_S):
    end = time.monotonic() + limit_s
    while not true() and time.monotonic() < end:
        time.sleep(0.1)
    assert true()


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def goes_on(tick, mended_ns: int, fault: Reason) -> bool:
    """Whether it is from after the mending, and that fault is over; what was held back is written a moment later."""
    return tick.inputs.t_ns > mended_ns and fault not in tick.inputs.faults


def faults_after(ticks, began_ns: int, fault: Reason) -> list[int]:
    return [tick.inputs.t_ns - began_ns for tick in ticks if fault in tick.inputs.faults]


# a killed vision process is back, with its number changed: it comes last
@pytest.mark.parametrize(("name", "number", "for_s", "fault", "within_s"), [
    ("vision", signal.SIGSTOP, 4.0, bot.CAMERA_LOST(cause=bot.VISION_UNRESPONSIVE()), 2.0),
    ("recorder", signal.SIGSTOP, 4.0, bot.NOT_RECORDING(cause=bot.RECORDER_UNRESPONSIVE()), 2.0),
    ("vision", signal.SIGKILL, 8.0, bot.CAMERA_LOST(cause=PROCESS_KILLED(process="vision", signal=9)), 0.5)])
def test_what_is_broken_for_a_while_is_a_hold_with_its_reason_and_then_goes_on(lasting, name, number, for_s, fault,
                                                                               within_s):
    began_ns = time.monotonic_ns()
    os.kill(lasting.pids[name], number)
    time.sleep(for_s)
    if number == signal.SIGSTOP:
        os.kill(lasting.pids[name], signal.SIGCONT)
    mended_ns = time.monotonic_ns()
    until(lambda: goes_on(list(all_ticks(lasting))[-1], mended_ns, fault))
    ticks = list(all_ticks(lasting))
    told = faults_after(ticks, began_ns, fault)
    assert 0 <= told[0] * 1e-9 < within_s
    assert not any(tick.verdict.fire for tick in ticks if fault in tick.inputs.faults)
    assert ticks[-1].inputs.t_ns - began_ns > told[-1]


def test_a_stopped_control_process_stalls_and_goes_on(lasting):
    os.kill(lasting.pids["control"], signal.SIGSTOP)
    time.sleep(3.0)
    now_ns = time.monotonic_ns()
    os.kill(lasting.pids["control"], signal.SIGCONT)
    until(lambda: list(all_ticks(lasting))[-1].inputs.t_ns > now_ns + NS_PER_S)
    ticks = list(all_ticks(lasting))
    first = next(tick for tick in ticks if tick.inputs.t_ns >= now_ns)
    before = ticks[ticks.index(first) - 1]
    assert first.inputs.t_ns - before.inputs.t_ns > 2.5 * NS_PER_S and not first.verdict.fire


def test_a_killed_recorder_ends_the_run_with_code_2_and_little_lost(robot):
    killed_ns = time.monotonic_ns()
    os.kill(robot.pids["recorder"], signal.SIGKILL)
    until(lambda: robot.code is not None)
    robot.wait()
    assert robot.code == 2 and "the recording stopped: the recorder process ended (signal 9)" in "".join(robot.said)
    assert not is_running(robot.pids["vision"])
    ticks = list(all_ticks(robot))
    assert (killed_ns - ticks[-1].inputs.t_ns) * 1e-9 < 0.5 + LATE_S
    assert recover(robot.session).ticks == len(ticks)


def test_a_killed_control_process_leaves_whole_files_and_nobody_behind(robot):
    killed_ns = time.monotonic_ns()
    os.kill(robot.pids["control"], signal.SIGKILL)
    until(lambda: not any(is_running(robot.pids[name]) for name in ("vision", "recorder")))
    reader = TickReader(robot.session)
    ticks = [tick for tick, _ in reader]
    assert not reader.cut_short                            # the recorder has finished them
    assert (killed_ns - ticks[-1].inputs.t_ns) * 1e-9 < 0.25 + LATE_S
