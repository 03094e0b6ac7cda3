"""Likelihood of tracks with each flight's own deviations integrated out (JAX).

About a point near the best one, positions are linear in a flight's unknowns d (deviations of its launch, and when it
left), so that y ~ N(f - J d0, J P J' + s^2 I) in closed form; P is the prior of d and s the tracker's noise.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float

from truearc.sim.infer.likelihood.track_data import TrackData
from truearc.sim.physics.flight import Law, rk4
from truearc.sim.physics.term import BallState
from truearc.sim.physics.vector import Vec

LEAD_SD_S = 1.0                       # from exit to first sample: effectively unknown
FREE_SD = (10.0, 10.0, 100.0, 100.0)  # start of a free flight about its guess, in m and m/s: effectively unknown
LEAD_STEPS = 4
STEP = 1e-3                           # of every unknown, for the derivatives by it
SUBSTEPS = 2                          # between samples, which come every hundredth of a second or a few


Look = Callable[[Vec, Vec, Any], Vec]    # position in m, velocity in m/s, time since release -> what a tracker says


class Start(NamedTuple):
    """Where and how flights start, arrays [k]: place in m, velocity in m/s, backspin in rev/s."""

    x_m: Float[Any, " k"]
    z_m: Float[Any, " k"]
    vx_m_s: Float[Any, " k"]
    vz_m_s: Float[Any, " k"]
    spin_rev_s: Float[Any, " k"]


class TrackLinearization(NamedTuple):
    """A flight's unknowns after its track: log-likelihood [k], mean [k, m] and covariance [k, m, m]."""

    log_likelihood: Float[Any, " k"]
    mean: Float[Any, "k m"]
    covariance: Float[Any, "k m m"]


def as_it_is(position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
    """A tracker that sees the ball where it is."""
    return position_m


def positions(law: Law, start: Start, lead_s: Float[Any, " k"], time_s: Float[Any, "k l"],
              look: Look = as_it_is) -> Float[Any, "k l 2"]:
    """(down, up) as the tracker has them at lead_s + time_s after the start."""
    def step(state: tuple[Any, ...], step_s: Any, parts: int) -> tuple[Any, ...]:
        def part(state: tuple[Any, ...], _: None) -> tuple[tuple[Any, ...], None]:
            x, z, vx, vz, flown_s = state
            ball = BallState(Vec(x, 0.0, z), Vec(vx, 0.0, vz), Vec(0.0, -start.spin_rev_s, 0.0), flown_s)
            moved = rk4(law, ball, step_s / parts)
            return (moved.position_m.x, moved.position_m.z, moved.velocity_m_s.x, moved.velocity_m_s.z,
                    moved.time_s), None

        return lax.scan(part, state, None, length=parts)[0]

    def sample(state: tuple[Any, ...], step_s: Any) -> tuple[tuple[Any, ...], Any]:
        state = step(state, step_s, SUBSTEPS)
        return state, looked(state)

    def looked(state: tuple[Any, ...]) -> Any:
        x, z, vx, vz, flown_s = state
        place = look(Vec(x, 0.0, z), Vec(vx, 0.0, vz), flown_s)
        return jnp.stack([place.x, place.z], axis=-1)

    shape = jnp.shape(time_s)[:1]
    first = step(tuple(jnp.broadcast_to(part, shape) for part in (*start[:4], jnp.zeros(()))), lead_s, LEAD_STEPS)
    rest = lax.scan(sample, first, jnp.diff(time_s, axis=1).T)[1]
    whole = jnp.concatenate([looked(first)[None], rest])
    return jnp.swapaxes(whole, 0, 1)


def launched(law: Law, exit: Any, release_height_m: float, at: Float[Any, "k 3"], time_s: Float[Any, "k l"],
             look: Look = as_it_is) -> Float[Any, "k l 2"]:
    """Positions of flights that leave with deviations `at`: log speed, elevation in rad, lead in s."""
    speed, elevation = exit.speed_m_s * jnp.exp(at[:, 0]), exit.elevation_rad + at[:, 1]
    zero = jnp.zeros_like(speed)
    start = Start(zero, zero + release_height_m + exit.above_m, speed * jnp.cos(elevation), speed * jnp.sin(elevation),
                  exit.spin_rev_s + zero)
    return positions(law, start, at[:, 2], time_s, look)


def loose(law: Law, spin_rev_s: Any, at: Float[Any, "k 4"], time_s: Float[Any, "k l"],
          look: Look = as_it_is) -> Float[Any, "k l 2"]:
    """Positions of free flights that start with `at`: x, z in m, their velocities in m/s.

    spin_rev_s: at the first sample, from which the time since release is counted too, since the release is unknown.
    """
    x_m, z_m, vx_m_s, vz_m_s = at.T
    return positions(law, Start(x_m, z_m, vx_m_s, vz_m_s, spin_rev_s), jnp.zeros(at.shape[0]), time_s, look)


def linear(fly: Any, data: TrackData, at: Float[Any, "k m"], mean: Float[Any, "k m"], sd: Float[Any, "k m"],
           noise_m: Any) -> TrackLinearization:
    """Integrate the unknowns out about `at`; their prior is normal with `mean` and `sd`.

    fly: at [k, m] -> positions [k, l, 2]; its derivatives are central differences of flights side by side, as in
    truearc.sim.infer.likelihood.heights and for the same reason. Whitened by the prior's sd: right for an unknown
    that is known exactly too.
    """
    m = at.shape[1]
    changes = jnp.concatenate([jnp.zeros((1, m)), jnp.eye(m), -jnp.eye(m)]) * STEP
    paths = jax.vmap(lambda change: fly(at + change))(changes)
    flown = paths[0]
    slopes = jnp.moveaxis((paths[1:m + 1] - paths[m + 1:]) / (2.0 * STEP), 0, -1) * data.mask[..., None, None]
    seen = jnp.stack([data.down_m, data.up_m], axis=-1)
    off = (seen - flown) * data.mask[..., None] + jnp.einsum("klci,ki->klc", slopes, at - mean)
    white = slopes * sd[:, None, None, :] / noise_m
    inner = jnp.eye(m) + jnp.einsum("klci,klcj->kij", white, white)
    log_det, inverse = log_det_and_inverse(inner)
    pull = jnp.einsum("klci,klc->ki", white, off) / noise_m
    shift = jnp.einsum("kij,kj->ki", inverse, pull)
    samples = 2.0 * data.mask.sum(1)
    quadratic = (off**2).sum((1, 2)) / noise_m**2 - (pull * shift).sum(1)
    value = -0.5 * (quadratic + log_det + samples * (2.0 * jnp.log(noise_m) + np.log(2.0 * np.pi)))
    return TrackLinearization(value, mean + sd * shift, sd[:, :, None] * inverse * sd[:, None, :])


def guess_start(data: TrackData, samples: int = 8) -> Float[np.ndarray, "k 4"]:
    """Start of each flight, x, z and velocities, by a parabola through the first samples."""
    guesses = []
    for time_s, down_m, up_m, mask in zip(data.time_s, data.down_m, data.up_m, data.mask, strict=True):
        count = min(int(mask.sum()), samples)
        fits = [np.polyfit(time_s[:count], part[:count], 2) for part in (down_m, up_m)]
        guesses.append([fits[0][2], fits[1][2], fits[0][1], fits[1][1]])
    return np.array(guesses)


def guess_lead(data: TrackData, exit: Any) -> Float[np.ndarray, "k 3"]:
    """Deviations to start from: none, and the time that the launch takes to the first sample."""
    ahead_m_s = np.maximum(np.asarray(exit.speed_m_s) * np.cos(exit.elevation_rad), 0.5)
    zero = np.zeros(len(data.row))
    return np.column_stack([zero, zero, np.clip(data.down_m[:, 0] / ahead_m_s[data.row], -0.5, 2.0)])


def log_det_and_inverse(matrix: Float[Any, "n m m"]) -> tuple[Float[Any, " n"], Float[Any, "n m m"]]:
    """(log of the determinant [n], inverse [n, m, m]) of positive definite matrices [n, m, m], by Gauss-Jordan.

    No library call, so that derivatives of any order are cheap.
    """
    size = matrix.shape[-1]
    left, right = matrix, jnp.broadcast_to(jnp.eye(size), matrix.shape)
    log_det = jnp.zeros(matrix.shape[:-2])
    for row in range(size):
        pivot = left[..., row, row]
        log_det = log_det + jnp.log(pivot)
        left_row, right_row = left[..., row, :] / pivot[..., None], right[..., row, :] / pivot[..., None]
        factor = left[..., :, row] - jnp.eye(size)[row]
        left = left - factor[..., :, None] * left_row[..., None, :]
        right = right - factor[..., :, None] * right_row[..., None, :]
    return log_det, right
