"""How late the ticks of `truearc run` come, by rate, load and layout.

The robot itself, with camera, vision and recording; another process plays its devices over slcan on a pseudo-terminal.
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from array import array
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.real_robot import PATIENT, ROOT, RealRobot, save_config

TIMED, BARE = (str(Path(__file__).with_name(name)) for name in ("timed_run.py", "bare_loop.py"))
WARM_S = 2.0                          # at the start: first images, first rows, the homing
LOADS = {"idle": "idle", "busy": "all cores busy", "asked": "page not asked"}
WINDOW_NS = 4_000_000_000             # of the load `asked`: so long the page is left alone, so long it is asked
QUESTION = json.dumps({"distance_m": [2.0 + 0.09 * k for k in range(64)],         # a map, as the page asks for it
                       "motor_ratio": [0.4 + 0.006 * k for k in range(48)], "hood_deg": 50.0}).encode()
LAYOUTS = ("one", "three")


class Late(NamedTuple):
    """How late ticks came, in microseconds, and what one cost its process."""

    late_us: np.ndarray
    period_us: float
    cpu_us: float
    real_time: list[str]              # what the system granted and refused
    missed: int                       # late by a period or more
    excused: int                      # of these, for half of that time or more a loop that only sleeps was late, too
    stalls_us: np.ndarray             # how late the loops that only sleep were, where they were


def measure(tick_hz: int, layout: str, seconds: float, options: tuple[str, ...], asked: bool = False) -> list[Late]:
    """One run of the robot, beside a loop on each core that only sleeps.

    `asked`: every other four seconds its page is asked at its limit; the ticks while it is not, and while it is.
    """
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    with tempfile.TemporaryDirectory() as name, bare_loops(Path(name)) as stalls:
        folder = Path(name)
        config = save_config(folder / "launcher.toml", PATIENT | {"tick_hz = 200": f"tick_hz = {tick_hz}"})
        notes = folder / "notes"
        robot = RealRobot(config, folder / "out", ("--layout", layout, "--page", str(port), *options),
                          run=(TIMED, str(notes)))
        try:
            with questions(port, asked) as began_ns:
                robot.rest(seconds + WARM_S)
        finally:
            robot.end()
        noted = array("q", notes.read_bytes())
    cpu_ns = noted.pop()
    t_ns, late_ns = np.array(noted).reshape(-1, 2).T
    said = [line.removeprefix("truearc run: ").strip() for line in robot.said if "granted" in line or "REFUSED" in line]
    warm = slice(round(WARM_S * tick_hz), None)
    t_ns, late_ns, cpu_us = t_ns[warm], late_ns[warm], 1e-3 * cpu_ns / len(t_ns)
    window = (t_ns - began_ns) // WINDOW_NS
    odd = window % 2 == 1
    if asked:
        print(_windows(window, late_ns))
    return [judge(t_ns[kept], late_ns[kept], 1e9 / tick_hz, np.array(stalls, np.int64).reshape(-1, 2), cpu_us, said)
            for kept in ([~odd, odd] if asked else [np.ones(len(t_ns), bool)])]


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
    loops = [subprocess.Popen([sys.executable, BARE, str(file), str(core)], cwd=ROOT, stderr=subprocess.DEVNULL)
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


def _windows(window: np.ndarray, late_ns: np.ndarray) -> str:
    """p99 of the median window, which a stall of the machine hardly changes, and which window of a pair was later."""
    p99_ms = {int(one): np.percentile(late_ns[window == one], 99) / 1e6 for one in np.unique(window)[:-1]}
    pairs = np.array([(p99_ms[one], p99_ms[one + 1]) for one in p99_ms if one % 2 == 0 and one + 1 in p99_ms])
    if not len(pairs):
        return "no whole pair of windows"
    alone, asked = np.median(pairs, axis=0)
    return (f"median window of {WINDOW_NS * 1e-9:g} s: p99 {alone:.3f} ms not asked, {asked:.3f} ms asked "
            f"({asked / alone:.2f} x); later while asked in {(pairs[:, 1] > pairs[:, 0]).sum()} of {len(pairs)} pairs")


@contextmanager
def questions(port: int, wanted: bool) -> Iterator[int]:
    """In every second window the page computes maps, the next as soon as it allows one; when the first window began."""
    over, answers, began_ns = threading.Event(), Counter[int](), time.monotonic_ns()

    def ask() -> None:
        while not over.is_set():
            if (time.monotonic_ns() - began_ns) // WINDOW_NS % 2 == 0:
                over.wait(0.02)
                continue
            line = HTTPConnection("127.0.0.1", port, timeout=60)
            line.request("POST", "/predict", QUESTION, {"Content-Type": "application/json", "Accept-Encoding": "gzip"})
            answer = line.getresponse()
            answer.read()
            answers[answer.status] += 1
            over.wait(float(answer.headers.get("Retry-After", 0.0)))
            line.close()

    asking = threading.Thread(target=ask)
    if wanted:
        asking.start()
    try:
        yield began_ns
    finally:
        over.set()
        if wanted:
            asking.join()
            print(f"maps: {answers[200]} answered, {answers[429]} refused as too many")
            assert answers[200], "no map: is --gate given, and a layout whose page has one?"


def report(rates: list[int], seconds: float, options: tuple[str, ...], loads: list[str], layouts: list[str]) -> None:
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
                    parts = measure(tick_hz, layout, seconds, options, load == "asked")
                for late, what in zip(parts, (LOADS[load], "page asked"), strict=False):
                    p99 = float(np.percentile(late.late_us, 99))
                    base = base or p99
                    print(_row(tick_hz, what, layout, late, p99 / base), flush=True)
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
