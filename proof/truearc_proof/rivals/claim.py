"""The entrants' common interface, the simplest entrant, and tracks and laws in the form that regressions need.

The simplest entrant claims the term that fits the given shots best. It refits as truearc does, and the term with the
highest likelihood wins unconditionally, so this entrant always names a term. Of the catalogue's terms, it refits the
LIKELY terms with the largest first-step gains (refitting more would take minutes in dirty worlds, whose fits converge
slowly), and those that truearc has refitted itself. It ranks terms by the log likelihood of the fitted shots, without
hold-out shots and without the penalty of a prior.

Tracks are cleaned as in truearc, using what the robot knows of each shot.

The library of a regression contains the accelerations of the catalogue's flight terms; the law is linear in each.

A column is a term's acceleration at its usual size (one standard deviation of the catalogue's prior). It is linearised
if it is nonlinear, and drag and lift within another term are at the middle of their priors. A threshold or a ridge thus
means the same for every column, and the rivals have the same prior knowledge as truearc. The columns of drag and lift
themselves are per unit of their coefficients (cd, cl), at the middle of their priors unless believed.

| column | acceleration | stands for |
|---|---|---|
| drag | abs(v) v | drag |
| magnus | w x v, where w is the no-slip spin of the wheels in the paper's convention | magnus |
| buoyancy | a constant, up | buoyancy, added_mass (the same once drag and lift are free) |
| wind_x, wind_y, wind_z | abs(v) e + (v.e / abs(v)) v, less the lift's w x e | each wind |
| spin_decay | time x (w x v), with the time since the track's first sample | spin_decay |
| spin_drag | w^2 v / abs(v) | spin_drag |
| drag_reynolds | (abs(v) / 10 m/s - 1) abs(v) v | drag_reynolds |
| lift_saturation | abs(w) / abs(v) (w x v) | lift_saturation |
| air_density | the gas's density change x (drag + lift) | air_density |
| drag_wear | the ball's age x drag | drag_wear |

The library cannot represent events before the first sample (all of sensing and launch, to which a regression on
accelerations is blind), each shot's own spin (which differs from that of the wheels by 5 %), or each ball's own drag.
The tracker's scale, tilt and clock are accelerations too, but they are omitted so that fewer columns can be mistaken
for the true one.

`end_errors` forecasts the height at a track's end, as truearc's own figure does (truearc.sim.discover.select.
simulations): the first 40 % of a track's samples determine the initial conditions, and the law continues the flight.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, circumstances_of
from truearc.sim.discover.investigate import Investigation
from truearc.sim.discover.select.simulations import FORECAST
from truearc.sim.discover.select.terms import Candidate, one_step
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.observations import gather_samples
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.simulate import launch_of, launch_state, own_balls

Array = np.ndarray
LIKELY = 3
MOST_USUAL = 3.0                      # usual sizes from which a refit starts at most


class Claim(Struct, frozen=True):
    """One entrant's claim about one world.

    says_something: that the believed simulation lacks something. names: terms of the catalogue, likeliest first; empty
    if none is named.
    """

    says_something: bool
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class RivalBelief:
    """The believed simulation fitted to the dataset, as truearc fits it; refits: of single terms, as far as made."""

    fitted: LauncherFit
    refits: Mapping[str, LauncherFit] = field(default_factory=dict)

    @property
    def terms(self) -> tuple[str, ...]:
        """The believed terms."""
        columns = self.fitted.scores.columns[self.fitted.scores.first_shared:]
        return tuple(dict.fromkeys(column.name.partition(".")[0] for column in columns if column.kind == "shared"))


Rival = Callable[[Dataset, RivalBelief, int], Claim]


def believed_of(found: Investigation) -> RivalBelief | None:
    """Return the belief from truearc's own investigation; None if the data allow no test."""
    if found.fitted is None:
        return None
    refits = found.steps[0].naming.refits if found.steps else {}
    return RivalBelief(found.fitted, refits)


def rms(errors: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(errors))))


def answer_argmax(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return names by how well they fit; nothing in it is random."""
    fitted = believed.fitted
    candidates = [one for one in one_step(fitted.scores)[0] if one.visible]
    if not candidates:
        return Claim(False)
    ordered = sorted(candidates, key=lambda one: -one.z**2)
    refits = {one.name: believed.refits.get(one.name) or _refit(fitted, one) for k, one in enumerate(ordered)
              if k < LIKELY or one.name in believed.refits}
    fits = {name: float(found.scores.log_score.sum()) for name, found in refits.items()}
    ranked = sorted(fits, key=lambda name: -fits[name]) + [one.name for one in ordered if one.name not in fits]
    return Claim(True, tuple(dict.fromkeys(name.partition(".")[0] for name in ranked)))


def _refit(fitted: LauncherFit, one: Candidate) -> LauncherFit:
    """From one step on, tamed: all is linear nearby only."""
    usual = fitted.scores.columns[one.column].usual
    return fitted.with_terms((one.name,), np.clip([one.amplitude], -MOST_USUAL * usual, MOST_USUAL * usual))


# --- tracks and laws

COLUMNS = ("drag", "magnus", "buoyancy", "wind_x", "wind_y", "wind_z", "spin_decay", "spin_drag", "drag_reynolds",
           "lift_saturation", "air_density", "drag_wear")
STANDS_FOR = {"buoyancy": ("buoyancy", "added_mass")}
FREE = ("drag", "magnus")             # whose coefficient no column has in it
CHANGES = {"buoyancy": None, "spin_decay": "magnus", "lift_saturation": "magnus"}      # others change drag
AT_M_S = 10.0                         # where the catalogue's drag_reynolds means its cd
WINDS = {"wind_x": 0, "wind_y": 1, "wind_z": 2}
FEWEST = 4                            # samples that tell how a ball left
STEPS = 2                             # of Gauss-Newton; flights are all but linear in how they begin
NUDGE = 1e-3
SLOWEST_M_S = 0.5


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
    """Return columns besides the known ones: free ones, and those that change what is known, as in truearc's terms."""
    return tuple(name for name in COLUMNS if name not in known
                 and (name in FREE or CHANGES.get(name, "drag") in (None, *known)))


def usual_of(name: str) -> float:
    """Return the usual amplitude of a column's term; 1 for a column with its own coefficient."""
    return 1.0 if name in FREE else _prior(name)[1]


def middle_of(name: str) -> float:
    """Return the middle of a coefficient's prior."""
    return _prior(name)[0]


def terms_of(column: str) -> tuple[str, ...]:
    """Return the terms of the catalogue that a column stands for."""
    return STANDS_FOR.get(column, (column,))


def accelerations(rig: Rig, names: tuple[str, ...], at: Moments) -> Array:
    """Return columns [..., 3, K] in m/s2 by name, at each one's usual size; gravity is not among them."""
    parts = _Parts(rig, at)
    return np.stack([usual_of(name) * parts.column(name) for name in names], axis=-1)


def gravity(rig: Rig) -> Array:
    """Return gravity [3] in m/s2."""
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
        """Return [3] whether any ball moves along an axis; a film from the side has zeros."""
        moved: Array = np.ptp(self.position_m[self.real], axis=0) > 0.0
        return moved

    def filled(self, k: int) -> tuple[Array, Array]:
        """Return times [T] at even steps and positions [T, 3] of track k, with lost frames interpolated linearly.

        Smoothers need even steps, and a line is off by a millimetre or two.
        """
        time_s, position_m = self.time_s[k][self.real[k]], self.position_m[k][self.real[k]]
        step_s = float(np.median(np.diff(time_s)))
        even_s = step_s * np.arange(round(time_s[-1] / step_s) + 1)
        return even_s, np.stack([np.interp(even_s, time_s, one) for one in position_m.T], axis=1)

    def moments(self, k: int, time_s: Array, velocity_m_s: Array) -> Moments:
        """Return the moments of track k at times [T] and velocities [T, 3]."""
        one = np.ones(len(time_s))
        return Moments(velocity_m_s, self.spin_rev_s[k] * one, time_s,
                       *(part[k] * one for part in (self.age, self.density, self.radius_m, self.mass_kg)))


def gather_flights(dataset: Dataset) -> Flights:
    """Gather tracks, omitting those that are too short and samples far off any flight.

    InputError for a launch that is only partly known.
    """
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


def end_errors(flights: Flights, names: tuple[str, ...], weights: Array) -> Array:
    """Return [n] in m: measured height of each track's last sample minus the forecast by gravity and columns `names`
    with each track's own weights [n, K]."""
    used = np.flatnonzero((weights != 0.0).any(axis=0))
    law = _Law(flights, tuple(names[k] for k in used), weights[:, used])
    count = flights.real.sum(1)
    early = np.arange(flights.time_s.shape[1]) < np.maximum((FORECAST * count).astype(int), FEWEST)[:, None]
    last = (np.arange(len(flights)), count - 1)
    start = _first_guess(flights, early)
    for _ in range(STEPS):
        flown, slopes = law.slopes(start)
        off = np.where(early[..., None], flights.position_m - flown, 0.0).reshape(len(flights), -1)
        slopes = np.where(early[..., None, None], slopes, 0.0).reshape(len(flights), -1, 6)
        square = np.einsum("nri,nrj->nij", slopes, slopes)
        start = start + np.linalg.solve(square, np.einsum("nri,nr->ni", slopes, off)[..., None])[..., 0]
    off_m: Array = flights.position_m[last][:, 2] - law.fly(start)[last][:, 2]
    return off_m


class _Law:
    """Flies all tracks at once on their own times by Runge-Kutta (classical), a step a frame."""

    def __init__(self, flights: Flights, names: tuple[str, ...], weights: Array) -> None:
        self.flights, self.names, self.weights = flights, names, weights
        self.step_s = np.diff(flights.time_s, axis=1)

    def fly(self, start: Array) -> Array:
        """Positions [n, L, 3] from position and velocity [n, 6] at the first sample."""
        position, velocity = start[:, :3], start[:, 3:]
        path = [position]
        for k in range(self.step_s.shape[1]):
            h, t = self.step_s[:, k, None], self.flights.time_s[:, k]
            a1 = self._pull(t, velocity)
            a2 = self._pull(t + 0.5 * h[:, 0], velocity + 0.5 * h * a1)
            a3 = self._pull(t + 0.5 * h[:, 0], velocity + 0.5 * h * a2)
            a4 = self._pull(t + h[:, 0], velocity + h * a3)
            position = position + h * velocity + h**2 / 6.0 * (a1 + a2 + a3)
            velocity = velocity + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            path.append(position)
        return np.stack(path, axis=1)

    def slopes(self, start: Array) -> tuple[Array, Array]:
        """(positions [n, L, 3], their slopes in how the ball began [n, L, 3, 6]); a shift shifts all."""
        flown = self.fly(start)
        slopes = np.zeros((*flown.shape, 6))
        for k in range(3):
            slopes[..., k, k] = 1.0
            nudged = start.copy()
            nudged[:, 3 + k] += NUDGE
            slopes[..., 3 + k] = (self.fly(nudged) - flown) / NUDGE
        return flown, slopes

    def _pull(self, time_s: Array, velocity_m_s: Array) -> Array:
        pull = np.broadcast_to(gravity(self.flights.facts), velocity_m_s.shape)
        if not self.names:
            return pull
        speed = np.linalg.norm(velocity_m_s, axis=1, keepdims=True)
        velocity_m_s = velocity_m_s * np.maximum(speed, SLOWEST_M_S) / np.maximum(speed, 1e-9)
        flights = self.flights
        at = Moments(velocity_m_s, flights.spin_rev_s, time_s, flights.age, flights.density, flights.radius_m,
                     flights.mass_kg)
        pulled: Array = pull + np.einsum("nck,nk->nc", accelerations(flights.facts, self.names, at), self.weights)
        return pulled


def _first_guess(flights: Flights, early: Array) -> Array:
    """[n, 6] from a parabola through the early samples."""
    start = np.zeros((len(flights), 6))
    for k, mine in enumerate(early):
        curve = np.polynomial.polynomial.polyfit(flights.time_s[k][mine], flights.position_m[k][mine], 2)
        start[k] = np.concatenate([curve[0], curve[1]])
    return start
