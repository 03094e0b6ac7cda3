"""What each repetition draws from the pool: its 100 configurations, split 80/20, and its 50 launched simulated ones."""

from typing import NamedTuple

import numpy as np

from truearc.sim.data.columns import OUTCOMES
from truearc.sim.data.dataset import Shots
from truearc_proof.reproduce.settings import Settings


class Draw(NamedTuple):
    """Row numbers: `train` and `test` of the real pool, `transfer` of the launched one; each even by outcome.

    `validation` is a part of `train`: it says when to stop training, and is fitted by what needs no stopping.
    """

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray
    transfer: np.ndarray


def draw(real: Shots, launched: Shots | None, settings: Settings, number: int) -> Draw:
    """The repetition of that number, from 0; the same settings and pools give the same draw.

    D_r is even by outcome, D_s^T by what the simulator said of it. Without `launched`, `transfer` is empty.
    """
    rng = np.random.default_rng([settings.base_seed, number, 33])
    chosen = _even(np.array(real.text("outcome")), settings.configurations, rng)
    test = _even(np.array(real.text("outcome"))[chosen], round(settings.test_share * len(chosen)), rng)
    kept = np.setdiff1d(np.arange(len(chosen)), test)
    train = chosen[kept]
    watched = _even(np.array(real.text("outcome"))[train], round(settings.test_share * len(train)), rng)
    if launched is None:
        transfer = np.zeros(0, np.int64)
    else:
        transfer = _even(np.array(launched.text("simulated")), settings.transfer,
                         np.random.default_rng([settings.base_seed, number, 34]))
    return Draw(train, train[watched], chosen[test], transfer)


def _even(outcomes: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """`count` ascending rows with as even a share of each outcome as there are rows for."""
    rest, chosen = count, []
    pools = sorted((rng.permutation(np.flatnonzero(outcomes == outcome)) for outcome in OUTCOMES), key=len)
    for number, pool in enumerate(pools):
        share = min(len(pool), -(-rest // (len(pools) - number)) if number else rest // len(pools))
        chosen.append(pool[:share])
        rest -= share
    return np.sort(np.concatenate(chosen))
