"""What may be wrong of wheels' speeds, and speeds of wheels beside those of their motors."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from msgspec import structs

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.columns import WHEEL
from truearc.sim.data.model import Shots
from truearc.sim.infer.plausibility.flaw import RPM, TRACKS, Flaw
from truearc.sim.physics.simulate import launch_state

MOTORS = "the motors' speeds, before the gears, given as the wheels'"
GEARS = "gears upside down: launcher.wheel.gear is wheel speed / motor speed"
SPEEDS = "launcher.free_speed_rad_s, or the wheels' speeds, in revolutions per "
DROOPS = 1.3                          # a wheel's speed by its motor's, or the inverse, under load and by slack belts
UNIT = 0.2                            # of the log of the ratio, by which a wrong unit is likelier than a wrong part
ALIKE = 1.2                           # causes that fit as well to within this are named together


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
