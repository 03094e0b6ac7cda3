"""Many flights at once: classical Runge-Kutta on one grid of time, cubic Hermite between its moments."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from truearc_proof.truth.plan import Floats

Law = Callable[[float, Floats], Floats]          # (time_s, velocity [3, n]) -> acceleration [3, n]
STEP_S = 0.02
COARSE_S = 0.04                       # for aiming
LONGEST_S = 4.0


class Path(NamedTuple):
    """States of n flights every step_s from the exit on; x toward the target, y left, z up."""

    step_s: float
    position_m: Floats                # [T, 3, n]
    velocity_m_s: Floats              # [T, 3, n]


class Arrival(NamedTuple):
    """Where flights cross their planes; nan height: never. `clear`: above the floor all the way."""

    height_m: Floats
    time_s: Floats
    clear: np.ndarray


def fly(law: Law, position_m: Floats, velocity_m_s: Floats, distance_m: Floats, step_s: float = STEP_S) -> Path:
    """Fly from [3, n] until every ball is past x = distance_m, going back, or LONGEST_S old; the floor stops none."""
    position, velocity = [position_m], [velocity_m_s]
    for k in range(round(LONGEST_S / step_s)):
        p, v = position[-1], velocity[-1]
        if np.all((p[0] >= distance_m) | (v[0] <= 0.0)):
            break
        moved, turned = _step(law, k * step_s, p, v, step_s)
        position.append(moved)
        velocity.append(turned)
    return Path(step_s, np.stack(position), np.stack(velocity))


def _step(law: Law, t: float, p: Floats, v: Floats, h: float) -> tuple[Floats, Floats]:
    a1 = law(t, v)
    v2 = v + (0.5 * h) * a1
    a2 = law(t + 0.5 * h, v2)
    v3 = v + (0.5 * h) * a2
    a3 = law(t + 0.5 * h, v3)
    v4 = v + h * a3
    a4 = law(t + h, v4)
    return p + (h / 6.0) * (v + 2.0 * (v2 + v3) + v4), v + (h / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)


def arrive(path: Path, distance_m: Floats) -> Arrival:
    """First crossing of x = distance_m, by Newton on the cubic of its step."""
    beyond = path.position_m[:, 0] >= distance_m
    reached = beyond.any(axis=0)
    last = np.maximum(beyond.argmax(axis=0), 1)
    time = path.step_s * (last - 0.5)
    for _ in range(6):
        p, v = at(path, time, last - 1)
        time = time + (distance_m - p[0]) / np.maximum(v[0], 1e-3)
        time = np.clip(time, path.step_s * (last - 1), path.step_s * last)
    height = at(path, time, last - 1)[0][2]
    before = np.arange(len(beyond))[:, None] < last
    clear = reached & (height > 0.0) & np.all((path.position_m[:, 2] > 0.0) | ~before, axis=0)
    return Arrival(np.where(reached, height, np.nan), np.where(reached, time, np.nan), clear)


def at(path: Path, time_s: Floats, step: np.ndarray | None = None) -> tuple[Floats, Floats]:
    """Position and velocity [3, n] of each flight at its own time; step: whose cubic, by default that time's."""
    k = np.clip((time_s / path.step_s).astype(int), 0, len(path.position_m) - 2) if step is None else step
    lane = np.arange(len(time_s))
    p0, p1 = path.position_m[k, :, lane].T, path.position_m[k + 1, :, lane].T
    v0, v1 = path.velocity_m_s[k, :, lane].T * path.step_s, path.velocity_m_s[k + 1, :, lane].T * path.step_s
    s = time_s / path.step_s - k
    bend, twist = 3.0 * (p1 - p0) - 2.0 * v0 - v1, 2.0 * (p0 - p1) + v0 + v1
    return p0 + s * (v0 + s * (bend + s * twist)), (v0 + s * (2.0 * bend + 3.0 * s * twist)) / path.step_s
