"""Plain least squares of a ball-throwing robot's flights; docs/measured/real-data.md has what discover says.

    python -m benchmarks.ball_butler ball_butler_tracks.csv [--picture FILE] [--flights N]

Shares no code with truearc's solver: one Runge-Kutta step a sample, a start and a velocity for each flight, and a few
numbers for all flights. Their errors are by how flights differ (sandwich), not by the noise of samples.
"""

import argparse
import math
from typing import NamedTuple

import numpy as np

from truearc.sim.printed import make_text
from truearc.sim.report import new_figure
from truearc_proof.importers.ball_butler import RIG, import_ball_butler

Array = np.ndarray
STEP, NEWTONS, NINETY = 1e-4, 12, 1.645
AREA_M2 = math.pi * RIG.ball.radius_m**2
K = 0.5 * RIG.air.density_kg_m3 * AREA_M2 / RIG.ball.mass_kg     # drag per speed squared, per unit of coefficient
NUMBERS = {"g": (9.81, 1.0), "cd": (0.0, 1.0), "by speed": (0.0, 1.0), "scale %": (0.0, 0.01),
           "ahead deg": (0.0, math.radians(1.0)), "left deg": (0.0, math.radians(1.0)),
           "per m %": (0.0, 0.01)}                               # usual value, unit
FITS = (("g",), ("cd",), ("cd", "g"), ("cd", "scale %"), ("cd", "scale %", "ahead deg", "left deg"),
        ("cd", "ahead deg", "left deg", "per m %"), ("cd", "scale %", "ahead deg", "left deg", "per m %"),
        ("cd", "by speed", "scale %", "ahead deg", "left deg"))
UP = np.array([0.0, 0.0, 1.0])
SHOWN = {"gravity": (), "gravity, drag": ("cd",), "gravity, drag, scale, tilts": FITS[4]}


class Flights(NamedTuple):
    """n flights of up to L samples: `position_m` [n, L, 3], `real` [n, L], and the time between samples."""

    position_m: Array
    real: Array
    gap_s: float


class Fit(NamedTuple):
    """`value`, `sd` of the free numbers; `left_m` [n, L, 3], NaN where there is no sample."""

    value: Array
    sd: Array
    left_m: Array


def load_flights(path: str) -> Flights:
    """The flights as the importer has them; samples must be evenly spaced."""
    tracks = import_ball_butler(path).tracks
    assert tracks is not None
    count = np.bincount(tracks.shot)
    real = np.arange(count.max()) < count[:, None]
    position_m = np.full((*real.shape, 3), np.nan)
    position_m[real] = np.stack([tracks.x_m, tracks.y_m, tracks.z_m], axis=1)
    gaps_s = np.diff(tracks.t_s)[np.diff(tracks.shot) == 0]
    assert np.ptp(gaps_s) < 1e-4
    return Flights(position_m, real, float(gaps_s.mean()))


def first(flights: Flights, most: int | None) -> Flights:
    """The first flights; all where there is no number."""
    return flights._replace(position_m=flights.position_m[:most], real=flights.real[:most])


def fly(flights: Flights, start: Array, free: tuple[str, ...], value: Array) -> Array:
    """Seen positions [..., n, L, 3] of balls that leave with start [..., n, 6]; value [..., free numbers]."""
    now = {name: usual for name, (usual, _) in NUMBERS.items()} | {
        name: value[..., k, None, None] * NUMBERS[name][1] for k, name in enumerate(free)}

    def slope(ball: Array) -> Array:
        speed = np.linalg.norm(ball[..., 3:], axis=-1, keepdims=True)
        pull = -K * now["cd"] * (1.0 + now["by speed"] * (speed - 2.5)) * speed * ball[..., 3:]
        return np.concatenate([ball[..., 3:], pull - now["g"] * UP], axis=-1)

    ball, seen, h = start, [start[..., :3]], flights.gap_s
    for _ in range(flights.real.shape[1] - 1):
        a = slope(ball)
        b = slope(ball + 0.5 * h * a)
        c = slope(ball + 0.5 * h * b)
        ball = ball + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(ball + h * c))
        seen.append(ball[..., :3])
    x, y, z = np.moveaxis(np.stack(seen, axis=-2), -1, 0)
    ahead, left = now["ahead deg"], now["left deg"]
    x, z = x * np.cos(ahead) - z * np.sin(ahead), z * np.cos(ahead) + x * np.sin(ahead)
    y, z = y * np.cos(left) - z * np.sin(left), z * np.cos(left) + y * np.sin(left)
    return np.stack([x, y, z], axis=-1) * (1.0 + now["scale %"] + now["per m %"] * z)[..., None]


def fit(flights: Flights, free: tuple[str, ...]) -> Fit:
    """Gauss-Newton steps, each flight's own start eliminated."""
    n, real = len(flights.real), flights.real
    t_s = np.arange(real.shape[1]) * flights.gap_s
    speeds = [np.polynomial.Polynomial.fit(t_s[one], place[one, k], 2).convert().coef[1]
              for one, place in zip(real, flights.position_m, strict=True) for k in range(3)]
    start = np.concatenate([flights.position_m[:, 0], np.reshape(speeds, (n, 3))], axis=1)
    value = np.array([0.5 if name == "cd" else NUMBERS[name][0] for name in free])
    moves = STEP * np.eye(7 + len(free), 6 + len(free), -1)     # none, of each number of a start, of each shared one
    for _ in range(NEWTONS):
        flown = fly(flights, start + moves[:, None, :6], free, value + moves[:, 6:])
        left, (own, shared) = flights.position_m - flown[0], np.split((flown[1:] - flown[0]) / STEP, [6])
        score, info, parts = np.zeros((n, len(free))), np.zeros((len(free),) * 2), []
        for k in range(n):
            mine, all_, rest = (many[:, k, real[k]].reshape(len(many), -1).T for many in (own, shared, left[None]))
            basis = np.linalg.qr(mine)[0]
            free_of = all_ - basis @ (basis.T @ all_)
            score[k], info = free_of.T @ rest[:, 0], info + free_of.T @ free_of
            parts.append((mine, all_, rest[:, 0]))
        step = np.linalg.solve(info, score.sum(0))
        value = value + step
        start = start + [np.linalg.lstsq(mine, rest - all_ @ step, rcond=None)[0] for mine, all_, rest in parts]
    inverse = np.linalg.inv(info)
    return Fit(value, np.sqrt(np.diag(inverse @ score.T @ score @ inverse) * n / (n - 1)), left)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--picture", metavar="FILE")
    parser.add_argument("--flights", type=int, help="the first ones only: to try this script")
    args = parser.parse_args()
    flights = first(load_flights(args.file), args.flights)
    rows = []
    for free in FITS:
        found = fit(flights, free)
        cells = {name: f"{value:.3g} ± {NINETY * sd:.2g}"
                 for name, value, sd in zip(free, found.value, found.sd, strict=True)}
        rows.append((*(f"{1e3 * one:.2f}" for one in rms(found)), *(cells.get(name, "") for name in NUMBERS)))
    print("RMS residuals in mm, then the numbers that were free, ± half of the 90 % interval")
    print("\n".join(make_text(("x", "y", "z", *NUMBERS), rows, right=range(3))))
    if args.picture:
        draw(args.picture, flights)


def rms(found: Fit) -> Array:
    return np.sqrt(np.nanmean(found.left_m**2, axis=(0, 1)))


def draw(path: str, flights: Flights) -> None:
    """Residuals along each flight, forward and upward, with ever more of what may be missing."""
    figure = new_figure(10.0, 4.6)
    t_s = np.arange(flights.real.shape[1]) * flights.gap_s
    for column, (said, free) in enumerate(SHOWN.items()):
        found = fit(flights, free)
        for row, (axis, name) in enumerate(((0, "ahead"), (2, "up"))):
            axes = figure.add_subplot(2, len(SHOWN), row * len(SHOWN) + column + 1)
            axes.plot(t_s, 1e3 * found.left_m[:, :, axis].T, linewidth=0.8, color="#1f5fa8", alpha=0.6)
            axes.set_title(f"{name}, mm: {said}", loc="left", fontsize=8)
            axes.spines[["top", "right"]].set_visible(False)
            if row:
                axes.set_xlabel("s")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
