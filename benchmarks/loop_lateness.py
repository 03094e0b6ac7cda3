"""How late the ticks of `truearc run` come, by rate, load and layout.

The robot itself, with camera, vision and recording; another process plays its devices over slcan on a pseudo-terminal.
"""

import os
import subprocess
import sys
import tempfile
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.real_robot import PATIENT, ROOT, RealRobot, save_config

TIMED = str(Path(__file__).with_name("timed_run.py"))
WARM_S = 2.0                          # at the start: first images, first rows, the homing
LOADS = {"idle": "idle", "busy": "all cores busy"}
LAYOUTS = ("one", "three")


class Late(NamedTuple):
    """How late ticks came, in microseconds, and what one cost its process."""

    late_us: np.ndarray
    period_us: float
    cpu_us: float
    real_time: list[str]              # what the system granted and refused

    @property
    def missed(self) -> int:
        return int((self.late_us >= self.period_us).sum())


def measure(tick_hz: int, layout: str, seconds: float, options: tuple[str, ...]) -> Late:
    """One run of the robot."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config = save_config(folder / "launcher.toml", PATIENT | {"tick_hz = 200": f"tick_hz = {tick_hz}"})
        notes = folder / "notes"
        robot = RealRobot(config, folder / "out", ("--layout", layout, *options), run=(TIMED, str(notes)))
        try:
            robot.rest(seconds + WARM_S)
        finally:
            robot.end()
        noted = array("d", notes.read_bytes())
    cpu_s = noted.pop()
    late_us = np.array(noted)
    said = [line.removeprefix("truearc run: ").strip() for line in robot.said if "granted" in line or "REFUSED" in line]
    return Late(late_us[round(WARM_S * tick_hz):], 1e6 / tick_hz, 1e6 * cpu_s / len(late_us), said)


def report(rates: list[int], seconds: float, options: tuple[str, ...], loads: list[str], layouts: list[str]) -> None:
    """The table; ratios are to the first layout at the same rate and load."""
    print(f"ticks of truearc run on {os.cpu_count()} cores, {seconds:g} s each after {WARM_S:g} s; devices in another "
          "process, slcan on a pseudo-terminal, 20 images/s")
    if hasattr(os, "getloadavg"):
        print(f"before this began, {os.getloadavg()[0]:.1f} processes of others wanted a core")
    print("  Hz  load            layout   p50 ms    p99 ms    max ms  missed     of  CPU us/tick  p99 to the first")
    told: list[str] = []
    for tick_hz in rates:
        for load in loads:
            base = 0.0
            for layout in layouts:
                with busy(load == "busy"):
                    late = measure(tick_hz, layout, seconds, options)
                p50, p99, worst = np.percentile(late.late_us, [50, 99, 100]) / 1000
                base = base or p99
                print(f"{tick_hz:4d}  {LOADS[load]:14s}  {layout:6s} {p50:8.3f} {p99:9.3f} {worst:9.3f} "
                      f"{late.missed:7d} {len(late.late_us):6d} {late.cpu_us:12.0f} {p99 / base:17.2f} x", flush=True)
                told = late.real_time
    print(*told, sep="\n")


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
