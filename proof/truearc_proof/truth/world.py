"""One concealed world: what is true, what is believed, and how badly it is seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Target, Wheel, WorldFacts
from truearc_proof.truth.effects import check_effects

LEVELS = ("L0", "L1", "L2")
BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")
DIRT = ("track_memory", "balls", "outliers", "noise_understated", "noise_overstated", "missing_frames", "clipped",
        "battery_with_wear")
TRACK_DIRT = ("track_memory", "missing_frames", "clipped")
NOISE = Noise(distance_m=0.03, hood_deg=0.2, wheel_rad_s=0.5, track_m=0.015)
FEWEST = 10


@dataclass(frozen=True)
class Scatter:
    """From shot to shot, standard deviations: speed and spin relative, angles in degrees."""

    speed: float = 0.015
    elevation_deg: float = 0.4
    azimuth_deg: float = 0.4
    spin: float = 0.05
    wheel: float = 0.003              # the speed loop's own error, relative, both wheels alike


@dataclass(frozen=True)
class World:
    """The truth of a world. `facts`: rig.toml as the solver gets it; `noise`: the sensors as they really are."""

    seed: int
    level: str
    shots: int
    facts: Rig
    cd: float
    lift_slope: float                 # k in lift coefficient = k S, S = r w / v
    efficiency: float                 # exit speed / mean surface speed of the wheels
    effects: Mapping[str, float] = field(default_factory=dict)
    dirt: tuple[str, ...] = ()
    scatter: Scatter = Scatter()
    noise: Noise = NOISE
    side: bool = False                # high or low is known of what is not a three

    def amount(self, name: str) -> float:
        """Amplitude of an effect; 0 when it is not at work."""
        return self.effects.get(name, 0.0)

    def rng(self, what: int) -> np.random.Generator:
        """Random numbers for one purpose: worlds that differ in effects alone share every draw."""
        return np.random.default_rng([self.seed, what])


def make_world(effects: Mapping[str, float] | None = None, level: str = "L0", shots: int = 300, seed: int = 0,
               dirt: Sequence[str] = (), believe: Sequence[str] = BELIEVED, side: bool = False) -> World:
    """A world of the paper's two-wheel rig, its coefficients drawn from `seed`.

    effects: {name: amplitude in the unit of truearc_proof.truth.effects}. Terms missing in `believe` are true all the
    same (that is a way of hiding drag, lift, or the loss of speed). InputError for an unknown level, effect or dirt.
    """
    for name in dirt:
        if name not in DIRT:
            raise InputError(f"there is no dirt {name!r}; there are {', '.join(DIRT)}")
    if level not in LEVELS:
        raise InputError(f"there is no level {level!r}; there are {', '.join(LEVELS)}")
    if shots < FEWEST or seed < 0:
        raise InputError(f"a world needs {FEWEST} shots and a seed of 0 or above, not {shots} and {seed}")
    rng = np.random.default_rng([seed, 0])
    cd, slope, efficiency = rng.uniform(0.40, 0.60), rng.uniform(0.35, 0.70), rng.uniform(0.70, 0.85)
    return World(seed, level, shots, _rig(dirt, believe), float(cd), float(slope), float(efficiency),
                 check_effects(effects or {}), tuple(dirt), side=side)


def _rig(dirt: Sequence[str], believe: Sequence[str]) -> Rig:
    """Return the paper's rig."""
    stated = 0.5 if "noise_understated" in dirt else 2.0 if "noise_overstated" in dirt else 1.0
    noise = Noise(NOISE.distance_m * stated, NOISE.hood_deg * stated, NOISE.wheel_rad_s * stated,
                  NOISE.track_m * stated)
    wheels = (Wheel("lower", 0.0508, 1.0, 180.0), Wheel("upper", 0.0349, 0.5625, 0.0))
    return Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, wheels), Target(2.44, 0.07, 0.35), Air(1.2),
                 WorldFacts(9.81), noise, Believe(tuple(believe)))


def as_table(world: World) -> dict[str, Any]:
    """Return the truth as plain values, for the grader."""
    return {"seed": world.seed, "level": world.level, "shots": world.shots, "cd": world.cd,
            "lift_slope": world.lift_slope, "efficiency": world.efficiency, "effects": dict(world.effects),
            "dirt": list(world.dirt), "believe": list(world.facts.believe.terms), "side": world.side}
