"""Unexplained effects: a free change of the launch, the distance or the flight, as fitted.

Each amplitude is multiplied by the circumstance of the term's name, which truearc.sim.infer.belief works out for every
shot. They are not hypotheses: no discovery tests them. A curve's points are numbers like a term's:
"curve.free_speed.0", ...
"""

import math
from typing import Any, ClassVar

import jax.numpy as jnp

from truearc.sim.physics import term
from truearc.sim.physics.term import Parameter
from truearc.sim.physics.vector import Vec, axes, length

FOUND = "as discovery found it in recordings"
AT_SPEED_M_S = 10.0                   # where a push that goes with the speed is stated
CURVE = "curve"
POINT = Parameter("point", "1", -math.inf, math.inf, 0.0, FOUND)


class Nameless(term.Term):
    """`usual`: one standard deviation of a curve's point before any data, in the unit of the amplitude."""

    usual: ClassVar[float]


class FreeSpeed(Nameless, term.LaunchTerm):
    """exit speed times exp(share)."""

    parameters = (Parameter("share", "1", -5.0, 5.0, 0.0, FOUND),)
    sentence = "The ball leaves faster or slower, for an unexplained reason."
    follows = "free_speed"
    usual = 0.2
    label = "a curve of the launch speed"

    def leave(self, rig: term.Rig, values: term.Values, exit: term.Exit) -> term.Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * jnp.exp(values["share"]))


class FreeElevation(Nameless, term.LaunchTerm):
    """exit elevation plus angle_rad."""

    parameters = (Parameter("angle_rad", "rad", -1.5, 1.5, 0.0, FOUND),)
    sentence = "The ball leaves steeper or flatter, for an unexplained reason."
    follows = "free_elevation"
    usual = 0.0175
    label = "a curve of the launch elevation"

    def leave(self, rig: term.Rig, values: term.Values, exit: term.Exit) -> term.Exit:
        return exit._replace(elevation_rad=exit.elevation_rad + values["angle_rad"])


class FreeDistance(Nameless, term.SensingTerm):
    """true distance = measured + bias_m."""

    parameters = (Parameter("bias_m", "m", -20.0, 20.0, 0.0, FOUND),)
    sentence = "The target is farther or nearer than measured, for an unexplained reason."
    follows = "free_distance"
    usual = 0.12
    label = "a curve of the distance"

    def sense(self, rig: term.Rig, values: term.Values, exit: term.Exit, distance_m: Any) -> tuple[term.Exit, Any]:
        return exit, distance_m + values["bias_m"]


class FreePush(Nameless, term.FlightTerm):
    """An acceleration size_m_s2 along, up across and left of the velocity by the shares of those names, between two
    times of the flight; times (speed / 10 m/s)^with_speed."""

    parameters = (
        Parameter("size_m_s2", "m/s2", -100.0, 100.0, 0.0, FOUND),
        *(Parameter(side, "1", -1.0, 1.0, 0.0, "a direction cosine") for side in ("along", "up", "left")),
        Parameter("from_s", "s", 0.0, 60.0, 0.0, "since release"),
        Parameter("to_s", "s", 0.0, 60.0, 60.0, "since release"),
        Parameter("with_speed", "1", 0.0, 1.0, 0.0, "0 or 1"))
    sentence = "An unexplained force pushes the ball in flight."
    follows = "free_push"
    usual = 1.5
    label = "a curve of a push"

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        at_work = (ball.time_s >= values["from_s"]) & (ball.time_s < values["to_s"])
        size = values["size_m_s2"] * at_work * (length(ball.velocity_m_s) / AT_SPEED_M_S)**values["with_speed"]
        sides = zip(axes(ball.velocity_m_s), ("along", "up", "left"), strict=True)
        parts = [Vec(*(size * values[name] * part for part in side)) for side, name in sides]
        return Vec(*(sum(components[1:], components[0]) for components in zip(*parts, strict=True)))


NAMELESS: tuple[Nameless, ...] = (FreeDistance(), FreeSpeed(), FreeElevation(), FreePush())


def find_nameless(name: str) -> Nameless:
    """Return the unexplained effect of this name; KeyError where there is none."""
    return {one.name: one for one in NAMELESS}[name]
