"""Pages and terminal text that report a finding, identifiability, or a plan of further shots."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from msgspec import UnsetType

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.decide import Step
from truearc.sim.discover.detect.covariates import CovariatePair
from truearc.sim.discover.finding import FindingRecord, FitSummary, Named
from truearc.sim.discover.identifiability import POWER, TAKEN, Fittable, Sight, TermIdentifiability, sight_of
from truearc.sim.discover.investigate import Investigation
from truearc.sim.discover.next_steps import LEAST_GAIN, MOST_RANDOM, Block, Design
from truearc.sim.discover.report import finding_text as wording
from truearc.sim.discover.report import pictures
from truearc.sim.discover.report import story as stories
from truearc.sim.discover.report.finding_text import WORDING, in_words, list_believed, plain, size_of
from truearc.sim.discover.report.flights import beliefs_of, draw_film, draw_flights
from truearc.sim.discover.report.pictures import View, draw_flight, draw_sight, halves, residual_figure, views_of
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.catalogue import Catalogue, as_catalogue, find_terms
from truearc.sim.printed import make_text
from truearc.sim.report import NO_ORIGIN, Origin, make_page, make_svg, render
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


def sight_section(sight: Sight, among: Catalogue | None = None, believed: str = "") -> str:
    """HTML of how well each effect would be seen; believed: what is said to be believed, in place of the summary."""
    seen = [one for one in sight.terms if one.shots_needed is not None]
    rows = [(plain(one.term, among), one.stage, size_of(one.term, one.usual, one.unit, among),
             size_of(one.term, one.smallest or 0.0, one.unit, among), f"{one.power:.0%}", _shots(one.shots_needed or 0),
             f"{one.share_left:.1%}", "" if one.like is None else f"{plain(one.like, among)} ({one.correlation:+.2f})")
            for one in seen]
    figure = draw_sight(sight, among)
    return render(
        "sight.html", sentence=sight_sentence(sight), believed=believed, shots=sight.shots, rows=rows, method=METHOD,
        alike=[" = ".join(plain(one, among) for one in group) for group in sight.classes],
        svg="" if figure is None else make_svg(figure, "shots needed for each effect"),
        never=[(plain(one.term, among), one.stage, why_not(one, among)) for one in sight.terms
               if one.shots_needed is None],
        fitted=[(one.name, _uncertainty(one, one.before), _uncertainty(one, one.after)) for one in sight.fitted])


def make_sight_page(name: str, sight: Sight, among: Catalogue | None = None, origin: Origin = NO_ORIGIN) -> str:
    """HTML page of what data of the rig `name` could tell."""
    return make_page(f"truearc identifiability: {name}", sight_sentence(sight), [
        ("Before any data", sight_section(sight, among, list_believed(sight.believed, among)))], origin)


def _uncertainty(one: Fittable, sd: float) -> str:
    """A standard deviation; of scatters, which are known by their logs, a factor."""
    if one.name.startswith("scatter."):
        return f"within a factor of {np.exp(sd):.2f}"
    return f"± {sd:.2g}" + ("" if one.unit == "1" else f" {one.unit}")


SCHEMA = "truearc.design/1"
# How a shot must be like the one it is named after, where a name that competes follows a circumstance.
AS_THEN: dict[str, str] = WORDING["as_then"]
# Chosen: above the chance of its draws
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


FINE_PRINT = (files("truearc.sim.discover.report") / "fine_print.txt").read_text(encoding="utf-8").split("\n\n")
MOST_NAMES = 5                        # with a bar; the others are folded


class Drawn(NamedTuple):
    """A picture of the report, and the sentence below it."""

    svg: str
    caption: str


def make_report(name: str, investigation: Investigation, origin: Origin = NO_ORIGIN,
                truth: Mapping[str, float] | None = None) -> str:
    """HTML text of the answer about the dataset called `name`; truth: sizes of what is really there, by term."""
    finding, among = investigation.finding, investigation.catalogue
    names, sight = names_of(finding, among, truth or {}), ""
    worth, gate = (_worth(finding, finding.fit) if finding.fit is not None and finding.fit.gain_per_shot is not None
                   else ([], ""))
    if investigation.fitted is not None:
        threshold = investigation.threshold if np.isfinite(investigation.threshold or np.inf) else None
        sight = sight_section(sight_of(investigation.fitted.scores, finding.data.level, finding.data.believed,
                                       threshold), among)
    return make_page(
        f"truearc discover: {name}", finding.sentence, [], origin._replace(sha256=finding.data.sha256), "finding.html",
        told=finding.told, pictures=make_pictures(investigation), names=names[:MOST_NAMES], folded=names[MOST_NAMES:],
        members=finding.set or (), truth=truth, numbers=_numbers(finding, among), worth=worth, gate=gate,
        fine_print=[" ".join(text.split()) for text in FINE_PRINT], tests=_tests(finding), sight=sight,
        shots=finding.data.shots)


def make_pictures(investigation: Investigation) -> list[Drawn]:
    """The flights, then for each effect its residual, the flight's and the field's; none of data that carry no test."""
    flown, data = draw_flights(investigation), investigation.dataset
    said = (f"Side view of flights as simulated{' (blue) and corrected (orange)' if investigation.steps else ''}; the "
            f"band holds nine in ten by the scatter of the launch{', dots: filmed' if data and data.tracks else ''}.")
    pictures = [] if flown is None else [Drawn(make_svg(flown, "flights, simulated and real"), said)]
    if (filmed := draw_film(data, beliefs_of(investigation))) is not None:
        pictures.insert(0, Drawn(make_svg(filmed, "filmed flights on the camera's picture"), "What the camera saw: all "
                                 "flights by outcome (green three, yellow two, red miss), and flights as simulated."))
    for view in _views(investigation, investigation.steps):
        what = _said(view.step, investigation.catalogue)
        shown = [_against(view, what), _along_flight(view, what)]
        if view.step is not None and view.step.unknown:
            shown.insert(1, _free_curve(view.step))
        if view.step is None or view.step.base == ():
            shown.append(_field(view, investigation, what))
        pictures += filter(None, shown)
    return pictures


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


def _free_curve(step: Step) -> Drawn | None:
    """The unexplained effect itself; None where it is the same in all shots."""
    place = step.place
    figure = None if place is None else pictures.draw_curve(place)
    if place is None or figure is None or place.test.what is None:
        return None
    what = place.test.what
    sized = ("Colour: its size." if isinstance(what, CovariatePair) else "The band: 90 % by the likelihood.")
    return Drawn(make_svg(figure, f"free curve: {place.column.name} against {what.name}"), "The free curve: the change "
                 f"of {place.column.name} over {in_words(what.name)} that fits all shots best, less its mean. {sized}")


def _against(view: View, what: str) -> Drawn:
    """Against the covariate that the effect goes with."""
    after = "" if view.after is None else " Where the correction is right, the pattern is gone in the lower picture."
    figure = residual_figure(view.residual, view.against, view.before.rows, what)
    return Drawn(make_svg(figure, f"{view.residual.name} against {view.against.name}"), "Real shots less simulated "
                 f"ones, in bins of {in_words(view.against.name)}. Bars are one standard error.{after}")


def _along_flight(view: View, what: str) -> Drawn | None:
    """Along the flight; None where no picture of it can be made."""
    in_flight = view.residual.column is not None and view.before.columns[view.residual.column].stage == "flight"
    figure = draw_flight(view.before, view.after, what, halves(view.stated if in_flight else None, view.before.rows))
    return None if figure is None else Drawn(
        make_svg(figure, "missing acceleration along the flight"), "Acceleration that the simulation lacks, by time in "
        "flight, each shot's own launch left free. Bars are one standard error.")


def _field(view: View, investigation: Investigation, what: str) -> Drawn | None:
    """Over distance and elevation, or speed and elevation where no distance varies."""
    assert investigation.fitted is not None
    lanes = investigation.fitted.model.data.lanes
    if np.asarray(lanes.free).all():
        return None
    distance_m, speed = np.asarray(lanes.distance_m), np.asarray(lanes.rolling.speed_m_s)
    across: tuple[str, Array] = ("distance [m]", distance_m) if np.ptp(distance_m) > 0.0 else ("launch speed [m/s]",
                                                                                              speed)
    elevation = ("launch elevation [°]", np.degrees(np.asarray(lanes.rolling.elevation_rad)))
    figure = pictures.draw_field(view.residual, across, elevation, what)
    return None if figure is None else Drawn(
        make_svg(figure, "residual over the field"), f"The same {view.residual.name}, by where and how steeply the "
        "shot was made. Numbers: the mean of a cell; colour: how many standard errors that is, so that pale ones may "
        "be chance. Cells with fewer than four shots are empty.")


def _numbers(finding: FindingRecord, among: Catalogue) -> list[tuple[str, str]]:
    """The table below the story, as on the console, with the tests behind the p-value."""
    rows, mismatch = stories.table_of(finding, among), finding.mismatch
    if mismatch.p_value is not None:
        families = ", ".join(f"{name} p = {p:.2g}" for name, p in mismatch.families.items())
        rows.append(("tests", f"alarm at {mismatch.false_alarm:g}; all together p = {mismatch.p_value:.2g}, each "
                              f"family alone: {families}"))
    return [*rows, *(("left out", reason) for reason in finding.data.left_out)]


def names_of(finding: FindingRecord, among: Catalogue, truth: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return a row per name: its probability, and its size with its interval on a scale that has zero and the truth."""
    members = set(finding.set or ())
    rows = [_row_of(one, one.term in members, truth.get(one.term), among) for one in finding.what
            if one.probability >= stories.LEAST_SHOWN or one.term in members]
    rest = finding.unexplained
    if finding.what and isinstance(rest, float):
        rows.insert(min(len(rows), MOST_NAMES - 1), {
            "name": "an effect of no term", "percent": f"{rest:.0%}", "in_set": finding.verdict == "unknown"})
    return rows


def _row_of(one: Named, in_set: bool, truth: float | None, among: Catalogue) -> dict[str, Any]:
    size, there = one.size, [] if truth is None else [truth]
    low, high = min(0.0, size.low90, *there), max(0.0, size.high90, *there)
    def at(value: float) -> float:
        return 3.0 + 94.0 * (value - low) / ((high - low) or 1.0)

    return {"name": plain(one.term, among), "percent": f"{one.probability:.0%}", "in_set": in_set, "zero": at(0.0),
            "low": at(size.low90), "width": at(size.high90) - at(size.low90), "at": at(size.value),
            "size": wording.interval_of(one.term, size, among),
            "truth": "" if truth is None else size_of(one.term, truth, size.unit, among),
            "truth_at": None if truth is None else at(truth)}


def _worth(finding: FindingRecord, fit: FitSummary) -> tuple[list[tuple[Any, ...]], str]:
    """(table, its header first; what a held ball counts) of forecasts and points before and after."""
    worth = finding.adoption
    rows: list[tuple[Any, ...]] = [
        ("outcome accuracy [%]", _percent(fit.accuracy_before), _percent(fit.accuracy_after)),
        (f"height error at the {fit.height_at}, rms [m]", fit.height_rmse_before_m, fit.height_rmse_after_m),
        ("error to the side at the track end, rms [m]", fit.side_rmse_before_m or None, fit.side_rmse_after_m or None),
        ("log score per shot", fit.log_score_before, fit.log_score_after)]
    header = (f"{fit.heldout_shots} hold-out shots", "as simulated", "corrected")
    if isinstance(worth, UnsetType):
        return [header, *(row for row in rows if None not in row)], ""
    rows += [("points per ball, had each shot been aimed by it", worth.aimed_before, worth.aimed_after),
             ("shots as made that its gate lets through [%]", *map(_percent, (worth.fired_before, worth.fired_after))),
             ("points per ball of these", worth.scored_before, worth.scored_after)]
    hits, least = (POINTS_THREE, "three times the least P(three)") if isinstance(worth.hit_points, UnsetType) else (
        worth.hit_points, "those of a hit times the least P(hit)")
    return [header, *(row for row in rows if None not in row)], (
        f"A ball that the gate holds counts {hits * worth.threshold:.1f} points: {least} for which it fires "
        f"({worth.threshold:g}).")


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _tests(finding: FindingRecord) -> list[tuple[Any, ...]]:
    return [(key, test.stage, test.direction, test.shape, test.statistic, test.p_value, test.amplitude, test.unit,
             test.log_gain) for key, test in finding.mismatch.tests.items()]
