"""Verdict and tables of a proof round: figures with Wilson's 95 % intervals, and targets set before the rounds."""

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from operator import attrgetter
from typing import Any, NamedTuple

from truearc.sim.statistics import wilson
from truearc_proof.rounds.marks import NULLS, Mark, up_to_alias
from truearc_proof.rounds.worlds import FOREIGN, MUJOCO, NUMPY, OWN
from truearc_proof.table import Table
from truearc_proof.truth.world import LEVELS

KINDS = {"one": "one effect", "two": "two effects", "alias": "aliases", "decoy": "with a decoy",
         "off": "in no catalogue"}
CHANGED = {**KINDS, "one": "one thing changed", "two": "two things"}     # of MuJoCo's robot
Question = Callable[[Mark], bool | None]
FOUND: Question = attrgetter("found")
STAGE: Question = attrgetter("stage")
RIGHT: tuple[Question, ...] = (attrgetter("first"), up_to_alias, attrgetter("covered"))


def make_tables(marks: Sequence[Mark]) -> list[Table]:
    """Return the tables of a round that have rows.

    False alarms, correct answers, the targets of the posterior, and rivals. Foreign worlds come first.
    """
    tables = [_alarms(marks), _right(marks),
              Table("Targets of the posterior", ("figure", "result", "target", ""),
                    posterior_rows(marks) if len({one.level for one in marks}) == 1 else []),
              _rivals(marks)]
    return [one for one in tables if one.rows]


def verdict(marks: Sequence[Mark]) -> str:
    """Return the verdict in a sentence or two."""
    nulls, hidden = ([one for one in marks if (one.kind in NULLS) == null] for null in (True, False))
    named = [one for one in hidden if one.first is not None]
    parts = []
    if nulls:
        parts.append(f"Where nothing was missing, something was claimed in {_words(nulls, lambda one: one.found)}.")
    if hidden:
        parts.append(f"Where something was hidden, it was found in {_words(hidden, lambda one: one.found)}.")
    if named:
        parts.append("Of what was found and has a name, the right one or one that such data cannot tell from it came "
                     f"first in {_words(named, up_to_alias)}.")
    return " ".join(parts)


def _words(marks: Sequence[Mark], question: Question) -> str:
    yes, of = share(marks, question)
    low, high = wilson(yes, of)
    return f"{yes} of {of} worlds ({low:.0%} to {high:.0%})"


def share(marks: Iterable[Mark], question: Question) -> tuple[int, int]:
    """Return (yes, of) for the items with an answer."""
    return yes_of(map(question, marks))


def said(yes: int, of: int) -> str:
    low, high = wilson(yes, of)
    return f"{yes}/{of} = {yes / of:.2f} ({low:.2f}-{high:.2f})" if of else "-"


def _alarms(marks: Sequence[Mark]) -> Table:
    titles = {"foreign, unchanged": [(FOREIGN, "clean")], "clean": [(NUMPY, "clean")], "dirty": [(NUMPY, "dirty")],
              "MuJoCo, unchanged": [(MUJOCO, "clean")], "MuJoCo, unchanged, dirty": [(MUJOCO, "dirty")],
              "external": [*product((OWN,), NULLS)],
              "together": [*product((FOREIGN, NUMPY, MUJOCO, OWN), NULLS)]}
    groups = {title: [one for one in marks if (one.engine, one.kind) in kinds] for title, kinds in titles.items()}
    rows = [[title, said(*share(mine, FOUND)), said(*share(mine, lambda one: bool(one.names)))]
            for title, mine in groups.items() if mine]
    return Table("Worlds in which nothing is missing (nominal 0.05)", ("", "false alarms", "a name was given"), rows)


def _right(marks: Sequence[Mark]) -> Table:
    """Each kind of world in which something is hidden, of those found."""
    kinds = {"foreign, one thing changed": (FOREIGN, "one"), **{words: (NUMPY, kind) for kind, words in KINDS.items()},
             **{f"MuJoCo, {words}": (MUJOCO, kind) for kind, words in CHANGED.items()},
             **{f"external, {words}": (OWN, kind) for kind, words in KINDS.items()}}
    rows = []
    for title, (engine, kind) in kinds.items():
        mine = [one for one in marks if (one.engine, one.kind) == (engine, kind)]
        errors = [one.error for one in mine if one.error is not None]
        sizes = [one.set_size for one in mine if one.set_size is not None]
        if mine:
            rows.append([title, *(said(*share(mine, question)) for question in (FOUND, STAGE, *RIGHT)),
                         f"{sum(sizes) / len(sizes):.1f}" if sizes else "-",
                         said(*share(mine, lambda one: one.holds)),
                         f"{(sum(error**2 for error in errors) / len(errors))**0.5:.2f}" if errors else "-",
                         said(*share(mine, worse_in_test))])
    return Table("Worlds in which something is hidden; from `stage` on, of those found", (
        "hidden", "found", "stage", "first name right", "up to alias", "in the set", "set size", "interval holds",
        "error / least possible, RMS", "worse in the sealed test than before"), rows)


def _rivals(marks: Sequence[Mark]) -> Table:
    """truearc and the rest, in the same worlds: those that rivals were put to."""
    mine = [(one, {"truearc": _ours(one)} | one.rivals) for one in marks if one.rivals]
    said_of = {name: [(one, answers[name]) for one, answers in mine if name in answers]
               for name in dict.fromkeys(name for _, answers in mine for name in answers)}
    rows = []
    for name, answers in said_of.items():
        nulls = [answer[0] for one, answer in answers if one.kind in NULLS]
        hidden = [answer for one, answer in answers if one.kind not in NULLS]
        rows.append([name, said(sum(nulls), len(nulls)), *(said(*yes_of([answer[k] for answer in hidden]))
                                                          for k in range(3))])
    return Table("Rivals in the same worlds (with tracks)", (
        "", "false alarms", "hidden effects detected",
        "first name right, if the catalogue has a right one", "up to alias"), rows)


def _ours(one: Mark) -> tuple[bool, bool | None, bool | None]:
    return (one.found, bool(one.first), bool(up_to_alias(one))) if one.right else (one.found, None, None)


def yes_of(answers: Iterable[bool | None]) -> tuple[int, int]:
    """Return (yes, of) for those that are not None."""
    known = [answer for answer in answers if answer is not None]
    return sum(known), len(known)


# --- figures and their targets

class Goal(NamedTuple):
    """A figure's text, and for each of LEVELS its target range; None: no target."""

    words: str
    wanted: tuple[tuple[float, float] | None, ...]


ALARM_RATES, FEW_ALARM_RATES = (0.03, 0.07), (0.0, 0.08)
NEGLIGIBLE = 1e-3                     # relative change of an error that counts as none
WORSE = 1.01                          # RMS error on the sealed season, by that without what was adopted
FOREIGN_ALARMS = Goal("false alarms, foreign", (FEW_ALARM_RATES,) * 3)
FOREIGN_FOUND = Goal("foreign: a change is found", (None, (0.83, 1.0), (0.83, 1.0)))
FOREIGN_HELD = Goal("foreign: set holds the truth", ((0.90, 1.0),) * 3)
FOREIGN_INTERVALS = Goal("foreign: 90 % intervals hold the change", ((0.82, 0.95),) * 3)
CLEAN = Goal("false alarms, clean", (ALARM_RATES,) * 3)
DIRTY = Goal("false alarms, dirty", (ALARM_RATES, ALARM_RATES, FEW_ALARM_RATES))
UNCHANGED = Goal("false alarms, MuJoCo unchanged", (ALARM_RATES, ALARM_RATES, FEW_ALARM_RATES))
POWER = Goal("power, share of what the data allow", ((0.93, 9.0), (0.93, 9.0), (0.95, 9.0)))
WRONG = Goal("single names wrong, whatever was hidden", ((0.0, 0.10), (0.0, 0.10), (0.0, 0.06)))
HELD = Goal("set holds the truth", ((0.90, 1.0), (0.90, 1.0), (0.92, 1.0)))
OFF = Goal("in no catalogue: unknown or a set", ((0.5, 1.0), (0.6, 1.0), (0.88, 1.0)))
BOTH = Goal("two effects, both right", (None, (0.3, 1.0), (0.6, 1.0)))
INTERVALS = Goal("90 % intervals hold the truth", ((0.86, 0.94),) * 3)
ADOPTED = Goal("adopted worse on the sealed season by over 1 %", ((0.0, 0.06),) * 3)
SIZE = Goal("mean size of a set", ((0.0, 5.0), (0.0, 4.0), (0.0, 1.6)))
OMITTED = (FOREIGN_ALARMS, FOREIGN_FOUND, FOREIGN_HELD, FOREIGN_INTERVALS, POWER, SIZE)    # where no world counts


class ProofFigure(NamedTuple):
    """A figure with Wilson's 95 % interval; value None if no world counts. `words`: as shown in tables."""

    value: float | None
    words: str
    low: float | None = None
    high: float | None = None


def figures_of(marks: Sequence[Mark]) -> dict[Goal, ProofFigure]:
    """Return figures of worlds of one level and number of shots, foreign ones first, then of all engines."""
    found = [one for one in marks if one.found]
    changed = [one for one in marks if one.engine == FOREIGN and one.kind not in NULLS]
    shares = {
        FOREIGN_ALARMS: [one.found for one in marks if one.engine == FOREIGN and one.kind in NULLS],
        FOREIGN_FOUND: [one.found for one in changed],
        FOREIGN_HELD: [bool(one.covered) for one in changed if one.found],
        FOREIGN_INTERVALS: [one.holds for one in changed if one.holds is not None],
        CLEAN: [one.found for one in marks if one.engine == NUMPY and one.kind == "clean"],
        DIRTY: [one.found for one in marks if one.engine == NUMPY and one.kind == "dirty"],
        UNCHANGED: [one.found for one in marks if one.engine == MUJOCO and one.kind in NULLS],
        POWER: [],
        WRONG: [not one.first and not up_to_alias(one) for one in found if one.verdict == "named"],
        HELD: [bool(one.covered) for one in found if one.right],
        OFF: [one.verdict != "named" for one in found if one.kind == "off"],
        BOTH: [bool(one.both) for one in found if one.kind == "two"],
        INTERVALS: [one.holds for one in found if one.holds is not None],
        ADOPTED: [one.off_m[1] > WORSE * one.off_m[0] for one in marks
                  if one.off_m is not None and worse_in_test(one) is not None]}
    figures = {goal: _share_figure(answers) for goal, answers in shares.items()}
    figures[POWER] = _power([one for one in marks if one.engine == NUMPY and one.kind == "one"])
    sizes = [len(one.names) for one in found if one.right and one.verdict in ("named", "set")]
    mean = sum(sizes) / len(sizes) if sizes else None
    return figures | {SIZE: ProofFigure(mean, "-" if mean is None else f"{mean:.2f} of {len(sizes)}", mean, mean)}


def _share_figure(answers: Sequence[bool]) -> ProofFigure:
    if not answers:
        return ProofFigure(None, "-")
    yes, of = sum(answers), len(answers)
    return ProofFigure(yes / of, said(yes, of), *wilson(yes, of))


def _power(marks: Sequence[Mark]) -> ProofFigure:
    """Share detected, by the mean chance that the data allow."""
    known = [(one.found, one.allowed[0]) for one in marks if one.allowed is not None]
    yes, of, allowed = sum(found for found, _ in known), len(known), sum(chance for _, chance in known)
    if not allowed:
        return ProofFigure(None, "-")
    value, low, high = (share / (allowed / of) for share in (yes / of, *wilson(yes, of)))
    return ProofFigure(value, f"{value:.2f} ({low:.2f}-{high:.2f}): {yes}/{of} of {allowed / of:.2f}", low, high)


def plain_figures(marks: Sequence[Mark]) -> dict[str, Any]:
    """Return {"level, shots": {figure: value and interval}}, plain values."""
    settings = sorted({(one.level, one.shots) for one in marks})
    return {f"{level}, {shots}": {goal.words: {"value": one.value, "low95": one.low, "high95": one.high}
                                  for goal, one in figures_of([mark for mark in marks if (mark.level, mark.shots)
                                                               == (level, shots)]).items()}
            for level, shots in settings}


def posterior_rows(marks: Sequence[Mark]) -> list[list[str]]:
    """Return rows [target, figure, wanted, whether it is reached] for worlds of one level."""
    level = LEVELS.index(marks[0].level)
    return [[goal.words, figure.words, _wanted(goal.wanted[level]), _reached(figure, goal.wanted[level])]
            for goal, figure in figures_of(marks).items() if figure.value is not None or goal not in OMITTED]


def _wanted(wanted: tuple[float, float] | None) -> str:
    if wanted is None:
        return "-"
    low, high = wanted
    return f"<= {high:g}" if low <= 0.0 else f">= {low:g}" if high >= 1.0 else f"{low:g} to {high:g}"


def _reached(figure: ProofFigure, wanted: tuple[float, float] | None) -> str:
    if figure.value is None or figure.low is None or figure.high is None:
        return "no world for it in these rounds"
    if wanted is None:
        return "no target"
    if wanted[0] <= figure.value <= wanted[1]:
        return "reached"
    return "NOT REACHED" if figure.high < wanted[0] or figure.low > wanted[1] else "NOT REACHED, may be chance"


def worse_in_test(one: Mark) -> bool | None:
    """Return whether the adopted belief forecasts sealed shots worse; None where the change of error is negligible."""
    if one.off_m is None:
        return None
    before, after = one.off_m[:2]
    return None if abs(after - before) <= NEGLIGIBLE * before else after > before
