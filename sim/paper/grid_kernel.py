"""Vectorised flights for the grid, 64 at a time, by the paper's equation of motion: gravity, drag and lift in a plane.

The flight equals that of truearc.sim.physics.flight, with scalars instead of arrays. It is integrated by Runge-Kutta
steps with a step length for each lane; the turning point and the crossings of the plane and the floor are found within
the last step. The flight continues through the floor down to `deepest_m`, so that the height at the plane is continuous
in the coefficients; the lowest height on the way is also returned.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.terms.flight import drag_per_m

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Numbers = tuple[float, ...]
Pair = tuple[float, float]            # what the law takes, (cd, cl), and what it gives, (ax, az)
Ball = tuple[float, float, float, float]      # x, z, vx, vz

LANES = 64                            # eight registers of eight doubles: enough to hide the latency of one
NEWTON_STEPS = 8
CLOSE_S = 1e-11                       # where Newton's method stops
TINY = 1e-200                         # of a square of speed: a ball at rest
# No promise that nothing is NaN or infinite: the others only let sums be reordered and products contracted.
REORDER = {"nsz", "arcp", "contract", "afn", "reassoc"}
fast = njit(fastmath=REORDER, error_model="numpy", nogil=True, cache=True)
small = njit(fastmath=REORDER, error_model="numpy", nogil=True, cache=True, forceinline=True)


def facts_of(rig: Rig) -> Numbers:
    """Return what the equation of motion uses of a rig: gravity in m/s2, drag_per_m of the drag term, and per rev/s of
    the lift term."""
    cube_m3 = rig.ball.radius_m * rig.ball.radius_m * rig.ball.radius_m
    lift_per_rev = 4.0 / 3.0 * 4.0 * math.pi**2 * cube_m3 * rig.air.density_kg_m3 / rig.ball.mass_kg
    return float(rig.world.gravity_m_s2), drag_per_m(rig), lift_per_rev


@small
def acceleration(vx: float, vz: float, spin: float, values: Pair, facts: Numbers) -> Pair:
    """Return gravity, drag and lift in m/s2, as in the terms of truearc.sim.physics; facts: see facts_of."""
    cd, cl = values
    gravity, drag_per_m, lift_per_rev = facts
    drag = -cd * drag_per_m * math.sqrt(vx * vx + vz * vz + TINY)
    lift = cl * lift_per_rev * spin
    return drag * vx - lift * vz, drag * vz + lift * vx - gravity


# Rows of the workspace, each LANES long. UNDER: 1 once below the floor; TIME: of the last step, up to turn or plane.
X, Z, VX, VZ, SPIN, DISTANCE, STEP, UNDER, FLYING, CD, CL, LONGEST, TIME, GAP = (row * LANES for row in range(14))
ROWS = 14


@small
def advance(x: float, z: float, vx: float, vz: float, spin: float, values: Pair, facts: Numbers, step: float) -> Ball:
    """Return (x, z, vx, vz) after one Runge-Kutta step."""
    half = 0.5 * step
    ax1, az1 = acceleration(vx, vz, spin, values, facts)
    vx2, vz2 = vx + half * ax1, vz + half * az1
    ax2, az2 = acceleration(vx2, vz2, spin, values, facts)
    vx3, vz3 = vx + half * ax2, vz + half * az2
    ax3, az3 = acceleration(vx3, vz3, spin, values, facts)
    vx4, vz4 = vx + step * ax3, vz + step * az3
    ax4, az4 = acceleration(vx4, vz4, spin, values, facts)
    sixth = step * (1.0 / 6.0)
    return (x + sixth * (vx + 2.0 * (vx2 + vx3) + vx4), z + sixth * (vz + 2.0 * (vz2 + vz3) + vz4),
            vx + sixth * (ax1 + 2.0 * (ax2 + ax3) + ax4), vz + sixth * (az1 + 2.0 * (az2 + az3) + az4))


@small
def goes_under(z0: float, vz0: float, z1: float, vz1: float, step: float) -> bool:
    """Return whether a step goes below the floor, by the parabola through height and vertical speeds at its ends."""
    dip = z0 * (vz1 - vz0) - 0.5 * vz0 * vz0 * step
    return (z1 < 0.0) | ((vz0 < 0.0) & (vz1 > 0.0) & (dip < 0.0))


@small
def step_of(vx: float, vz: float, spin: float, values: Pair, facts: Numbers, step_s: float, turn_rad: float,
            shortest_s: float) -> float:
    """Return the lane's step, as in truearc.sim.physics.flight: weight, which acts on a ball at rest, does not
    count."""
    ax, az = acceleration(vx, vz, spin, values, facts)
    per_s = math.sqrt((ax**2 + (az + facts[0]) ** 2) / (vx * vx + vz * vz + 1e-200)) + 1e-200
    return min(max(turn_rad / per_s, shortest_s), step_s)


@small
def part_of_step(w: Floats, facts: Numbers, lane: int, part: float) -> Ball:
    """Return the lane's ball part of a step later: (x, z, vx, vz)."""
    return advance(w[X + lane], w[Z + lane], w[VX + lane], w[VZ + lane], w[SPIN + lane],
                   (w[CD + lane], w[CL + lane]), facts, part)


@fast
def start_batch(w: Floats, launch: Floats, which: Ints, cd: Floats, cl: Floats, facts: Numbers, rules: Numbers,
                first: int) -> None:
    """Put LANES lanes into the workspace; see fly_lanes."""
    release_m, step_s, turn_rad, shortest_s = rules[:4]
    for lane in range(LANES):
        row = which[first + lane]
        w[SPIN + lane], w[DISTANCE + lane] = launch[row, 2], launch[row, 3]
        w[VX + lane], w[VZ + lane] = launch[row, 0], launch[row, 1]
        w[CD + lane], w[CL + lane] = cd[first + lane], cl[first + lane]
    for lane in range(LANES):
        w[X + lane], w[Z + lane] = 0.0, release_m
        values = w[CD + lane], w[CL + lane]
        w[STEP + lane] = step_of(w[VX + lane], w[VZ + lane], w[SPIN + lane], values, facts, step_s, turn_rad,
                                 shortest_s)
        w[UNDER + lane] = 1.0 if release_m < 0.0 else 0.0
        w[FLYING + lane] = 1.0 if (w[VX + lane] > 0.0) & (w[DISTANCE + lane] > 0.0) else 0.0


@fast
def fly_batch(w: Floats, facts: Numbers, deepest_m: float, most_steps: float) -> None:
    """Fly all lanes of the workspace until the step that ends each; the state stays at the start of that step."""
    active = 1.0
    steps = 0.0
    while active > 0.0 and steps < most_steps:
        active = 0.0
        steps += 1.0
        for lane in range(LANES):
            x, z, vx, vz, step = w[X + lane], w[Z + lane], w[VX + lane], w[VZ + lane], w[STEP + lane]
            nx, nz, nvx, nvz = part_of_step(w, facts, lane, step)
            under = goes_under(z, vz, nz, nvz, step)
            u0 = w[UNDER + lane]
            f0 = w[FLYING + lane]
            d0 = w[DISTANCE + lane]
            ends = (nx >= d0) | (nvx <= 0.0) | (nz < deepest_m) | (f0 <= 0.0)
            w[X + lane] = x if ends else nx
            w[Z + lane] = z if ends else nz
            w[VX + lane] = vx if ends else nvx
            w[VZ + lane] = vz if ends else nvz
            un = 1.0 if under else u0
            w[UNDER + lane] = u0 if ends else un
            go = 0.0 if ends else 1.0
            w[FLYING + lane] = go
            active += go


@fast
def turn_batch(w: Floats, facts: Numbers) -> float:
    """Set LONGEST, the part of the last step for which vx > 0; return the number of lanes that may reach the plane."""
    turning, near = 0.0, 0.0
    for lane in range(LANES):
        _nx, _nz, nvx, _nvz = part_of_step(w, facts, lane, w[STEP + lane])
        w[LONGEST + lane] = w[STEP + lane]
        w[FLYING + lane] = 1.0 if nvx <= 0.0 else 0.0
        turning += w[FLYING + lane]
        fastest = max(w[VX + lane], nvx)
        near += 1.0 if w[DISTANCE + lane] - w[X + lane] <= 2.0 * w[STEP + lane] * fastest else 0.0
    rounds = 0.0
    while turning > 0.0 and rounds < NEWTON_STEPS:
        rounds += 1.0
        turning = 0.0
        for lane in range(LANES):
            _tx, _tz, tvx, tvz = part_of_step(w, facts, lane, w[LONGEST + lane])
            slope, _unused = acceleration(tvx, tvz, w[SPIN + lane], (w[CD + lane], w[CL + lane]), facts)
            better = min(max(w[LONGEST + lane] - tvx / (slope if slope < 0.0 else -1e300), 0.0), w[STEP + lane])
            better = better if w[FLYING + lane] > 0.0 else w[STEP + lane]
            turning += 1.0 if abs(better - w[LONGEST + lane]) > CLOSE_S else 0.0
            w[LONGEST + lane] = better
    return near


@fast
def reach_batch(w: Floats, facts: Numbers) -> None:
    """Set TIME, the part of the last step after which the lane is at the plane, or LONGEST, and FLYING, 1 if it gets
    there."""
    for lane in range(LANES):
        tx, _tz, _tvx, _tvz = part_of_step(w, facts, lane, w[LONGEST + lane])
        vx, gap = w[VX + lane], w[DISTANCE + lane] - w[X + lane]
        ax, _unused = acceleration(vx, w[VZ + lane], w[SPIN + lane], (w[CD + lane], w[CL + lane]), facts)
        divisor = vx + math.sqrt(max(vx * vx + 2.0 * ax * gap, 0.0))
        part = min(max(2.0 * gap / (divisor if divisor > 0.0 else 1e300), 0.0), w[LONGEST + lane])
        w[GAP + lane] = min(w[DISTANCE + lane] - tx, gap)
        w[FLYING + lane] = 1.0 if w[GAP + lane] <= 0.0 else 0.0
        w[TIME + lane] = part if w[FLYING + lane] > 0.0 else w[LONGEST + lane]
    moving, rounds = 1.0, 0.0
    while moving > 0.0 and rounds < NEWTON_STEPS:
        rounds += 1.0
        moving = 0.0
        for lane in range(LANES):
            px, _pz, pvx, _pvz = part_of_step(w, facts, lane, w[TIME + lane])
            off = (px - w[DISTANCE + lane]) / (pvx if pvx > 0.0 else 1e300)
            better = min(max(w[TIME + lane] - off, 0.0), w[LONGEST + lane])
            better = better if w[FLYING + lane] > 0.0 else w[LONGEST + lane]
            moving += 1.0 if abs(better - w[TIME + lane]) > CLOSE_S else 0.0
            w[TIME + lane] = better


@fast
def fly_lanes(batches: tuple[int, int], launch: Floats, which: Ints, cd: Floats, cl: Floats, facts: Numbers,
              rules: Numbers, height_m: Floats, gap_m: Floats, under: npt.NDArray[np.bool_]) -> None:
    """Fly batches [first, last) of LANES lanes each: lane k is launch which[k] with (cd[k], cl[k]).

    launch: [n, 4] = forward and upward speed m/s, spin rev/s, distance m. rules: release height m, longest step s, turn
    rad, shortest step s, deepest m, longest flight s. Results [lanes]: the height at the plane, or where the flight
    ends without it (it turns back, or is deeper than `deepest_m`); the gap to the plane then, and else minus how much
    farther the last step would have gone, up to its turn; whether the floor was met on the way.
    """
    w = np.zeros(ROWS * LANES)
    for batch in range(batches[0], batches[1]):
        first = batch * LANES
        start_batch(w, launch, which, cd, cl, facts, rules, first)
        fly_batch(w, facts, rules[4], rules[5] / rules[3])
        if turn_batch(w, facts) > 0.0:
            reach_batch(w, facts)
        else:
            for lane in range(LANES):
                w[TIME + lane] = w[LONGEST + lane]
                w[GAP + lane] = w[DISTANCE + lane] - w[X + lane]
        for lane in range(LANES):
            ex, ez, _evx, evz = part_of_step(w, facts, lane, w[TIME + lane])
            low = goes_under(w[Z + lane], w[VZ + lane], ez, evz, w[TIME + lane])
            w[UNDER + lane] = 1.0 if low else w[UNDER + lane]
            w[X + lane], w[Z + lane] = ex, ez
        for lane in range(LANES):
            height_m[first + lane] = w[Z + lane]
            gap_m[first + lane] = w[GAP + lane]
            under[first + lane] = w[UNDER + lane] > 0.0
