"""The sweep of the paper's Table II (7 sizes x 20 seeds), all networks in one batch against one after another in JAX.

    python benchmarks/training.py [--steps 20000] [--repeats 3]

The plain loop is one lax.scan of Adam steps a network, on a graph compiled once and warmed up (rows are padded to one
shape, so that every size runs the same graph); it is timed on one seed of each size and scaled to 20. Both get the
same first weights and the same minibatches, and what they learn is compared.
"""

import argparse
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from sim.network import Layers, initial_layers, logits, standardisation
from sim.sweep import Job, Order, Recipe, pack, train_many
from sim.sweep_kernel import BATCH
from sim.train import Rows, cross_entropy

SIZES = (0, 500, 600, 750, 900, 1000, 1250)
SEEDS = 20
REAL = 80
RATE = Recipe().learning_rate


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20000, help="of every network")
    parser.add_argument("--repeats", type=int, default=3, help="the fastest of so many counts, of both")
    args = parser.parse_args()
    jobs = [make_job(size, seed) for size in SIZES for seed in range(SEEDS)]
    subset = jobs[::SEEDS]
    plain = make_plain_loop()
    train_many(jobs[:1], Recipe(steps=10))
    plain(subset[0], 10)
    batch_s, plain_s = [], []
    for _ in range(args.repeats):
        batch_s.append(timed(lambda: train_many(jobs, Recipe(steps=args.steps))))
        plain_s.append(timed(lambda: [plain(job, args.steps) for job in subset]))
    whole_s = min(plain_s)[0] * SEEDS
    print(f"{len(jobs)} networks ({REAL} recorded rows and {SIZES} simulated, {SEEDS} seeds), {args.steps} steps each")
    print(f"one after another in JAX  {whole_s:8.1f} s     1.0 x   "
          f"({whole_s / len(jobs) / args.steps * 1e6:.1f} us a step; {len(subset)} timed, scaled by {SEEDS})")
    one_s = min(batch_s)[0]
    print(f"all in one batch          {one_s:8.1f} s  {whole_s / one_s:6.1f} x   "
          f"({one_s / args.steps * 1e6:.0f} us a step of all)")
    for name in ("torch", "keras"):
        print(f"{name}: {'installed, not timed' if importlib.util.find_spec(name) else 'not installed'}")
    agree([one.network.layers for one in batch_s[0][1][::SEEDS]], plain_s[0][1])


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    began = time.perf_counter()
    done = run()
    return time.perf_counter() - began, done


def agree(found: list[Layers], wanted: list[Layers]) -> None:
    """Print the largest difference in any weight between the two ways; raises if it is more than rounding."""
    worst = max(float(np.abs(pack(one) - pack(other)).max()) for one, other in zip(found, wanted, strict=True))
    print(f"largest difference in a weight after training: {worst:.1e}")
    if worst > 1e-6:
        raise SystemExit("the two ways disagree")


def make_job(size: int, seed: int) -> Job:
    """Shots of which distance and speed decide, in the seed's ranges; as many recorded ones as the seed trained on."""
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
        order = Order(rng, REAL, size).take(steps)
        return jax.block_until_ready(run((layers, adam.init(layers)), order, rows, labels, weights)[0])

    return train


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
