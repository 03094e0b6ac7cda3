"""Benchmark of the control loop: the speed of the emulated robot, replay and one tick, and the lateness of real ticks.

    python -m benchmarks.loop [--trials 50]
    python -m benchmarks.loop --lateness [--seconds 20] [--rates 100,200,500] [--loads idle,busy] [--layouts one,three]

`--lateness` measures `truearc run` with camera, vision and recording, idle and with all cores busy, in one process and
in three; another process emulates its devices over slcan on a pseudo-terminal. Meanwhile, a bare loop on each core,
which only sleeps at the highest real-time priority, shows when the machine itself was late, so that no program could
have been on time. At SIGTERM it writes pairs of 64-bit integers, the due time and the actual time of each late wake-up,
in monotonic nanoseconds.
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

from benchmarks.options import read_options
from benchmarks.real_robot import PATIENT, ROOT, RealRobot, save_config
from truearc.cli.common import SHIPPED
from truearc.robot.config.schema import Config, load_config
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay
from truearc.robot.tick import step
from truearc.robot.types import Memory

TIMED = str(Path(__file__).with_name("timed_run.py"))
PERIOD_NS, LATE_NS, PRIORITY = 2_000_000, 1_000_000, 98        # of the bare loops
WARM_S = 2.0                          # at the start: first images, first rows, the homing


def main() -> None:
    if sys.argv[1:2] == ["--bare"]:
        return sleep_only(Path(sys.argv[2]), int(sys.argv[3]))
    args = read_options(__doc__, trials=50, lateness=False, seconds=(20.0, "of each measurement"),
                        rates=("100,200,500", "ticks a second"), loads="idle,busy", layouts="one,three")
    if args.lateness:
        report([*map(int, args.rates.split(","))], args.seconds, args.loads.split(","), args.layouts.split(","))
    else:
        time_stepped(args.trials)


def time_stepped(trials: int) -> None:
    """The emulated robot in stepped time, its replay, and the tick alone."""
    from truearc.sim.world.emulated_robot import emulate  # not for loops that only sleep

    config = load_config(SHIPPED)
    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder) / "session"
        began = time.perf_counter()
        emulate(config, session, trials=trials, seed=0)
        emulated_s = time.perf_counter() - began
        began = time.perf_counter()
        ticks, _ = replay(session)
        replayed_s = time.perf_counter() - began
        tick_us = time_ticks(session, config)
    robot_s = ticks / config.tick_hz
    print(f"{trials} trials, {robot_s:.0f} s of robot time, {ticks} ticks at {config.tick_hz} Hz")
    print(f"real time        {robot_s:8.1f} s      1.0 x")
    print(f"emulated robot   {emulated_s:8.1f} s  {robot_s / emulated_s:7.1f} x  (with images, CAN frames, recording)")
    print(f"replay --check   {replayed_s:8.1f} s  {robot_s / replayed_s:7.1f} x")
    p50, p99, worst = np.percentile(tick_us, [50, 99, 100])
    print(f"one tick         p50 {p50:.0f} us, p99 {p99:.0f} us, max {worst:.0f} us of {1e6 / config.tick_hz:.0f} us")


def time_ticks(session: Path, config: Config) -> np.ndarray:
    """Microseconds of each tick's own thinking, over the recorded inputs."""
    memory, spent = Memory(), []
    for tick, _ in TickReader(session):
        began = time.perf_counter_ns()
        memory = step(tick.inputs, memory, config, None).memory
        spent.append((time.perf_counter_ns() - began) / 1e3)
    return np.array(spent)


class Late(NamedTuple):
    """How late ticks came, in microseconds, and what one cost its process."""

    late_us: np.ndarray
    cpu_us: float
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
    return judge(t_ns, late_ns, 1e9 / tick_hz, np.array(stalls, np.int64).reshape(-1, 2),
                 1e-3 * cpu_ns / (len(noted) // 2))


def judge(t_ns: np.ndarray, late_ns: np.ndarray, period_ns: float, stalls_ns: np.ndarray, cpu_us: float) -> Late:
    """t_ns, late_ns: when each tick came, and how late; stalls_ns [n, 2]: from when to when a bare loop was late."""
    missed = late_ns >= period_ns
    due_ns, came_ns = t_ns[missed] - late_ns[missed], t_ns[missed]
    both_ns = np.minimum(stalls_ns[:, 1:], came_ns) - np.maximum(stalls_ns[:, :1], due_ns)
    excused = (both_ns >= late_ns[missed] / 2).any(axis=0)
    here = (stalls_ns[:, 1] > t_ns[0]) & (stalls_ns[:, 0] < t_ns[-1])
    return Late(late_ns / 1e3, cpu_us, int(missed.sum()), int(excused.sum()),
                (stalls_ns[here, 1] - stalls_ns[here, 0]) / 1e3)


@contextmanager
def bare_loops(folder: Path) -> Iterator[list[int]]:
    """A loop on each core that only sleeps; when it was late is there at the end. None without real-time priority."""
    stalls: list[int] = []
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    files = [folder / f"bare{core}" for core in cores]
    loops = [subprocess.Popen([sys.executable, "-m", "benchmarks.loop", "--bare", str(file), str(core)], cwd=ROOT,
                              stderr=subprocess.DEVNULL) for core, file in zip(cores, files, strict=True)]
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
        print(f"load average before the run: {os.getloadavg()[0]:.1f}")
    print("missed: late by a period or more; (n): n of these were due to the machine: a bare loop, which only sleeps,\n"
          "at priority 98, was also late for at least half of that time; stalls: delays of a bare loop above 1 ms:\n"
          "number, longest in ms")
    print("  Hz  load            layout   p50 ms    p99 ms    max ms  missed         of  CPU us/tick   p99 / first p99"
          "  stalls")
    for tick_hz in rates:
        for load in loads:
            base = 0.0
            for layout in layouts:
                with busy(load == "busy"):
                    late = measure(tick_hz, layout, seconds)
                p50, p99, worst = np.percentile(late.late_us, [50, 99, 100]) / 1000
                base = base or p99
                what = "all cores busy" if load == "busy" else load
                print(f"{tick_hz:4d}  {what:14s}  {layout:6s} {p50:8.3f} {p99:9.3f} {worst:9.3f} {late.missed:7d} "
                      f"{f'({late.excused})':4s} {len(late.late_us):7d} {late.cpu_us:12.0f} {p99 / base:15.2f} x  "
                      f"{len(late.stalls_us):6d}, {late.stalls_us.max(initial=0.0) / 1000:.1f}", flush=True)


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
    main()
