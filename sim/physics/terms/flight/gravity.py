"""Weight (the seed's Eq. 1)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter
from truearc.sim.physics.vector import Vec


@final
@dataclass(frozen=True)
class Gravity(FlightTerm):
    """a = -g in z; `scale` multiplies the rig's own g and is 1 unless someone doubts it."""

    name: ClassVar[str] = "gravity"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("scale", "1", 0.0, 2.0, 1.0, "1 by definition; rig.toml states g"),)
    symmetry: ClassVar[str] = "vertical"
    sentence: ClassVar[str] = "The ball falls under its weight."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        return Vec(0.0, 0.0, -facts.world.gravity_m_s2 * values["scale"])
