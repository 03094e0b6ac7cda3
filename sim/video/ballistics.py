"""The flight of a ball in the plane of a side view, and its least-squares fit to positions in a clip.

The acceleration is gravity, which may lean if the camera does, drag k |v| v against the motion, and lift s v across it,
of a spin that stays. A rolling shutter exposes the rows of a picture one after the other. Gravity is fitted as if it
were unknown: its value tests scale and clock. Numbers that a single flight tells little of have priors. Gauss-Newton
with numerical derivatives; Tukey's weights for outliers.
Frame: x to the right, z up. Units: those of the positions, and seconds.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
X, Z, VX, VZ, G, DRAG, LIFT, LEAN, READOUT = range(9)       # parameters of a flight
LONGEST_STEP_S = 0.04
STEPS = 8                             # of Gauss-Newton; a flight settles in three
TUKEY = 4.7                           # standard deviations at which a position has no weight left
LEAST_SCATTER = 0.3                   # of the stated sigma: few residuals can be small by chance
SMALL = np.array([1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4, 1e-5])        # steps of the derivatives

# Derived: drag of a ball, 3/8 x 1.2 x 0.5 / (radius x density), is 0.01/m of a baseball, 0.05/m of a foam ball of 18 cm
# and 0.13/m of a ball of table tennis; lift of a foam ball with backspin is a fifth of its weight at 10 m/s
DRAG_PRIOR, LIFT_PRIOR = (0.04, 0.05), (0.0, 0.25)        # 1/m, 1/s: mean and standard deviation
LEAN_SD = 0.04                        # rad: a phone held by hand is level to two degrees
READOUT_PRIOR = (0.012, 0.012)        # s from the first row to the last: sensors of phones take 8 to 30 ms


class FlightFit(NamedTuple):
    """A fitted flight.

    Fields:
        values: The parameters at the first time [9], in the order of X to READOUT.
        covariance: Theirs [9, 9].
        residual: Positions less fitted ones [n, 2].
        weight: 0 (outlier) to 1, a position [n].
        scatter: Standard deviation of a residual / stated sigma.
    """

    values: Floats
    covariance: Floats
    residual: Floats
    weight: Floats
    scatter: float

    @property
    def gravity_sd(self) -> float:
        """Standard deviation of the fitted gravity."""
        return float(np.sqrt(self.covariance[G, G]))


def fly(values: Floats, t_s: Floats) -> Floats:
    """Return positions [n, 2, m] and velocities behind them [n, 4, m] of m flights at rising times.

    Args:
        values: Parameters [9, m] at the first time.
        t_s: Times [n].
    """
    state = values[[X, Z, VX, VZ]].copy()
    found = np.empty((len(t_s), *state.shape))
    found[0] = state
    for k in range(1, len(t_s)):
        gap = t_s[k] - t_s[k - 1]
        pieces = max(1, int(np.ceil(gap / LONGEST_STEP_S)))
        for _ in range(pieces):
            state = _step(values, state, gap / pieces)
        found[k] = state
    return found


def _step(values: Floats, state: Floats, h: float) -> Floats:
    """One step of Runge and Kutta."""
    a = _rate(values, state)
    b = _rate(values, state + 0.5 * h * a)
    c = _rate(values, state + 0.5 * h * b)
    d = _rate(values, state + h * c)
    result: Floats = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return result


def _rate(values: Floats, state: Floats) -> Floats:
    vx, vz = state[2], state[3]
    drag = values[DRAG] * np.hypot(vx, vz)
    return np.stack([vx, vz, values[G] * values[LEAN] - drag * vx - values[LIFT] * vz,
                     -values[G] - drag * vz + values[LIFT] * vx])


class Priors(NamedTuple):
    """Mean and standard deviation of what a single flight tells little of.

    Fields:
        drag: In 1 / unit of length.
        lift: In 1/s.
        lean: In rad.
        readout: In s.
    """

    drag: tuple[float, float] = DRAG_PRIOR
    lift: tuple[float, float] = LIFT_PRIOR
    lean: tuple[float, float] = (0.0, LEAN_SD)
    readout: tuple[float, float] = READOUT_PRIOR


def fit_flight(t_s: Floats, place: Floats, sigma: Floats, row: Floats, priors: Priors) -> FlightFit:
    """Fit a flight to positions; covariance and scatter are by the residuals.

    Args:
        t_s: Times of the pictures, rising [n]; at least 4.
        place: Positions [n, 2].
        sigma: Their standard deviations but for a common factor [n].
        row: Share of the read-out after which each was exposed, -0.5 to 0.5 [n].
        priors: Of drag, lift, lean and read-out.
    """
    values, weight, scatter = _parabola(t_s, place), np.ones(len(t_s)), 1.0
    values[DRAG:], prior = np.array(priors)[:, 0], np.zeros(len(values))
    centre, prior[DRAG:] = values.copy(), np.array(priors)[:, 1] ** -2
    for number in range(STEPS):
        jacobian, fitted = derivatives(values, t_s, row)
        residual = place - fitted
        size = np.hypot(residual[:, 0], residual[:, 1]) / sigma
        free = max(2.0 * weight.sum() - 5.0, 1.0)
        # at first the median, which outliers do not move
        scatter = max(float(np.median(size)) / 1.177 if number < 2 else
                      float(np.sqrt((weight * size ** 2).sum() / free)), LEAST_SCATTER)
        if number:
            # no position is an outlier that is off by no more than its sigma explains
            weight = np.clip(1.0 - (size / (TUKEY * max(scatter, 1.0))) ** 2, 0.0, 1.0) ** 2
        rows = (weight / (sigma * scatter) ** 2)[:, None, None]
        information = np.einsum("nik,nil->kl", jacobian * rows, jacobian) + np.diag(prior)
        score = np.einsum("nik,ni->k", jacobian * rows, residual) + prior * (centre - values)
        change = np.linalg.solve(information, score)
        for bound in (DRAG, READOUT):
            if values[bound] + change[bound] < 0.0:       # at its bound; the others are solved for that
                others = np.arange(len(values)) != bound
                change[bound] = -values[bound]
                rest = score[others] - information[others, bound] * change[bound]
                change[others] = np.linalg.solve(information[np.ix_(others, others)], rest)
        values = values + change
    return FlightFit(values, np.linalg.pinv(information), place - derivatives(values, t_s, row)[1], weight, scatter)


def _parabola(t_s: Floats, place: Floats) -> Floats:
    """Parameters of the parabola through positions, without air."""
    since = t_s - t_s[0]
    quadratic = np.stack([np.ones_like(since), since, 0.5 * since ** 2], axis=1)
    (x, z), (vx, vz), (_, az) = np.linalg.lstsq(quadratic, place, rcond=None)[0]
    return np.array([x, z, vx, vz, -az, 0.0, 0.0, 0.0, 0.0])


def derivatives(values: Floats, t_s: Floats, row: Floats) -> tuple[Floats, Floats]:
    """Return derivatives [n, 2, 9] and positions [n, 2] of a flight."""
    beside = np.concatenate([values[:, None], values[:, None] + np.diag(SMALL)], axis=1)
    states = fly(beside, t_s)
    # a row is exposed later than the picture's middle by its share of the read-out, to second order
    late = row[:, None] * beside[READOUT]
    flights = states[:, :2] + late[:, None] * states[:, 2:]
    flights[:, 1] -= 0.5 * late ** 2 * beside[G]
    return (flights[..., 1:] - flights[..., :1]) / SMALL, flights[..., 0]
