"""A ball that leaves slower than the wheels' surfaces run: energy lost in squeezing it and in spinning it up."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class ExitEfficiency(LaunchTerm):
    """exit speed = speed by the wheels x (1 - loss), the same share at every speed; the spin is left as it is."""

    name: ClassVar[str] = "exit_efficiency"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss", "1", 0.0, 0.9, 0.0, "team 971 measured 13 to 33 % below surface speed",
                  Prior("left", 0.2, 0.2, "67 to 87 % of surface speed were measured with wheels above and "
                                          "below; 0.2 on the log of what is left is 54 to 98 % at two sigma")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The ball leaves slower than the wheels' surfaces run, by the same share at every speed."

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * (1.0 - values["loss"]))
