"""Wheels that slip on the ball, the more the faster they turn: there is less time to bring it up to speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class WheelSlip(LaunchTerm):
    """exit speed = u / (1 + k u) with u the speed by the wheels: a share k u lost while that is small.

    The quotient rather than u (1 - k u): faster wheels never give a slower ball.
    """

    name: ClassVar[str] = "wheel_slip"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss_per_m_s", "s/m", 0.0, 0.05, 0.0, "the share of surface speed that team 971's balls left with "
                                                         "differed by 0.2 over its range of speeds",
                  Prior("linear", 0.0, 0.015, "0.015 s/m is 15 % lost at 10 m/s, about as much as was seen to depend "
                                              "on speed; around zero, for the constant part is another term's")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The wheels slip on the ball, the more the faster they turn."

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s / (1.0 + values["loss_per_m_s"] * exit.speed_m_s))
