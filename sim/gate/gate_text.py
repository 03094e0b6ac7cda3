"""The report of a fitted gate: its correction to the physics, and hold-out figures, as text."""

import numpy as np

from truearc.robot.config.rig_spec import Target
from truearc.sim.gate.model import Physics, PhysicsGate, residual
from truearc.sim.gate.train import LEVEL, MIN_CONFIGURATIONS, Heldout
from truearc.sim.statistics import Figures

SILENT_M = 0.02                       # a residual smaller than this is not worth a sentence


def tell_residual(gate: PhysicsGate, features: np.ndarray, physics: Physics) -> list[str]:
    """How far the physics alone is off, and how shots scatter, at near, middle and far recorded shots [n, 3]."""
    learned_m, _ = residual(gate.fit, gate.scaling(features), physics)
    _, sigma_m = gate.correct(features, physics)
    order = np.array_split(np.argsort(features[:, 0], kind="stable"), 3)
    lines = []
    for rows in (rows for rows in order if rows.size):
        at_m, off_m = float(np.median(features[rows, 0])), -float(np.median(learned_m[rows]))
        side = "high" if off_m > 0.0 else "low"
        said = "the shots move the physics by less than 2 cm" if abs(off_m) < SILENT_M else (
            f"the physics alone is {100.0 * abs(off_m):.0f} cm {side}")
        lines.append(f"at {at_m:.1f} m {said}; "
                     f"a shot passes within {100.0 * float(np.median(sigma_m[rows])):.0f} cm of what the gate expects "
                     "two times in three")
    return lines


def tell_heldout(heldout: Heldout, temperature: float, target: Target | None = None) -> list[str]:
    """Report hold-out figures on configurations that the gate was not fitted to, though the belief may have been."""
    lines = ["on configurations that the correction had not learned from, each fifth in turn (the coefficients may "
             "have been fitted to them):",
             _figures("  the gate", heldout.plain), *_beside_commonest(heldout, target)]
    if temperature == 1.0:
        return [*lines, "calibration: the spread is as fitted; stretching it made unseen configurations no likelier"]
    how = "wider" if temperature > 1.0 else "narrower"
    return [*lines, _figures("  and calibrated", heldout.calibrated),
            f"calibration: the spread is made {abs(temperature - 1.0):.0%} {how}, as unseen configurations ask for"]


def _beside_commonest(heldout: Heldout, target: Target | None) -> list[str]:
    """Compare with what needs no gate: the commonest outcome for every shot, and the plain shares of outcomes."""
    shares, commonest = _commonest(heldout.level, target)
    by_shares = float((shares[shares > 0.0] * np.log(shares[shares > 0.0])).sum())
    lines = [f"  always naming the commonest, {commonest}: outcome right {shares.max():.1%}; by the plain shares of "
             f"outcomes: log score {by_shares:.3f}"]
    if heldout.calibrated.log_score <= by_shares:
        lines.append("warning: on shots that it had not seen the gate says no more than the plain shares of outcomes")
    return lines


def tell_too_few(group: np.ndarray, level: np.ndarray, target: Target | None) -> str:
    """Say that configurations [n] are too few to hold any out, and what needs no gate. level [n]: -1 is not judged."""
    shares, commonest = _commonest(level[level >= 0], target)
    return (f"warning: {len(np.unique(group[level >= 0]))} configurations with an outcome are too few to say whether "
            f"the gate is better than always naming the commonest, {commonest}, which is right for {shares.max():.1%} "
            f"of them; at least {MIN_CONFIGURATIONS} are needed")


def _commonest(level: np.ndarray, target: Target | None) -> tuple[np.ndarray, str]:
    """(shares of the outcomes, the word for the commonest)."""
    shares = np.bincount(level, minlength=len(LEVEL)) / max(len(level), 1)
    commonest = list(LEVEL)[int(np.argmax(shares))]
    return shares, commonest if target is None else target.word(commonest)


def _figures(name: str, figures: Figures) -> str:
    return (f"{name}: {figures.shots} shots, outcome right {figures.accuracy:.1%}, log score {figures.log_score:.3f}, "
            f"Brier {figures.brier:.4f}, stated and true shares differ by {figures.ece:.3f}")
