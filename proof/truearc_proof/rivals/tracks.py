"""Tracks as the regressions take them: cleaned as truearc cleans them, with what the robot knows of each shot."""

from dataclasses import dataclass

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.shot_conditions import circumstances_of
from truearc.sim.infer.likelihood.track_noise import gather_samples
from truearc.sim.physics.simulate import launch_of
from truearc_proof.rivals.claim import Array
from truearc_proof.rivals.library import Moments


@dataclass(frozen=True)
class Flights:
    """n tracks padded to L samples (padding repeats the last): time_s [n, L] from 0, position_m [n, L, 3], real [n, L].

    Of each shot [n]: backspin in rev/s by the wheels, the ball's age, the relative change of the air's density.
    """

    facts: Rig
    time_s: Array
    position_m: Array
    real: Array
    spin_rev_s: Array
    age: Array
    density: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def filled(self, k: int) -> tuple[Array, Array]:
        """Times [T] at even steps and positions [T, 3] of track k, lost frames by straight lines between their
        neighbours: smoothers want even steps, and a line is off by a millimetre or two."""
        time_s, position_m = self.time_s[k][self.real[k]], self.position_m[k][self.real[k]]
        step_s = float(np.median(np.diff(time_s)))
        even_s = step_s * np.arange(round(time_s[-1] / step_s) + 1)
        return even_s, np.stack([np.interp(even_s, time_s, one) for one in position_m.T], axis=1)

    def moments(self, k: int, time_s: Array, velocity_m_s: Array) -> Moments:
        """Of track k at times [T] and velocities [T, 3]."""
        one = np.ones(len(time_s))
        return Moments(velocity_m_s, self.spin_rev_s[k] * one, time_s, self.age[k] * one, self.density[k] * one)


def gather_flights(dataset: Dataset) -> Flights:
    """InputError without wheels; tracks that are too short, and samples far off any flight, are left out."""
    if dataset.tracks is None:
        raise ValueError("there are no tracks")
    samples = gather_samples(dataset.tracks, len(dataset.shots))[0]
    rows = samples.rows
    around = circumstances_of(dataset)
    spin = np.asarray(launch_of(dataset.facts, dataset.shots).spin_rev_s, dtype=float)
    return Flights(dataset.facts, samples.time_s, samples.position_m, samples.real, spin[rows],
                   np.asarray(around.age)[rows], np.asarray(around.density)[rows])
