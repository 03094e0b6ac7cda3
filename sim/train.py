"""Training as the seed has it: each batch of recorded shots paired with one of simulated shots (section III-D, Eq. 15).

What the seed leaves open is settled here: features are standardised with the mean and standard deviation of the
recorded training rows; the two outputs' cross-entropies are summed and averaged over the batch; the number of epochs
was chosen on two sessions of the emulated robot (116 shots to train on, 900 simulated, 120 shots of another session to
watch): the watched cross-entropy fell from 0.95 at 6000 epochs to 0.73 at 20000.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.flatten_util import ravel_pytree

from robot.config import BadInput
from robot.gate.contract import FEATURES
from sim.network import Layers, Network, initial_layers, logits, probabilities, standardisation
from sim.shots import Shots

LABELS = {"miss": (0.0, 0.0), "two": (1.0, 0.0), "three": (1.0, 1.0)}     # three lies inside two
BATCH = 10
EPOCHS = 20000
DOMAIN_MARGIN = 0.1                   # the domain is the recorded rows' box, wider by this share (half on each side)
CURVE_POINTS = 50


class Rows(NamedTuple):
    """Training rows: `features` [n, 3] in the contract's order and units, `labels` [n, 2] (hit two, hit three)."""

    features: np.ndarray
    labels: np.ndarray


def training_rows(shots: Shots, name: str) -> tuple[Rows, list[str]]:
    """Rows with an outcome and all three features, and a sentence for each kind of shot of dataset `name` left out."""
    features = np.stack([shots.number(feature.name) for feature in FEATURES], axis=1)
    outcomes = shots.text("outcome")
    judged = np.array([outcome in LABELS for outcome in outcomes], bool)
    whole = np.isfinite(features).all(axis=1)
    left_out = [f"{name}: {int(lacks.sum())} of {len(shots)} shots left out: no {what}"
                for what, lacks in (("outcome", ~judged), (_either_of_features(), judged & ~whole)) if lacks.any()]
    kept = np.flatnonzero(judged & whole)
    labels = np.array([LABELS[outcomes[row]] for row in kept], float).reshape(-1, 2)
    return Rows(features[kept], labels), left_out


def _either_of_features() -> str:
    return " or no ".join(feature.name for feature in FEATURES)


@dataclass(frozen=True)
class Recipe:
    """How to train; the defaults are the seed's, the epochs excepted (it gives none)."""

    simulated_weight: float = 0.01    # the seed's lambda
    learning_rate: float = 1e-4
    epochs: int = EPOCHS
    seed: int = 0


def check_recipe(recipe: Recipe) -> None:
    """BadInput names the option that no training can be done with."""
    if recipe.epochs < 1:
        raise BadInput(f"--epochs is {recipe.epochs}; at least 1 is needed")
    if recipe.seed < 0:
        raise BadInput(f"--seed is {recipe.seed}; it cannot be negative")
    if not 0.0 <= recipe.simulated_weight < math.inf:
        raise BadInput(f"--lambda is {recipe.simulated_weight}; it must be 0 or more")
    if not 0.0 < recipe.learning_rate < math.inf:
        raise BadInput(f"--learning-rate is {recipe.learning_rate}; it must be more than 0")


class CurvePoint(NamedTuple):
    """Mean cross-entropy a row (summed over the two outputs) after `epoch` epochs; NaN where there are no rows."""

    epoch: int
    real: float
    simulated: float
    heldout: float


class _Batches(NamedTuple):
    features: jax.Array               # [m, 3], standardised: recorded rows, then simulated ones
    labels: jax.Array                 # [m, 2]
    weights: jax.Array                # [batch] share of each row of a batch in the loss


def train(real: Rows, simulated: Rows | None, recipe: Recipe, heldout: Rows | None = None,
          progress: Callable[[float, str], None] = lambda done, note: None) -> tuple[Network, list[CurvePoint]]:
    """Train the seed's network; the same arguments give the same numbers.

    An epoch is once through the simulated rows, with recorded rows reshuffled as often as that takes (section IV-B);
    without simulated rows it is once through the recorded ones. `heldout` is only watched. BadInput when there is
    nothing to train on, the recipe is nonsense or the loss stops being a number.
    """
    check_recipe(recipe)
    if not len(real.features):
        raise BadInput("no recorded shots to train on")
    rng = np.random.default_rng(recipe.seed)
    mean, scale = standardisation(real.features)
    flat, restore = ravel_pytree(jax.tree.map(jnp.asarray, initial_layers(rng)))
    steps = _make_steps(_make_batches(real, simulated, mean, scale, recipe), restore, recipe.learning_rate)
    state = (flat, optax.adam(recipe.learning_rate).init(flat))
    curve = []
    for done in _epoch_marks(recipe.epochs):
        epochs = done - (curve[-1].epoch if curve else 0)
        order = np.concatenate([epoch_batches(rng, len(real.features), _count(simulated)) for _ in range(epochs)])
        state = steps(state, jnp.asarray(order))
        network = Network(mean, scale, Layers(*map(np.asarray, restore(state[0]))))
        curve.append(CurvePoint(done, mean_loss(network, real), mean_loss(network, simulated),
                                mean_loss(network, heldout)))
        if not np.isfinite(curve[-1].real):
            raise BadInput(f"training diverged within {done} epochs: the loss is {curve[-1].real}; "
                           "lower --learning-rate")
        progress(done / recipe.epochs, f"loss {curve[-1].real:.3f}, held out {curve[-1].heldout:.3f}")
    return network, curve


def epoch_batches(rng: np.random.Generator, real: int, simulated: int) -> np.ndarray:
    """Row numbers of one epoch's batches, [batches, 20] (or [batches, 10] when `simulated` is 0).

    The first ten of a batch are recorded rows, 0 to real - 1; the rest simulated rows, numbered on from there. Both
    come from permutations; the last batch of simulated rows is filled up from the head of its permutation.
    """
    batches = -(-(simulated or real) // BATCH)
    if not simulated:
        return np.resize(rng.permutation(real), (batches, BATCH))
    rounds = -(-batches * BATCH // real)
    recorded = np.concatenate([rng.permutation(real) for _ in range(rounds)])[:batches * BATCH]
    imagined = real + np.resize(rng.permutation(simulated), batches * BATCH)
    return np.hstack([recorded.reshape(batches, BATCH), imagined.reshape(batches, BATCH)])


def cross_entropy(log_odds: Any, labels: Any) -> Any:
    """Binary cross-entropy of each row, summed over the two outputs: log odds [n, 2], labels [n, 2] -> [n] nats."""
    return jnp.sum(jax.nn.softplus(log_odds) - labels * log_odds, axis=-1)


def mean_loss(network: Network, rows: Rows | None) -> float:
    """Mean cross-entropy a row; NaN when there are none."""
    if rows is None or not len(rows.features):
        return float("nan")
    z = (rows.features - network.mean) * network.scale
    return float(jnp.mean(cross_entropy(logits(network.layers, z), rows.labels)))


def _make_batches(real: Rows, simulated: Rows | None, mean: np.ndarray, scale: np.ndarray,
                  recipe: Recipe) -> _Batches:
    weights = np.full(BATCH, 1.0 / BATCH)
    rows = real
    if _count(simulated):
        rows = Rows(*(np.concatenate(pair) for pair in zip(real, simulated, strict=True)))
        weights = np.concatenate([weights, recipe.simulated_weight * weights])
    return _Batches(jnp.asarray((rows.features - mean) * scale), jnp.asarray(rows.labels), jnp.asarray(weights))


def _make_steps(batches: _Batches, restore: Callable[[Any], Layers], learning_rate: float) -> Callable[..., Any]:
    """(state, order [steps, batch]) -> state after one Adam step for each row of `order`: one scan, compiled once."""
    adam = optax.adam(learning_rate)

    def loss(flat: Any, index: Any) -> Any:
        log_odds = logits(restore(flat), batches.features[index])
        return jnp.dot(batches.weights, cross_entropy(log_odds, batches.labels[index]))

    def step(state: Any, index: Any) -> tuple[Any, None]:
        flat, memory = state
        updates, memory = adam.update(jax.grad(loss)(flat, index), memory)
        return (optax.apply_updates(flat, updates), memory), None

    return jax.jit(lambda state, order: jax.lax.scan(step, state, order)[0])


def _epoch_marks(epochs: int) -> list[int]:
    """Epochs after which the losses are noted: at most CURVE_POINTS, as evenly as may be, the last one last."""
    return sorted({round(epochs * (k + 1) / CURVE_POINTS) for k in range(CURVE_POINTS)} - {0})


def _count(rows: Rows | None) -> int:
    return 0 if rows is None else len(rows.features)


def split_heldout(rows: Rows, share: float, seed: int) -> tuple[Rows, Rows]:
    """(kept, held out): `share` of each class is held out, drawn by seed; BadInput unless 0 <= share < 1."""
    if not 0.0 <= share < 1.0:
        raise BadInput(f"--holdout is {share}; it must be at least 0 and less than 1")
    rng = np.random.default_rng([seed, 1])
    level = rows.labels.sum(axis=1)
    out = np.zeros(len(level), bool)
    for value in np.unique(level):
        members = rng.permutation(np.flatnonzero(level == value))
        out[members[:round(share * len(members))]] = True
    return Rows(*(array[~out] for array in rows)), Rows(*(array[out] for array in rows))


def accuracy(network: Network, rows: Rows) -> dict[str, float | int | None]:
    """Share of rows whose outcome (of three), two-point hit and three-point hit are called right at p = 0.5."""
    if not len(rows.features):
        return {"shots": 0, "outcome": None, "two": None, "three": None}
    right = (probabilities(network, rows.features) >= 0.5) == (rows.labels >= 0.5)
    return {"shots": len(right), "outcome": float(right.all(axis=1).mean()),
            "two": float(right[:, 0].mean()), "three": float(right[:, 1].mean())}


def domain_of(features: np.ndarray) -> dict[str, list[float]]:
    """Where the model may be believed: the box around the recorded rows [n, 3], 10 % wider, within the contract.

    Simulated rows do not widen it: they cover configurations that no robot has shown anything about.
    """
    low, high = features.min(axis=0), features.max(axis=0)
    margin = 0.5 * DOMAIN_MARGIN * (high - low)
    return {feature.name: [float(max(feature.low, low[k] - margin[k])), float(min(feature.high, high[k] + margin[k]))]
            for k, feature in enumerate(FEATURES)}
