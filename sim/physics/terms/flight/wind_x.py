"""Air that moves toward the target, or away from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import AirTerm, BallState, Parameter, Prior
from truearc.sim.physics.vector import plus, times


@final
@dataclass(frozen=True)
class WindX(AirTerm):
    """The ball's velocity through the air is its own less speed_m_s toward the target."""

    name: ClassVar[str] = "wind_x"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("speed_m_s", "m/s", -10.0, 10.0, 0.0, "halls have draughts of 0.1 to 0.3 m/s, fields winds of 1 to 3 "
                  "m/s",
                  Prior("linear", 0.0, 0.8, "a hall's draught to a light breeze; more would be felt")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = "There is wind toward the target, or from it."

    def meet(self, facts: Rig, values: Mapping[str, Any], ball: BallState) -> BallState:
        through = ball.velocity_m_s
        return ball._replace(velocity_m_s=through._replace(x=plus(through.x, times(-1.0, values["speed_m_s"]))))
