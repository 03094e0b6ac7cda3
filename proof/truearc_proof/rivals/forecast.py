"""Forecast of the height at a track's end, from its beginning by a law of library columns.

The same question that truearc's own figure answers (truearc.sim.discover.select.simulations): the first 40 % of a
track's samples tell how the ball left, the law flies it on. truearc also knows wheels and hood when it does so; a law
of accelerations does not, so compare each entrant's after with its own before.
"""

import numpy as np

from truearc.sim.discover.select.simulations import FORECAST
from truearc_proof.rivals.claim import Array
from truearc_proof.rivals.library import Moments, accelerations, gravity
from truearc_proof.rivals.tracks import Flights

FEWEST = 4                            # samples that tell how a ball left
STEPS = 2                             # of Gauss-Newton; flights are all but linear in how they begin
NUDGE = 1e-3
SLOWEST_M_S = 0.5


def end_errors(flights: Flights, names: tuple[str, ...], weights: Array) -> Array:
    """[n] in m: measured height of each track's last sample less the forecast by gravity and columns `names` with
    each track's own weights [n, K]."""
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
