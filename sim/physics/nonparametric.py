"""What an effect without a name does: a free change of the launch, the distance or the flight, as fitted.

Each amplitude is multiplied by the circumstance of the term's name, which truearc.sim.infer.curve works out for every
shot. They are no hypotheses: no discovery asks about them. A curve's points are numbers like a term's:
"curve.free_speed.0", ...
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import jax.numpy as jnp

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.frame import axes
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import BallState, FlightTerm, LaunchTerm, Parameter, SensingTerm, Term
from truearc.sim.physics.vector import Vec, length

FOUND = "as discovery found it in recordings"
AT_SPEED_M_S = 10.0                   # where a push that goes with the speed is stated
CURVE = "curve"
POINT = Parameter("point", "1", -math.inf, math.inf, 0.0, FOUND)


@final
@dataclass(frozen=True)
class FreeSpeed(LaunchTerm):
    """exit speed times exp(share)."""

    name: ClassVar[str] = "free_speed"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("share", "1", -5.0, 5.0, 0.0, FOUND),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The ball leaves faster or slower, for a reason without a name."
    follows: ClassVar[str | None] = "free_speed"

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * jnp.exp(values["share"]))


@final
@dataclass(frozen=True)
class FreeElevation(LaunchTerm):
    """exit elevation plus angle_rad."""

    name: ClassVar[str] = "free_elevation"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("angle_rad", "rad", -1.5, 1.5, 0.0, FOUND),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The ball leaves steeper or flatter, for a reason without a name."
    follows: ClassVar[str | None] = "free_elevation"

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(elevation_rad=exit.elevation_rad + values["angle_rad"])


@final
@dataclass(frozen=True)
class FreeDistance(SensingTerm):
    """true distance = measured + bias_m."""

    name: ClassVar[str] = "free_distance"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("bias_m", "m", -20.0, 20.0, 0.0, FOUND),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The target is farther or nearer than measured, for a reason without a name."
    follows: ClassVar[str | None] = "free_distance"

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit, distance_m + values["bias_m"]


@final
@dataclass(frozen=True)
class FreePush(FlightTerm):
    """An acceleration size_m_s2 along, up across and left of the velocity by the shares of those names, between two
    times of the flight; times (speed / 10 m/s)^with_speed."""

    name: ClassVar[str] = "free_push"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("size_m_s2", "m/s2", -100.0, 100.0, 0.0, FOUND),
        *(Parameter(side, "1", -1.0, 1.0, 0.0, "a direction cosine") for side in ("along", "up", "left")),
        Parameter("from_s", "s", 0.0, 60.0, 0.0, "since release"),
        Parameter("to_s", "s", 0.0, 60.0, 60.0, "since release"),
        Parameter("with_speed", "1", 0.0, 1.0, 0.0, "0 or 1"))
    symmetry: ClassVar[str] = "vertical"
    sentence: ClassVar[str] = "Something without a name pushes the ball in flight."
    follows: ClassVar[str | None] = "free_push"

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        at_work = (ball.time_s >= values["from_s"]) & (ball.time_s < values["to_s"])
        size = values["size_m_s2"] * at_work * (length(ball.velocity_m_s) / AT_SPEED_M_S)**values["with_speed"]
        sides = zip(axes(ball.velocity_m_s), ("along", "up", "left"), strict=True)
        parts = [Vec(*(size * values[name] * part for part in side)) for side, name in sides]
        return Vec(*(sum(components[1:], components[0]) for components in zip(*parts, strict=True)))


NAMELESS: tuple[Term, ...] = (FreeDistance(), FreeSpeed(), FreeElevation(), FreePush())
