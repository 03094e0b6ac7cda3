"""The paper's network at every amount and weight of simulated data, in every repetition, trained as one batch."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from truearc.sim.paper.network import probabilities
from truearc.sim.paper.settings import Recipe
from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.paper.train_many import Job, train_many
from truearc.sim.printed import Progress
from truearc_proof.reproduce.repetition import Repetition
from truearc_proof.reproduce.settings import Settings


class Answer(NamedTuple):
    """One network's p [70, 2] on the test rows, its least validation loss and the epoch of that."""

    p: np.ndarray
    validation_loss: float
    epoch: int


def settings_of(settings: Settings) -> list[SweepSetting]:
    """Table II's and Figure 10's, each once."""
    return list(dict.fromkeys([*(SweepSetting(size, settings.best_weight) for size in settings.sizes),
                               *(SweepSetting(settings.best_size, weight) for weight in settings.weights)]))


def train_networks(repetitions: Sequence[Repetition], settings: Settings,
                   progress: Progress) -> list[dict[SweepSetting, Answer]]:
    """One answer for each setting, repetition by repetition; first weights and minibatches follow the repetition."""
    wanted = settings_of(settings)
    jobs = [Job(one.learn, one.simulated.get(setting.size), one.validation, setting.weight,
                1000 * settings.base_seed + one.number) for one in repetitions for setting in wanted]
    trained = iter(train_many(jobs, Recipe(steps=settings.steps, patience=settings.patience), progress))
    answers = []
    for one in repetitions:
        named = {}
        for setting in wanted:
            network = next(trained)
            loss = min(point.validation for point in network.curve)
            named[setting] = Answer(probabilities(network.network, one.asked.features), loss, network.epoch)
        answers.append(named)
    return answers
