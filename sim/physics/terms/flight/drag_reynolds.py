"""A drag coefficient that changes with speed (the Reynolds number of a given ball)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, length, scale


@final
@dataclass(frozen=True)
class DragReynolds(FlightTerm):
    """cd x (1 + slope (v / at_m_s - 1)): cd is the coefficient at at_m_s."""

    name: ClassVar[str] = "drag_reynolds"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("slope", "1", -1.0, 1.0, 0.0, "cd falls from 0.5 to 0.1-0.2 as rough balls pass Re 1e5 to 3e5 "
                  "(volleyballs: Hong 2020), and stays for tennis balls",
                  Prior("linear", 0.0, 0.3, "a ball of 18 cm at 8 to 15 m/s is just below that fall or at its foot")),
        Parameter("at_m_s", "m/s", 1.0, 30.0, 10.0, "a usual exit speed; it only says where cd is meant"))
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The drag coefficient changes with the ball's speed."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        if "drag" not in forces:
            return Vec(0.0, 0.0, 0.0)
        faster = length(ball.velocity_m_s) / values["at_m_s"] - 1.0
        return scale(values["slope"] * faster, forces["drag"])
