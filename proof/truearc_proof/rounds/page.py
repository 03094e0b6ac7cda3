"""The page of a proof round, with the rates of correct claims and every commitment in the round's ledger."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from truearc.sim.report import NO_ORIGIN, Origin, make_page, make_png, new_figure, paragraph, picture, table
from truearc.sim.statistics import wilson
from truearc_proof.rounds import Entry
from truearc_proof.rounds.marks import NULLS, Mark, up_to_alias
from truearc_proof.rounds.tables import Question, ladder_of, share
from truearc_proof.table import Table

SHOWN = 16                            # of a hash's digits; the ledger has them all
LAMBDA = ("Lambda is how plain an effect is in such data: the square of its amplitude over the least standard error "
          "that anybody could have.")
INK, OURS, ALLOWED, NAMED = "#30343b", "#1f5fa8", "#c2571a", "#2f7d4f"
CLAIMED = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.01)       # bins of probabilities
BAND_95 = 1.358                       # Kolmogorov's, over the root of the number (Smirnov 1948)


def make_proof_page(marks: Sequence[Mark], tables: Sequence[Table], entries: Sequence[Entry],
                    origin: Origin = NO_ORIGIN) -> str:
    """Return self-contained HTML. entries: the round's ledger."""
    levels = sorted({f"{one.level}, {one.shots} shots" for one in marks})
    sections = []
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
    sections += [("Every world", _worlds(marks)), ("The ledger", _ledger(entries))]
    title = f"truearc prove: {len(marks)} concealed worlds, {'; '.join(levels)}"
    return make_page(title, verdict(marks), sections, origin)


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


def ladder_png(marks: Sequence[Mark]) -> bytes:
    """Draw the share found and the share named right (up to alias) of all worlds with one hidden effect, over
    lambda."""
    figure = new_figure(7.5, 4.4)
    axes = figure.subplots()
    steps = ladder_of(marks)
    place = [float(np.exp(np.mean(np.log([max(one.strength or 0.0, 0.1) for one in mine])))) for _, _, mine in steps]
    allowed = [np.mean([one.allowed[0] for one in mine if one.allowed] or [np.nan]) for _, _, mine in steps]
    axes.plot(place, allowed, "o--", color=ALLOWED, ms=5, label="could be found: the data's information")
    for answers, aside, colour, label in (
            ([[one.found for one in mine] for _, _, mine in steps], 0.97, OURS, "found"),
            ([[bool(one.alias) for one in mine] for _, _, mine in steps], 1.03, NAMED,
             "found, and its name or an alias of it said first")):
        shares = [sum(one) / len(one) for one in answers]
        ends = np.array([wilson(sum(one), len(one)) for one in answers])
        axes.errorbar(np.array(place) * aside, shares, np.abs(ends.T - shares), fmt="o-", color=colour, ms=6,
                      capsize=2.5, label=label)
    for x, (_, _, mine) in zip(place, steps, strict=True):
        axes.annotate(str(len(mine)), (x, -0.06), ha="center", fontsize=8, color=INK)
    axes.set(xscale="log", ylim=(-0.1, 1.05), xlabel="how plain the hidden effect is: lambda (worlds below)",
             ylabel="share of worlds, 95 %")
    figure.legend(frameon=False, loc="outside upper left", fontsize=9)
    _clean(axes)
    return make_png(figure)


def reliability_png(marks: Sequence[Mark]) -> bytes | None:
    """Draw claimed probabilities against how often they were right, one panel per level; None if none is known.

    Of the first name in worlds with something hidden, where the verdict is not unknown: right, or of its class; of an
    unexplained change: nothing hidden is in the catalogue.
    """
    levels = sorted({one.level for one in marks if one.said is not None})
    if not levels:
        return None
    figure = new_figure(0.6 + 3.4 * len(levels), 3.8)
    for axes, level in zip(figure.subplots(1, len(levels), squeeze=False)[0], levels, strict=True):
        mine = [one for one in marks if one.level == level and one.said is not None]
        claims = [(float(one.said or 0.0), bool(one.alias)) for one in mine if one.verdict != "unknown"]
        odd = [(float(one.unexplained), not one.right) for one in mine if one.unexplained is not None]
        axes.plot([0, 1], [0, 1], "--", color=INK, lw=0.8)
        for pairs, colour, label in ((claims, OURS, "first name"), (odd, ALLOWED, "unexplained")):
            _draw_claims(axes, pairs, colour, f"{label}: {len(pairs)} worlds")
        axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), title=level, xlabel="probability that was claimed")
        axes.legend(frameon=False, loc="upper left", fontsize=8)
        _clean(axes)
    figure.axes[0].set_ylabel("share that was right, 95 %")
    return make_png(figure)


def _draw_claims(axes: Axes, pairs: Sequence[tuple[float, bool]], colour: str, label: str) -> None:
    """Points at the mean claim of each bin."""
    bins = claimed_bins(pairs)
    said, right = [mean for mean, _, _ in bins], np.array([hits / of for _, hits, of in bins])
    ends = np.array([wilson(hits, of) for _, hits, of in bins]).reshape(-1, 2)
    axes.errorbar(said, right, np.abs(ends.T - right), fmt="o", color=colour, ms=5, capsize=2.5, label=label)


def claimed_bins(pairs: Sequence[tuple[float, bool]]) -> list[tuple[float, int, int]]:
    """Return (mean claimed probability, how many were right, of how many) of each non-empty bin of CLAIMED."""
    bins = [[pair for pair in pairs if low <= pair[0] < high] for low, high in pairwise(CLAIMED)]
    return [(float(np.mean([said for said, _ in each])), sum(hit for _, hit in each), len(each)) for each in bins
            if each]


def chance_png(marks: Sequence[Mark]) -> bytes | None:
    """Draw the share of nulls with a p-value up to p, which is the diagonal if p-values are calibrated; None without
    nulls."""
    p = np.sort([one.p_value for one in marks if one.kind in NULLS and one.p_value is not None])
    if not len(p):
        return None
    figure = new_figure(4.6, 3.8)
    axes = figure.subplots()
    line, half = np.linspace(0.0, 1.0, 101), BAND_95 / np.sqrt(len(p))
    axes.fill_between(line, np.clip(line - half, 0, 1), np.clip(line + half, 0, 1), color=ALLOWED, alpha=0.15, lw=0,
                      label="chance, 95 %")
    axes.plot(line, line, "--", color=ALLOWED, lw=1.0)
    axes.step([0.0, *p, 1.0], [0.0, *np.arange(1, len(p) + 1) / len(p), 1.0], where="post", color=OURS, lw=1.8,
              label=f"{len(p)} worlds without a mismatch")
    axes.axvline(0.05, color=INK, lw=0.8)
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="p-value that was claimed", ylabel="share of worlds with such or less")
    axes.legend(frameon=False, loc="lower right", fontsize=9)
    _clean(axes)
    return make_png(figure)


def _clean(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
