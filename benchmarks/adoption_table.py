"""The gate before and after adoption, world by world: paired differences, and their intervals over worlds."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from truearc.sim.statistics import student_half
from truearc_proof.table import Table

HEADER = ("gate", "figure", "before", "after", "after - before, 95 %", "worlds better, worse")
SIDES = ("before", "after")
NOTHING = "nothing"                   # the world in which nothing was changed
FIGURES: tuple[tuple[str, str, str], ...] = (
    ("Brier score", "brier", "less"), ("log score a shot", "log_score", "more"), ("outcome right", "accuracy", "more"),
    ("calibration error", "ece", "less"), ("scored share of fired shots", "scored_share", "more"),
    ("shots fired", "fired", "more"))

Line = Mapping[str, Any]


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: means over changed worlds with Student's 95 % interval of the paired difference; and each world."""
    changed = [one for one in lines if one["name"] != NOTHING]
    parts = [_summary(f"{len(changed)} worlds with one thing changed", changed)]
    found = [one for one in changed if one["found"]]
    if len(found) < len(changed):
        parts.append(_summary(f"the {len(found)} of these in which a mismatch was found", found))
    return "\n\n".join([*parts, _each(lines)])


def _summary(title: str, lines: Sequence[Line]) -> str:
    rows = _row("none", "heights off, simulation alone (m)", "less",
                *(np.array([one[which]["off_m"] for one in lines]) for which in SIDES))
    for gate in lines[0]["after"]["gates"] if lines else ():
        for said, key, better in FIGURES:
            rows += _row(gate, said, better, *(
                np.array([_value(one[which]["gates"][gate], key) for one in lines], dtype=float) for which in SIDES))
    return Table(title, HEADER, rows).markdown()


def _row(gate: str, said: str, better: str, before: np.ndarray, after: np.ndarray) -> list[list[str]]:
    """One line of the table; none where fewer than two worlds have both."""
    both = np.isfinite(before) & np.isfinite(after)
    gain = (after - before)[both]
    if len(gain) < 2:
        return []
    half, sign = student_half(gain), 1.0 if better == "more" else -1.0
    return [[gate, said, f"{before[both].mean():.3f}", f"{after[both].mean():.3f}",
             f"{gain.mean():+.4f} ({gain.mean() - half:+.4f} to {gain.mean() + half:+.4f})",
             f"{int((sign * gain > 0).sum())}, {int((sign * gain < 0).sum())}"]]


def _value(figures: Line, key: str) -> float:
    if key != "scored_share":
        return float(figures[key])
    return figures["scored"] / figures["fired"] if figures["fired"] else float("nan")


def _each(lines: Sequence[Line]) -> str:
    rows = []
    for one in sorted(lines, key=lambda one: (one["name"], one["seed"])):
        before, after = (one[which] for which in SIDES)
        brier = [f"{gate} {before['gates'][gate]['brier']:.3f} -> {figures['brier']:.3f}"
                 for gate, figures in after["gates"].items()]
        rows.append([one["name"], str(one["seed"]), ", ".join(one["adopted"]) or "-",
                     f"{before['off_m']:.3f} -> {after['off_m']:.3f}", "; ".join(brier)])
    header = ("changed", "seed", "adopted", "heights off (m)", "Brier of the gates")
    return Table("Each world", header, rows).markdown()
