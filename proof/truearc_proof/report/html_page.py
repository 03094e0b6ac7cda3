"""The one page of a round of proof: how often it was right, in pictures and tables, and every commitment in its ledger.
"""

from collections.abc import Sequence

from truearc.sim.report import NO_ORIGIN, Origin, make_page, paragraph, picture, table
from truearc.sim.statistics import wilson
from truearc_proof.report.plots import chance_png, ladder_png, matrix_png, reliability_png
from truearc_proof.report.tables import Question, ladder_of, share
from truearc_proof.rounds.ledger import Entry
from truearc_proof.scoring.decoys import up_to_alias
from truearc_proof.scoring.score_world import NULLS, Mark
from truearc_proof.table import Table

SHOWN = 16                            # of a hash's digits; the ledger has them all
LAMBDA = ("Lambda is how plain an effect is in such data: the square of its amplitude over the least standard error "
          "that anybody could have.")


def make_proof_page(marks: Sequence[Mark], tables: Sequence[Table], entries: Sequence[Entry],
                    origin: Origin = NO_ORIGIN) -> str:
    """HTML that needs nothing but itself. entries: the round's ledger. A round that was only driven has no marks."""
    levels = sorted({f"{one.level}, {one.shots} shots" for one in marks})
    sections = [("What was said of what was true", _matrix(marks))] if marks else []
    if ladder_of(marks):
        sections.append(("The plainer, the surer", picture(ladder_png(marks), "share found over lambda") +
                         paragraph(LAMBDA, dim=True)))
    chance = chance_png(marks)
    if chance is not None:
        sections.append(("Where nothing is missing", picture(
            chance, "p-values of the nulls against chance", "Worlds in which nothing is missing. A share p of "
            "them should look so extreme that their p-value is p or less: the diagonal.")))
    reliability = reliability_png(marks)
    if reliability is not None:
        sections.append(("Do probabilities mean what they say", picture(
            reliability, "probabilities that were claimed against shares that were right")))
    sections += [(one.title, table(one.header, one.rows)) for one in tables]
    sections += [("Every world", _worlds(marks))] if marks else []
    sections += [("The ledger", _ledger(entries))]
    title = f"{len(marks)} concealed worlds, {'; '.join(levels)}" if marks else "driven worlds"
    return make_page(f"truearc prove: {title}", verdict(marks), sections, origin)


def verdict(marks: Sequence[Mark]) -> str:
    """In a sentence or two."""
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


def _matrix(marks: Sequence[Mark]) -> str:
    return picture(matrix_png(marks), "worlds by what was true and what was said",
                   "Worlds; the darker, the larger the share of the row. named: one name; set: names that these data "
                   "cannot tell apart; unknown: an unexplained effect; none: nothing found.")


def _worlds(marks: Sequence[Mark]) -> str:
    rows = [[one.world, one.engine, one.kind, ", ".join(one.hidden) or "nothing",
             None if one.strength is None else f"{one.strength:.3g}", one.p_value, one.verdict, ", ".join(one.names),
             _word(one.stage), _word(one.first), _word(up_to_alias(one))] for one in marks]
    return _folded(f"{len(rows)} worlds", table(["world", "engine", "kind", "hidden", "lambda", "p-value", "verdict",
                                                 "said", "stage right", "first name", "up to alias"], rows))


def _ledger(entries: Sequence[Entry]) -> str:
    rows = [[entry.number, entry.what, entry.world, entry.sha256[:SHOWN], entry.before[:SHOWN]] for entry in entries]
    return paragraph("Each line has the hash of the line before it; a world was sealed before its data were given "
                     "away, claims were in the ledger before the seal was opened.") + _folded(
        f"{len(rows)} lines", table(["", "step", "world", "SHA-256", "line before"], rows))


def _folded(title: str, body: str) -> str:
    return f"<details><summary>{title}</summary>{body}</details>"


def _word(answer: bool | None) -> str:
    return "" if answer is None else "yes" if answer else "no"
