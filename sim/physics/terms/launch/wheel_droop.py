"""Wheels that slow down while the ball passes, so that it leaves slower than they ran before."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class WheelDroop(LaunchTerm):
    """exit speed x (1 - loss x droop); droop: dip of the wheels in this shot by the mean dip, 1 without telemetry."""

    name: ClassVar[str] = "wheel_droop"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss", "1", -0.5, 0.5, 0.0, "teams see their wheels dip by up to a tenth as a ball passes, the "
                  "lighter the wheel the more",
                  Prior("linear", 0.0, 0.05, "a ball takes its energy out of the wheels'; a tenth lost at two sigma")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The wheels slow down while the ball passes; the more they dip, the slower it leaves."
    follows: ClassVar[str | None] = "droop"

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * (1.0 - values["loss"]))
