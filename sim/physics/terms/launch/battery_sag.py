"""Balls that leave faster or slower with the battery, at the same wheel speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class BatterySag(LaunchTerm):
    """exit speed x (1 + sensitivity x (battery voltage / its median - 1))."""

    name: ClassVar[str] = "battery_sag"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sensitivity", "1", -2.0, 2.0, 0.0, "a motor holds its speed under the ball's load with the voltage "
                  "that is left over",
                  Prior("linear", 0.0, 0.3, "a tenth of the voltage costs a few per cent of the speed; all of it, "
                        "were there no control, a tenth")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "A weaker battery gives a slower ball at the same wheel speed."
    follows: ClassVar[str | None] = "battery"

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * (1.0 + values["sensitivity"]))
