"""Tracks as the regressions take them: cleaned as truearc cleans them, with what the robot knows of each shot."""

from dataclasses import dataclass

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.shot_conditions import circumstances_of
from truearc.sim.infer.likelihood.observations import gather_samples
from truearc.sim.physics.simulate import launch_of, launch_state, own_balls
from truearc_proof.rivals.claim import Array
from truearc_proof.rivals.library import Moments


@dataclass(frozen=True)
class Flights:
    """n tracks padded to L samples (padding repeats the last): time_s [n, L] from 0, position_m [n, L, 3], real [n, L].

    Of each shot [n]: backspin in rev/s by the wheels (0 without), the ball's age, the relative change of the air's
    density, the ball's own radius and mass (the rig's where not stated).
    """

    facts: Rig
    time_s: Array
    position_m: Array
    real: Array
    spin_rev_s: Array
    age: Array
    density: Array
    radius_m: Array
    mass_kg: Array

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def measured(self) -> Array:
        """[3] whether any ball moves along an axis; a film from the side has zeros."""
        moved: Array = np.ptp(self.position_m[self.real], axis=0) > 0.0
        return moved

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
        return Moments(velocity_m_s, self.spin_rev_s[k] * one, time_s,
                       *(part[k] * one for part in (self.age, self.density, self.radius_m, self.mass_kg)))


def gather_flights(dataset: Dataset) -> Flights:
    """InputError for a launch that is half known; tracks that are too short, and samples far off any flight, are left
    out."""
    if dataset.tracks is None:
        raise ValueError("there are no tracks")
    samples = gather_samples(dataset.tracks)[0]
    rows, facts, shots = samples.rows, dataset.facts, dataset.shots
    around = circumstances_of(dataset)
    launched = launch_state(facts, shots)
    spin = np.asarray(launch_of(facts, shots).spin_rev_s, dtype=float) if launched else np.zeros(len(shots))
    one = np.ones(len(shots))
    mass_kg, radius_m = own_balls(facts, shots) or (facts.ball.mass_kg * one, facts.ball.radius_m * one)
    return Flights(facts, samples.time_s, samples.position_m, samples.real, spin[rows], np.asarray(around.age)[rows],
                   np.asarray(around.density)[rows], radius_m[rows], mass_kg[rows])
