"""Benchmark of the time that the gate takes for one decision.

    python -m benchmarks.gate [--calls 5000] [--rounds 12] [--shots 120]

It simulates shots, trains both kinds of model on them, exports both, and times `Gate.rate` from three floats to a
rating, including the features and the check of the domain, in one thread without spinning. The models take turns in
rounds. On a shared machine about one call in a hundred is interrupted, and all calls are sometimes slowed to half their
speed. Therefore the median round and the fastest round are reported; the latter is closest to an undisturbed machine.

The exit code is 1 if the 99th percentile of a gate in its fastest round exceeds 50 microseconds.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.options import read_options
from truearc.model_export.graph import export_weights
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel
from truearc.robot.gate import FEATURES, load_gate
from truearc.sim.data.dataset import Shots
from truearc.sim.gate.model import fit_novelty, novelty_record, physics_of, save_physics_gate
from truearc.sim.gate.train import train_physics_gate
from truearc.sim.infer.belief import point_belief
from truearc.sim.paper.network import Network, domain_of, initial_layers, save_weights, standardisation

LIMIT_US = 50.0
WARM_UP = 500
FACTS = Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, (Wheel("lower", 0.0508, 1.0, 180.0),
                                                              Wheel("upper", 0.0349, 0.5625, 0.0))), Target(2.44))
BELIEF = point_belief({"drag": {"cd": 1.06}, "magnus": {"cl": 0.033}}, {"speed": 0.02, "elevation_deg": 0.3})
Rate = Callable[[float, float, float], object]


def make_shots(count: int) -> Shots:
    """Configurations aimed at the target within a tenth or so of the speed, with outcomes by the forecast's spread."""
    rng = np.random.default_rng(1)
    wide = rng.uniform([2.5, 0.4, 30.0], [8.0, 0.9, 54.0], (60 * count, 3))
    ahead = physics_of(FACTS, BELIEF, wide)
    kept = np.flatnonzero(np.abs(ahead.deviation_m) < 1.0)[:count]
    miss_m = np.abs(ahead.deviation_m[kept] + ahead.sigma_m[kept] * rng.normal(size=kept.size))
    outcome = np.where(miss_m <= 0.07, "three", np.where(miss_m <= 0.35, "two", "miss"))
    return Shots(tuple(f"s{row}" for row in range(kept.size)),
                 {feature.name: wide[kept, k] for k, feature in enumerate(FEATURES)},
                 {"outcome": tuple(map(str, outcome))})


def make_rates(shots: Shots, folder: Path) -> dict[str, Rate]:
    """Everything that is timed, by name."""
    features = np.stack([shots.number(feature.name) for feature in FEATURES], axis=1)
    gate, _ = train_physics_gate(FACTS, BELIEF, shots)
    domain = domain_of(features)
    save_physics_gate(folder / "physics", gate, {"domain": domain})
    network = Network(*standardisation(features), initial_layers(np.random.default_rng(2)))
    save_weights(folder / "network", network, {"domain": domain, "novelty": novelty_record(fit_novelty(features))})
    rates: dict[str, Rate] = {}
    for kind in ("network", "physics"):
        export_weights(folder / kind, folder / f"{kind}.onnx")
        rates[f"gate, {kind}"] = load_gate(folder / f"{kind}.onnx").rate
    return rates


def time_calls(rate: Rate, rows: list[list[float]]) -> np.ndarray:
    """p50, p99 and p99.9 in microseconds of one call each."""
    for row in rows[:WARM_UP]:
        rate(*row)
    took = np.empty(len(rows))
    for number, row in enumerate(rows):
        began = time.perf_counter_ns()
        rate(*row)
        took[number] = time.perf_counter_ns() - began
    return np.percentile(took, [50, 99, 99.9]) * 1e-3


def main() -> int:
    args = read_options(__doc__, calls=(5000, "of each way in each round"), rounds=12, shots=(120, "to train on"))
    with tempfile.TemporaryDirectory() as folder:
        rates = make_rates(make_shots(args.shots), Path(folder))
        rows = np.random.default_rng(3).uniform([2.5, 0.4, 30.0], [8.0, 0.9, 54.0], (args.calls, 3)).tolist()
        took = {name: [] for name in rates}
        for _ in range(args.rounds):
            for name, rate in rates.items():
                took[name].append(time_calls(rate, rows))
    print(f"{args.rounds} rounds of {args.calls} decisions, trained on {args.shots} shots; us, p50 / p99 / p99.9")
    slow = False
    for name, rounds in took.items():
        best = min(rounds, key=lambda one: one[1])
        middle, quickest = (" /".join(f"{value:7.1f}" for value in one) for one in (np.median(rounds, axis=0), best))
        print(f"{name:34s} median round {middle}   fastest {quickest}")
        slow |= best[1] > LIMIT_US
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
