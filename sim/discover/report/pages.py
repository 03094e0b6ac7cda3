"""Pages and terminal text that report a finding, identifiability, or a plan of further shots."""

import html
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from msgspec import UnsetType

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.decide import Step, form_of, gain_interval
from truearc.sim.discover.detect.covariates import IN_FLIGHT, CovariatePair
from truearc.sim.discover.finding import FindingRecord
from truearc.sim.discover.identifiability import POWER, TAKEN, Fittable, Sight, TermIdentifiability, sight_of
from truearc.sim.discover.investigate import Investigation
from truearc.sim.discover.next_steps import MOST_RANDOM, Block, Design
from truearc.sim.discover.report import finding_text as wording
from truearc.sim.discover.report import pictures
from truearc.sim.discover.report import story as stories
from truearc.sim.discover.report.finding_text import WORDING, in_words, list_believed, plain, size_of
from truearc.sim.discover.report.pictures import View, flight_png, halves, residual_figure, sight_png, views_of
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.catalogue import Catalogue, as_catalogue, find_terms
from truearc.sim.printed import make_text
from truearc.sim.report import NO_ORIGIN, Origin, make_page, make_png, paragraph, picture, table
from truearc.sim.statistics import POINTS_THREE

MOST_SHOTS = 10_000                   # beyond which the number is no longer said
NEXT = 4                              # effects beyond what is shown that a summary lists
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
    lines += make_text(head, [_row(one, among) for one in sight.terms if one.shots_needed is not None], right=(3, 4))
    lines += ["", *(f"one and the same to these data, while small: {', '.join(group)}" for group in sight.classes)]
    lines += [f"never seen: {one.term}: {why_not(one, among)}" for one in sight.terms if one.shots_needed is None]
    lines.append("fitted anyway: " + ", ".join(f"{one.name} {_uncertainty(one, one.after)}" for one in sight.fitted))
    return lines


def sight_summary(sight: Sight, among: Catalogue | None = None) -> list[str]:
    """What these shots would show, and which effects the next few shots would add, in three lines at most."""
    possible = sorted((one.shots_needed, one.term, one.power) for one in sight.terms if one.shots_needed is not None)
    shown = [plain(term, among) for _, term, power in possible if power >= POWER]
    more = [f"{plain(term, among)} ({_shots(needed)})" for needed, term, power in possible if power < POWER]
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
    shown = [one for one in sight.terms if one.power >= POWER]
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
    believed = list_believed(sight.believed, among)
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


SCHEMA = "truearc.design/1"
# How a shot must be like the one it is named after, where a name that competes follows a circumstance.
AS_THEN: dict[str, str] = WORDING["as_then"]
# Chosen: above the chance of its draws
LEAST_GAIN = 0.01                     # probability by which a plan must raise that of one name that stands alone
SETTINGS = ("distance_m", "hood_deg", "motor_ratio", "exit_speed_m_s", "exit_deg")


def design_table(design: Design, dataset: Dataset, step: Step, among: Catalogue | None = None) -> dict[str, Any]:
    """Return the plan as plain values, without schema and verdict; `next` as in truearc.finding/1."""
    names = [name.partition(".")[0] for name in design.names]
    rows = step.fitted.scores.rows
    shoot = [{"do": "shoot", **_settings(dataset.shots, int(rows[block.row]), block.pace), "shots": block.shots,
              "separates": names}
             for block in _together(design.blocks)]
    measure = [{"do": "measure", "instrument": one.instrument.id, "what": one.instrument.what,
                "separates": list(one.terms), "probability": one.probability}
               for one in design.measurements if not (one.instrument.filmed and dataset.tracks is not None)]
    follow = [term.follows for term in find_terms(names, among)]
    return {"names": dict(zip(names, map(float, design.probability), strict=True)),
            "as_then": [AS_THEN[one] for one in dict.fromkeys(follow) if one in AS_THEN],
            "probability_before": design.before, "probability_after": design.after,
            "random_shots_worth_as_much": design.random, "next": shoot + measure}


def design_lines(table: dict[str, Any], among: Catalogue | None = None) -> list[str]:
    """Return the plan as text, line by line."""
    names = ", ".join(f"{plain(name, among)} ({share:.0%})" for name, share in table["names"].items())
    shoot = [one for one in table["next"] if one["do"] == "shoot"]
    total = sum(one["shots"] for one in shoot)
    lines = [f"To tell apart: {names}."]
    for one in shoot:
        where = ", ".join(f"{name} {value:.4g}" for name, value in one.items() if name in SETTINGS)
        pace = one.get("pace", 1.0)
        wheels = "" if pace == 1.0 else f", wheels {abs(pace - 1.0):.0%} {'faster' if pace > 1.0 else 'slower'}"
        lines.append(f"  {one['shots']:4d} shots at {where} (as shot {one['like']}{wheels})")
    if table["as_then"]:
        lines.append(f"As then also with {', '.join(table['as_then'])}: a name that is left follows that.")
    random = table["random_shots_worth_as_much"]
    worth = f"more than {MOST_RANDOM} times as many as there are" if random is None else f"{random}"
    before, after = table["probability_before"], table["probability_after"]
    if after < before + LEAST_GAIN:
        lines.append(f"Such shots hardly help, if one of these it is: the right one stands alone (95 % sure) with a "
                     f"probability of {before:.0%} now.")
        return lines + _measurements(table, before)
    lines.append(f"After these {total} shots the right one stands alone (95 % sure) with a probability of "
                 f"{after:.0%}, now {before:.0%}; of shots like the present "
                 f"ones it would take {worth} to part them as well.")
    return lines + _measurements(table, before)


def _measurements(table: dict[str, Any], before: float) -> list[str]:
    """Those that part the names better than the present shots do."""
    return [f"Or measure {one['what']}: {one['probability']:.0%}." for one in table["next"]
            if one["do"] == "measure" and one["probability"] > before]


def _together(blocks: tuple[Block, ...]) -> list[Block]:
    """Blocks of one configuration as one."""
    return [replace(block, shots=block.shots * count) for block, count in Counter(blocks).items()]


def _settings(shots: Shots, row: int, pace: float) -> dict[str, Any]:
    wheels = [name for name in shots.numbers if name.startswith("wheel_") and name.endswith("_rad_s")]
    driven = {"motor_ratio", "exit_speed_m_s", *wheels}
    known = {name: float(shots.number(name)[row]) * (pace if name in driven else 1.0) for name in (*SETTINGS, *wheels)}
    like = {"like": shots.shot_id[row], **({} if pace == 1.0 else {"pace": pace})}
    return {**like, **{name: round(value, 4) for name, value in known.items() if value == value}}


HERE = files("truearc.sim.discover.report")
STYLE = (HERE / "finding.css").read_text(encoding="utf-8")
FINE_PRINT = (HERE / "fine_print.txt").read_text(encoding="utf-8").split("\n\n")
BARS = ("A bar is the probability that this effect is among those left out. Several can be, so bars may add up to more "
        "than 100 %.")
LEVELS = {"L0": "outcomes only", "L1": "outcomes with telemetry", "L2": "tracks of the flight, or times at heights"}


def make_report(name: str, investigation: Investigation, origin: Origin = NO_ORIGIN) -> str:
    """HTML text of the answer about the dataset called `name`."""
    finding, among = investigation.finding, investigation.catalogue
    sections = [("", f"<style>\n{STYLE}</style>" + _summary(finding, among))]
    if investigation.fitted is not None:
        sight = sight_of(investigation.fitted.scores, finding.data.level, finding.data.believed,
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
    return None if view is None else residual_figure(
        view.residual, view.against, view.before.rows, _said(view.step, investigation.catalogue))


def _views(investigation: Investigation, steps: tuple[Step, ...]) -> Iterator[View]:
    if investigation.fitted is None or investigation.asked is None:
        return iter(())
    return views_of(investigation.fitted, investigation.asked, steps, investigation.finding.where.covariate)


def _said(step: Step | None, among: Catalogue) -> str:
    if step is None:
        return ""
    return "the free curve" if step.unknown else plain(step.naming.leader, among)


def _free_curve(step: Step) -> str:
    """The unexplained effect itself; "" where it is the same in all shots."""
    place = step.place
    png = None if place is None else pictures.curve_png(place)
    if place is None or png is None or place.test.what is None:
        return ""
    what = place.test.what
    sized = ("Colour: its size." if isinstance(what, CovariatePair) else "The band: 90 % by the likelihood.")
    return picture(png, f"free curve: {place.column.name} against {what.name}", "The free curve: the change of "
                   f"{place.column.name} over {in_words(what.name)} that fits all shots best, less its mean. {sized}")


def _against(view: View, what: str) -> str:
    """Against the covariate that the effect goes with."""
    after = "" if view.after is None else " Where that is right, the pattern is gone in the lower picture."
    png = make_png(residual_figure(view.residual, view.against, view.before.rows, what))
    return picture(png, f"{view.residual.name} against {view.against.name}",
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
    lanes = investigation.fitted.model.data.lanes
    if np.asarray(lanes.free).all():
        return ""
    distance_m, speed = np.asarray(lanes.distance_m), np.asarray(lanes.rolling.speed_m_s)
    across: tuple[str, Array] = ("distance [m]", distance_m) if np.ptp(distance_m) > 0.0 else ("launch speed [m/s]",
                                                                                              speed)
    elevation = ("launch elevation [°]", np.degrees(np.asarray(lanes.rolling.elevation_rad)))
    png = pictures.field_png(view.residual, across, elevation, what)
    return picture(
        png, "residual over the field", f"The same {view.residual.name}, by where and how steeply the shot was made. "
        "Numbers: the mean of a cell; colour: how many standard errors that is, so that pale ones may be chance. Cells "
        "with fewer than four shots are empty.")


def _summary(finding: FindingRecord, among: Catalogue) -> str:
    data = finding.data
    lines = [f"{data.shots} shots, {LEVELS[data.level]} ({data.level}); believed: "
             f"{list_believed(data.believed, among)}."]
    where = finding.where
    if finding.mismatch.found and where.inseparable:
        lines.append(f"{_capital(wording.say_inseparable(where))}.")
    if finding.next:
        lines.append(f"Next: {wording.say_step(finding.next[0], among)}.")
    lines += [f"Note: {line}." for line in data.notes] + [f"Not tested: {line}." for line in data.untested]
    if data.left_out:
        lines.append(f"Left out: {'; '.join(data.left_out)}.")
    return _listed("ul", lines)


def _listed(kind: str, lines: Iterable[str]) -> str:
    return f"<{kind}>{''.join(f'<li>{html.escape(line)}</li>' for line in lines)}</{kind}>"


def _where(finding: FindingRecord) -> str:
    return paragraph(stories.say_where(finding.where))


def _names(finding: FindingRecord, among: Catalogue) -> str:
    """Names with their probabilities as bars; members of the set in another colour."""
    members = set(finding.set or ())
    rows = [_bar(plain(one.term, among), one.probability, "set" if one.term in members else "", one.term in members,
                 _capital(wording.say_name(one, among, finding.data.topspin)) + ".")
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
    sure = stories.say_how_sure(finding)
    said += paragraph(f"{BARS} {_capital(sure)}." if sure else BARS)
    return said + "".join(map(paragraph, finding.told.also))


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
    hits, least = (POINTS_THREE, "three times the least P(three)") if isinstance(worth.hit_points, UnsetType) else (
        worth.hit_points, "those of a hit times the least P(hit)")
    return table((f"{worth.shots} shots", "as simulated", "corrected"), rows) + paragraph(
        _capital(wording.say_points(worth)) + f". A ball that the gate holds counts {hits * worth.threshold:.1f} "
        f"points: {least} for which it fires ({worth.threshold:g}).")


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
