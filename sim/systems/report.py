"""The words and pictures of a finding on a system."""

import html
import inspect
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from msgspec import UnsetType

from truearc.sim.discover.decide import Step, form_of, gain_interval
from truearc.sim.discover.finding import FoundEffect, Named
from truearc.sim.discover.identifiability import Sight, TermIdentifiability
from truearc.sim.discover.report.finding_text import either, say_chance
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.printed import make_text
from truearc.sim.report import (
    AFTER,
    BEFORE,
    GREY,
    INK,
    NO_ORIGIN,
    PHONE_IN,
    Origin,
    make_page,
    new_panels,
    paragraph,
    picture,
    table,
)
from truearc.sim.systems.discovery import (
    Intervals,
    SystemFitted,
    SystemInvestigation,
    forecast_errors,
    goes_with,
    inseparable,
)
from truearc.sim.systems.score_table import SystemModel
from truearc.sim.systems.system import SystemSpec

SHOWN = 6                             # candidates that a sentence or a table lists; chosen: a line
CURVE = 200                           # points of a picture's curve


def size(one: Named) -> str:
    """Return an effect's size with its 90 % interval."""
    value, low, high = (quantity(at, one.size.unit) for at in (one.size.value, one.size.low90, one.size.high90))
    return f"{value} (90 %: {low} to {high})"


def quantity(value: float, unit: str) -> str:
    """Return an amount with its sign and unit; that of a user's own numbers is the user's."""
    return f"{100.0 * value:+.3g} %" if unit == "1" else f"{value:+.3g}" + ("" if unit == "unit" else f" {unit}")


def sentence(found: SystemInvestigation) -> str:
    """Return the verdict in words: the effect and its size, what it gains, and how likely chance is."""
    finding = found.finding
    p_value = finding.mismatch.p_value
    assert p_value is not None
    if finding.verdict == "none":
        return (f"No mismatch: {finding.data.shots} runs differ from the simulator by no more than chance. If nothing "
                f"were missing, {say_chance(p_value)} (p = {p_value:.2g}, alarm at {finding.mismatch.false_alarm:g})."
                + smallest(found.sight, found.model))
    leading = FoundEffect(finding.what, finding.set, finding.unknown, finding.unexplained, finding.withheld)
    said = [f"The simulator leaves something out{say_effect(leading, found.steps[0])}"]
    for one, step in zip(finding.also, found.steps[1:], strict=True):
        said.append(f"With that in it, something more is missing{say_effect(one, step)}")
    return " ".join([*said, *gained(found),
                     f"If nothing were missing, {say_chance(p_value)} (p = {p_value:.2g}, adjusted for all tests)."])


def say_effect(one: FoundEffect, step: Step) -> str:
    """Return an effect, after a colon, with a full stop."""
    label = step.fitted.model.label_of
    if one.set is None:
        changed, follows = goes_with(step)
        goes = f": {changed}" + (f", which goes with {follows}" if follows and follows not in changed else "")
        why = f"; {one.withheld}" if not isinstance(one.withheld, UnsetType) else ""
        return f" that no candidate explains{why}{goes if changed else ''}."
    members = [name for name in one.what if name.term in one.set]
    leader: SystemFitted | None = step.naming.refits.get(members[0].term)
    sized = size(members[0]) + ("" if leader is None else leader.model.shape_of(members[0].term, leader.point))
    if len(one.set) == 1:
        return f": {label(members[0].term)}: {sized}."
    form = form_of([name.probability for name in members] + [0.0] * (len(one.set) - len(members)))
    listed = either([f"{label(name.term)} ({name.probability:.0%})" for name in members[:SHOWN]],
                    "and" if form == "both" else "or")
    more = f", or one of {len(one.set) - SHOWN} others" if len(one.set) > SHOWN else ""
    return (f": {listed}{more}. These runs cannot tell which of these it is. If it is the first, its size is "
            f"{sized}.")


def gained(found: SystemInvestigation) -> list[str]:
    """Return what the better simulator forecasts, in a sentence."""
    fit = found.finding.fit
    interval = None if fit is None else gain_interval(fit)
    if found.more is None or interval is None or found.fitted is None:
        return []
    before, after = forecast_errors(found.fitted), forecast_errors(found.more)
    parts = [f"{name} within {after[name]:.3g} instead of {before[name]:.3g}" for name in before]
    return [f"Runs left out are forecast {' and '.join(parts)} (RMS, from their first sample; log score per run "
            f"{interval[0]:+.3g} to {interval[1]:+.3g}, 90 %)."]


def smallest(sight: Sight | None, model: SystemModel) -> str:
    """Return the smallest effects that the runs would have shown, four times in five."""
    terms = [] if sight is None else sorted((one for one in sight.terms if one.smallest is not None),
                                            key=lambda one: (one.smallest or 0.0) / one.usual)
    if not terms:
        return ""
    listed = "; ".join(f"{model.label_of(one.term)} of {amount(one)}" for one in terms[:SHOWN])
    return f" Smallest effects that they would have shown, four times in five: {listed}."


def amount(one: TermIdentifiability) -> str:
    """Return the smallest size that is seen."""
    return quantity(one.smallest or 0.0, one.unit).removeprefix("+")


def lines(found: SystemInvestigation) -> list[str]:
    """Return the report on a terminal."""
    finding = found.finding
    said = [finding.sentence]
    if found.fitted is None:
        return [*said, *(f"note: {line}" for line in finding.data.notes)]
    clusters = finding.data.clusters
    said.append(f"{finding.data.shots} rows ({clusters['by']}s), {finding.mismatch.tests_made} tests")
    fitted = finding.data.fitted["all"]
    without = "fitted without it" if finding.mismatch.found else "fitted"
    said.append(f"{without}: " + ", ".join(f"{name} {value:.4g}" for name, value in fitted.items()
                                           if not name.startswith("scatter.")))
    if finding.what:
        said.append("names: " + ", ".join(f"{one.term} {one.probability:.0%}" for one in finding.what[:SHOWN]
                                          if one.probability >= 0.005))
    said += [f"next: {say_step(step)}" for step in finding.next]
    if found.refused:
        said.append(f"not adopted: {found.refused}")
    return said + [f"note: {line}" for line in finding.data.notes]


def say_step(step: dict[str, object]) -> str:
    """Return a planned step in words."""
    names = step["separates"]
    assert isinstance(names, list)
    return (f"{step['runs']} runs with {step['condition']} {step['value']:.3g}, to tell {' from '.join(names)}")


def fit_lines(intervals: Intervals) -> list[str]:
    """Return the report of a fit."""
    fitted = intervals.fitted
    model: SystemModel = fitted.model
    rows = [(name, f"{value:.5g}", f"{low:.5g}", f"{high:.5g}") for name, value, low, high in intervals.rows]
    said = make_text(("parameter", "value", "low90", "high90"), rows, (1, 2, 3))
    said += [f"{first} and {second} cannot be told apart by these runs (correlation {correlation:+.3f})"
             for first, second, correlation in inseparable(fitted)]
    errors = ", ".join(f"{name} {value:.3g}" for name, value in intervals.errors.items())
    said.append(f"runs left out are forecast from their first sample with an RMS error of {errors}")
    if not fitted.settled:
        said.append("warning: the fit did not settle")
    said.append("a fit that has converged may still be wrong: ta.discover tests the structure")
    return said + [f"note: {line}" for line in model.recording.notes]


def sight_lines(sight: Sight, model: SystemModel) -> list[str]:
    """Return what runs could show, line by line."""
    seen = [one for one in sight.terms if one.smallest is not None]
    said = [f"{len(seen)} of {len(sight.terms)} candidates could be seen with {sight.shots} rows"]
    rows = [(one.term, f"{one.power:.0%}", amount(one), one.like or "", f"{one.correlation:+.2f}") for one in seen]
    said += make_text(("candidate", "power", "smallest", "most like", "corr."), rows, (1, 2, 4))
    for one in sight.terms:
        if one.why is not None:
            taken = (f"taken up by {', '.join(one.taken_by)}" if one.taken_by else
                     "nothing that is observed depends on it")
            said.append(f"never: {model.label_of(one.term)}: {taken}")
    return said


# --- the page


def page(name: str, found: SystemInvestigation, origin: Origin = NO_ORIGIN) -> str:
    """Return the report as one HTML page."""
    finding, sections = found.finding, []
    if found.fitted is not None:
        shown = picture(flights_figure(found), "recorded and simulated", "One run: recorded (dots), believed (blue)"
                        f"{' and with what was found (orange)' * (found.more is not None)}.")
        if (figure := curve_figure(found)) is not None:
            shown += picture(figure, "the missing push along a value", "What is missing; ticks: recorded values.")
        sections.append(("", f'<div class="pair">{shown}</div>'))
        names = [(found.model.label_of(one.term), f"{one.probability:.0%}", f"{one.size.value:.3g} (90 %: "
                  f"{one.size.low90:.3g} to {one.size.high90:.3g})", one.term) for one in finding.what]
        head, more = ("in words", "probability", "size", "name"), names[SHOWN:]
        likely = table(head, names[:SHOWN]) if names else paragraph("No candidate is needed.")
        sections.append(("What it may be", likely + (_folded(f"{len(more)} more", table(head, more)) if more else "")))
        rows = Intervals.of(found.fitted).rows
        sections.append(("Tests, numbers and limits", _folded(
            "Fitted without it" if finding.mismatch.found else "Fitted", table(
                ("parameter", "value", "low 90 %", "high 90 %"),
                [(key, f"{a:.5g}", f"{b:.5g}", f"{c:.5g}") for key, a, b, c in rows])) + _folded(
            "Tests", table(("test", "statistic", "p alone", "p of all", "amplitude"), [
                (key, f"{one.statistic:.2f}", f"{one.p_alone:.2g}", f"{one.p_value:.2g}", f"{one.amplitude:.3g}")
                for key, one in finding.mismatch.tests.items()]))))
    sections.append(("", _folded("Notes", "".join(paragraph(line) for line in lines(found)[1:]))))
    if text := source_of(found.system):
        sections.append(("", _folded("The simulator", f"<pre>{html.escape(text)}</pre>")))
    return make_page(name, finding.sentence, sections, origin)


def _folded(summary: str, body: str) -> str:
    return f"<details><summary>{summary}</summary>{body}</details>"


def source_of(system: SystemSpec) -> str:
    """Return the text of the simulator; "" if there is none."""
    try:
        return inspect.getsource(system.rate or system.simulate_run or SystemSpec)
    except (OSError, TypeError):
        return ""


def flights_figure(found: SystemInvestigation) -> Figure:
    """The row that gains most: recorded, believed simulator, better one."""
    assert found.fitted is not None
    model, recording = found.model, found.model.recording
    row, fits = 0, [("believed", found.fitted.without_terms(), BEFORE)]
    if found.more is not None:
        gain = found.more.without_terms().scores.log_score - found.fitted.scores.log_score
        row = int(np.argmax(gain))
        fits.append(("with it", found.more.without_terms(), AFTER))
    outputs = list(model.system.outputs)
    figure, panels = new_panels(PHONE_IN, 1.5 * len(outputs) + 0.6, len(outputs), sharex=True)
    there = recording.real[row]
    time_s = recording.time_s[row, there]
    for k, (name, axes) in enumerate(zip(outputs, panels, strict=True)):
        axes.plot(time_s, recording.seen[row, there, k], ".", color=INK, markersize=2.5, label="recorded")
        for label, fit, colour in fits:
            axes.plot(time_s, _flown(fit)[row, there, k], color=colour, linewidth=1.5, label=label,
                      linestyle="--" if colour == BEFORE else "-")
        axes.set_ylabel(name)
    panels[0].legend(frameon=False, loc="best", fontsize=8)
    panels[0].set_title(f"run {recording.labels[row]}", fontsize=9, loc="left")
    panels[-1].set_xlabel("t [s]")
    return figure


def _flown(fitted: SystemFitted) -> Float[Array, "R T O"]:
    model: SystemModel = fitted.model
    return model.flights(fitted.point)


def curve_figure(found: SystemInvestigation) -> Figure | None:
    """The push along what it goes with, if a push was found."""
    if found.more is None or found.refused:
        return None
    better = found.adopt()
    pushes = [(one, prior) for one, prior in better.found if one.push is not None and one.push.times < 0]
    if not pushes:
        return None
    model = found.model
    values = model.sources(found.more.model._states(found.more.point)[0])
    figure, panels = new_panels(PHONE_IN, 1.8 * len(pushes), len(pushes))
    for axes, (one, prior) in zip(panels, pushes, strict=True):
        assert one.push is not None
        seen = values[one.push.reads][model.recording.real]
        low, high = np.percentile(seen, [1.0, 99.0]).tolist()
        grid = np.linspace(low, high, CURVE)
        height = prior.centre * one.push.law(grid, *one.numbers())
        axes.plot(grid, height, color=AFTER)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        names: Sequence[str] = [*model.system.state, *model.names]
        axes.set_xlabel(names[one.push.reads])
        axes.set_ylabel(f"push on {names[one.push.rate]}")
        axes.plot(seen[::max(len(seen) // 300, 1)], np.full(len(seen[::max(len(seen) // 300, 1)]), axes.get_ylim()[0]),
                  "|", color=GREY, markersize=6)
    return figure
