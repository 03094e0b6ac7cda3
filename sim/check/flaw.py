"""Flaws of a dataset, and what makes speeds of wheels impossible: units, gears, motors taken for wheels, lone shots."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool
from msgspec import structs

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Floats, Shots
from truearc.sim.data.table import WHEEL
from truearc.sim.physics.simulate import launch_state

LENGTHS = {"millimetres": ("mm", 1e-3), "centimetres": ("cm", 0.01), "inches": ("in", 0.0254), "feet": ("ft", 0.3048)}
RPM = math.pi / 30.0
TRACKS = 3                            # fewest tracks, angles and heights that are judged
MOTORS = "the motors' speeds, before the gears, given as the wheels'"
GEARS = "gears upside down: launcher.wheel.gear is wheel speed / motor speed"
SPEEDS = "launcher.free_speed_rad_s, or the wheels' speeds, in revolutions per "
DROOPS = 1.3                          # a wheel's speed by its motor's, or the inverse, under load and by slack belts
# logs of the speed of scoring shots by the least that carries a ball so far in vacuum
APART, NEAR, LIKE = 0.3, 0.12, 0.25   # by which shots are far from the others, near, and like them,
ALL_BUT, BETWEEN = 0.8, 0.15          # at least this share of those that are far, and at most that many in between
LONE, FEW, LISTED = 0.5, 0.1, 5       # by which single shots are far, largest share of them, and how many are named
UNIT = 0.2                            # of the log of the ratio, by which a wrong unit is likelier than a wrong part
ALIKE = 1.2                           # causes that fit as well to within this are named together


class Flaw(NamedTuple):
    """One implausible thing: which check, the file and key, and a sentence with what to do."""

    check: str
    place: str
    what: str
    warns: bool = False               # it may well be true

    def __str__(self) -> str:
        return f"{self.place}: {self.what}"


def speed_causes(rig: Rig, shots: Shots) -> dict[str, float]:
    """What may be wrong of the wheels, and by what share of the recorded one a ball then leaves."""
    causes = {f"{SPEEDS}minute": RPM, f"{SPEEDS}second": 2.0 * math.pi, "a wheel's diameter given as its radius": 0.5,
              "half of a wheel's radius or gear given as the whole": 2.0}
    if np.isfinite(shots.number("motor_ratio")).any() and not any(map(WHEEL.fullmatch, shots.numbers)):
        causes["half of launcher.free_speed_rad_s or of motor_ratio"] = 2.0
    geared = {(name := f"wheel_{wheel.name}_rad_s"): wheel.gear * shots.number(name) for wheel in rig.launcher.wheel}
    turned = structs.replace(rig.launcher, wheel=tuple(
        structs.replace(wheel, gear=1.0 / (wheel.gear or math.inf)) for wheel in rig.launcher.wheel))
    before, *others = (launch_state(*one).get("exit_speed_m_s", np.full(len(shots), np.nan)) for one in (
        (rig, shots), (rig, replace(shots, numbers={**shots.numbers, **geared})),
        (structs.replace(rig, launcher=turned), shots)))
    for cause, after in zip((MOTORS, GEARS), others, strict=True):
        moved = after[before > 0.0] / before[before > 0.0]
        if len(moved) and abs(np.median(moved) - 1.0) > 0.05:
            causes[cause] = float(np.median(moved))
    return causes


def likeliest(found: Mapping[str, float], within: tuple[float, float], typical: float, otherwise: str) -> str:
    """The causes by which a ratio would be most typical, of those by which it can be."""
    off = {cause: abs(math.log(ratio / typical)) - UNIT * (" in " in cause) for cause, ratio in found.items()
           if within[0] <= ratio <= within[1]}
    best = min(off.values(), default=0.0)
    return " or ".join(sorted((cause for cause in off if off[cause] < best + math.log(ALIKE) + 1e-9),
                              key=lambda cause: off[cause])[:3]) or otherwise


def judge_wheels(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """Speeds of wheels that their motors' contradict, or that are one motor's although their gears differ."""
    ratio, free_rad_s = shots.number("motor_ratio"), rig.launcher.free_speed_rad_s or math.nan
    named = [(wheel, f"wheel_{wheel.name}_rad_s") for wheel in rig.launcher.wheel if wheel.gear]
    for wheel, name in named:
        shares = np.abs(shots.number(name) / np.where(ratio > 0.0, ratio * wheel.gear * free_rad_s, np.nan))
        share = float(np.median(known)) if len(known := shares[np.isfinite(shares)]) >= TRACKS else 1.0
        if share <= 0.0 or abs(math.log(share)) < math.log(DROOPS):
            continue
        stem = name.removesuffix("_rad_s")
        likely = likeliest({f"revolutions per minute; rename the column to {stem}_rpm": share * RPM,
                            f"revolutions per second; rename the column to {stem}_rev_s": share * 2.0 * math.pi,
                            f"the motor's speed; multiply it by the gear, {wheel.gear:g}": share * abs(wheel.gear)},
                           (1.0 / DROOPS, DROOPS), 1.0, "")
        if likely:
            yield Flaw("wheels", f"{shots.source}: {name}", f"is {share:.3g} times the speed by motor_ratio, free "
                       f"speed and gear; this looks like {likely}")
    columns = [shots.number(name) for _, name in named]
    gears = [abs(wheel.gear) for wheel, _ in named]
    if (len(columns) > 1 and np.isfinite(columns[0]).sum() >= TRACKS and max(gears) > DROOPS * min(gears)
            and all(np.allclose(columns[0], one, equal_nan=True) for one in columns[1:])):
        yield Flaw("wheels", f"{shots.source}: {', '.join(name for _, name in named)}", "are equal although the "
                   "wheels' gears differ; make sure that they are not the motors', before the gears", warns=True)


def mixed_units(ratio: Floats, other: Callable[[Bool[np.ndarray, " n"], float], Floats]) -> str:
    """What to say where some shots' ratios are like the others' only with their distances in another unit."""
    gets_there = ratio > 0.0
    if gets_there.mean() < ALL_BUT / 2.0:
        return ""
    usual = float(np.quantile(ratio[gets_there], 0.75))
    off = np.abs(np.log(np.maximum(ratio, 1e-9) / usual))
    far = off > APART
    if (off[~far] > NEAR).mean() > BETWEEN:
        return ""                     # not two kinds of shots, but one that varies
    read = [(metres, name, suffix) for name, (suffix, metres) in LENGTHS.items()]
    read += [(1.0 / metres, f"metres among {name}", "m") for name, (_, metres) in LENGTHS.items()]
    for scale, name, suffix in read if far.sum() >= TRACKS else ():
        if (np.abs(np.log(np.maximum(other(far, scale), 1e-9) / usual)) < LIKE).mean() > ALL_BUT:
            return (f"{far.sum()} of {len(far)} scoring shots look as if their distances were {name}: "
                    f"convert these, for instance in a file of their own with a column distance_{suffix}")
    return ""


def lone_shots(ratio: Floats, names: Sequence[str]) -> str:
    """What to say of a few scoring shots whose ratio is far from that of all others, which are alike."""
    off = np.abs(np.log(np.maximum(ratio, 1e-9) / np.median(ratio))) if np.median(ratio) > 0.0 else np.zeros(len(ratio))
    far = off > LONE
    if not far.any() or far.mean() > FEW or np.quantile(off[~far], 0.9) > APART:
        return ""
    shown = ", ".join(f"{name} ({share:.2g} times)" for name, share in zip(
        [name for name, one in zip(names, far, strict=True) if one][:LISTED], (ratio / np.median(ratio))[far],
        strict=False))
    return (f"scoring shots whose speed is far from what the others needed for their distance and angle: {shown}"
            f"{', ...' if far.sum() > LISTED else ''}; make sure of these rows")
