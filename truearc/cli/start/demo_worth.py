"""What putting a finding into the simulation was worth: the same robot and gate before and after, on unseen shots."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import truearc as ta
from truearc.cli.start.demo_files import NS, Demo, Score, read_rows, score, share
from truearc.sim.data.columns import OUTCOMES
from truearc.sim.discover.select.refit import clustered_error
from truearc.sim.intervals import difference
from truearc.sim.metrics import Figures, figures_of, log_scores
from truearc.sim.report import paragraph, table

TOGETHER_S = 0.2                      # a shot and a ball of the world that are less apart are one
NINETY_FIVE = 1.96


class Worth(NamedTuple):
    """Before and after: figures of the gates on shots inside both domains, and three-point scores driven.

    off_m: RMS error of heights (of `balls`) by the paper's grid, before and after. gain, error: mean of the log score
    per shot, and its standard error.
    """

    figures: tuple[Figures, Figures]
    off_m: tuple[float, float, float]
    balls: int
    scored: tuple[Score, Score]
    gain: float
    error: float


def worth_of(demo: Demo) -> Worth:
    """By the session without a gate, which neither has learnt from, and the two sessions that the gates drove."""
    p, level = rated(demo, (demo.ratings, demo.ratings_after), inside=2)
    gain = log_scores(p[1], level) - log_scores(p[0], level)
    off_m, balls = _heights_off_m(demo)
    before, after = (score(shots, ("three",)) for shots in (demo.gated_shots, demo.after_shots))
    return Worth((figures_of(p[0], level), figures_of(p[1], level)), off_m, balls, (before, after),
                 float(gain.mean()), clustered_error(gain, np.arange(len(gain))))


def put_in(demo: Demo) -> str:
    """The headline."""
    worth = worth_of(demo)
    before, after = worth.figures
    half95 = NINETY_FIVE * worth.error
    low, high = difference(worth.scored[1], worth.scored[0])
    return (f"with that put in: heights of {worth.balls} unseen balls forecast within {worth.off_m[2]:.3f} m, not "
            f"{worth.off_m[1]:.3f} m (the paper's grid: {worth.off_m[0]:.3f} m); the gate's log score "
            f"{worth.gain:+.3f} per shot (95 %: {worth.gain - half95:+.3f} to {worth.gain + half95:+.3f}), right "
            f"on {after.accuracy:.0%} instead of {before.accuracy:.0%}; three points driven: {share(worth.scored[1])} "
            f"instead of {share(worth.scored[0])}, difference {low:+.0%} to {high:+.0%} (95 %)")


def worth_of_it(demo: Demo) -> str:
    """The table, and what it rests on."""
    worth = worth_of(demo)
    shots = worth.figures[0].shots
    rows = [["heights at the target, RMS error", *(f"{off:.3f} m" for off in worth.off_m)],
            ["log score", "", *(f"{one.log_score:.3f}" for one in worth.figures)],
            ["outcome right", "", *(f"{one.accuracy:.0%}" for one in worth.figures)],
            ["Brier score", "", *(f"{one.brier:.3f}" for one in worth.figures)],
            ["calibration error", "", *(f"{one.ece:.3f}" for one in worth.figures)],
            ["three points, of shots fired", "", *map(share, worth.scored)]]
    return table(["", "the paper's grid", "before", "after"], rows) + paragraph(
        f"The physics of the first gate is the fit of drag, lift and efficiency; that of the second is what discovery "
        f"adopted. Both gates learnt from the {len(ta.load_dataset(demo.shots).shots)} practice shots alone, and "
        f"add what they learnt of the rest, so that a gate may make up for a simulation. Heights: {worth.balls} "
        f"balls of the session without a gate, as the world has them. The next four rows: {shots} shots of that "
        "session inside both gates' domains. The last: two sessions alike except in the gate.", dim=True)


def rated(demo: Demo, files: Sequence[Path], inside: int) -> tuple[list[np.ndarray], np.ndarray]:
    """(p [n, 2] of each file's gate, level [n]: 0, 1, 2) of the ungated shots inside the first `inside` gates' domains.
    """
    shots = ta.load_dataset(demo.ungated_shots).shots
    ratings = [read_rows(path) for path in files]
    kept = [row for row in range(len(shots))
            if all(one[row]["in_domain"] == "true" and one[row]["p_two"] for one in ratings[:inside])]
    p = [np.array([[float(one[row][name]) for name in ("p_two", "p_three")] for row in kept]).reshape(-1, 2)
         for one in ratings]
    return p, np.array([OUTCOMES.index(shots.text("outcome")[row]) for row in kept], int)


def _heights_off_m(demo: Demo) -> tuple[tuple[float, float, float], int]:
    """RMS errors of balls that the world and all three simulations saw reach the plane, and how many."""
    forecast_m = np.array([[float(row["height_m"] or "nan") for row in read_rows(path)]
                           for path in (demo.heights_grid, demo.heights, demo.heights_after)])
    t_s = ta.load_dataset(demo.ungated_shots).shots.number("t_s")
    fed = json.loads(demo.truth.read_text(encoding="utf-8"))
    fed_s = np.array([t_ns for t_ns, _ in fed]) * NS
    nearest = np.abs(fed_s[None] - t_s[:, None]).argmin(1)
    true = np.array([np.nan if fed[k][1] is None else fed[k][1] for k in nearest])
    off = forecast_m - np.where(np.abs(fed_s[nearest] - t_s) < TOGETHER_S, true, np.nan)
    seen = np.isfinite(off).all(0)
    grid, before, after = np.sqrt((off[:, seen]**2).mean(1))
    return (float(grid), float(before), float(after)), int(seen.sum())
