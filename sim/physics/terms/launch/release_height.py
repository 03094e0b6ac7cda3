"""A ball that leaves the wheels higher or lower than stated."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class ReleaseHeight(LaunchTerm):
    """The flight starts above_m over rig.toml's release height."""

    name: ClassVar[str] = "release_height"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("above_m", "m", -0.5, 0.5, 0.0, "the ball lets go of the last wheel a few centimetres before or "
                  "after the drawing's point",
                  Prior("linear", 0.0, 0.04, "half a ball's radius, by how it is held and how the robot sits on its "
                        "wheels")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = "The ball leaves higher or lower than the stated release height."

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(above_m=exit.above_m + values["above_m"])
