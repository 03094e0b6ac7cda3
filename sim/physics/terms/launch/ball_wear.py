"""Balls that wear in the course of a session, and so leave slower."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class BallWear(LaunchTerm):
    """exit speed x (1 - loss x age); age runs from 0 to 1 through the session, or through a ball's own shots."""

    name: ClassVar[str] = "ball_wear"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss", "1", -0.5, 0.5, 0.0, "balls of a season are visibly smaller and torn at its end",
                  Prior("linear", 0.0, 0.03, "none to five per cent of exit speed in a session")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The balls leave slower, or faster, the more they have been shot."
    follows: ClassVar[str | None] = "age"

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * (1.0 - values["loss"]))
