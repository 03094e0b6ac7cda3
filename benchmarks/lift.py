"""Lift from measured spin about any axis, and lift that sessions have in common.

    python -m benchmarks.lift [--seeds 5] [--launcher FOLDER] [--picture FILE]

Flights of balls that turn about one axis, or each about another, integrated by SciPy's DOP853 with drag and the lift of
the whole spin: the lift coefficient that `fit` finds, beside the one that was put in. With --launcher (mpi_launches.csv
and mpi_tracks.csv of the table-tennis launcher) three disjoint thirds of a real launcher, each alone and pooled.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import truearc as ta
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Tracker
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.printed import make_text
from truearc_proof.importers.mpi import import_mpi

MASS, RADIUS, AIR, CD, CL, NOISE_M = 0.14, 0.0889, 1.2, 0.5, 0.12, 0.004
RIG = Rig(Ball(MASS, RADIUS), LauncherFacts(release_height_m=1.0), air=Air(AIR), noise=Noise(track_m=NOISE_M),
          tracker=Tracker(calibrated=True), believe=Believe(()))
FRAMES_S = np.linspace(0.0, 0.6, 31)
FLIGHTS, SPIN_REV_S = 16, 6.0
AXES = {"backspin": (0.0, 1.0, 0.0), "sidespin": (0.0, 0.0, 1.0), "about the throw": (1.0, 0.0, 0.0),
        "any axis": (1.0, 1.0, 1.0)}
SPUN = ["gravity", "drag", "magnus"]
Row = tuple[str, float, float, float]            # whose, lift coefficient, ends of its 90 % interval


def fly(start: np.ndarray, spin_rev_s: np.ndarray) -> np.ndarray:
    """Positions [31, 3]: m a = m g - cd/2 A rho |v| v + cl 4/3 (4 pi^2 r^3 rho) s x v, s in turns a second."""
    drag = 0.5 * CD * np.pi * RADIUS**2 * AIR / MASS
    lift = CL * 4.0 / 3.0 * 4.0 * np.pi**2 * RADIUS**3 * AIR / MASS

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        v = y[3:]
        return np.concatenate([v, [0.0, 0.0, -9.81] - drag * np.linalg.norm(v) * v + lift * np.cross(spin_rev_s, v)])

    return solve_ivp(rate, (0.0, 0.6), start, "DOP853", t_eval=FRAMES_S, rtol=1e-10, atol=1e-12).y[:3].T


def tracked(spins: np.ndarray, launched: bool, seed: int = 0) -> Dataset:
    """Flights of these spins [n, 3] about (x, y, z); launched: with the speed and the angle as the launcher says."""
    rng = np.random.default_rng(seed)
    n = len(spins)
    speed, deg = rng.uniform(7.0, 10.0, n), rng.uniform(35.0, 60.0, n)
    ahead = np.stack([np.cos(np.radians(deg)), np.zeros(n), np.sin(np.radians(deg))], axis=1)
    places = [fly(np.concatenate([[0.0, 0.0, 1.0], v]), spin) + rng.normal(0.0, NOISE_M, (31, 3))
              for v, spin in zip(speed[:, None] * ahead, spins, strict=True)]
    numbers = dict(zip(("exit_spin_x_rev_s", "exit_spin_y_rev_s", "exit_spin_z_rev_s"), spins.T, strict=True))
    if launched:
        numbers |= {"exit_speed_m_s": speed, "exit_deg": deg}
    tracks = Tracks(np.repeat(np.arange(n), 31), np.tile(FRAMES_S, n), *np.concatenate(places).T)
    return Dataset("spun", RIG, Shots(tuple(f"s{k}" for k in range(n)), numbers, {}), tracks)


def spun(seeds: int) -> list[Row]:
    """Fits of each axis and seed."""
    rows = []
    for axis, parts in AXES.items():
        for seed in range(seeds):
            spins = np.random.default_rng([seed, *map(int, parts)]).normal(0.0, SPIN_REV_S, (FLIGHTS, 3)) * parts
            rows.append(_lift(axis, ta.fit(tracked(spins, launched=True, seed=seed), SPUN)))
    return rows


def pooled(folder: Path) -> list[Row]:
    """Thirds of a real launcher alone, each given all, and what they have in common."""
    whole = import_mpi(folder / "mpi_launches.csv", folder / "mpi_tracks.csv")
    fits = [ta.fit(whole.take(list(range(start, len(whole.shots), 3))), SPUN) for start in range(3)]
    together = ta.pool(fits)
    given = [row[-3:] for row in together.members().rows if row[1] == "magnus.cl"]
    value, low, high = together.table().rows[together.names.index("magnus.cl")][1:4]
    return [*(_lift(f"third {k + 1} alone", fit) for k, fit in enumerate(fits)),
            *((f"third {k + 1} given all", *three) for k, three in enumerate(given)), ("in common", value, low, high)]


def _lift(name: str, fit: ta.Fit) -> Row:
    one = next(one for one in fit.intervals if one.name == "magnus.cl")
    return name, one.value, one.low90, one.high90


def draw(known: Sequence[Row], real: Sequence[Row], path: Path) -> None:
    """Intervals of simulated flights beside the truth, and of the real launcher's thirds."""
    from matplotlib.figure import Figure
    figure = Figure((11.0, 4.2), layout="constrained")
    for axes, rows, title in zip(figure.subplots(1, 2), (known, real), (
            f"{FLIGHTS} simulated flights a line, spin measured", "a real table-tennis launcher"), strict=True):
        for place, (_, value, low, high) in enumerate(reversed(rows)):
            axes.plot([low, high], [place, place], color="C0", linewidth=2)
            axes.plot(value, place, "o", color="C0", markersize=4)
        names = [row[0] for row in reversed(rows)]
        axes.set_yticks(range(len(rows)), [name if name not in names[k + 1:] else "" for k, name in enumerate(names)])
        axes.set_xlabel("lift coefficient, 90 % interval")
        axes.set_title(title)
        if rows is known:
            axes.axvline(CL, color="0.4", linestyle=":", label=f"put in: {CL}")
            axes.legend()
    figure.savefig(path, dpi=110)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--launcher", type=Path, metavar="FOLDER", help="of the real launcher's files")
    parser.add_argument("--picture", type=Path, metavar="FILE")
    args = parser.parse_args()
    keep_compiled()
    known, real = spun(args.seeds), pooled(args.launcher) if args.launcher else []
    print("\n".join(make_text(("", "lift", "from", "to"), [(name, *(f"{one:.4f}" for one in row))
                                                          for name, *row in (*known, *real)], right=(1, 2, 3))))
    held = [low <= CL <= high for _, _, low, high in known]
    print(f"intervals that hold {CL}: {sum(held)} of {len(held)}")
    if args.picture:
        draw(known, real, args.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
