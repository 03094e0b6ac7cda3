"""Balls whose drag changes as they wear."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, scale


@final
@dataclass(frozen=True)
class DragWear(FlightTerm):
    """drag x (1 + share x age); age runs from 0 to 1 through the session, or through a ball's own shots."""

    name: ClassVar[str] = "drag_wear"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.9, 2.0, 0.0, "worn tennis balls have clearly less drag than new ones (Goodwill "
                  "2004); torn foam has more",
                  Prior("linear", 0.0, 0.1, "none to fifteen per cent in a session, in either direction")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The drag of the balls changes the more they have been shot."
    follows: ClassVar[str | None] = "age"

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        return scale(values["share"], forces["drag"]) if "drag" in forces else Vec(0.0, 0.0, 0.0)
