"""The demo's answer on one screen, and its page with three pictures that a phone can show."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from truearc.cli.start.demo_acts import Act
from truearc.cli.start.demo_effects import NOTHING, Envelope
from truearc.sim.discover.report.finding_text import either, plain, size_of
from truearc.sim.plots import COLOURS
from truearc.sim.report import PHONE_IN, Origin, make_page, make_png, new_panels, paragraph, picture, table
from truearc.sim.tables import make_text

HEAD = ("", "what was wrong", "what the robot found", "threes", "points per ball")
SEEN = "Of their usual size"          # what a finding of nothing says of the effects that it could not have shown
LISTED = 3                            # names in a row
MARKS = {("three", ""): "o", ("two", ""): "o", ("two", "low"): "v", ("two", "high"): "^", ("miss", "low"): "v",
         ("miss", "high"): "^"}
BEFORE, AFTER = "#9aa3af", "#1f5fa8"
Acts = Mapping[str, Act]              # practice, event, control


def answer(acts: Acts, effect: str) -> list[str]:
    """A table: what was wrong, what was found with its size, and what that was worth."""
    return make_text(HEAD, _rows(acts, effect))


def _rows(acts: Acts, effect: str) -> list[Sequence[str]]:
    wrong = ("the paper's physics has no wheel slip", effect, NOTHING.name)
    return [(name, why, _found(act), f"{act.volleys[0].threes} to {act.volleys[1].threes} of {act.volleys[1].balls}",
             " to ".join(f"{one.per_ball:.2f}" for one in act.volleys))
            for (name, act), why in zip(acts.items(), wrong, strict=True)]


def _found(act: Act) -> str:
    """Names, the likeliest first, with its size; since practice, where it was believed then."""
    best = act.finding.best
    if best is None:
        return "something that no term explains" if act.finding.verdict == "unknown" else "nothing"
    more = [plain(one.term) for one in act.finding.alternatives]
    others = [*more[:LISTED - 1], *([f"{len(more) - LISTED + 1} more"] if len(more) >= LISTED else [])]
    return (f"{plain(best.term)} {size_of(best.term, best.value - (best.believed or 0.0), best.unit)}"
            + (f"; or {either(others)}" if others else ""))


def say_limits(event: Act, control: Act) -> str:
    """One line on what the marked shots cannot tell apart, and what they could not have shown."""
    alike = [plain(one.term) for one in (*event.finding.effects[:1], *event.finding.alternatives)]
    blind = control.finding.sentence.partition(SEEN)[2].partition(" To see")[0]
    line = f"These marks cannot tell {either(alike[:LISTED + 1], 'from')}. " if len(alike) > 1 else ""
    return line + (f"{SEEN}{blind}" if blind else "") or "Marks do not show in which part a difference arises."


def save_page(folder: Path, acts: Acts, envelope: Envelope, origin: Origin) -> Path:
    """Write index.html; returns its path."""
    effect, event = envelope.effect.name, acts["event"]
    before, after = (one.per_ball for one in event.volleys)
    verdict = (f"At the event something had changed that no sensor saw ({effect}): {before:.2f} points per ball, and "
               f"{after:.2f} once the robot had aimed again after {len(event.shots.shots)} marked shots.")
    aim = event.aims[1].plot()
    aim.set_size_inches(PHONE_IN, 1.5 * PHONE_IN)
    sections = [
        ("What it was worth", picture(make_png(_draw_worth(acts)), "points per ball before and after")),
        ("What the marks showed", picture(make_png(_draw_marks(event)), "outcomes of the marked shots")),
        ("The aim after that", picture(make_png(aim), "hood, motor speed and chances over distance")),
        ("In numbers", table(HEAD, _rows(acts, effect)) + paragraph(say_limits(event, acts["control"]))),
        ("What was found", "".join(paragraph(f"{name}: {act.finding.sentence}")
                                   + f'<p><a href="{name}.html">all of it</a></p>' for name, act in acts.items())),
        ("Fine print", paragraph(
            "All balls were shot by the emulated robot: a part of practice through its runtime, images and CAN frames, "
            "the rest by the same MuJoCo world without them. Before and after are the same balls from the same places. "
            f"Envelope: {envelope.text}; SHA-256 {envelope.sha256}.", dim=True))]
    page = folder / "index.html"
    page.write_text(make_page("truearc demo", verdict, sections, origin), encoding="utf-8")
    return page


def _draw_worth(acts: Acts) -> Figure:
    figure, (axes,) = new_panels(PHONE_IN, 3.4)
    for row, act in enumerate(acts.values()):
        for shift, volley, colour in zip((-0.2, 0.2), act.volleys, (BEFORE, AFTER), strict=True):
            axes.barh(row + shift, volley.per_ball, color=colour, height=0.38)
            axes.text(volley.per_ball - 0.05, row + shift, f"{volley.per_ball:.2f}", va="center", ha="right",
                      color="white", weight="bold")
    axes.set_yticks(range(len(acts)), acts)
    axes.set(xlim=(0.0, 3.0), ylim=(2.6, -0.6), xlabel="points per ball: before (grey), after (blue)")
    return figure


def _draw_marks(act: Act) -> Figure:
    figure, (axes,) = new_panels(PHONE_IN, 3.8)
    shots = act.shots.shots
    marks = list(zip(shots.text("outcome"), shots.text("side"), strict=True))
    for mark, marker in MARKS.items():
        rows = [row for row, one in enumerate(marks) if one == mark]
        if not rows:
            continue
        axes.scatter(shots.number("distance_m")[rows], shots.number("hood_deg")[rows], color=COLOURS[mark[0]],
                     marker=marker, label=f"{' '.join(filter(None, mark))}: {len(rows)}")
    axes.set(xlabel="distance, m", ylabel="hood, deg")
    axes.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure
