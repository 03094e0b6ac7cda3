"""Targets that were set before the first round of proof, each beside the figure that was reached."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from truearc.sim.statistics import wilson
from truearc_proof.report.figures import RESOLVABLE, TITLES, ProofFigure, figures_of
from truearc_proof.scoring.score_world import Mark

Setting = tuple[str, int, float]      # level, shots, scale of effects


class Target(NamedTuple):
    """A target of the design (section 8).

    figure: id of truearc_proof.report.figures.TITLES. least: the figure must reach it, else stay at or below it. most:
    and not go beyond this.
    """

    figure: str
    least: bool
    at: dict[Setting, float]
    most: float = math.inf


L0_300, L0_1000, L1_300, L1_1000 = ("L0", 300, 1.0), ("L0", 1000, 1.0), ("L1", 300, 1.0), ("L1", 1000, 1.0)
L2_300 = ("L2", 300, 0.25)
SETTINGS = (L0_300, L0_1000, L1_300, L1_1000, L2_300)
PLAIN = ("L2", 300, 1.0)              # tracks, usual sizes: everything should be seen and named
LARGE = ("L2", 300, 2.0)              # where what is in no catalogue is looked at
PLAINLY = {PLAIN: 0.97}


def goals(*values: float) -> dict[Setting, float]:
    """{setting: figure}, of SETTINGS."""
    return dict(zip(SETTINGS, values, strict=True))


TARGETS = (
    Target("detected", True, goals(0.45, 0.72, 0.50, 0.74, 0.72) | PLAINLY),
    Target("stage", True, goals(0.72, 0.78, 0.82, 0.88, 0.97) | PLAINLY),
    Target("top_1", True, goals(0.62, 0.70, 0.74, 0.82, 0.88) | PLAINLY),
    Target("up_to_alias", True, goals(0.74, 0.82, 0.78, 0.86, 0.95) | PLAINLY),
    Target("in_set", True, goals(0.90, 0.90, 0.90, 0.90, 0.90) | PLAINLY),
    Target("set_size", False, goals(5.0, 3.5, 4.5, 2.5, 1.6)),
    Target("interval_holds", True, goals(0.86, 0.86, 0.86, 0.86, 0.86), 0.94),
    Target("gain_kept", True, goals(0.70, 0.82, 0.75, 0.87, 0.90)),
    Target("gain_lost", False, goals(0.05, 0.03, 0.05, 0.03, 0.02)),
    Target("called_unknown", False, goals(0.10, 0.10, 0.10, 0.08, 0.05)),
    Target("named_wrong", False, goals(0.10, 0.10, 0.10, 0.10, 0.05)),
    Target("off_unknown", True, goals(0.40, 0.55, 0.55, 0.70, 0.85) | {LARGE: 0.85}),
    Target("off_goes_with", True, {L2_300: 0.75, LARGE: 0.75}),
)
# The ceilings that the design's targets were set against (its section 4.4).
DESIGN_CEILING = {"detected": goals(0.53, 0.82, 0.56, 0.83, 0.80) | {PLAIN: 1.0},
                  "top_1": goals(0.70, 0.77, 0.81, 0.88, 0.92) | {PLAIN: 1.0},
                  "up_to_alias": goals(0.80, 0.88, 0.82, 0.90, 0.98) | {PLAIN: 1.0},
                  "stage": goals(0.79, 0.83, 0.88, 0.92, 0.99) | {PLAIN: 1.0}}
ALARMS = (
    Target("false_alarms_clean", True, goals(0.03, 0.03, 0.03, 0.03, 0.03), 0.06),
    Target("false_alarms_dirty", False, goals(0.07, 0.07, 0.07, 0.07, 0.07)),
)
FURTHER = (
    Target("sealed_gain_kept", True, goals(0.70, 0.82, 0.75, 0.87, 0.90)),
    Target("sealed_worse", False, goals(0.05, 0.03, 0.05, 0.03, 0.02)),
    Target("amplitude_error", False, goals(1.4, 1.25, 1.35, 1.2, 1.15)),
    Target("alias_set", True, goals(0.95, 0.95, 0.95, 0.95, 0.95)),
    Target("decoy_first", False, goals(0.10, 0.10, 0.10, 0.10, 0.05)),
    Target("decoy_in_set", False, {}),
    Target("two_one_right", True, goals(0.50, 0.72, 0.60, 0.80, 0.88)),
    Target("two_both_right", True,
           {setting: wanted for setting, wanted in goals(0.0, 0.20, 0.0, 0.38, 0.40).items() if wanted}),
    Target("random_worth", True, {L0_300: 300.0, L1_300: 300.0}),
)
WIDER = {"gain_lost": "all_gains_lost", "named_wrong": "all_named_wrong"}      # the same target over more worlds
UNASKED = ("decoy_in_set", "two_both_right")      # reported even where the design has no target
WHY = {"off_unknown": f"none with a lambda of {RESOLVABLE:g} or more was found",
       "decoy_first": "no decoy that such data have anything of",
       "decoy_in_set": "no decoy that such data have anything of",
       "random_worth": "no shots were asked for and given"}
NOT_MEASURED, NO_WORLD = "not measured", "no world of this round says"


def against_targets(marks: Sequence[Mark], scale: float | None = None) -> list[list[str]]:
    """Return a row for every target of the design for a level that was played.

    A row has level and shots, figure, value reached, value that the data allow, target, and whether it is reached or
    why it was not measured. scale: of effects, where they have one.
    """
    rows = []
    for level, shots in sorted({(one.level, one.shots) for one in marks}):
        mine = [one for one in marks if (one.level, one.shots) == (level, shots)]
        setting = next((one for one in (*SETTINGS, PLAIN, LARGE) if one[:2] == (level, shots)
                        and scale in (None, one[2])), None)
        rows += [[f"{level}, {shots}", *row] for row in _rows(setting, mine)]
    played = {(one.level, one.shots) for one in marks}
    return rows + [[f"{level}, {shots}", "all", NOT_MEASURED, "-", "-", f"no world here has {shots} shots"]
                   for level, shots, _ in SETTINGS
                   if level in {one.level for one in marks} and (level, shots) not in played]


def _rows(setting: Setting | None, marks: Sequence[Mark]) -> list[list[str]]:
    if setting is None:
        return [["all", NOT_MEASURED, "-", "-", "the design has no targets for this number of shots"]]
    figures = figures_of(marks)
    targets = [*ALARMS, *(one for target in TARGETS for one in _widened(target)), *FURTHER]
    return [[TITLES[target.figure], *_judged(setting, target, figures[target.figure])]
            for target in targets if setting in target.at or target.figure in UNASKED]


def _widened(target: Target) -> list[Target]:
    wider = WIDER.get(target.figure)
    return [target] if wider is None else [target, target._replace(figure=wider)]


def _judged(setting: Setting, target: Target, figure: ProofFigure) -> list[str]:
    scaled = scaled_target(setting, target, figure.allowed)
    wanted = target.at.get(setting) if scaled is None else scaled
    words = "-" if wanted is None else words_of(target, wanted) + ("" if scaled is None else " (scaled)")
    if figure.value is None:
        return [NOT_MEASURED, "-", words, WHY.get(target.figure, NO_WORLD)]
    return [figure.words, "-" if figure.allowed is None else f"{figure.allowed:.2f}", words,
            "no target" if wanted is None else _verdict(target, wanted, figure)]


def _verdict(target: Target, wanted: float, figure: ProofFigure) -> str:
    """Return whether the target is reached; a share may be so by chance if Wilson's interval crosses the target."""
    assert figure.value is not None
    reached = is_reached(target, figure.value, wanted)
    said = "reached" if reached else "NOT REACHED"
    if figure.counts is None:
        return said
    low, high = wilson(*figure.counts)
    ends = is_reached(target, low, wanted) and is_reached(target, high, wanted)
    apart = high < wanted or low > target.most if target.least else low > wanted
    return said if (ends if reached else apart) else f"{said}, may be chance"


def is_reached(target: Target, value: float, goal: float) -> bool:
    return goal <= value <= target.most if target.least else value <= goal


def words_of(target: Target, goal: float) -> str:
    most = f", <= {target.most:.2g}" if target.most < 1.0 else ""
    return f"{'>=' if target.least else '<='} {round(goal, 2):g}{most}"


def scaled_target(setting: Setting, target: Target, allowed: float | None) -> float | None:
    """The target times our ceiling over the design's (its section 8 asks to keep the ratios); None without either."""
    theirs = DESIGN_CEILING.get(target.figure, {}).get(setting)
    wanted = target.at.get(setting)
    if theirs is None or wanted is None or allowed is None:
        return None
    return wanted / theirs * allowed
