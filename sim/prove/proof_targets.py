"""The design's targets (discovery.md, section 8) for a round of proof, each beside what was reached."""

from collections.abc import Sequence
from typing import NamedTuple

from sim.intervals import wilson
from sim.prove.marking import Mark
from sim.prove.table import CEILINGS, SETTINGS, TARGETS, Setting, Target, goals, is_reached, scaled_target, words_of

RESOLVABLE = 50.0                     # lambda, from which what has no name should be told as such

# What the benchmark of discovery does not ask.
FURTHER = (
    Target("false alarms, clean", False, goals(0.06, 0.06, 0.06, 0.06, 0.06)),
    Target("false alarms, dirty", False, goals(0.07, 0.07, 0.07, 0.07, 0.07)),
    Target("amplitude's RMS error / least", False, goals(1.4, 1.25, 1.35, 1.2, 1.15)),
    Target("aliases: the set", True, goals(0.95, 0.95, 0.95, 0.95, 0.95)),
    Target("decoy named", False, goals(0.10, 0.10, 0.10, 0.10, 0.05)),
    Target("two: one is right", True, goals(0.50, 0.72, 0.60, 0.80, 0.88)),
    Target("two: both are right", True, {setting: wanted for setting, wanted in goals(
        0.0, 0.20, 0.0, 0.38, 0.40).items() if wanted}),
)


class Figure(NamedTuple):
    """What was reached: a share (counts: its yes and of), or another number; allowed: by the data's own information."""

    value: float | None
    words: str
    allowed: float | None = None
    counts: tuple[int, int] | None = None


def against_targets(marks: Sequence[Mark]) -> list[list[str]]:
    """Rows of level and shots, figure, what was reached, what the data allow, what is wanted, and whether it is."""
    rows = []
    for level, shots in sorted({(one.level, one.shots) for one in marks}):
        setting = next((one for one in SETTINGS if one[:2] == (level, shots)), None)
        mine = [one for one in marks if (one.level, one.shots) == (level, shots) and one.engine == "numpy"]
        figures = figures_of(mine)
        for target in (*FURTHER[:2], *TARGETS, *FURTHER[2:]):
            if setting is not None and setting in target.at and figures[target.figure].value is not None:
                rows.append([f"{level}, {shots}", target.figure, *_judged(setting, target, figures[target.figure])])
    return rows


def _judged(setting: Setting, target: Target, figure: Figure) -> list[str]:
    scaled = scaled_target(setting, target, figure.allowed)
    wanted = target.at[setting] if scaled is None else scaled
    assert figure.value is not None
    return [figure.words, "-" if figure.allowed is None else f"{figure.allowed:.2f}",
            words_of(target, wanted) + ("" if scaled is None else " (scaled)"),
            "reached" if is_reached(target, figure.value, wanted) else "NOT REACHED"]


def figures_of(marks: Sequence[Mark]) -> dict[str, Figure]:
    """All figures that targets are about; value None where no world says."""
    single = [one for one in marks if one.kind == "one"]
    catalogued = [one for one in single if one.allowed is not None]
    found = [one for one in catalogued if one.found]
    off = [one for one in marks if one.kind == "off" and one.found
           and (one.strength is None or one.strength >= RESOLVABLE)]
    two = [one for one in marks if one.kind == "two" and one.found]
    shares: dict[str, list[bool | None]] = {
        "false alarms, clean": [one.found for one in marks if one.kind == "clean"],
        "false alarms, dirty": [one.found for one in marks if one.kind == "dirty"],
        "detected": [one.found for one in catalogued], "stage": [one.stage for one in found],
        "top-1": [one.first for one in found], "up to alias": [one.alias for one in found],
        "in the set": [one.covered for one in found], "interval holds": [one.holds for one in found],
        "gain below 0": [None if one.gain is None else one.gain < 0.0 for one in found],
        "called unknown": [one.verdict == "unknown" for one in found], "named wrong": [_wrong(one) for one in found],
        "off: unknown": [one.verdict == "unknown" for one in off],
        "off: covariate and direction": [one.goes_with for one in off],
        "aliases: the set": [_told_as_set(one) for one in marks if one.kind == "alias" and one.found],
        "decoy named": [_wrong(one) for one in marks if one.kind == "decoy"],
        "two: one is right": [one.first for one in two], "two: both are right": [one.both for one in two]}
    figures = {name: _share(answers) for name, answers in shares.items()}
    figures |= {name: figures[name]._replace(allowed=_allowed(catalogued, place)) for name, place in CEILINGS.items()}
    figures["set size"] = _mean([one.set_size for one in found if one.set_size is not None])
    errors = [one.error**2 for one in found if one.error is not None]
    figures["amplitude's RMS error / least"] = _number((sum(errors) / len(errors))**0.5 if errors else None)
    pairs = [(one.gain, one.oracle_gain) for one in found if one.gain is not None and one.oracle_gain is not None]
    best = sum(oracle for _, oracle in pairs)
    figures["gain kept"] = _number(sum(gain for gain, _ in pairs) / best if best > 0.0 else None)
    return figures


def _wrong(one: Mark) -> bool:
    """One name is given, and it is neither the true one nor of its class."""
    return one.verdict == "named" and not one.first and not one.alias


def _told_as_set(one: Mark) -> bool:
    """Several names, the true one among them: more cannot be said."""
    return one.verdict == "set" and bool(one.covered) and len(one.names) > 1


def _share(answers: Sequence[bool | None]) -> Figure:
    known = [answer for answer in answers if answer is not None]
    if not known:
        return Figure(None, "-")
    low, high = wilson(sum(known), len(known))
    return Figure(sum(known) / len(known), f"{sum(known)}/{len(known)} = {sum(known) / len(known):.2f} "
                                           f"({low:.2f}-{high:.2f})", counts=(sum(known), len(known)))


def _mean(values: Sequence[float]) -> Figure:
    return _number(sum(values) / len(values) if values else None)


def _number(value: float | None) -> Figure:
    return Figure(value, "-" if value is None else f"{value:.2f}")


def _allowed(marks: Sequence[Mark], part: int) -> float | None:
    """Mean chance to detect, or (part > 0) of those detected the share that could be told right."""
    allowed = [one.allowed for one in marks if one.allowed is not None]
    detected = sum(one[0] for one in allowed)
    if not detected:
        return None
    return detected / len(allowed) if part == 0 else sum(one[part] for one in allowed) / detected
