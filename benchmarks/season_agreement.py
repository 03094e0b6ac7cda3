"""Does a season straight from the world agree with the emulated robot's recordings of the same world?

    python -m benchmarks.season_agreement --trials 240 --seed 11

The emulated robot (buses, images, control, operator) records a session; truearc_proof.world.season then shoots the
same settings, as the world had them at each shot, with the same launcher and rack of balls and other random effects.
The truths of every ball are compared as distributions: means with the standard error of the difference of pairs,
deviations, and the two-sample Kolmogorov-Smirnov test; then the readings of each shot against the truth.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import ks_2samp

from truearc.api.emulation import KINDS
from truearc.cli.common import SHIPPED, make_progress
from truearc.robot.config.schema import load_config
from truearc.sim.data.dataset import Shots
from truearc.sim.data.recordings import shots_from_sessions
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.field import BallResult
from truearc.sim.world.options import Options
from truearc.sim.world.season import ShotSetting, play_season
from truearc_proof.table import make_markdown

NS = 1e-9
TOGETHER_S = 0.2                      # a recorded shot and a ball of the world that are less apart are one


def truths(results: list[BallResult]) -> dict[str, np.ndarray]:
    """Return the truths of each ball [n], normalized by the setting where possible."""
    wheel = np.array([one.wheel_before_rad_s for one in results])
    speed = np.array([one.exit_speed_m_s for one in results])
    return {"exit speed / wheel speed (m)": speed / wheel,
            "exit elevation - hood (deg)": np.array([one.exit_deg - one.hood_deg for one in results]),
            "spin / exit speed (rev/m)": np.array([one.exit_spin_rev_s for one in results]) / speed,
            "dip of the wheels": 1.0 - np.array([one.wheel_after_rad_s for one in results]) / wheel,
            "height at the plane (m)": np.array([np.nan if one.z_m is None else one.z_m for one in results]),
            "sideways at the plane (m)": np.array([np.nan if one.y_m is None else one.y_m for one in results])}


def readings(shots: Shots, results: list[BallResult], free_rad_s: float) -> dict[str, np.ndarray]:
    """Return the errors of each shot's readings [n]."""
    fed_s = np.array([one.fed_t_ns for one in results]) * NS
    t_s = shots.number("t_s")
    nearest = np.abs(fed_s[None] - t_s[:, None]).argmin(1)
    near = np.abs(fed_s[nearest] - t_s) < TOGETHER_S
    true = [results[k] for k in nearest[near]]
    return {"distance read - true (m)": shots.number("distance_m")[near] - [one.distance_m for one in true],
            "hood read - true (deg)": shots.number("hood_deg")[near] - [one.hood_deg for one in true],
            "motor ratio read - true": shots.number("motor_ratio")[near] - [one.wheel_before_rad_s / free_rad_s
                                                                           for one in true]}


def make_table(emulated: dict[str, np.ndarray], season: dict[str, np.ndarray], paired: bool) -> str:
    """Markdown, a row per quantity."""
    header = ("quantity", "robot: mean, sd", "season: mean, sd",
              f"difference{' of pairs' if paired else ''}, its error", "KS p")
    rows = []
    for name, one in emulated.items():
        other = season[name]
        apart, error = _paired(one - other) if paired else _apart(one, other)
        p = ks_2samp(one[np.isfinite(one)], other[np.isfinite(other)]).pvalue
        rows.append([name, f"{np.nanmean(one):.4g}, {np.nanstd(one):.3g}",
                     f"{np.nanmean(other):.4g}, {np.nanstd(other):.3g}", f"{apart:+.3g}, {error:.2g}", f"{p:.3f}"])
    return make_markdown(header, rows)


def _paired(gap: np.ndarray) -> tuple[float, float]:
    """(mean, its standard error) of differences, where both sides have a value."""
    known = gap[np.isfinite(gap)]
    return float(known.mean()), float(known.std(ddof=1) / np.sqrt(len(known)))


def _apart(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """(difference of the means, its standard error)."""
    return float(one.mean() - other.mean()), float(np.hypot(one.std(ddof=1) / np.sqrt(len(one)),
                                                            other.std(ddof=1) / np.sqrt(len(other))))


def main() -> int:
    args = _arguments()
    config = load_config(SHIPPED)
    free_rad_s = config.rig.launcher.free_speed_rad_s or 1.0
    with tempfile.TemporaryDirectory() as folder:
        results = emulate(config, Path(folder) / "session", args.trials, args.seed, progress=make_progress("robot"))
        recorded = shots_from_sessions([Path(folder) / "session"], "recorded").shots
    settings = [ShotSetting(one.distance_m, one.hood_deg, one.wheel_before_rad_s / free_rad_s) for one in results]
    season = play_season(config.rig, Options(), args.seed, settings, "L1", progress=make_progress("season"))
    ours = list(season.results)
    print(f"{len(results)} balls of the emulated robot, and as many of the season\n")
    print(make_table(truths(results), truths(ours), True), end="\n\n")
    for name, each in (("robot", results), ("season", ours)):
        counts = {mark: sum(one.outcome == mark for one in each) for mark in KINDS}
        print(f"{name}: " + ", ".join(f"{count} {mark}" for mark, count in counts.items()))
    print("\n" + make_table(readings(recorded, results, free_rad_s), readings(season.dataset.shots, ours, free_rad_s),
                            False))
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=240)
    parser.add_argument("--seed", type=int, default=11)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
