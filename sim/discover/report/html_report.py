"""The report for a driver coach: verdict, where, what, what it is worth, what to do next; then the fine print."""

import html
from collections.abc import Iterable, Iterator
from importlib.resources import files

import numpy as np
from matplotlib.figure import Figure
from msgspec import UnsetType

from truearc.sim.discover.adopt import Investigation
from truearc.sim.discover.decide import form_of, gain_interval
from truearc.sim.discover.detect.covariates import IN_FLIGHT, CovariatePair
from truearc.sim.discover.detect.residuals import View, halves, views_of
from truearc.sim.discover.finding import FindingRecord
from truearc.sim.discover.plan.detectability import sight_of
from truearc.sim.discover.report import finding_text as wording
from truearc.sim.discover.report.effect_wording import in_words, plain, say_effect
from truearc.sim.discover.report.finding_plots import curve_png, field_png, flight_png, residual_figure
from truearc.sim.discover.report.identifiability_report import sight_section, sight_sentence
from truearc.sim.discover.select.name_effects import Step
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.metrics import POINTS_THREE
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.report import NO_ORIGIN, Origin, make_page, make_png, paragraph, picture, table

HERE = files("truearc.sim.discover.report")
STYLE = (HERE / "finding.css").read_text(encoding="utf-8")
FINE_PRINT = (HERE / "fine_print.txt").read_text(encoding="utf-8").split("\n\n")
MOSTLY = 0.97                         # of the improvement: then a region tells nothing new
BARS = ("A bar is the probability that this effect is among those left out. Several can be, so bars may add up to more "
        "than 100 %.")
LEVELS = {"L0": "outcomes only", "L1": "outcomes with telemetry", "L2": "tracks of the flight, or times at heights"}


def make_report(name: str, investigation: Investigation, origin: Origin = NO_ORIGIN) -> str:
    """HTML text of the answer about the dataset called `name`."""
    finding, among = investigation.finding, investigation.catalogue
    sections = [("", f"<style>\n{STYLE}</style>" + _summary(finding, among))]
    if investigation.fitted is not None:
        sight = sight_of(investigation.fitted.evidence, finding.data.level, finding.data.believed,
                         investigation.threshold if np.isfinite(investigation.threshold or np.inf) else None)
        opened = finding.verdict == "none"
        shown = (paragraph(sight_sentence(sight)) if opened else "") + sight_section(sight, opened, among)
        sections.append((f"What these {finding.data.shots} shots could show", shown))
    sections += make_pictures(investigation)
    if finding.what:
        sections.append(("What it is", _names(finding, among)))
    if finding.fit is not None and finding.fit.gain_per_shot is not None:
        sections.append(("What it is worth, on shots that the fit had not seen", _worth(finding)))
    if finding.next:
        sections.append(("What to do next", _listed("ol", [_capital(wording.say_step(step, among))
                                                           for step in finding.next])))
    sections.append(("Fine print", _fine_print(finding)))
    return make_page(f"truearc discover: {name}", finding.sentence, sections,
                     origin._replace(sha256=finding.data.sha256))


def make_pictures(investigation: Investigation) -> list[tuple[str, str]]:
    """(heading, HTML) of where the effects are, one per step; of a dataset that carries no test none."""
    first, sections = investigation.finding.where.covariate, []
    for view in _views(investigation, investigation.steps):
        what = _said(view.step, investigation.catalogue)
        shown = [_against(view, what), _along_flight(view, what)]
        if view.step is not None and view.step.unknown:
            shown.insert(0, _free_curve(view.step))
        if view.step is None:
            sections.append(("Simulation and shots", "".join([*shown, _field(view, investigation, what)])))
        elif view.step.base == ():
            shown = [*(reversed(shown) if first in IN_FLIGHT else shown), _field(view, investigation, what)]
            sections.append(("Where it is", _where(investigation.finding) + "".join(shown)))
        else:
            sections.append((f"Besides: {'an unexplained effect' if view.step.unknown else what}", "".join(shown)))
    return sections


def plot_residuals(investigation: Investigation) -> Figure | None:
    """Draw real shots less simulated ones, with and without the first effect found.

    None: nothing that was recorded varies, or the data carry no test.
    """
    view = next(_views(investigation, investigation.steps[:1]), None)
    return None if view is None else _figure(view, _said(view.step, investigation.catalogue))


def _views(investigation: Investigation, steps: tuple[Step, ...]) -> Iterator[View]:
    if investigation.fitted is None or investigation.asked is None:
        return iter(())
    return views_of(investigation.fitted, investigation.asked, steps, investigation.finding.where.covariate)


def _figure(view: View, what: str) -> Figure:
    return residual_figure(view.residual, view.against, view.before.rows, what)


def _said(step: Step | None, among: Catalogue) -> str:
    if step is None:
        return ""
    return "the free curve" if step.unknown else plain(step.naming.leader, among)


def _free_curve(step: Step) -> str:
    """The unexplained effect itself; "" where it is the same in all shots."""
    place = step.place
    png = None if place is None else curve_png(place)
    if place is None or png is None or place.test.what is None:
        return ""
    what = place.test.what
    sized = ("Colour: its size." if isinstance(what, CovariatePair) else "The band: 90 % by the likelihood.")
    return picture(png, f"free curve: {place.column.name} against {what.name}", "The free curve: the change of "
                   f"{place.column.name} over {in_words(what.name)} that fits all shots best, less its mean. {sized}")


def _against(view: View, what: str) -> str:
    """Against the covariate that the effect goes with."""
    after = "" if view.after is None else " Where that is right, the pattern is gone in the lower picture."
    return picture(make_png(_figure(view, what)), f"{view.residual.name} against {view.against.name}",
                   f"Real shots less simulated ones, in bins of {in_words(view.against.name)}. Bars are one standard "
                   f"error.{after}")


def _along_flight(view: View, what: str) -> str:
    """Along the flight; "" where no picture of it can be made."""
    in_flight = view.residual.column is not None and view.before.columns[view.residual.column].stage == "flight"
    png = flight_png(view.before, view.after, what, halves(view.stated if in_flight else None, view.before.rows))
    return picture(
        png, "missing acceleration along the flight", "Acceleration that the simulation lacks, by time in flight, each "
        "shot's own launch left free. Bars are one standard error.")


def _field(view: View, investigation: Investigation, what: str) -> str:
    """Over distance and elevation, or speed and elevation where no distance varies."""
    assert investigation.fitted is not None
    lanes = investigation.fitted.intake.lanes
    if np.asarray(lanes.free).all():
        return ""
    distance_m, speed = np.asarray(lanes.distance_m), np.asarray(lanes.rolling.speed_m_s)
    across: tuple[str, Array] = ("distance [m]", distance_m) if np.ptp(distance_m) > 0.0 else ("launch speed [m/s]",
                                                                                              speed)
    elevation = ("launch elevation [°]", np.degrees(np.asarray(lanes.rolling.elevation_rad)))
    png = field_png(view.residual, across, elevation, what)
    return picture(
        png, "residual over the field", f"The same {view.residual.name}, by where and how steeply the shot was made. "
        "Numbers: the mean of a cell; colour: how many standard errors that is, so that pale ones may be chance. Cells "
        "with fewer than four shots are empty.")


def _summary(finding: FindingRecord, among: Catalogue) -> str:
    data = finding.data
    lines = [f"{data.shots} shots, {LEVELS[data.level]} ({data.level}); believed: "
             f"{', '.join(plain(name, among) for name in data.believed)}."]
    where = finding.where
    if finding.mismatch.found and where.inseparable:
        lines.append(f"{_capital(wording.say_inseparable(where))}.")
    if finding.next:
        lines.append(f"Next: {wording.say_step(finding.next[0], among)}.")
    lines += [f"Not tested: {line}." for line in data.untested]
    if data.left_out:
        lines.append(f"Left out: {'; '.join(data.left_out)}.")
    return _listed("ul", lines)


def _listed(kind: str, lines: Iterable[str]) -> str:
    return f"<{kind}>{''.join(f'<li>{html.escape(line)}</li>' for line in lines)}</{kind}>"


def _where(finding: FindingRecord) -> str:
    where = finding.where
    if not where.stage_probability:
        return ""
    ranked = sorted(where.stage_probability.items(), key=lambda item: -item[1])
    parts = [f"{wording.STAGE_WORDS[stage]} ({p:.0%})" for stage, p in ranked if p >= 0.005]
    said = f"Where it happens: {', '.join(parts)}."
    if where.covariate:
        said += f" It goes with {in_words(where.covariate)}."
    if where.times_s:
        end = f"{where.times_s[1]:.2f} s" if np.isfinite(where.times_s[1]) else "the end"
        said += f" Along the flight most of it lies between {where.times_s[0]:.2f} and {end}."
    region = where.region
    if "low" in region and region["share_of_gain"] < MOSTLY:
        said += (f" {region['share_of_gain']:.0%} of the improvement comes from shots with "
                 f"{in_words(region['covariate'])} between {region['low']:.3g} and {region['high']:.3g}.")
    return paragraph(said)


def _names(finding: FindingRecord, among: Catalogue) -> str:
    """Names with their probabilities as bars; members of the set in another colour."""
    members = set(finding.set or ())
    rows = [_bar(plain(one.term, among), one.probability, "set" if one.term in members else "", one.term in members,
                 _capital(say_effect(one.term, next(iter(one.parameters.values())), one.sentence, among,
                             finding.data.topspin)) + ".")
            for one in finding.what if one.probability >= 0.005 or one.term in members]
    rest = finding.unexplained
    if not isinstance(rest, float):   # of an earlier version
        rest = max(1.0 - sum(one.probability for one in finding.what), 0.0)
    rows.append(_bar("an unexplained effect in their place", rest, "rest", finding.verdict == "unknown", ""))
    said = f'<div class="bars">{"".join(rows)}</div>'
    if len(members) > 1:
        listed = wording.either([plain(name, among) for name in finding.set or ()], "and")
        cannot = f"These data cannot tell {listed} apart (orange)."
        if form_of([one.probability for one in finding.what if one.term in members]) == "likely":
            cannot = f"In orange what cannot be excluded: {listed}."
        said = paragraph(cannot) + said
    sure = wording.say_how_sure(finding)
    said += paragraph(f"{BARS} {_capital(sure)}." if sure else BARS)
    return said + "".join(paragraph(wording.besides(further, then, among).strip())
                          for further, then in zip(finding.also, wording.THEN, strict=False))


def _bar(name: str, probability: float, kind: str, bold: bool, note: str) -> str:
    below = f'<div class="note">{html.escape(note)}</div>' if note else ""
    long = probability >= 0.5         # then the number stands in the bar, else right of it
    place = "left:.5rem" if long else f"left:calc({100.0 * probability:.1f}% + .4rem)"
    return (f'<div class="{"in" if bold else ""}">{html.escape(name)}</div><div class="track"><div class="fill {kind}" '
            f'style="width:{100.0 * probability:.1f}%"></div><span class="much{" on" if long else ""}" '
            f'style="{place}">{probability:.0%}</span></div>{below}')


def _worth(finding: FindingRecord) -> str:
    fit = finding.fit
    interval = None if fit is None else gain_interval(fit)
    if fit is None or interval is None:
        return ""
    rows = [("outcome accuracy [%]", _percent(fit.accuracy_before), _percent(fit.accuracy_after)),
            (f"height error at the {fit.height_at}, rms [m]", fit.height_rmse_before_m, fit.height_rmse_after_m),
            ("error to the side at the track end, rms [m]", fit.side_rmse_before_m or None,
             fit.side_rmse_after_m or None),
            ("log score per shot", fit.log_score_before, fit.log_score_after)]
    shown = [row for row in rows if row[1] is not None and row[2] is not None]
    return table((f"{fit.heldout_shots} shots", "as simulated", "corrected"), shown) + paragraph(
        f"The log score gains {fit.gain_per_shot:.4g} per shot (90 %: {interval[0]:.4g} to {interval[1]:.4g}); above 0 "
        "the corrected simulation is the better forecast.") + _points(finding)


def _points(finding: FindingRecord) -> str:
    """Points by what was believed and by what was found."""
    worth = finding.adoption
    if isinstance(worth, UnsetType):
        return ""
    rows = [("points per ball, had each shot been aimed by it", worth.aimed_before, worth.aimed_after),
            ("shots as made that its gate lets through [%]", _percent(worth.fired_before), _percent(worth.fired_after)),
            ("points per ball of these", worth.scored_before, worth.scored_after)]
    return table((f"{worth.shots} shots", "as simulated", "corrected"), rows) + paragraph(
        _capital(wording.say_points(worth)) + f". A ball that the gate holds counts "
        f"{POINTS_THREE * worth.threshold:.1f} points: three times the least P(three) for which it fires "
        f"({worth.threshold:g}).")


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _fine_print(finding: FindingRecord) -> str:
    data, mismatch = finding.data, finding.mismatch
    fitted = [(name, value) for values in data.fitted.values() for name, value in values.items()]
    said, by = "", f"{data.clusters['by']} ({data.clusters['count']})"
    if mismatch.p_value is not None:
        families = ", ".join(f"{name} p = {p:.2g}" for name, p in mismatch.families.items())
        said += paragraph(f"{mismatch.tests_made} tests, alarm at {mismatch.false_alarm:g}; all together p = "
                          f"{mismatch.p_value:.2g}, each family alone: {families}. Signs are drawn for each {by}.",
                          dim=True)
    said += "".join(paragraph(" ".join(text.split()), dim=True) for text in FINE_PRINT)
    if fitted:
        said += table(("fitted without it" if mismatch.found else "fitted", "value"), fitted)
    return said + (_tests(finding) if mismatch.tests else "")


def _tests(finding: FindingRecord) -> str:
    rows = [(key, test.stage, test.direction, test.shape, test.statistic, test.p_value, test.amplitude, test.unit,
             test.log_gain) for key, test in finding.mismatch.tests.items()]
    return "<details><summary>The strongest tests</summary>" + table(
        ("test", "stage", "direction", "shape", "standard errors", "p in the family", "amplitude", "unit",
         "log-likelihood"), rows) + "</details>"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
