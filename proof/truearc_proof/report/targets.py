"""Figures of a round of proof against the targets that were set before it: the design's, and the posterior's."""

import math
from collections.abc import Sequence
from statistics import median
from typing import Any, NamedTuple

from truearc.sim.statistics import wilson
from truearc_proof.scoring.score_world import Mark, has_decoy, named_decoy, up_to_alias
from truearc_proof.worlds.sampling_plan import ALIKE, MUJOCO, NUMPY

# places in truearc_proof.scoring.oracle.Ceiling
CEILINGS = {"detected": 0, "top_1": 1, "up_to_alias": 2, "stage": 3}
RESOLVABLE = 50.0                     # lambda, from which an effect in no catalogue should be reported as unknown
NEGLIGIBLE = 1e-3                     # relative change of an error that counts as none
# {id of a figure: its text in tables}; all_: of every claim, by either engine and whatever was hidden.
TITLES = {
    "detected": "detected", "stage": "stage", "top_1": "top-1", "up_to_alias": "up to alias",
    "in_set": "in the set", "set_size": "set size", "interval_holds": "interval holds",
    "gain_kept": "gain kept, by the solver's own folds", "gain_lost": "gain below 0, of one effect found",
    "all_gains_lost": "gain below 0, of all claims with a gain",
    "called_unknown": "called unknown", "named_wrong": "named wrong, of one effect found",
    "all_named_wrong": "named wrong, of all single names given",
    "off_unknown": "off: unknown", "off_goes_with": "off: covariate and direction",
    "false_alarms_clean": "false alarms, clean", "false_alarms_dirty": "false alarms, dirty",
    "sealed_gain_kept": "gain kept, in the sealed test", "sealed_worse": "worse in the sealed test, of all claims",
    "amplitude_error": "amplitude's RMS error / least", "alias_set": "aliases: a set with the whole class",
    "decoy_first": "decoy: its name first", "decoy_in_set": "decoy: its name in the set",
    "two_one_right": "two: one is right", "two_both_right": "two: both are right",
    "random_worth": "follow-up: random shots that 100 designed ones equal",
}
Setting = tuple[str, int, float]      # level, shots, scale of effects
POSTERIOR_LEVELS = ("L0", "L1", "L2")
WORSE = 1.01                          # RMS error on the sealed season, by that without what was adopted
ALARM_RATES, FEW_ALARM_RATES = (0.03, 0.07), (0.0, 0.08)


class ProofFigure(NamedTuple):
    """A share (counts: its yes and of), or another number; allowed: the ceiling by the data's own information."""

    value: float | None
    words: str
    allowed: float | None = None
    counts: tuple[int, int] | None = None


def figures_of(marks: Sequence[Mark]) -> dict[str, ProofFigure]:
    """Return {id of TITLES: figure} of worlds of one level and number of shots; value None where no world has one.

    The figures cover worlds of the NumPy engine; all_gains_lost, all_named_wrong, sealed_worse and random_worth cover
    both engines.
    """
    mine = [one for one in marks if one.engine == NUMPY]
    catalogued = [one for one in mine if one.kind == "one" and one.allowed is not None]
    found = [one for one in catalogued if one.found]
    shares = _shares_of_effects(catalogued, found) | _shares_of_others(mine) | {
        "all_gains_lost": [_lost(one) for one in marks], "sealed_worse": [worse_in_test(one) for one in marks],
        "all_named_wrong": [_wrong(one) for one in marks if one.verdict == "named"]}
    figures = {name: _share(answers) for name, answers in shares.items()}
    figures |= {name: figures[name]._replace(allowed=_allowed(catalogued, place)) for name, place in CEILINGS.items()}
    figures["set_size"] = _mean([one.set_size for one in found if one.set_size is not None])
    errors = [one.error**2 for one in found if one.error is not None]
    figures["amplitude_error"] = _number((sum(errors) / len(errors))**0.5 if errors else None)
    pairs = [(one.gain, one.oracle_gain) for one in found if one.gain is not None and one.oracle_gain is not None]
    best = sum(oracle for _, oracle in pairs)
    figures["gain_kept"] = _number(sum(gain for gain, _ in pairs) / best if best > 0.0 else None)
    figures["sealed_gain_kept"] = kept_in_test(found)
    figures["random_worth"] = _median([one.random for one in marks if one.random is not None], ".0f")
    return figures


def plain_figures(marks: Sequence[Mark]) -> dict[str, Any]:
    """Return {"level, shots": {id: value; of a share yes, of and Wilson's interval; the ceiling}}, plain values."""
    settings = sorted({(one.level, one.shots) for one in marks})
    return {f"{level}, {shots}": {name: _plain(one) for name, one in figures_of(
        [mark for mark in marks if (mark.level, mark.shots) == (level, shots)]).items()} for level, shots in settings}


def _plain(figure: ProofFigure) -> dict[str, Any]:
    yes_of = {} if figure.counts is None else {"yes": figure.counts[0], "of": figure.counts[1],
                                               "low95": wilson(*figure.counts)[0], "high95": wilson(*figure.counts)[1]}
    return {"value": figure.value, **yes_of, "allowed": figure.allowed}


def kept_in_test(marks: Sequence[Mark]) -> ProofFigure:
    """Return the share that adoption reached of the true term's reduction of the squared error of sealed heights.

    The median over the worlds in which that reduction is not NEGLIGIBLE: a sum would be decided by the few in which
    balls were forecast to fall short.
    """
    known = [one.off_m for one in marks if one.off_m is not None and len(one.off_m) == 3]
    shares = [(before**2 - after**2) / (before**2 - true**2) for before, after, true in known
              if true < before * (1.0 - NEGLIGIBLE)]
    return _median(shares, ".2f")


def _shares_of_effects(catalogued: Sequence[Mark], found: Sequence[Mark]) -> dict[str, list[bool | None]]:
    """Of worlds with one hidden effect of the catalogue; found: those in which it was."""
    return {
        "detected": [one.found for one in catalogued], "stage": [one.stage for one in found],
        "top_1": [one.first for one in found], "up_to_alias": [one.alias for one in found],
        "in_set": [one.covered for one in found], "interval_holds": [one.holds for one in found],
        "gain_lost": [_lost(one) for one in found], "called_unknown": [one.verdict == "unknown" for one in found],
        "named_wrong": [one.verdict == "named" and _wrong(one) for one in found]}


def _shares_of_others(marks: Sequence[Mark]) -> dict[str, list[bool | None]]:
    off = [one for one in marks if one.kind == "off" and one.found
           and (one.strength is None or one.strength >= RESOLVABLE)]
    two = [one for one in marks if one.kind == "two" and one.found]
    return {
        "false_alarms_clean": [one.found for one in marks if one.kind == "clean"],
        "false_alarms_dirty": [one.found for one in marks if one.kind == "dirty"],
        "off_unknown": [one.verdict == "unknown" for one in off],
        "off_goes_with": [one.goes_with for one in off],
        "alias_set": [_told_as_set(one) for one in marks if one.kind == "alias" and one.found],
        "decoy_first": [named_decoy(one) for one in marks], "decoy_in_set": [has_decoy(one) for one in marks],
        "two_one_right": [one.first for one in two], "two_both_right": [one.both for one in two]}


def _lost(one: Mark) -> bool | None:
    return None if one.gain is None else one.gain < 0.0


def worse_in_test(one: Mark) -> bool | None:
    """Return whether the adopted belief forecasts sealed shots worse; None where the change of error is negligible."""
    if one.off_m is None:
        return None
    before, after = one.off_m[:2]
    return None if abs(after - before) <= NEGLIGIBLE * before else after > before


def _wrong(one: Mark) -> bool:
    """Whether the first name is neither true nor of a true one's class: any is, if no catalogued term is hidden."""
    return not one.first and not up_to_alias(one)


def _told_as_set(one: Mark) -> bool:
    """The set holds all names that such data never tell apart; it may hold more."""
    return one.verdict == "set" and set(ALIKE[one.level]) <= set(one.names)


def _share(answers: Sequence[bool | None]) -> ProofFigure:
    known = [answer for answer in answers if answer is not None]
    if not known:
        return ProofFigure(None, "-")
    low, high = wilson(sum(known), len(known))
    return ProofFigure(sum(known) / len(known), f"{sum(known)}/{len(known)} = {sum(known) / len(known):.2f} "
                                           f"({low:.2f}-{high:.2f})", counts=(sum(known), len(known)))


def _median(values: Sequence[float], form: str) -> ProofFigure:
    if not values:
        return ProofFigure(None, "-")
    return ProofFigure(float(median(values)), f"{median(values):{form}} (median of {len(values)})")


def _mean(values: Sequence[float]) -> ProofFigure:
    return _number(sum(values) / len(values) if values else None)


def _number(value: float | None) -> ProofFigure:
    return ProofFigure(value, "-" if value is None else f"{value:.2f}")


def _allowed(marks: Sequence[Mark], part: int) -> float | None:
    """Mean chance to detect, or (part > 0) of those detected the share that could be named right."""
    allowed = [one.allowed for one in marks if one.allowed is not None]
    detected = sum(one[0] for one in allowed)
    if not detected:
        return None
    return detected / len(allowed) if part == 0 else sum(one[part] for one in allowed) / detected


class Target(NamedTuple):
    """A target of the design (section 8).

    figure: id of truearc_proof.report.targets.TITLES. least: the figure must reach it, else stay at or below it. most:
    and not go beyond this.
    """

    figure: str
    least: bool
    at: dict[Setting, float]
    most: float = math.inf


L0_300, L0_1000, L1_300, L1_1000 = ("L0", 300, 1.0), ("L0", 1000, 1.0), ("L1", 300, 1.0), ("L1", 1000, 1.0)
L2_300 = ("L2", 300, 0.25)
SETTINGS = (L0_300, L0_1000, L1_300, L1_1000, L2_300)
PLAIN = ("L2", 300, 1.0)              # tracks, usual sizes: everything should be seen and named
LARGE = ("L2", 300, 2.0)              # where what is in no catalogue is looked at
PLAINLY = {PLAIN: 0.97}


def goals(*values: float) -> dict[Setting, float]:
    """{setting: figure}, of SETTINGS."""
    return dict(zip(SETTINGS, values, strict=True))


TARGETS = (
    Target("detected", True, goals(0.45, 0.72, 0.50, 0.74, 0.72) | PLAINLY),
    Target("stage", True, goals(0.72, 0.78, 0.82, 0.88, 0.97) | PLAINLY),
    Target("top_1", True, goals(0.62, 0.70, 0.74, 0.82, 0.88) | PLAINLY),
    Target("up_to_alias", True, goals(0.74, 0.82, 0.78, 0.86, 0.95) | PLAINLY),
    Target("in_set", True, goals(0.90, 0.90, 0.90, 0.90, 0.90) | PLAINLY),
    Target("set_size", False, goals(5.0, 3.5, 4.5, 2.5, 1.6)),
    Target("interval_holds", True, goals(0.86, 0.86, 0.86, 0.86, 0.86), 0.94),
    Target("gain_kept", True, goals(0.70, 0.82, 0.75, 0.87, 0.90)),
    Target("gain_lost", False, goals(0.05, 0.03, 0.05, 0.03, 0.02)),
    Target("called_unknown", False, goals(0.10, 0.10, 0.10, 0.08, 0.05)),
    Target("named_wrong", False, goals(0.10, 0.10, 0.10, 0.10, 0.05)),
    Target("off_unknown", True, goals(0.40, 0.55, 0.55, 0.70, 0.85) | {LARGE: 0.85}),
    Target("off_goes_with", True, {L2_300: 0.75, LARGE: 0.75}),
)
# The ceilings that the design's targets were set against (its section 4.4).
DESIGN_CEILING = {"detected": goals(0.53, 0.82, 0.56, 0.83, 0.80) | {PLAIN: 1.0},
                  "top_1": goals(0.70, 0.77, 0.81, 0.88, 0.92) | {PLAIN: 1.0},
                  "up_to_alias": goals(0.80, 0.88, 0.82, 0.90, 0.98) | {PLAIN: 1.0},
                  "stage": goals(0.79, 0.83, 0.88, 0.92, 0.99) | {PLAIN: 1.0}}
ALARMS = (
    Target("false_alarms_clean", True, goals(0.03, 0.03, 0.03, 0.03, 0.03), 0.06),
    Target("false_alarms_dirty", False, goals(0.07, 0.07, 0.07, 0.07, 0.07)),
)
FURTHER = (
    Target("sealed_gain_kept", True, goals(0.70, 0.82, 0.75, 0.87, 0.90)),
    Target("sealed_worse", False, goals(0.05, 0.03, 0.05, 0.03, 0.02)),
    Target("amplitude_error", False, goals(1.4, 1.25, 1.35, 1.2, 1.15)),
    Target("alias_set", True, goals(0.95, 0.95, 0.95, 0.95, 0.95)),
    Target("decoy_first", False, goals(0.10, 0.10, 0.10, 0.10, 0.05)),
    Target("decoy_in_set", False, {}),
    Target("two_one_right", True, goals(0.50, 0.72, 0.60, 0.80, 0.88)),
    Target("two_both_right", True,
           {setting: wanted for setting, wanted in goals(0.0, 0.20, 0.0, 0.38, 0.40).items() if wanted}),
    Target("random_worth", True, {L0_300: 300.0, L1_300: 300.0}),
)
WIDER = {"gain_lost": "all_gains_lost", "named_wrong": "all_named_wrong"}      # the same target over more worlds
UNASKED = ("decoy_in_set", "two_both_right")      # reported even where the design has no target
WHY = {"off_unknown": f"none with a lambda of {RESOLVABLE:g} or more was found",
       "decoy_first": "no decoy that such data have anything of",
       "decoy_in_set": "no decoy that such data have anything of",
       "random_worth": "no shots were asked for and given"}
NOT_MEASURED, NO_WORLD = "not measured", "no world of this round says"


def against_targets(marks: Sequence[Mark], scale: float | None = None) -> list[list[str]]:
    """Return a row for every target of the design for a level that was played.

    A row has level and shots, figure, value reached, value that the data allow, target, and whether it is reached or
    why it was not measured. scale: of effects, where they have one.
    """
    rows = []
    for level, shots in sorted({(one.level, one.shots) for one in marks}):
        mine = [one for one in marks if (one.level, one.shots) == (level, shots)]
        setting = next((one for one in (*SETTINGS, PLAIN, LARGE) if one[:2] == (level, shots)
                        and scale in (None, one[2])), None)
        rows += [[f"{level}, {shots}", *row] for row in _rows(setting, mine)]
    played = {(one.level, one.shots) for one in marks}
    return rows + [[f"{level}, {shots}", "all", NOT_MEASURED, "-", "-", f"no world here has {shots} shots"]
                   for level, shots, _ in SETTINGS
                   if level in {one.level for one in marks} and (level, shots) not in played]


def _rows(setting: Setting | None, marks: Sequence[Mark]) -> list[list[str]]:
    if setting is None:
        return [["all", NOT_MEASURED, "-", "-", "the design has no targets for this number of shots"]]
    figures = figures_of(marks)
    targets = [*ALARMS, *(one for target in TARGETS for one in _widened(target)), *FURTHER]
    return [[TITLES[target.figure], *_judged(setting, target, figures[target.figure])]
            for target in targets if setting in target.at or target.figure in UNASKED]


def _widened(target: Target) -> list[Target]:
    wider = WIDER.get(target.figure)
    return [target] if wider is None else [target, target._replace(figure=wider)]


def _judged(setting: Setting, target: Target, figure: ProofFigure) -> list[str]:
    scaled = scaled_target(setting, target, figure.allowed)
    wanted = target.at.get(setting) if scaled is None else scaled
    words = "-" if wanted is None else words_of(target, wanted) + ("" if scaled is None else " (scaled)")
    if figure.value is None:
        return [NOT_MEASURED, "-", words, WHY.get(target.figure, NO_WORLD)]
    return [figure.words, "-" if figure.allowed is None else f"{figure.allowed:.2f}", words,
            "no target" if wanted is None else _verdict(target, wanted, figure)]


def _verdict(target: Target, wanted: float, figure: ProofFigure) -> str:
    """Return whether the target is reached; a share may be so by chance if Wilson's interval crosses the target."""
    assert figure.value is not None
    reached = is_reached(target, figure.value, wanted)
    said = "reached" if reached else "NOT REACHED"
    if figure.counts is None:
        return said
    low, high = wilson(*figure.counts)
    ends = is_reached(target, low, wanted) and is_reached(target, high, wanted)
    apart = high < wanted or low > target.most if target.least else low > wanted
    return said if (ends if reached else apart) else f"{said}, may be chance"


def is_reached(target: Target, value: float, goal: float) -> bool:
    return goal <= value <= target.most if target.least else value <= goal


def words_of(target: Target, goal: float) -> str:
    most = f", <= {target.most:.2g}" if target.most < 1.0 else ""
    return f"{'>=' if target.least else '<='} {round(goal, 2):g}{most}"


def scaled_target(setting: Setting, target: Target, allowed: float | None) -> float | None:
    """The target times our ceiling over the design's (its section 8 asks to keep the ratios); None without either."""
    theirs = DESIGN_CEILING.get(target.figure, {}).get(setting)
    wanted = target.at.get(setting)
    if theirs is None or wanted is None or allowed is None:
        return None
    return wanted / theirs * allowed


class Goal(NamedTuple):
    """A row: its text, and for each of POSTERIOR_LEVELS from where to where the figure should be; None: no target."""

    words: str
    wanted: tuple[tuple[float, float] | None, ...]


CLEAN = Goal("false alarms, clean", (ALARM_RATES,) * 3)
DIRTY = Goal("false alarms, dirty", (ALARM_RATES, ALARM_RATES, FEW_ALARM_RATES))
UNCHANGED = Goal("false alarms, MuJoCo unchanged", (ALARM_RATES, ALARM_RATES, FEW_ALARM_RATES))
WRONG = Goal("single names wrong, whatever was hidden", ((0.0, 0.10), (0.0, 0.10), (0.0, 0.06)))
HELD = Goal("set holds the truth", ((0.90, 1.0), (0.90, 1.0), (0.92, 1.0)))
OFF = Goal("in no catalogue: unknown or a set", ((0.5, 1.0), (0.6, 1.0), (0.88, 1.0)))
BOTH = Goal("two effects, both right", (None, (0.3, 1.0), (0.6, 1.0)))
INTERVALS = Goal("90 % intervals hold the truth", ((0.86, 0.94),) * 3)
ADOPTED = Goal("adopted worse on the sealed season by over 1 %", ((0.0, 0.06),) * 3)
POWER = Goal("power, share of what the data allow", ((0.93, 9.0), (0.93, 9.0), (0.95, 9.0)))
SIZE = Goal("mean size of a set", ((1.0, 5.0), (1.0, 4.0), (1.0, 1.6)))


def shares_of(marks: Sequence[Mark]) -> dict[Goal, list[bool]]:
    """The answers behind each share, of worlds of one level by both engines."""
    found = [one for one in marks if one.found]
    known = [one for one in found if one.right]
    return {
        CLEAN: [one.found for one in marks if one.engine == NUMPY and one.kind == "clean"],
        DIRTY: [one.found for one in marks if one.engine == NUMPY and one.kind == "dirty"],
        UNCHANGED: [one.found for one in marks if one.engine == MUJOCO and one.kind in ("clean", "dirty")],
        WRONG: [not one.first and not up_to_alias(one) for one in found if one.verdict == "named"],
        HELD: [bool(one.covered) for one in known],
        OFF: [one.verdict != "named" for one in found if one.kind == "off"],
        BOTH: [bool(one.both) for one in found if one.kind == "two"],
        INTERVALS: [one.holds for one in found if one.holds is not None],
        ADOPTED: [one.off_m[1] > WORSE * one.off_m[0] for one in marks
                  if one.off_m is not None and worse_in_test(one) is not None]}


def posterior_rows(marks: Sequence[Mark]) -> list[list[str]]:
    """Rows [target, figure, wanted, whether it is reached] for worlds of one level."""
    level = POSTERIOR_LEVELS.index(marks[0].level)
    rows = [_share_row(goal, answers, goal.wanted[level]) for goal, answers in shares_of(marks).items()]
    power = figures_of(marks)["detected"]
    if power.counts is not None and power.allowed:
        wanted, share = POWER.wanted[level], power.allowed
        assert wanted is not None
        low, high = (end / share for end in wilson(*power.counts))
        rows.insert(3, [POWER.words, f"{power.counts[0] / power.counts[1] / share:.2f} ({low:.2f}-{high:.2f}): "
                        f"{power.counts[0]}/{power.counts[1]} of {share:.2f}", f">= {wanted[0]:g}",
                        _posterior_said(power.counts[0] / power.counts[1] / share, (low, high), wanted)])
    sizes = [len(one.names) for one in marks if one.found and one.right and one.verdict in ("named", "set")]
    if sizes and (most := SIZE.wanted[level]):
        mean = sum(sizes) / len(sizes)
        rows.append([SIZE.words, f"{mean:.2f} of {len(sizes)}", f"<= {most[1]:g}",
                     "reached" if mean <= most[1] else "NOT REACHED"])
    return rows


def _share_row(goal: Goal, answers: Sequence[bool], wanted: tuple[float, float] | None) -> list[str]:
    figure = _share(answers)
    if figure.counts is None or figure.value is None:
        return [goal.words, "-", _posterior_words(wanted), "no world of these rounds says"]
    return [goal.words, figure.words, _posterior_words(wanted),
            "no target" if wanted is None else _posterior_said(figure.value, wilson(*figure.counts), wanted)]


def _posterior_said(value: float, ends: tuple[float, float], wanted: tuple[float, float]) -> str:
    if wanted[0] <= value <= wanted[1]:
        return "reached"
    return "NOT REACHED" if ends[1] < wanted[0] or ends[0] > wanted[1] else "NOT REACHED, may be chance"


def _posterior_words(wanted: tuple[float, float] | None) -> str:
    if wanted is None:
        return "-"
    low, high = wanted
    return f"<= {high:g}" if low <= 0.0 else f">= {low:g}" if high >= 1.0 else f"{low:g} to {high:g}"
