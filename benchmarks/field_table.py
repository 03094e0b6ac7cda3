"""Claims of all entrants about the same worlds -> marks -> one table."""

from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import msgspec
import numpy as np

from benchmarks.suite import Job, drawn_of, measured_of, names_of
from truearc_proof.report.tables import said, yes_of
from truearc_proof.rivals import OURS
from truearc_proof.rivals.claim import Claim
from truearc_proof.scoring.oracle import FALSE_ALARM
from truearc_proof.scoring.score_finding import STAGE_OF, names_ranked
from truearc_proof.scoring.score_world import mark_rival, right_names
from truearc_proof.table import make_markdown

RESOLVABLE = 0.95                     # chance that these data's information lets anybody detect the effect
WANTED = 0.95                         # of resolvable worlds, that ours names right
KINDS = ("nulls", "effects", "cut")
LEVEL = "L2"
HEAD = ("hidden", "resolvable, of", "entrant", "detects", "top-1", "up to alias", "track's end, cm", "s")
NAMING = ("named", "set")             # verdicts that give names; "unknown" gives none, whatever it ranks
QUESTIONS = (attrgetter("says"), attrgetter("right"), attrgetter("alias"))


class Mark(NamedTuple):
    """One entrant in one world. right, alias: None where nothing has a name to be found (nulls)."""

    kind: str
    name: str
    scale: float
    entrant: str
    resolvable: bool
    says: bool
    right: bool | None
    alias: bool | None
    before_m: float | None
    after_m: float | None
    seconds: float


def flight_names(kind: str) -> tuple[str, ...]:
    """Return the null worlds and the terms of the flight."""
    return tuple(name for name in names_of(kind, LEVEL) if kind == "nulls" or STAGE_OF[name] == "flight")


def claim_of(finding: dict[str, Any]) -> Claim:
    """truearc's own finding (truearc.finding/1, decoded) as a claim like the others'; names only where its verdict
    gives them."""
    fit = finding.get("fit") or {}
    before, after = fit.get("height_rmse_before_m"), fit.get("height_rmse_after_m")
    names = tuple(names_ranked(finding)) if finding["verdict"] in NAMING else ()
    return Claim(bool(finding["mismatch"]["found"]), names, before, before if after is None else after,
                 {} if finding["mismatch"]["p_value"] is None else {"p_value": float(finding["mismatch"]["p_value"])})


def marks_of(line: dict[str, Any]) -> list[Mark]:
    """Of one world's line: every entrant's, by the proof's own rules."""
    job = msgspec.convert(line["job"], Job)
    drawn, ceiling = drawn_of(job), line.get("ceiling")
    resolvable = ceiling is not None and ceiling[0] >= RESOLVABLE
    found = []
    for entrant, each in line["claims"].items():
        claim = each["claim"]
        marks = mark_rival(drawn, claim, right_names(drawn), measured_of(ceiling, {}))
        found.append(Mark(job.kind, job.name, job.scale, entrant, resolvable, *marks,
                          claim.get("before_m"), claim.get("after_m"), each["seconds"]))
    return found


def make_table(lines: Sequence[dict[str, Any]], everywhere: bool = False) -> str:
    """Markdown: nulls, each hidden effect, all together; of each, every entrant. Shares with Wilson 95 % and counts.

    Of worlds with something hidden only the resolvable ones are counted, unless `everywhere`.
    """
    marks = [mark for line in lines for mark in marks_of(line)]
    entrants = [OURS, *dict.fromkeys(mark.entrant for mark in marks if mark.entrant != OURS)]
    rows: list[list[str]] = []
    nulls = [mark for mark in marks if mark.kind == "nulls"]
    for name in [*dict.fromkeys(mark.name for mark in nulls), "together"] if nulls else ():
        mine = [mark for mark in nulls if name in (mark.name, "together")]
        rows += _lines(f"nothing: {name}", mine, mine, entrants)
    hidden = [mark for mark in marks if mark.kind != "nulls"]
    for scale in sorted({mark.scale for mark in hidden}, reverse=True):
        here = [mark for mark in hidden if mark.scale == scale]
        for kind, name in [*dict.fromkeys((mark.kind, mark.name) for mark in here), ("", "")]:
            title = f"{name}{' (cut)' if kind == 'cut' else ''} x {scale:g}" if name else f"**together x {scale:g}**"
            mine = [mark for mark in here if not name or (mark.kind, mark.name) == (kind, name)]
            rows += _lines(title, mine, [mark for mark in mine if everywhere or mark.resolvable], entrants)
    return "\n".join([make_markdown(HEAD, rows), "", *_against_target(hidden)])


def _lines(hidden: str, marks: Sequence[Mark], counted: Sequence[Mark], entrants: Sequence[str]) -> list[list[str]]:
    """A row an entrant, of the worlds that count; one row in all where none does."""
    worlds = max(sum(mark.entrant == one for mark in marks) for one in entrants)
    if not counted:
        return [[hidden, f"0 of {worlds}", *["-"] * (len(HEAD) - 2)]]
    rows = []
    for entrant in entrants:
        mine = [mark for mark in counted if mark.entrant == entrant]
        seconds = f"{np.median([mark.seconds for mark in mine]):.0f}" if mine else "-"
        rows.append([hidden, f"{sum(mark.resolvable for mark in mine)} of {worlds}" if mine and mine[0].kind != "nulls"
                     else f"{worlds}", entrant, *(said(*yes_of(map(question, mine))) for question in QUESTIONS),
                     _ends(mine), seconds])
    return rows


def _ends(marks: Iterable[Mark]) -> str:
    """Return the mean over worlds of the RMS forecast error before and after, of entrants that forecast."""
    pairs = [(mark.before_m, mark.after_m) for mark in marks if mark.before_m is not None and mark.after_m is not None]
    if not pairs:
        return "-"
    before, after = 100.0 * np.mean(pairs, axis=0)
    return f"{before:.2f} -> {after:.2f}"


def _against_target(hidden: Sequence[Mark]) -> list[str]:
    """Compare with the target: truearc names the concealed flight term in 95 % of resolvable worlds."""
    mine = [mark for mark in hidden if mark.entrant == OURS and mark.resolvable]
    if not mine:
        return ["No world with something hidden is resolvable."]
    told = []
    for what, question in zip(("names it", "up to alias"), QUESTIONS[1:], strict=True):
        yes, of = yes_of(map(question, mine))
        told.append(f"{what} {said(yes, of)}: {'reached' if yes >= WANTED * of else 'NOT REACHED'}")
    return [f"truearc in resolvable worlds (a {FALSE_ALARM:g} test has a chance of {RESOLVABLE:g} or more, by the "
            f"information in these very data), wanted {WANTED:g}: " + "; ".join(told) + "."]
