"""The sweep of the paper's Table II (7 sizes x 20 seeds), all networks in one batch against one after another in JAX.

    pip install 'truearc[bench]'; python -m benchmarks.training [--steps 20000] [--repeats 3]

The plain loop is one lax.scan of Adam steps a network, on a graph compiled once and warmed up (rows are padded to one
shape, so that every size runs the same graph); it is timed on one seed of each size and scaled to 20. Both get the
same first weights and the same minibatches, and what they learn is compared. Wall time wants a machine that does
nothing else; processor seconds of all threads stand beside it.
"""

import argparse
import importlib.util
import os
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numba import njit

from truearc.sim.paper.network import Layers, Rows, cross_entropy, initial_layers, logits, standardisation
from truearc.sim.paper.settings import Recipe
from truearc.sim.paper.train_many import BATCH, Decks, Job, deal, make_decks, pack, train_many

SIZES = (0, 500, 600, 750, 900, 1000, 1250)
SEEDS = 20
REAL = 80
RATE = Recipe().learning_rate


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20000, help="of every network")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each; the fastest counts")
    args = parser.parse_args()
    jobs = [make_job(size, seed) for size in SIZES for seed in range(SEEDS)]
    subset = jobs[::SEEDS]
    plain = make_plain_loop()
    train_many(jobs[:1], Recipe(steps=10))
    plain(subset[0], 10)
    batches, plains = [], []
    for _ in range(args.repeats):
        batches.append(timed(lambda: train_many(jobs, Recipe(steps=args.steps))))
        plains.append(timed(lambda: [plain(job, args.steps) for job in subset]))
    print(f"{len(jobs)} networks ({REAL} recorded rows and {SIZES} simulated, {SEEDS} seeds), {args.steps} steps each; "
          f"{len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}")
    print(f"one after another in JAX: {len(subset)} timed, scaled by {SEEDS}")
    batch_s, plain_s = fastest(batches), [SEEDS * part_s for part_s in fastest(plains)]
    for kind, one_s, whole_s in zip(("wall", "processor"), batch_s, plain_s, strict=True):
        print(f"{kind:9s} time  one after another {whole_s:7.1f} s ({whole_s / len(jobs) / args.steps * 1e6:.1f} us a "
              f"step)  one batch {one_s:6.2f} s ({one_s / args.steps * 1e6:.0f} us a step of all)"
              f"  {whole_s / one_s:5.1f} x")
    for name in ("torch", "keras"):
        print(f"{name}: {'installed, not timed' if importlib.util.find_spec(name) else 'not installed'}")
    agree([one.network.layers for one in batches[0].result[::SEEDS]], plains[0].result)


class Timed(NamedTuple):
    wall_s: float
    processor_s: float
    result: Any


def timed(run: Callable[[], Any]) -> Timed:
    wall, processor = time.perf_counter(), time.process_time()
    done = run()
    return Timed(time.perf_counter() - wall, time.process_time() - processor, done)


def fastest(runs: list[Timed]) -> tuple[float, float]:
    """Least wall and least processor seconds."""
    return min(run.wall_s for run in runs), min(run.processor_s for run in runs)


def agree(found: list[Layers], wanted: list[Layers]) -> None:
    """Print the largest difference in any weight between the two ways; exits 1 if it is more than rounding.

    The batch is in float32, the plain loop in float64, as the gate's trainer was before there were batches.
    """
    worst = max(float(np.abs(pack(one) - pack(other)).max()) for one, other in zip(found, wanted, strict=True))
    print(f"largest difference in a weight after training: {worst:.1e} (float32 against float64)")
    if worst > 1e-3:
        raise SystemExit("the two ways disagree")


def make_job(size: int, seed: int) -> Job:
    """Shots decided by distance and speed, in the paper's ranges, with as many recorded ones as the paper has."""
    return Job(make_rows(REAL, seed), make_rows(size, 1000 + seed) if size else None, None, 0.01, seed)


def make_rows(count: int, seed: int) -> Rows:
    rng = np.random.default_rng(seed)
    features = np.column_stack([rng.uniform(2, 9, count), rng.uniform(0.3, 0.9, count), rng.uniform(20, 70, count)])
    reach_m = 12.0 * features[:, 1] - features[:, 0]
    return Rows(features, np.column_stack([reach_m > 1.0, reach_m > 3.0]).astype(float))


def make_plain_loop() -> Callable[[Job, int], Layers]:
    """(job, steps) -> layers: one network, one step after the other, as one compiled scan."""
    adam = optax.adam(RATE)

    def step(carry: Any, index: Any, rows: Any, labels: Any, weights: Any) -> Any:
        layers, memory = carry
        slopes = jax.grad(lambda of: jnp.dot(weights, cross_entropy(logits(of, rows[index]), labels[index])))(layers)
        updates, memory = adam.update(slopes, memory)
        return optax.apply_updates(layers, updates), memory

    @jax.jit
    def run(carry: Any, order: Any, rows: Any, labels: Any, weights: Any) -> Any:
        return jax.lax.scan(lambda c, index: (step(c, index, rows, labels, weights), None), carry, order)[0]

    def train(job: Job, steps: int) -> Layers:
        rng = np.random.default_rng(job.seed)
        layers = jax.tree.map(jnp.asarray, initial_layers(rng))
        size = len(job.simulated.features) if job.simulated else 0
        rows, labels = padded(job)
        weights = np.repeat([1.0, job.simulated_weight if size else 0.0], BATCH) / BATCH
        order = deal_all(make_decks([rng], [(REAL, size)]), steps)
        return jax.block_until_ready(run((layers, adam.init(layers)), order, rows, labels, weights)[0])

    return train


@njit
def deal_all(decks: Decks, steps: int) -> np.ndarray:
    """The minibatches of the one network, [steps, 20] row numbers."""
    order = np.zeros((steps, 2 * BATCH), np.int32)
    for step in range(steps):
        deal(decks, 0, order[step])
    return order


def padded(job: Job) -> tuple[np.ndarray, np.ndarray]:
    """Standardised features and labels of all rows, filled up to one length."""
    mean, scale = standardisation(job.real.features)
    parts = [job.real, *([job.simulated] if job.simulated else [])]
    features = np.concatenate([(rows.features - mean) * scale for rows in parts])
    labels = np.concatenate([rows.labels for rows in parts])
    room = REAL + max(SIZES) - len(features)
    return np.pad(features, ((0, room), (0, 0))), np.pad(labels, ((0, room), (0, 0)))


if __name__ == "__main__":
    main()
