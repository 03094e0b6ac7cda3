"""What data could tell, as a table on the terminal, a section of a report, and a page of its own."""

import html

import numpy as np

from truearc.sim.discover.plan.detectability import TAKEN, Fittable, Sight, TermIdentifiability
from truearc.sim.discover.report.effect_wording import plain, size_of
from truearc.sim.discover.report.finding_plots import sight_png
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.printed import make_text
from truearc.sim.report import NO_ORIGIN, Origin, make_page, paragraph, picture, table

MOST_SHOTS = 10_000                   # beyond which the number is no longer said
NEXT = 4                              # effects beyond what is shown that a summary lists
SURE = 0.8                            # power that counts as "would be seen"
METHOD = (
    "Expected Fisher information: what is left of each effect's after the fitted coefficients, scatters and the random "
    "effects of balls (or sessions) have absorbed what they can. Seen means that truearc discover reports a mismatch "
    "four times in five, at 5 % false alarms over all terms, if this one effect is there at its usual size and no "
    "other; naming it takes more shots. Effects whose patterns over the shots are alike to 0.95 or more are listed as "
    "one. Small effects are assumed, so that everything is linear in them.")


def sight_lines(sight: Sight, among: Catalogue | None = None) -> list[str]:
    """The table on the terminal."""
    lines = [sight_sentence(sight), ""]
    head = ("effect", "stage", "usual size", "left", "shots needed", "like")
    rows = [_row(one, among) for one in sight.terms if one.shots_needed is not None]
    lines += make_text(head, rows, right=(3, 4))
    lines += ["", *(f"one and the same to these data, while small: {', '.join(group)}" for group in sight.classes)]
    lines += [f"never seen: {one.term}: {why_not(one, among)}" for one in sight.terms if one.shots_needed is None]
    lines.append("fitted anyway: " + ", ".join(f"{one.name} {_uncertainty(one, one.after)}" for one in sight.fitted))
    return lines


def sight_summary(sight: Sight, among: Catalogue | None = None) -> list[str]:
    """What these shots would show, and which effects the next few shots would add, in three lines at most."""
    possible = sorted((one.shots_needed, one.term, one.power) for one in sight.terms if one.shots_needed is not None)
    shown = [plain(term, among) for _, term, power in possible if power >= SURE]
    more = [f"{plain(term, among)} ({_shots(needed)})" for needed, term, power in possible if power < SURE]
    said = (("would be seen", shown), ("with more shots", more[:NEXT]))
    return [sight_sentence(sight), *(f"  {what}: {', '.join(names)}" for what, names in said if names)]


def _row(one: TermIdentifiability, among: Catalogue | None) -> tuple[str, ...]:
    like = "" if one.like is None else f"{one.like} {one.correlation:+.2f}"
    return (one.term, one.stage, size_of(one.term, one.usual, one.unit, among), f"{one.share_left:.1%}",
            _shots(one.shots_needed or 0), like)


def _shots(needed: int) -> str:
    """The number of shots, up to MOST_SHOTS."""
    return str(needed) if needed <= MOST_SHOTS else f"over {MOST_SHOTS}"


def sight_sentence(sight: Sight) -> str:
    """How many effects would be seen, and the one thing to keep in mind."""
    shown = [one for one in sight.terms if one.power >= SURE]
    possible = [one for one in sight.terms if one.shots_needed is not None]
    more, never = len(possible) - len(shown), len(sight.terms) - len(possible)
    said = (f"{sight.shots} shots of this kind ({sight.level}) would show {len(shown)} of {len(sight.terms)} effects "
            "at their usual size, four times in five")
    said += f"; {more} more need more shots" if more else ""
    said += f"; {never} {'is' if never == 1 else 'are'} undetectable with any number of shots" if never else ""
    return f"{said}."


def why_not(one: TermIdentifiability, among: Catalogue | None = None) -> str:
    """Why no number of shots would show it, and what would."""
    term = as_catalogue(among).get(one.term)
    if term is not None and term.unseen:
        return term.unseen
    record = f"; record {term.record}" if term is not None and term.record else ""
    if one.why == TAKEN:
        return f"what it does, {', '.join(one.taken_by) or 'the fit'} would absorb{record}"
    varied = ", not always the same" if record else ""
    return f"nothing in these data depends on it{record}{varied}"


def sight_section(sight: Sight, opened: bool = False, among: Catalogue | None = None) -> str:
    """The summary, with picture and tables to unfold; or these opened, for where the summary stands already."""
    inner = picture(sight_png(sight, among), "shots needed for each effect",
                    "Full colour: fewer than these shots will do.")
    inner += _table(sight, among) + _never(sight, among) + _fitted(sight) + paragraph(METHOD, dim=True)
    if opened:
        return _alike(sight, among) + inner
    return (paragraph(sight_sentence(sight)) + _alike(sight, among)
            + f"<details><summary>Effect by effect</summary>{inner}</details>")


def make_sight_page(name: str, sight: Sight, among: Catalogue | None = None, origin: Origin = NO_ORIGIN) -> str:
    """HTML page of what data of the rig `name` could tell."""
    believed = ", ".join(plain(one, among) for one in sight.believed)
    return make_page(f"truearc identifiability: {name}", sight_sentence(sight), [
        ("Before any data", paragraph(f"Believed: {believed}. Tested: every other effect of the catalogue.")
         + sight_section(sight, True, among))], origin)


def _alike(sight: Sight, among: Catalogue | None) -> str:
    if not sight.classes:
        return ""
    items = "".join(f"<li>{html.escape(' = '.join(plain(one, among) for one in group))}</li>"
                    for group in sight.classes)
    return ("<p>While they are small, these are one and the same to these data, and only a measurement tells which:</p>"
            f"<ul>{items}</ul>")


def _table(sight: Sight, among: Catalogue | None) -> str:
    rows = [(plain(one.term, among), one.stage, size_of(one.term, one.usual, one.unit, among),
             size_of(one.term, one.smallest or 0.0, one.unit, among), f"{one.power:.0%}", _shots(one.shots_needed or 0),
             f"{one.share_left:.1%}", "" if one.like is None else f"{plain(one.like, among)} ({one.correlation:+.2f})")
            for one in sight.terms if one.shots_needed is not None]
    return table(("effect", "stage", "usual size", f"seen from, with {sight.shots} shots", "seen at usual size",
                  "shots needed", "left after the fit", "most alike"), rows)


def _never(sight: Sight, among: Catalogue | None) -> str:
    rows = [(plain(one.term, among), one.stage, why_not(one, among)) for one in sight.terms if one.shots_needed is None]
    return paragraph("No number of these shots would show:") + table(("effect", "stage", "why"), rows) if rows else ""


def _fitted(sight: Sight) -> str:
    rows = [(one.name, _uncertainty(one, one.before), _uncertainty(one, one.after)) for one in sight.fitted]
    return paragraph("Fitted anyway:") + table(("number", "uncertainty before", "after these shots"), rows)


def _uncertainty(one: Fittable, sd: float) -> str:
    """A standard deviation; of scatters, which are known by their logs, a factor."""
    if one.name.startswith("scatter."):
        return f"within a factor of {np.exp(sd):.2f}"
    return f"± {sd:.2g}" + ("" if one.unit == "1" else f" {one.unit}")
