"""How fast the emulated robot and its replay run, against real time; and what one tick costs.

    python -m benchmarks.loop [--trials 50]
    python -m benchmarks.loop --lateness [--seconds 20] [--rates 100,200,500] [--loads idle,busy] [--layouts one,three]

`--lateness`: how late the ticks of `truearc run` come, idle and with all cores busy, in one process and in three.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import loop_lateness
from truearc.cli.common import SHIPPED
from truearc.robot.config.schema import Config, load_config
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay
from truearc.robot.tick import step
from truearc.robot.types import Memory
from truearc.sim.world.emulated_robot import emulate


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--lateness", action="store_true")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--rates", default="100,200,500", help="ticks a second")
    parser.add_argument("--loads", default="idle,busy")
    parser.add_argument("--layouts", default="one,three")
    args = parser.parse_args()
    if args.lateness:
        loop_lateness.report([*map(int, args.rates.split(","))], args.seconds, args.loads.split(","),
                             args.layouts.split(","))
    else:
        time_stepped(args.trials)


def time_stepped(trials: int) -> None:
    """The emulated robot in stepped time, its replay, and the tick alone."""
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


if __name__ == "__main__":
    main()
