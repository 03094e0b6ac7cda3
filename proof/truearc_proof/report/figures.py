"""The figures of a round of proof that the design's targets are about, each with the worlds that it rests on."""

from collections.abc import Sequence
from statistics import median
from typing import Any, NamedTuple

from truearc.sim.statistics import wilson
from truearc_proof.scoring.decoys import has_decoy, named_decoy, up_to_alias
from truearc_proof.scoring.score_world import Mark
from truearc_proof.worlds.sampling_plan import ALIKE, NUMPY

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
