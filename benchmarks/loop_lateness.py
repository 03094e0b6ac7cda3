"""How late the ticks of `truearc run` come, by rate, load and layout.

The robot itself, with camera, vision and recording; another process plays its devices over slcan on a pseudo-terminal.
Beside it, on each core, a loop at the highest real-time priority that only sleeps (`python -m benchmarks.loop_lateness
FILE CORE`, until SIGTERM): when that is late, no program on this machine is spared. FILE then has pairs of 64-bit
integers: when it should have woken, and when it did, in monotonic nanoseconds.
"""

import gc
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.real_robot import PATIENT, ROOT, RealRobot, save_config

TIMED = str(Path(__file__).with_name("timed_run.py"))
PERIOD_NS, LATE_NS, PRIORITY = 2_000_000, 1_000_000, 98        # of the bare loops
WARM_S = 2.0                          # at the start: first images, first rows, the homing
LOADS = {"idle": "idle", "busy": "all cores busy"}


class Late(NamedTuple):
    """How late ticks came, in microseconds, and what one cost its process."""

    late_us: np.ndarray
    period_us: float
    cpu_us: float
    real_time: list[str]              # what the system granted and refused
    missed: int                       # late by a period or more
    excused: int                      # of these, for half of that time or more a loop that only sleeps was late, too
    stalls_us: np.ndarray             # how late the loops that only sleep were, where they were


def measure(tick_hz: int, layout: str, seconds: float) -> Late:
    """One run of the robot, beside a loop on each core that only sleeps."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    with tempfile.TemporaryDirectory() as name, bare_loops(Path(name)) as stalls:
        folder = Path(name)
        config = save_config(folder / "launcher.toml", PATIENT | {"tick_hz = 200": f"tick_hz = {tick_hz}"})
        notes = folder / "notes"
        robot = RealRobot(config, folder / "out", ("--layout", layout, "--page", str(port), "--priority", "50"),
                          run=(TIMED, str(notes)))
        try:
            robot.rest(seconds + WARM_S)
        finally:
            robot.end()
        noted = array("q", notes.read_bytes())
    cpu_ns = noted.pop()
    t_ns, late_ns = np.array(noted).reshape(-1, 2)[round(WARM_S * tick_hz):].T
    said = [line.removeprefix("truearc run: ").strip() for line in robot.said if "granted" in line or "REFUSED" in line]
    return judge(t_ns, late_ns, 1e9 / tick_hz, np.array(stalls, np.int64).reshape(-1, 2),
                 1e-3 * cpu_ns / (len(noted) // 2), said)


def judge(t_ns: np.ndarray, late_ns: np.ndarray, period_ns: float, stalls_ns: np.ndarray, cpu_us: float,
          said: list[str]) -> Late:
    """t_ns, late_ns: when each tick came, and how late; stalls_ns [n, 2]: from when to when a bare loop was late."""
    missed = late_ns >= period_ns
    due_ns, came_ns = t_ns[missed] - late_ns[missed], t_ns[missed]
    both_ns = np.minimum(stalls_ns[:, 1:], came_ns) - np.maximum(stalls_ns[:, :1], due_ns)
    excused = (both_ns >= late_ns[missed] / 2).any(axis=0)
    here = (stalls_ns[:, 1] > t_ns[0]) & (stalls_ns[:, 0] < t_ns[-1])
    return Late(late_ns / 1e3, period_ns / 1e3, cpu_us, said, int(missed.sum()), int(excused.sum()),
                (stalls_ns[here, 1] - stalls_ns[here, 0]) / 1e3)


@contextmanager
def bare_loops(folder: Path) -> Iterator[list[int]]:
    """A loop on each core that only sleeps; when it was late is there at the end. None without real-time priority."""
    stalls: list[int] = []
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    files = [folder / f"bare{core}" for core in cores]
    loops = [subprocess.Popen([sys.executable, __file__, str(file), str(core)], cwd=ROOT, stderr=subprocess.DEVNULL)
             for core, file in zip(cores, files, strict=True)]
    try:
        yield stalls
    finally:
        for loop in loops:
            loop.terminate()
            loop.wait()
        for file in files:
            if file.exists():
                stalls.extend(array("q", file.read_bytes()))


def sleep_only(file: Path, core: int) -> None:
    """A bare loop, until SIGTERM; PermissionError without real-time priority."""
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    gc.disable()
    late, ended = array("q"), []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
    due_ns = time.monotonic_ns() + PERIOD_NS
    while not ended:
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
        now_ns = time.monotonic_ns()
        if now_ns - due_ns > LATE_NS and not ended:
            late.extend((due_ns, now_ns))
        due_ns = max(due_ns + PERIOD_NS, now_ns)
    file.write_bytes(late.tobytes())


def report(rates: list[int], seconds: float, loads: list[str], layouts: list[str]) -> None:
    """The table; ratios are to the first row at the same rate and load."""
    print(f"ticks of truearc run on {os.cpu_count()} cores, {seconds:g} s each after {WARM_S:g} s; devices in another "
          "process, slcan on a pseudo-terminal, 20 images/s")
    if hasattr(os, "getloadavg"):
        print(f"before this began, {os.getloadavg()[0]:.1f} processes of others wanted a core")
    print("missed: late by a period or more; (n): n of these for the machine's sake: a loop that only sleeps, at\n"
          "priority 98, was late, too, for half of that time or more; stalls: how often it was, by over 1 ms; the most")
    print("  Hz  load            layout   p50 ms    p99 ms    max ms  missed         of  CPU us/tick  p99 to the first"
          "  stalls")
    told: list[str] = []
    for tick_hz in rates:
        for load in loads:
            base = 0.0
            for layout in layouts:
                with busy(load == "busy"):
                    late = measure(tick_hz, layout, seconds)
                p99 = float(np.percentile(late.late_us, 99))
                base = base or p99
                print(_row(tick_hz, LOADS[load], layout, late, p99 / base), flush=True)
                told = late.real_time
    print(*told, sep="\n")


def _row(tick_hz: int, what: str, layout: str, late: Late, ratio: float) -> str:
    p50, p99, worst = np.percentile(late.late_us, [50, 99, 100]) / 1000
    return (f"{tick_hz:4d}  {what:14s}  {layout:6s} {p50:8.3f} {p99:9.3f} {worst:9.3f} {late.missed:7d} "
            f"{f'({late.excused})':4s} {len(late.late_us):7d} {late.cpu_us:12.0f} {ratio:15.2f} x  "
            f"{len(late.stalls_us):6d}, {late.stalls_us.max(initial=0.0) / 1000:.1f}")


@contextmanager
def busy(wanted: bool) -> Iterator[None]:
    """A process for each core that does nothing but keep it busy."""
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"], cwd=ROOT)
            for _ in range(os.cpu_count() or 1)] if wanted else []
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


if __name__ == "__main__":
    sleep_only(Path(sys.argv[1]), int(sys.argv[2]))
