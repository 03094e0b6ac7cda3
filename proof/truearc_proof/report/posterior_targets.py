"""Targets of the posterior over hypotheses: whether what it says is so as often as it says it, on sealed rounds.

They were set before the solver was, with the measurements of the procedure that it replaced.
"""

from collections.abc import Sequence
from typing import NamedTuple

from truearc.sim.statistics import wilson
from truearc_proof.report.figures import figures_of, worse_in_test
from truearc_proof.scoring.decoys import up_to_alias
from truearc_proof.scoring.score_world import Mark
from truearc_proof.worlds.sampling_plan import MUJOCO, NUMPY

LEVELS = ("L0", "L1", "L2")
WORSE = 1.01                          # RMS error on the sealed season, by that without what was adopted
ALARMS, FEW_ALARMS = (0.03, 0.07), (0.0, 0.08)


class Goal(NamedTuple):
    """A row: its text, and for each of LEVELS from where to where the figure should be; None: no target."""

    words: str
    wanted: tuple[tuple[float, float] | None, ...]


CLEAN = Goal("false alarms, clean", (ALARMS,) * 3)
DIRTY = Goal("false alarms, dirty", (ALARMS, ALARMS, FEW_ALARMS))
UNCHANGED = Goal("false alarms, MuJoCo unchanged", (ALARMS, ALARMS, FEW_ALARMS))
WRONG = Goal("single names wrong, whatever was hidden", ((0.0, 0.10), (0.0, 0.10), (0.0, 0.06)))
HELD = Goal("set holds the truth", ((0.90, 1.0), (0.90, 1.0), (0.92, 1.0)))
OFF = Goal("in no catalogue: unknown or a set", ((0.5, 1.0), (0.6, 1.0), (0.88, 1.0)))
BOTH = Goal("two effects, both right", (None, (0.3, 1.0), (0.6, 1.0)))
INTERVALS = Goal("90 % intervals hold the truth", ((0.86, 0.94),) * 3)
ADOPTED = Goal("adopted worse on the sealed season by over 1 %", ((0.0, 0.06),) * 3)
POWER = Goal("power, share of what the data allow", ((0.93, 9.0), (0.93, 9.0), (0.95, 9.0)))
SIZE = Goal("mean size of a set", ((1.0, 5.0), (1.0, 4.0), (1.0, 1.6)))


def shares_of(marks: Sequence[Mark]) -> dict[Goal, list[bool]]:
    """The answers behind each share, of worlds of one level by both engines."""
    found = [one for one in marks if one.found]
    known = [one for one in found if one.right]
    return {
        CLEAN: [one.found for one in marks if one.engine == NUMPY and one.kind == "clean"],
        DIRTY: [one.found for one in marks if one.engine == NUMPY and one.kind == "dirty"],
        UNCHANGED: [one.found for one in marks if one.engine == MUJOCO and one.kind in ("clean", "dirty")],
        WRONG: [not one.first and not up_to_alias(one) for one in found if one.verdict == "named"],
        HELD: [bool(one.covered) for one in known],
        OFF: [one.verdict != "named" for one in found if one.kind == "off"],
        BOTH: [bool(one.both) for one in found if one.kind == "two"],
        INTERVALS: [one.holds for one in found if one.holds is not None],
        ADOPTED: [one.off_m[1] > WORSE * one.off_m[0] for one in marks
                  if one.off_m is not None and worse_in_test(one) is not None]}


def posterior_rows(marks: Sequence[Mark]) -> list[list[str]]:
    """Rows [target, figure, wanted, whether it is reached] for worlds of one level."""
    level = LEVELS.index(marks[0].level)
    rows = [_share_row(goal, answers, goal.wanted[level]) for goal, answers in shares_of(marks).items()]
    power = figures_of(marks)["detected"]
    if power.counts is not None and power.allowed:
        wanted, share = POWER.wanted[level], power.allowed
        assert wanted is not None
        low, high = (end / share for end in wilson(*power.counts))
        rows.insert(3, [POWER.words, f"{power.counts[0] / power.counts[1] / share:.2f} ({low:.2f}-{high:.2f}): "
                        f"{power.counts[0]}/{power.counts[1]} of {share:.2f}", f">= {wanted[0]:g}",
                        _said(power.counts[0] / power.counts[1] / share, (low, high), wanted)])
    sizes = [len(one.names) for one in marks if one.found and one.right and one.verdict in ("named", "set")]
    if sizes and (most := SIZE.wanted[level]):
        mean = sum(sizes) / len(sizes)
        rows.append([SIZE.words, f"{mean:.2f} of {len(sizes)}", f"<= {most[1]:g}",
                     "reached" if mean <= most[1] else "NOT REACHED"])
    return rows


def _share_row(goal: Goal, answers: Sequence[bool], wanted: tuple[float, float] | None) -> list[str]:
    if not answers:
        return [goal.words, "-", _words(wanted), "no world of these rounds says"]
    low, high = wilson(sum(answers), len(answers))
    share = sum(answers) / len(answers)
    return [goal.words, f"{sum(answers)}/{len(answers)} = {share:.2f} ({low:.2f}-{high:.2f})", _words(wanted),
            "no target" if wanted is None else _said(share, (low, high), wanted)]


def _said(value: float, ends: tuple[float, float], wanted: tuple[float, float]) -> str:
    if wanted[0] <= value <= wanted[1]:
        return "reached"
    return "NOT REACHED" if ends[1] < wanted[0] or ends[0] > wanted[1] else "NOT REACHED, may be chance"


def _words(wanted: tuple[float, float] | None) -> str:
    if wanted is None:
        return "-"
    low, high = wanted
    return f"<= {high:g}" if low <= 0.0 else f">= {low:g}" if high >= 1.0 else f"{low:g} to {high:g}"
