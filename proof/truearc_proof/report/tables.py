"""Tables of a round of proof, with Wilson 95 % intervals."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from operator import attrgetter

import numpy as np
from scipy.stats import fisher_exact

from truearc.sim.statistics import wilson
from truearc_proof.report import targets
from truearc_proof.scoring.score_world import MEASUREMENT, NULLS, SHOTS, Mark, up_to_alias
from truearc_proof.table import Table
from truearc_proof.worlds.sampling_plan import MUJOCO, NUMPY, OWN

VERDICTS = ("none", "named", "set", "unknown")
GROUPS = {"nothing": NULLS, "one of the catalogue": ("one", "decoy", "cut"), "aliases": ("alias",), "two": ("two",),
          "in no catalogue": ("off",)}
KINDS = {"one": "one effect", "two": "two effects", "alias": "aliases", "decoy": "with a decoy",
         "off": "in no catalogue", "cut": "a term cut from the belief"}
CHANGED = {**KINDS, "one": "one thing changed", "two": "two things"}     # of MuJoCo's robot
STEPS = (0.0, 1.0, 3.0, 7.0, 15.0, 35.0, 100.0, float("inf"))      # of lambda
REQUESTS = {SHOTS: "shots", MEASUREMENT: "one measurement"}
Question = Callable[[Mark], bool | None]
Again = Sequence[tuple[Mark, Mark]]
FOUND: Question = attrgetter("found")
STAGE: Question = attrgetter("stage")
RIGHT: tuple[Question, ...] = (attrgetter("first"), up_to_alias, attrgetter("covered"))
ROUNDING = 1e-9                       # an interval that begins at 0 may begin a last digit above it


def make_tables(marks: Sequence[Mark], again: Again = (), scale: float | None = None) -> list[Table]:
    """Return the tables of a round that have rows.

    False alarms, detection by lambda and by name, correct answers, the abstention matrix, the targets of the posterior
    and of the design, rivals, and the gain of further shots.

    Args:
        marks: Of first claims.
        again: (first, second) marks of the worlds that were shot again.
        scale: Of effects; None: any.
    """
    tables = [_alarms(marks), _ladder(marks), _by_name(marks), _right(marks), _matrix(marks), _posterior(marks),
              _targets(marks, scale), _rivals(marks), _again(again)]
    return [one for one in tables if one.rows]


def share(marks: Iterable[Mark], question: Question) -> tuple[int, int]:
    """(yes, of) of those that answer."""
    return yes_of(map(question, marks))


def said(yes: int, of: int) -> str:
    low, high = wilson(yes, of)
    return f"{yes}/{of} = {yes / of:.2f} ({low:.2f}-{high:.2f})" if of else "-"


def matrix_of(marks: Sequence[Mark]) -> dict[str, list[int]]:
    """{what was true: worlds by verdict}, of what there was."""
    return {title: [sum(one.verdict == word for one in marks if one.kind in kinds) for word in VERDICTS]
            for title, kinds in GROUPS.items() if any(one.kind in kinds for one in marks)}


def ladder_of(marks: Sequence[Mark]) -> list[tuple[float, float, list[Mark]]]:
    """(least lambda, most, worlds with one hidden effect of the catalogue in between)."""
    single = [one for one in marks if one.kind in ("one", "alias")]
    steps = [(low, high, [one for one in single if one.strength is not None and low <= one.strength < high])
             for low, high in pairwise(STEPS)]
    return [step for step in steps if step[2]]


def _alarms(marks: Sequence[Mark]) -> Table:
    nulls = [one for one in marks if one.kind in NULLS]
    groups = {"clean": [one for one in nulls if one.kind == "clean" and one.engine == NUMPY],
              "dirty": [one for one in nulls if one.kind == "dirty" and one.engine == NUMPY],
              "MuJoCo, unchanged": [one for one in nulls if one.engine == MUJOCO and one.kind == "clean"],
              "MuJoCo, unchanged, dirty": [one for one in nulls if one.engine == MUJOCO and one.kind == "dirty"],
              "external": [one for one in nulls if one.engine == OWN], "together": nulls}
    rows = [[title, said(*share(mine, lambda one: one.found)), said(*share(mine, lambda one: bool(one.names)))]
            for title, mine in groups.items() if mine]
    return Table(
        "Worlds in which nothing is missing (nominal 0.05)", ("", "false alarms", "a name was given"), rows
    )


def _ladder(marks: Sequence[Mark]) -> Table:
    rows = []
    for low, high, mine in ladder_of(marks):
        allowed = [one.allowed[0] for one in mine if one.allowed]
        rows.append([f"{low:g}-{high:g}" if high < STEPS[-1] else f"{low:g} and more",
                     said(*share(mine, lambda one: one.found)),
                     f"{sum(allowed) / len(allowed):.2f}" if allowed else "-",
                     *(said(*share(mine, question)) for question in (*RIGHT, STAGE))])
    return Table("One hidden effect, by how plain it is", (
        "lambda", "found", "these data allow", "first name right", "up to alias", "in the set", "stage"), rows)


def _by_name(marks: Sequence[Mark]) -> Table:
    """Those first of which most was missed of what their data allow."""
    single = [one for one in marks if one.engine == NUMPY and one.kind == "one" and one.allowed]
    rows = []
    for name in sorted({one.hidden for one in single}):
        mine = [one for one in single if one.hidden == name]
        allowed = sum(one.allowed[0] for one in mine if one.allowed)
        rows.append((sum(one.found for one in mine) - allowed, [
            ", ".join(name), f"{sum(one.found for one in mine)}/{len(mine)}", f"{allowed:.1f}"]))
    return Table("One effect of the catalogue, by name", ("hidden", "found", "these data allow to find"),
                 [row for _, row in sorted(rows)])


def _right(marks: Sequence[Mark]) -> Table:
    """Each kind of world in which something is hidden, of those found."""
    kinds = {**{words: (NUMPY, kind) for kind, words in KINDS.items()},
             **{f"MuJoCo, {words}": (MUJOCO, kind) for kind, words in CHANGED.items()},
             **{f"external, {words}": (OWN, kind) for kind, words in KINDS.items()}}
    rows = []
    for title, (engine, kind) in kinds.items():
        mine = [one for one in marks if (one.engine, one.kind) == (engine, kind)]
        errors = [one.error for one in mine if one.error is not None]
        sizes = [one.set_size for one in mine if one.set_size is not None]
        pairs = [(one.gain, one.oracle_gain) for one in mine if one.gain is not None and one.oracle_gain is not None]
        best = sum(oracle for _, oracle in pairs)
        if mine:
            rows.append([title, *(said(*share(mine, question)) for question in (FOUND, STAGE, *RIGHT)),
                         f"{sum(sizes) / len(sizes):.1f}" if sizes else "-",
                         said(*share(mine, lambda one: one.holds)),
                         f"{(sum(error**2 for error in errors) / len(errors))**0.5:.2f}" if errors else "-",
                         f"{sum(gain for gain, _ in pairs) / best:.2f}" if best > 0.0 else "-",
                         *_in_test(mine)])
    return Table("Worlds in which something is hidden; from `stage` on, of those found", (
        "hidden", "found", "stage", "first name right", "up to alias", "in the set", "set size", "interval holds",
        "error / least possible, RMS", "gain kept, by the solver's own folds", "in the sealed test",
        "worse there than before"), rows)


def _in_test(marks: Sequence[Mark]) -> list[str]:
    return [targets.kept_in_test(marks).words, said(*share(marks, targets.worse_in_test))]


def _matrix(marks: Sequence[Mark]) -> Table:
    rows = [[title, *map(str, counts)] for title, counts in matrix_of(marks).items()]
    return Table("What was true against what was said", ("true, said", *VERDICTS), rows)


def _posterior(marks: Sequence[Mark]) -> Table:
    levels = {one.level for one in marks}
    return Table("Against the targets of the posterior", ("figure", "here", "wanted", ""),
                 targets.posterior_rows(marks) if len(levels) == 1 else [])


def _targets(marks: Sequence[Mark], scale: float | None) -> Table:
    return Table("Against the design's targets", (
        "level, shots", "figure", "here", "these data allow", "wanted", ""), targets.against_targets(marks, scale))


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
    return Table("Beside others, in the same worlds (with tracks)", (
        "", "says something though nothing is missing", "says something where something is hidden",
        "first name right, of all with a name to be found", "up to alias"), rows)


def _ours(one: Mark) -> tuple[bool, bool | None, bool | None]:
    return (one.found, bool(one.first), bool(up_to_alias(one))) if one.right else (one.found, None, None)


def yes_of(answers: Iterable[bool | None]) -> tuple[int, int]:
    """(yes, of) of those that are not None."""
    known = [answer for answer in answers if answer is not None]
    return sum(known), len(known)


def _again(pairs: Again) -> Table:
    named = {kind: [pair for pair in pairs if pair[0].first is not None and pair[0].asked == kind]
             for kind in REQUESTS}
    rows = [[REQUESTS[kind], str(len(mine)), *_before_and_after(mine)] for kind, mine in named.items() if mine]
    return Table("Further shots and measurements: answers before and after", (
        "", "worlds", "set before", "after", "first name right before", "after", "the right name alone before",
        "after"), rows)


def _before_and_after(named: Again) -> list[str]:
    sizes = [[one.set_size for one in side if one.set_size is not None] for side in zip(*named, strict=True)]
    cells = [f"{sum(side) / len(side):.1f}" if side else "-" for side in sizes]
    for question in (lambda one: one.first, lambda one: bool(one.first) and one.names == one.hidden):
        cells += [said(*share(side, question)) for side in zip(*named, strict=True)]
    return cells


def beside(published: Sequence[Mark], again: Sequence[Mark]) -> Table:
    """A row for each share that both rounds have: whether the second one's lies in the first one's 95 % interval, ends
    included, and how often chance alone would put two rounds of these sizes as far apart (Fisher's exact test): of six
    worlds a share lies outside easily."""
    ours, theirs = targets.figures_of(published), targets.figures_of(again)
    rows = [_beside_row(targets.TITLES[name], ours[name], theirs[name]) for name in ours
            if ours[name].counts is not None and theirs[name].counts is not None]
    return Table("Played again", ("figure", "published", "again", "inside", "by chance"), rows)


def _beside_row(name: str, ours: targets.ProofFigure, theirs: targets.ProofFigure) -> list[str]:
    assert ours.counts is not None and theirs.counts is not None
    (low, high), (yes, of) = wilson(*ours.counts), theirs.counts
    counts = np.array([[yes, of - yes], [ours.counts[0], ours.counts[1] - ours.counts[0]]])
    return [name, ours.words, theirs.words, "yes" if low - ROUNDING <= yes / of <= high + ROUNDING else "no",
            f"{fisher_exact(counts).pvalue:.2f}"]
