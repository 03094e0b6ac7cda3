"""The library of the sparse regressions: accelerations that the catalogue's flight terms stand for, linear in each.

A column is a term's acceleration at its usual size (one standard deviation of the catalogue's prior), linearised where
it is not linear, drag and lift inside another term at the middle of their priors: so one threshold, and one ridge,
means the same for every column, and the rivals have the same prior knowledge as truearc. Drag and lift themselves are
per coefficient (cd, cl), at the middle of their priors where they are not believed.

| column | acceleration | stands for |
|---|---|---|
| drag | abs(v) v | drag |
| magnus | w x v, w the no-slip spin of the wheels in the paper's convention | magnus |
| buoyancy | a constant, up | buoyancy, added_mass (the same once drag and lift are free) |
| wind_x, wind_y, wind_z | abs(v) e + (v.e / abs(v)) v, less the lift's w x e | each wind |
| spin_decay | time x (w x v), time since the track's first sample | spin_decay |
| spin_drag | w^2 v / abs(v) | spin_drag |
| drag_reynolds | (abs(v) / 10 m/s - 1) abs(v) v | drag_reynolds |
| lift_saturation | abs(w) / abs(v) (w x v) | lift_saturation |
| air_density | the gas's density change x (drag + lift) | air_density |
| drag_wear | the ball's age x drag | drag_wear |

What it cannot represent: whatever happens before the first sample (all of sensing and launch: a regression on
accelerations is blind to it and needs not care), the tracker's scale, tilt and clock (left out, though they are
accelerations too: fewer columns to take for the true one), each shot's own spin (wheels turn it by 5 % more or less
than they say), and each ball's own drag.
"""

import math
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.catalogue import find_terms

Array = np.ndarray
COLUMNS = ("drag", "magnus", "buoyancy", "wind_x", "wind_y", "wind_z", "spin_decay", "spin_drag", "drag_reynolds",
           "lift_saturation", "air_density", "drag_wear")
STANDS_FOR = {"buoyancy": ("buoyancy", "added_mass")}
FREE = ("drag", "magnus")             # whose coefficient no column has in it
CHANGES = {"buoyancy": None, "spin_decay": "magnus", "lift_saturation": "magnus"}      # others change drag
AT_M_S = 10.0                         # where the catalogue's drag_reynolds means its cd
WINDS = {"wind_x": 0, "wind_y": 1, "wind_z": 2}


class Moments(NamedTuple):
    """Balls in flight: velocity_m_s [..., 3]; backspin, time since the first sample, age, the relative change of the
    air's density, and the ball's own radius and mass, all [...]."""

    velocity_m_s: Array
    spin_rev_s: Array
    time_s: Array
    age: Array
    density: Array
    radius_m: Array
    mass_kg: Array


def candidates_of(known: tuple[str, ...]) -> tuple[str, ...]:
    """Columns beside the known ones: free ones, and those that change what is known, as truearc has its terms."""
    return tuple(name for name in COLUMNS if name not in known
                 and (name in FREE or CHANGES.get(name, "drag") in (None, *known)))


def usual_of(name: str) -> float:
    """Amplitude of a column's term that is usual; 1 for what has a coefficient of its own."""
    return 1.0 if name in FREE else _prior(name)[1]


def middle_of(name: str) -> float:
    """The middle of a coefficient's prior."""
    return _prior(name)[0]


def terms_of(column: str) -> tuple[str, ...]:
    """Terms of the catalogue that a column stands for."""
    return STANDS_FOR.get(column, (column,))


def accelerations(rig: Rig, names: tuple[str, ...], at: Moments) -> Array:
    """Columns [..., 3, K] in m/s2 by name, at each one's usual size; gravity is not among them."""
    parts = _Parts(rig, at)
    return np.stack([usual_of(name) * parts.column(name) for name in names], axis=-1)


def gravity(rig: Rig) -> Array:
    """[3] in m/s2."""
    return np.array([0.0, 0.0, -rig.world.gravity_m_s2])


class _Parts:
    """What columns are made of, worked out once."""

    def __init__(self, rig: Rig, at: Moments) -> None:
        self.at, self.facts = at, rig
        self.rim_m_s = 2.0 * math.pi * at.radius_m * at.spin_rev_s
        self.speed = np.maximum(np.linalg.norm(at.velocity_m_s, axis=-1), 1e-3)
        self.drag_per_m = 0.5 * math.pi * at.radius_m**2 * rig.air.density_kg_m3 / at.mass_kg
        self.lift_per_rev = 4.0 / 3.0 * 4.0 * math.pi**2 * at.radius_m**3 * rig.air.density_kg_m3 / at.mass_kg
        self.drag = -(self.drag_per_m * self.speed)[..., None] * at.velocity_m_s
        self.lift = self._lift(at.velocity_m_s)
        self.cd, self.cl = middle_of("drag"), middle_of("magnus")

    def column(self, name: str) -> Array:
        """[..., 3] per unit of the term's amplitude."""
        if name in WINDS:
            return self._wind(WINDS[name])
        share, force = self._shared(name)
        column: Array = share[..., None] * force
        return column

    def _shared(self, name: str) -> tuple[Array, Array]:
        """(factor [...], vector [..., 3])."""
        one, drag, lift = np.ones_like(self.speed), self.cd * self.drag, self.cl * self.lift
        slope = {"drag": (one, self.drag), "magnus": (one, self.lift), "buoyancy": (one, self._buoyancy()),
                 "spin_decay": (-self.at.time_s * one, lift),
                 "spin_drag": ((self.rim_m_s / self.speed)**2, self.drag),
                 "drag_reynolds": (self.speed / AT_M_S - 1.0, drag),
                 "lift_saturation": (-np.abs(self.rim_m_s) / self.speed, lift),
                 "air_density": (self.at.density * one, drag + lift), "drag_wear": (self.at.age * one, drag)}
        return slope[name]

    def _wind(self, axis: int) -> Array:
        """Change of drag and lift by 1 m/s of wind along an axis: the velocity through the air is less by that."""
        along = np.zeros(3)
        along[axis] = 1.0
        ahead = self.at.velocity_m_s / self.speed[..., None]
        slower = self.speed[..., None] * along + self.at.velocity_m_s[..., axis, None] * ahead
        lifted = self._lift(np.broadcast_to(along, ahead.shape))
        slope: Array = self.cd * self.drag_per_m[..., None] * slower - self.cl * lifted
        return slope

    def _lift(self, velocity_m_s: Array) -> Array:
        """Spin x velocity for backspin, which turns about the right-hand side."""
        x, _, z = np.moveaxis(velocity_m_s, -1, 0)
        spin = self.lift_per_rev * self.at.spin_rev_s
        return np.stack([-spin * z, np.zeros_like(spin * z), spin * x], axis=-1)

    def _buoyancy(self) -> Array:
        lighter = self.facts.air.density_kg_m3 * 4.0 / 3.0 * math.pi * self.at.radius_m**3 / self.at.mass_kg
        return np.broadcast_to(-lighter[..., None] * gravity(self.facts), self.at.velocity_m_s.shape)


def _prior(name: str) -> tuple[float, float]:
    """(middle, standard deviation) of a term's first fitted parameter."""
    term = find_terms([name])[0]
    prior = next(parameter.prior for parameter in term.parameters if parameter.prior is not None)
    return prior.centre, prior.sd
