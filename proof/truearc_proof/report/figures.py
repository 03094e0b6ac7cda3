"""The figures of a round of proof that the design's targets are about, each with the worlds that it rests on."""

from collections.abc import Sequence
from statistics import median
from typing import Any, NamedTuple

from truearc.sim.intervals import wilson
from truearc_proof.scoring.decoys import has_decoy, named_decoy, up_to_alias
from truearc_proof.scoring.score_world import Mark
from truearc_proof.worlds.sampling_plan import ALIKE, NUMPY

# places in truearc_proof.scoring.oracle.Ceiling
CEILINGS = {"detected": 0, "top-1": 1, "up to alias": 2, "stage": 3}
RESOLVABLE = 50.0                     # lambda, from which what has no name should be told as such
# Of everything that was said, by whichever engine the world was made and whatever was hidden.
ALL_GAINS, ALL_NAMES = "gain below 0, of all claims with a gain", "named wrong, of all single names given"
DECOY_FIRST, DECOY_AMONG = "decoy: its name first", "decoy: its name in the set"
SEALED_KEPT, SEALED_LOST = "gain kept, in the sealed test", "worse in the sealed test, of all claims"
DESIGNED = "follow-up: random shots that 100 designed ones equal"
TRIFLE = 1e-3
ALIAS_SET, PAIR = "aliases: a set with the whole class", "two: both are right"


class ProofFigure(NamedTuple):
    """What was reached: a share (counts: its yes and of), or another number; allowed: by the data's own information."""

    value: float | None
    words: str
    allowed: float | None = None
    counts: tuple[int, int] | None = None


def figures_of(marks: Sequence[Mark]) -> dict[str, ProofFigure]:
    """All figures, of worlds of one level and as many shots; value None where no world says. Of the NumPy engine's
    alone, but for ALL_GAINS and ALL_NAMES."""
    mine = [one for one in marks if one.engine == NUMPY]
    catalogued = [one for one in mine if one.kind == "one" and one.allowed is not None]
    found = [one for one in catalogued if one.found]
    shares = _shares_of_effects(catalogued, found) | _shares_of_others(mine) | {
        ALL_GAINS: [_lost(one) for one in marks], SEALED_LOST: [worse_in_test(one) for one in marks],
        ALL_NAMES: [_wrong(one) for one in marks if one.verdict == "named"]}
    figures = {name: _share(answers) for name, answers in shares.items()}
    figures |= {name: figures[name]._replace(allowed=_allowed(catalogued, place)) for name, place in CEILINGS.items()}
    figures["set size"] = _mean([one.set_size for one in found if one.set_size is not None])
    errors = [one.error**2 for one in found if one.error is not None]
    figures["amplitude's RMS error / least"] = _number((sum(errors) / len(errors))**0.5 if errors else None)
    pairs = [(one.gain, one.oracle_gain) for one in found if one.gain is not None and one.oracle_gain is not None]
    best = sum(oracle for _, oracle in pairs)
    figures["gain kept"] = _number(sum(gain for gain, _ in pairs) / best if best > 0.0 else None)
    figures[SEALED_KEPT] = kept_in_test(found)
    figures[DESIGNED] = _median([one.random for one in marks if one.random is not None], ".0f")
    return figures


def plain_figures(marks: Sequence[Mark]) -> dict[str, Any]:
    """{level, shots: {figure: value; of a share yes, of and Wilson's interval; what the data allow}}, plain values."""
    settings = sorted({(one.level, one.shots) for one in marks})
    return {f"{level}, {shots}": {name: _plain(one) for name, one in figures_of(
        [mark for mark in marks if (mark.level, mark.shots) == (level, shots)]).items()} for level, shots in settings}


def _plain(figure: ProofFigure) -> dict[str, Any]:
    yes_of = {} if figure.counts is None else {"yes": figure.counts[0], "of": figure.counts[1],
                                               "low95": wilson(*figure.counts)[0], "high95": wilson(*figure.counts)[1]}
    return {"value": figure.value, **yes_of, "allowed": figure.allowed}


def kept_in_test(marks: Sequence[Mark]) -> ProofFigure:
    """Share of the squared error of sealed heights that the true term takes away, which what was adopted took away: the
    median world's, of those in which the true term takes away more than a trifle. (A sum over worlds would be the word
    of the few in which balls were foretold to fall short.)"""
    known = [one.off_m for one in marks if one.off_m is not None and len(one.off_m) == 3]
    shares = [(before**2 - after**2) / (before**2 - true**2) for before, after, true in known
              if true < before * (1.0 - TRIFLE)]
    return _median(shares, ".2f")


def _shares_of_effects(catalogued: Sequence[Mark], found: Sequence[Mark]) -> dict[str, list[bool | None]]:
    """Of worlds with one hidden effect of the catalogue; found: those in which it was."""
    return {
        "detected": [one.found for one in catalogued], "stage": [one.stage for one in found],
        "top-1": [one.first for one in found], "up to alias": [one.alias for one in found],
        "in the set": [one.covered for one in found], "interval holds": [one.holds for one in found],
        "gain below 0": [_lost(one) for one in found], "called unknown": [one.verdict == "unknown" for one in found],
        "named wrong": [one.verdict == "named" and _wrong(one) for one in found]}


def _shares_of_others(marks: Sequence[Mark]) -> dict[str, list[bool | None]]:
    off = [one for one in marks if one.kind == "off" and one.found
           and (one.strength is None or one.strength >= RESOLVABLE)]
    two = [one for one in marks if one.kind == "two" and one.found]
    return {
        "false alarms, clean": [one.found for one in marks if one.kind == "clean"],
        "false alarms, dirty": [one.found for one in marks if one.kind == "dirty"],
        "off: unknown": [one.verdict == "unknown" for one in off],
        "off: covariate and direction": [one.goes_with for one in off],
        ALIAS_SET: [_told_as_set(one) for one in marks if one.kind == "alias" and one.found],
        DECOY_FIRST: [named_decoy(one) for one in marks], DECOY_AMONG: [has_decoy(one) for one in marks],
        "two: one is right": [one.first for one in two], PAIR: [one.both for one in two]}


def _lost(one: Mark) -> bool | None:
    return None if one.gain is None else one.gain < 0.0


def worse_in_test(one: Mark) -> bool | None:
    """Whether sealed shots are foretold worse by what was adopted; None where heights hang on it by no more than a
    trifle."""
    if one.off_m is None:
        return None
    before, after = one.off_m[:2]
    return None if abs(after - before) <= TRIFLE * before else after > before


def _wrong(one: Mark) -> bool:
    """The first name is neither true nor of a true one's class: any is where nothing is missing, or has no name."""
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
    """Mean chance to detect, or (part > 0) of those detected the share that could be told right."""
    allowed = [one.allowed for one in marks if one.allowed is not None]
    detected = sum(one[0] for one in allowed)
    if not detected:
        return None
    return detected / len(allowed) if part == 0 else sum(one[part] for one in allowed) / detected
