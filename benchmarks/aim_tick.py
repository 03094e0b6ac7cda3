"""What aiming by an aim file costs the tick, against the plan of [collect].

    python -m benchmarks.aim_tick [--trials 12] [--rounds 5]

Records one session of the emulated robot, then steps its inputs through the tick with both policies in turn, a block of
ticks each, so that both meet the same machine. Printed: microseconds a tick, median and 99th percentile, and ratios.
"""

import argparse
import gc
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace

import truearc as ta
from truearc.cli.common import SHIPPED, make_progress
from truearc.robot.aim_file import load_aim_for
from truearc.robot.config.schema import AimConfig, Config, load_config
from truearc.robot.runtime import Think
from truearc.robot.tick import step
from truearc.robot.types import Inputs, Memory
from truearc.sim.infer.belief import point_belief

BLOCK = 400                           # ticks in a row by one policy
BELIEF = point_belief({"drag": {"cd": 0.45}, "magnus": {"cl": 0.1}, "exit_efficiency": {"loss": 0.38}},
                      {"speed": 0.015, "elevation_deg": 0.5})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=12, help="of the recorded session")
    parser.add_argument("--rounds", type=int, default=5, help="how often the session is stepped through by each")
    args = parser.parse_args()
    config = load_config(SHIPPED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "aim.json"
        ta.export_aim(ta.aim(BELIEF, config.rig, distances_m=np.arange(2.0, 8.1, 0.25), hood_deg=(30.0, 54.0)), BELIEF,
                      config.rig, path)
        ta.emulate(config, Path(folder) / "s", args.trials, 1, progress=make_progress("record", False))
        inputs = [tick.inputs for tick in ta.Recording(Path(folder) / "s")]
        aims = {"": load_aim_for(path, config)}
    ways = {"plan": (config, step),
            "belief": (replace(config, aim=AimConfig("belief", 0.005)), partial(step, aims=aims))}
    took = {name: np.concatenate([one for one in rows]) for name, rows in _measured(inputs, ways, args.rounds).items()}
    figures = {name: np.percentile(us, (50.0, 99.0)) for name, us in took.items()}
    for name, (median, p99) in figures.items():
        print(f"{name:8} {len(took[name])} ticks, {median:.1f} us median, {p99:.1f} us p99")
    ratios = figures["belief"] / figures["plan"]
    print(f"belief / plan: {ratios[0]:.3f} of the median, {ratios[1]:.3f} of the p99")
    return 0


def _measured(inputs: list[Inputs], ways: dict[str, tuple[Config, Think]], rounds: int) -> dict[str, list[np.ndarray]]:
    """Microseconds of every tick but the first block's, by policy."""
    took: dict[str, list[np.ndarray]] = {name: [] for name in ways}
    gc.collect()
    gc.freeze()
    for number in range(rounds):
        memories = dict.fromkeys(ways, Memory())
        for first in range(0, len(inputs), BLOCK):
            for name in (list(ways) if (first // BLOCK + number) % 2 else list(ways)[::-1]):
                config, think = ways[name]
                memory, us = memories[name], []
                for one in inputs[first:first + BLOCK]:
                    began = time.perf_counter_ns()
                    memory = think(one, memory, config, None).memory
                    us.append((time.perf_counter_ns() - began) * 1e-3)
                memories[name] = memory
                if first:
                    took[name].append(np.array(us))
    return took


if __name__ == "__main__":
    sys.exit(main())
