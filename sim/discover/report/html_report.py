"""The report for a driver coach: verdict, where, what, what it is worth, what to do next; then the fine print."""

import html

import numpy as np
from matplotlib.figure import Figure

from truearc.sim.discover.detect.residuals import (
    Along,
    Residual,
    choose,
    covariates_in,
    evidence_after,
    find_along,
    halves,
    residuals_of,
    stage_of,
    stated_covariate,
)
from truearc.sim.discover.finding import Finding, Further
from truearc.sim.discover.investigate import Investigation
from truearc.sim.discover.model.prepared_data import Intake
from truearc.sim.discover.model.score_table import Array, ScoreTable
from truearc.sim.discover.plan.detectability import sight_of
from truearc.sim.discover.report.effect_wording import IN_FLIGHT, in_words, plain, say_effect
from truearc.sim.discover.report.finding_plots import field_png, flight_png, residual_figure
from truearc.sim.discover.report.finding_text import (
    STAGE_WORDS,
    THEN,
    besides,
    gained_interval,
    say_inseparable,
    say_step,
)
from truearc.sim.discover.report.identifiability_report import sight_section, sight_sentence
from truearc.sim.discover.select.selection_step import Step
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.report import make_page, make_png, paragraph, picture, table

STYLE = """<style>
.bars { display: grid; grid-template-columns: max-content 1fr; gap: .35rem .9rem; align-items: center; }
.bars .track { background: #8883; border-radius: .2rem; position: relative; height: 1.35rem; }
.bars .fill { background: #1f5fa8; border-radius: .2rem; height: 100%; } .bars .fill.rest { background: #8889; }
.bars .in { font-weight: 600; } .bars .fill.set { background: #c2571a; }
.bars .much { position: absolute; left: .5rem; top: 0; font-size: .85rem; line-height: 1.35rem; }
.bars .note { grid-column: 2; color: var(--dim); font-size: .88rem; margin: -.15rem 0 .3rem; }
details summary { cursor: pointer; color: var(--accent); } li { margin: .2rem 0; }
</style>"""
METHOD = (
    "How it was judged. The believed coefficients and the scatter of the launch were fitted, each shot's own "
    "deviation integrated out. Every test asks whether one more effect is there: an effect of the catalogue, or a "
    "free change of launch, distance or flight that goes with anything recorded, or with two such things together. "
    "What the fitted numbers could explain is taken out of its score first. The p-value is the chance that the "
    "strongest of all tests comes out as strong when the signs of the shots' scores are drawn at random. Names are "
    "ranked by refitting the simulation with each likely one; each has a prior on its size, and one that would have "
    "to be absurdly large loses to one that need not. Gains and curves are judged on shots that the fit had not seen "
    "(every fifth in turn).")
UNTESTED = (
    "Not tested: differences between balls (or sessions, where there are many) count as luck, since each may have its "
    "own; gravity is taken as known; with tracks the tracker's scale, tilt and clock are fitted always. What two or "
    "more effects do together is found one after another, three at most.")
MOSTLY = 0.97                         # of the improvement: then a region is no news
LEVELS = {"L0": "outcomes only", "L1": "outcomes with telemetry", "L2": "tracks of the flight"}


def make_report(name: str, investigation: Investigation) -> str:
    """HTML text of the answer about the dataset called `name`."""
    finding, among = investigation.finding, investigation.catalogue
    sections = [("", STYLE + _summary(finding, among))]
    if investigation.fitted is not None:
        sight = sight_of(investigation.fitted.evidence, finding.data.level, finding.data.believed)
        opened = finding.verdict == "none"
        shown = (paragraph(sight_sentence(sight)) if opened else "") + sight_section(sight, opened, among)
        sections.append((f"What these {finding.data.shots} shots could show", shown))
    sections += make_pictures(investigation)
    if finding.what:
        sections.append(("What it is", _names(finding, among)))
    if finding.fit is not None and finding.fit.gain_per_shot is not None:
        sections.append(("What it is worth, on shots that the fit had not seen", _worth(finding)))
    if finding.next:
        sections.append(("What to do next", "<ol>" + "".join(f"<li>{html.escape(_capital(say_step(step, among)))}</li>"
                                                              for step in finding.next) + "</ol>"))
    sections.append(("Fine print", _fine_print(finding)))
    return make_page(f"truearc discover: {name}", finding.sentence, sections)


def make_pictures(investigation: Investigation) -> list[tuple[str, str]]:
    """(heading, HTML) of where the effects are, one a step; of a dataset that carries no test none."""
    fitted, asked = investigation.fitted, investigation.asked
    if fitted is None or asked is None:
        return []
    along = covariates_in(asked)
    if not investigation.steps:
        found = "".join(_views(fitted.evidence, None, fitted.intake, along, None, ""))
        return [("Simulation and shots", found)] if found else []
    sections = []
    for step in investigation.steps:
        first = investigation.finding.where.covariate
        what = _said(step, investigation.catalogue)
        views = _views(step.fitted.evidence, evidence_after(step), fitted.intake, along,
                       find_along(stated_covariate(step, along, first), along), what, stage_of(step), step.base == ())
        if step.base == () and first in IN_FLIGHT:
            views = [views[1], views[0], *views[2:]]
        found = "".join(views)
        besides = "something without a name" if step.unknown else what
        heading = "Where it is" if step.base == () else f"Besides: {besides}"
        if found:
            sections.append((heading, (_where(investigation.finding) if step.base == () else "") + found))
    return sections


def plot_residuals(investigation: Investigation) -> Figure | None:
    """Draw what the shots did less what the simulation says, with and without the first effect found.

    None: nothing that was recorded varies, or the data carry no test.
    """
    fitted, asked = investigation.fitted, investigation.asked
    if fitted is None or asked is None:
        return None
    along, tracked = covariates_in(asked), fitted.intake.samples is not None
    if not investigation.steps:
        chosen = choose(residuals_of(fitted.evidence, None, tracked), along, fitted.evidence.rows, None)
        return None if chosen is None else residual_figure(*chosen, fitted.evidence.rows, "")
    step = investigation.steps[0]
    before = step.fitted.evidence
    stated = find_along(stated_covariate(step, along, investigation.finding.where.covariate), along)
    chosen = choose(residuals_of(before, evidence_after(step), tracked), along if stated is None else (stated,),
                    before.rows, stage_of(step))
    return None if chosen is None else residual_figure(*chosen, before.rows, _said(step, investigation.catalogue))


def _said(step: Step, among: Catalogue) -> str:
    return "the free curve" if step.unknown else plain(step.naming.leader, among)


def _views(before: ScoreTable, after: ScoreTable | None, intake: Intake, along: tuple[Along, ...], stated: Along | None,
           what: str, stage: str | None = None, field: bool = True) -> list[str]:
    """Pictures against the guilty covariate, along the flight, over the field; "" for those that there are none of."""
    residuals = residuals_of(before, after, intake.samples is not None)
    chosen = choose(residuals, along if stated is None else (stated,), before.rows, stage)
    if chosen is None:
        return ["", ""]
    residual, against = chosen
    after_words = "" if after is None else " Where that is right, the pattern is gone on the right."
    png_against = make_png(residual_figure(residual, against, before.rows, what))
    shown = [picture(png_against, f"{residual.name} against {against.name}",
                    f"What the real shots did less what the simulation says, in bins of {against.name}; bars are one "
                    f"standard error.{after_words}")]
    in_flight = residual.column is not None and before.columns[residual.column].stage == "flight"
    png = flight_png(before, after, what, halves(stated if in_flight else None, before.rows))
    shown.append("" if png is None else
                 picture(png, "missing acceleration along the flight",
                         "Acceleration that the simulation lacks, by time in flight, each shot's own launch left "
                         "free. Bars are one standard error."))
    return [*shown, _field(residual, intake, what)] if field else shown


def _field(residual: Residual, intake: Intake, what: str) -> str:
    """Over distance and elevation, or speed and elevation where no distance varies."""
    lanes = intake.lanes
    if np.asarray(lanes.free).all():
        return ""
    distance_m, speed = np.asarray(lanes.distance_m), np.asarray(lanes.rolling.speed_m_s)
    across: tuple[str, Array] = ("distance [m]", distance_m) if np.ptp(distance_m) > 0.0 else ("launch speed [m/s]",
                                                                                              speed)
    elevation = ("launch elevation [°]", np.degrees(np.asarray(lanes.rolling.elevation_rad)))
    png = field_png(residual, across, elevation, what)
    return "" if png is None else picture(png, "residual over the field", f"The same {residual.name}, by where and how "
                                          "steeply the shot was made. Numbers: the mean of a cell; colour: how many "
                                          "standard errors that is, so that pale ones may be luck. Cells with fewer "
                                          "than four shots are empty.")


def _summary(finding: Finding, among: Catalogue) -> str:
    data = finding.data
    lines = [f"{data.shots} shots, {LEVELS[data.level]} ({data.level}); believed: "
             f"{', '.join(plain(name, among) for name in data.believed)}."]
    where = finding.where
    if finding.mismatch.found and where.inseparable:
        lines.append(f"{_capital(say_inseparable(where))}.")
    if finding.next:
        lines.append(f"Next: {say_step(finding.next[0], among)}.")
    if data.left_out:
        lines.append(f"Left out: {'; '.join(data.left_out)}.")
    return "<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>"


def _where(finding: Finding) -> str:
    where = finding.where
    if not where.stage_probability:
        return ""
    ranked = sorted(where.stage_probability.items(), key=lambda item: -item[1])
    parts = [f"{STAGE_WORDS[stage]} ({p:.0%})" for stage, p in ranked if p >= 0.005]
    said = f"Where it happens: {', '.join(parts)}."
    if where.covariate:
        said += f" It goes with {in_words(where.covariate)}."
    if where.times_s:
        said += f" Along the flight most of it lies between {where.times_s[0]:.2f} and {_until(where.times_s[1])}."
    region = where.region
    if "low" in region and region["share_of_gain"] < MOSTLY:
        said += (f" {region['share_of_gain']:.0%} of the improvement comes from shots with "
                 f"{in_words(region['covariate'])} between {region['low']:.3g} and {region['high']:.3g}.")
    return paragraph(said)


def _until(time_s: float) -> str:
    return f"{time_s:.2f} s" if np.isfinite(time_s) else "the end"


def _names(finding: Finding, among: Catalogue) -> str:
    """Names with their probabilities as bars; members of the set in another colour."""
    members = set(finding.set or ())
    rows = [_bar(plain(one.term, among), one.probability, "set" if one.term in members else "", one.term in members,
                 _capital(say_effect(one.term, next(iter(one.parameters.values())), one.sentence, among)) + ".")
            for one in finding.what if one.probability >= 0.005 or one.term in members]
    rest = max(1.0 - sum(one.probability for one in finding.what), 0.0)
    rows.append(_bar("something without a name", rest, "rest", finding.verdict == "unknown", ""))
    said = f'<div class="bars">{"".join(rows)}</div>'
    if len(members) > 1:
        listed = _list([plain(name, among) for name in finding.set or ()])
        said = paragraph(f"These data cannot tell {listed} apart; together "
                         "they hold the orange bars.") + said
    return said + (_also(finding.also, among) if finding.also else "")


def _bar(name: str, probability: float, kind: str, bold: bool, note: str) -> str:
    below = f'<div class="note">{html.escape(note)}</div>' if note else ""
    return (f'<div class="{"in" if bold else ""}">{html.escape(name)}</div><div class="track"><div class="fill {kind}" '
            f'style="width:{100.0 * probability:.1f}%"></div><span class="much">{probability:.0%}</span></div>{below}')


def _also(also: tuple[Further, ...], among: Catalogue) -> str:
    return "".join(paragraph(besides(further, then, among).strip()) for further, then in zip(also, THEN, strict=False))


def _worth(finding: Finding) -> str:
    fit = finding.fit
    interval = None if fit is None else gained_interval(fit)
    if fit is None or interval is None:
        return ""
    rows = [("outcomes foretold, of 100", _times(fit.accuracy_before, 100.0), _times(fit.accuracy_after, 100.0)),
            (f"height error at the {fit.height_at}, rms [m]", fit.height_rmse_before_m, fit.height_rmse_after_m),
            ("log score a shot", fit.log_score_before, fit.log_score_after)]
    shown = [row for row in rows if row[1] is not None and row[2] is not None]
    return table((f"{fit.heldout_shots} shots", "as simulated", "corrected"), shown) + paragraph(
        f"The log score gains {fit.gain_per_shot:.4g} a shot (90 %: {interval[0]:.4g} to {interval[1]:.4g}); above 0 "
        "the corrected simulation is the better forecast.")


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _fine_print(finding: Finding) -> str:
    data, mismatch = finding.data, finding.mismatch
    fitted = [(name, value) for values in data.fitted.values() for name, value in values.items()]
    said = ""
    if mismatch.p_value is not None:
        families = ", ".join(f"{name} p = {p:.2g}" for name, p in mismatch.families.items())
        said += paragraph(f"{mismatch.tests_made} tests, alarm at {mismatch.false_alarm:g}; all together p = "
                          f"{mismatch.p_value:.2g} ({families}). What hangs together: {data.clusters['by']} "
                          f"({data.clusters['count']}).", dim=True)
    said += paragraph(METHOD, dim=True) + paragraph(UNTESTED, dim=True)
    if data.left_out:
        said += paragraph(f"Left out: {'; '.join(data.left_out)}.", dim=True)
    if fitted:
        said += table(("fitted", "value"), fitted)
    return said + (_tests(finding) if mismatch.tests else "")


def _tests(finding: Finding) -> str:
    rows = [(key, test.stage, test.direction, test.shape, test.statistic, test.p_value, test.amplitude, test.unit,
             test.log_gain) for key, test in finding.mismatch.tests.items()]
    return "<details><summary>The strongest tests</summary>" + table(
        ("test", "stage", "direction", "shape", "standard errors", "p in the family", "amplitude", "unit",
         "log-likelihood"), rows) + "</details>"


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
