"""Grades -> tables in Markdown, beside the targets of the design."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from sim.intervals import wilson
from sim.prove.grade import Grade

Setting = tuple[str, int, float]      # level, shots, scale of effects


class Target(NamedTuple):
    """What the design asks for (section 8); `least`: the figure must reach it, else stay at or below it; `most`: and
    not go beyond this."""

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
    Target("top-1", True, goals(0.62, 0.70, 0.74, 0.82, 0.88) | PLAINLY),
    Target("up to alias", True, goals(0.74, 0.82, 0.78, 0.86, 0.95) | PLAINLY),
    Target("in the set", True, goals(0.90, 0.90, 0.90, 0.90, 0.90) | PLAINLY),
    Target("set size", False, goals(5.0, 3.5, 4.5, 2.5, 1.6)),
    Target("interval holds", True, goals(0.86, 0.86, 0.86, 0.86, 0.86), 0.94),
    Target("gain kept", True, goals(0.70, 0.82, 0.75, 0.87, 0.90)),
    Target("gain below 0", False, goals(0.05, 0.03, 0.05, 0.03, 0.02)),
    Target("called unknown", False, goals(0.10, 0.10, 0.10, 0.08, 0.05)),
    Target("named wrong", False, goals(0.10, 0.10, 0.10, 0.10, 0.05)),
    Target("off: unknown", True, goals(0.40, 0.55, 0.55, 0.70, 0.85) | {LARGE: 0.85}),
    Target("off: covariate and direction", True, {L2_300: 0.75, LARGE: 0.75}),
)
# The ceilings that the design's targets were set against (its section 4.4).
DESIGN_CEILING = {"detected": goals(0.53, 0.82, 0.56, 0.83, 0.80) | {PLAIN: 1.0},
                  "top-1": goals(0.70, 0.77, 0.81, 0.88, 0.92) | {PLAIN: 1.0},
                  "up to alias": goals(0.80, 0.88, 0.82, 0.90, 0.98) | {PLAIN: 1.0},
                  "stage": goals(0.79, 0.83, 0.88, 0.92, 0.99) | {PLAIN: 1.0}}
CEILINGS = {"detected": 0, "top-1": 1, "up to alias": 2, "stage": 3}      # places in sim.prove.ceiling.Ceiling
RESOLVABLE = 50.0                     # lambda, from which what has no name should be told as such (the design)
LOWEST_ALARMS, HIGHEST_ALARMS = 0.03, 0.07


class Share(NamedTuple):
    """Successes of trials."""

    yes: int
    of: int

    def words(self) -> str:
        low, high = wilson(self.yes, self.of)
        return f"{self.yes / self.of:.2f} ({low:.2f}-{high:.2f}), {self.of}" if self.of else "-"


def make_tables(grades: Sequence[Grade]) -> str:
    """Markdown: false alarms, then per setting every effect and the whole against the targets, then what it costs."""
    settings = sorted({(g.level, g.shots, g.scale) for g in grades if g.kind != "nulls"})
    parts = [_alarms([g for g in grades if g.kind == "nulls"])]
    for setting in settings:
        mine = [g for g in grades if g.kind != "nulls" and (g.level, g.shots, g.scale) == setting]
        parts += [_effects(setting, mine), _against_targets(setting, mine)]
    return "\n".join(part for part in [*parts, _seconds(grades)] if part)


def _alarms(grades: Sequence[Grade]) -> str:
    if not grades:
        return ""
    lines = ["## False alarms (nominal 0.05), share with Wilson 95 % and worlds", "",
             "| level, shots | null | false alarms | a name was given | 0.03-0.07 |", "|---|---|---|---|---|"]
    for level, shots in sorted({(g.level, g.shots) for g in grades}):
        here = [g for g in grades if (g.level, g.shots) == (level, shots)]
        for name in [*dict.fromkeys(g.name for g in here), "dirty together", "together"]:
            mine = [g for g in here if name == "together" or g.name == name
                    or (name == "dirty together" and g.name != "clean")]
            share = share_of(mine, lambda g: g.found)
            low, high = wilson(*share)
            inside = ("reached" if LOWEST_ALARMS <= share.yes / share.of <= HIGHEST_ALARMS else
                      "not told" if low <= HIGHEST_ALARMS and high >= LOWEST_ALARMS else "NO") if share.of else "-"
            named = share_of(mine, lambda g: g.verdict in ("named", "set"))
            lines.append(f"| {level}, {shots} | {name} | {share.words()} | {named.words()} | {inside} |")
    return "\n".join([*lines, ""])


def share_of(grades: Iterable[Grade], question: Callable[[Grade], bool | None]) -> Share:
    """How many answer yes, of those to whom the question applies."""
    answers = [answer for answer in map(question, grades) if answer is not None]
    return Share(sum(answers), len(answers))


def figures(grades: Sequence[Grade]) -> dict[str, float | None]:
    """The figures that targets are about; None where no world says."""
    catalogued = _asked_about(grades)
    found = [g for g in catalogued if g.found]
    off = [g for g in grades if g.kind == "off" and g.found and (g.strength is None or g.strength >= RESOLVABLE)]
    sizes = [g.set_size for g in found if g.set_size is not None]
    shares = {
        "detected": share_of(catalogued, lambda g: g.found), "stage": share_of(found, lambda g: g.stage_right),
        "top-1": share_of(found, lambda g: g.top_right), "up to alias": share_of(found, lambda g: g.alias_right),
        "in the set": share_of(found, lambda g: g.covered),
        "interval holds": share_of(found, lambda g: g.interval_holds),
        "gain below 0": share_of(found, lambda g: None if g.gain is None else g.gain < 0.0),
        "called unknown": share_of(found, lambda g: g.verdict == "unknown"),
        "named wrong": share_of(found, named_wrong), "off: unknown": share_of(off, lambda g: g.verdict == "unknown"),
        "off: covariate and direction": share_of(off, lambda g: g.goes_with_right)}
    values: dict[str, float | None] = {name: one.yes / one.of if one.of else None for name, one in shares.items()}
    values["set size"] = sum(sizes) / len(sizes) if sizes else None
    values["gain kept"] = gain_kept(found)
    return values


def _asked_about(grades: Iterable[Grade]) -> list[Grade]:
    """Hidden effects that are asked about at all: a tracker's errors are fitted with tracks, whoever has them."""
    return [g for g in grades if g.kind == "effects" and g.ceiling is not None]


def named_wrong(grade: Grade) -> bool:
    """One name is given, and it is neither the true one nor of its class."""
    return grade.verdict == "named" and not grade.top_right and not grade.alias_right


def gain_kept(grades: Iterable[Grade]) -> float | None:
    """Held-out gain as a share of what the true term would have given, all worlds together; None when none says."""
    pairs = [(g.gain, g.oracle_gain) for g in grades if g.gain is not None and g.oracle_gain is not None]
    best = sum(oracle for _, oracle in pairs)
    return sum(gain for gain, _ in pairs) / best if best > 0.0 else None


def _effects(setting: Setting, grades: Sequence[Grade]) -> str:
    level, shots, scale = setting
    lines = [f"## {level}, {shots} shots, effects x {scale:g}", "",
             "Detected with Wilson 95 % and worlds; the rest of those detected.", "",
             "| hidden | detected | ceiling | stage | top-1 | up to alias | in the set | set size | interval holds "
             "| verdicts | gain a shot | gain kept |", "|" + "---|" * 12]
    for kind, name in dict.fromkeys((g.kind, g.name) for g in sorted(grades, key=lambda g: g.kind)):
        mine = [g for g in grades if (g.kind, g.name) == (kind, name)]
        lines.append(_effect_line(f"{name}" if kind == "effects" else f"{name} ({kind})", mine))
    return "\n".join([*lines, ""])


def _effect_line(name: str, grades: Sequence[Grade]) -> str:
    found = [g for g in grades if g.found]
    sizes = [g.set_size for g in found if g.set_size is not None]
    gains = [g.gain for g in found if g.gain is not None]
    verdicts = ", ".join(f"{sum(g.verdict == one for g in grades)} {one}"
                         for one in dict.fromkeys(g.verdict for g in grades))
    cells = [name, share_of(grades, lambda g: g.found).words(), _number(ceiling_of(grades), 2), *(
        _plain(share_of(found, question)) for question in (
            lambda g: g.stage_right, lambda g: g.top_right, lambda g: g.alias_right, lambda g: g.covered)),
        _number(sum(sizes) / len(sizes) if sizes else None, 1), _plain(share_of(found, lambda g: g.interval_holds)),
        verdicts, _number(sum(gains) / len(gains) if gains else None, 3), _number(gain_kept(found), 2)]
    return "| " + " | ".join(cells) + " |"


def ceiling_of(grades: Iterable[Grade], part: int = 0) -> float | None:
    """What the information in these very data allows: the mean chance to detect, or (part > 0) of those detected the
    share whose likeliest term is the true one, of its class, of its stage."""
    ceilings = [g.ceiling for g in grades if g.ceiling is not None]
    if not ceilings:
        return None
    detected = sum(one[0] for one in ceilings)
    return detected / len(ceilings) if part == 0 else sum(one[part] for one in ceilings) / detected


def _plain(share: Share) -> str:
    return f"{share.yes}/{share.of}" if share.of else "-"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _against_targets(setting: Setting, grades: Sequence[Grade]) -> str:
    """Every figure beside what the data allow and what the design asks for: of its own ceiling, where it states one,
    since rigs differ in what they let through."""
    lines = [f"All of {setting[0]}, {setting[1]} shots, x {setting[2]:g}, against the design:", "",
             "| figure | reached here | these data allow | design's target | scaled to what these data allow | |",
             "|---|---|---|---|---|---|"]
    catalogued = _asked_about(grades)
    values = figures(grades)
    for target in TARGETS:
        value, wanted = values[target.figure], target.at.get(setting)
        allowed = ceiling_of(catalogued, CEILINGS[target.figure]) if target.figure in CEILINGS else None
        scaled = scaled_target(setting, target, allowed)
        said = ["-" if goal is None else words_of(target, goal) for goal in (wanted, scaled)]
        goal = wanted if scaled is None else scaled
        if value is None or goal is None:
            verdict = "not asked" if goal is None else "not measured"
        else:
            verdict = "reached" if is_reached(target, value, goal) else "NOT REACHED"
        lines.append(f"| {target.figure} | {_number(value, 3)} | {_number(allowed, 2)} | {said[0]} | {said[1]} "
                     f"| {verdict} |")
    return "\n".join([*lines, ""])


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


def _seconds(grades: Sequence[Grade]) -> str:
    lines = ["## Seconds a world", "", "| level, shots | worlds | median | slowest |", "|---|---|---|---|"]
    for level, shots in sorted({(g.level, g.shots) for g in grades}):
        taken = sorted(g.seconds for g in grades if (g.level, g.shots) == (level, shots))
        lines.append(f"| {level}, {shots} | {len(taken)} | {taken[len(taken) // 2]:.1f} | {taken[-1]:.1f} |")
    return "\n".join([*lines, ""])
