"""White plus first-order autoregressive noise of outputs: the filter that turns signals into independent innovations.

Compiled by Numba, and without declared shapes, which it does not take.
"""

from typing import Any

import numba
import numpy as np

Gains = tuple[Any, Any, Any]


def noise_gains(noise: Any, step_s: Any, known: Any) -> Gains:
    """Return gain, variance of the innovation and fade to the next sample [R, T, O] of the filter.

    Args:
        noise: Logs of white noise, slow noise and its time constant [O, 3].
        step_s: Time steps [R, T - 1].
        known: Which samples are known [R, T, O].
    """
    white, slow = np.exp(2.0 * noise[:, 0]), np.exp(2.0 * noise[:, 1])
    fade = np.ones(known.shape)
    fade[:, :-1] = np.exp(-step_s[:, :, None] / np.exp(noise[:, 2]))
    return (*_gains(white, slow, fade, known), fade)


@numba.njit(cache=True)
def _gains(white: Any, slow: Any, fade: Any, known: Any) -> Any:
    gain, variance = np.zeros(known.shape), np.ones(known.shape)
    for r in range(known.shape[0]):
        for o in range(known.shape[2]):
            p = slow[o]
            for t in range(known.shape[1]):
                if known[r, t, o]:
                    variance[r, t, o] = p + white[o]
                    gain[r, t, o] = p / (p + white[o])
                    p *= 1.0 - gain[r, t, o]
                f = fade[r, t, o] * fade[r, t, o]
                p = f * p + slow[o] * (1.0 - f)
    return gain, variance


@numba.njit(cache=True)
def whiten(parts: Any, gain: Any, variance: Any, fade: Any) -> Any:
    """Return signals [R, T, O, M] as innovations of unit variance; 0 where the output is unknown (gain 0)."""
    found = np.zeros(parts.shape)
    rows, samples, outputs, many = parts.shape
    for r in range(rows):
        for o in range(outputs):
            mean = np.zeros(many)
            for t in range(samples):
                for m in range(many):
                    if gain[r, t, o] > 0.0:
                        e = parts[r, t, o, m] - mean[m]
                        found[r, t, o, m] = e / np.sqrt(variance[r, t, o])
                        mean[m] += gain[r, t, o] * e
                    mean[m] *= fade[r, t, o]
    return found
