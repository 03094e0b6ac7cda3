"""The rack of balls, what each is like, and how one seating differs from the next."""

from typing import NamedTuple

import numpy as np

from truearc.sim.world.options import Options

RACK = 12
MASS_KG = 0.14
RADIUS_M = 0.0889
STIFFNESS_N_M = 8000.0            # of one squeezed side; 23 mm on each side is then 184 N

# Standard deviations at scatter_scale 1. Between balls of one rack:
MASS_SHARE = 0.015
RADIUS_SHARE = 0.003
STIFFNESS_SHARE = 0.06
# From shot to shot of one ball:
FRICTION_SHARE = 0.04             # dust, seam
SEAT_M = 0.002                    # where in the chute it lies, along the line of wheel centres
SIDE_M_S = 0.05                   # sideways drift when the wheels take it
DRAG_SHARE = 0.02                 # how its seams happen to face the air


class Ball(NamedTuple):
    """One ball as it is for one shot."""

    ball_id: str
    mass_kg: float
    radius_m: float
    stiffness_n_m: float
    friction_scale: float
    drag_scale: float
    seat_m: float
    side_m_s: float


class Rack:
    """Balls come in a shuffled order, all of them before any comes again; each wears as it is used."""

    def __init__(self, seed: int, options: Options) -> None:
        self._seed = seed
        self._options = options
        draws = np.random.default_rng([seed, 1]).standard_normal((RACK, 3)) * options.scatter_scale
        self._draws = np.clip(draws, -3.0, 3.0)
        self._used = [0] * RACK

    def ball(self, shot: int) -> Ball:
        """The ball that shot number `shot` (from 0) will be, as worn as it is now."""
        number = self._number(shot)
        options = self._options
        mass, radius, stiffness = self._draws[number]
        used = self._used[number]
        noise = np.clip(np.random.default_rng([self._seed, 2, shot]).standard_normal(4), -3.0, 3.0)
        friction, seat, side, drag = noise * options.scatter_scale
        warm = max(0.2, 1.0 + options.stiffness_per_c * (options.temperature_c - 20.0))
        return Ball(
            ball_id=f"ball{number + 1:02d}",
            mass_kg=MASS_KG * options.ball_mass_scale * float(1.0 + MASS_SHARE * mass),
            radius_m=RADIUS_M * options.ball_radius_scale * float(1.0 + RADIUS_SHARE * radius)
            * (1.0 - options.wear_radius_per_shot) ** used,
            stiffness_n_m=STIFFNESS_N_M * options.ball_stiffness_scale * float(1.0 + STIFFNESS_SHARE * stiffness)
            * warm * (1.0 - options.wear_stiffness_per_shot) ** used,
            friction_scale=options.ball_friction_scale * float(1.0 + FRICTION_SHARE * friction)
            * (1.0 - options.wear_friction_per_shot) ** used,
            drag_scale=float(1.0 + DRAG_SHARE * drag),
            seat_m=float(SEAT_M * seat),
            side_m_s=float(SIDE_M_S * side),
        )

    def use(self, shot: int) -> None:
        """The ball of that shot has gone through the wheels."""
        self._used[self._number(shot)] += 1

    def _number(self, shot: int) -> int:
        order = np.random.default_rng([self._seed, 3, shot // RACK]).permutation(RACK)
        return int(order[shot % RACK])
