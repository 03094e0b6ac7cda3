"""Balls that differ: some leave always a little faster than others."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class BallSpread(LaunchTerm):
    """exit speed x (1 + spread x the ball's own departure), a standard normal number that nobody knows."""

    name: ClassVar[str] = "ball_spread"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("spread", "1", 0.0, 0.3, 0.0, "masses and stiffnesses of like balls differ by up to a tenth, new "
                  "ones included",
                  Prior("linear", 0.0, 0.03, "two to five per cent of exit speed between balls of one kind")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The balls differ: each has a speed of its own, faster or slower than the others."
    follows: ClassVar[str | None] = "ball"

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * (1.0 + values["spread"]))
