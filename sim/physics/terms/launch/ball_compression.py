"""A squeezed ball rolls on a smaller radius than its own, and so spins faster."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class BallCompression(LaunchTerm):
    """spin / (1 - share); the speed of its centre stays."""

    name: ClassVar[str] = "ball_compression"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.3, 0.6, 0.0, "teams found that a squeezed ball rolls like one up to a third smaller",
                  Prior("linear", 0.0, 0.1, "foam balls are squeezed by a tenth to a half of their diameter, and "
                        "roll on somewhat less than what is left")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = ("The squeezed ball rolls on a smaller radius than its own, so that it leaves with more "
                               "spin.")

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(spin_rev_s=exit.spin_rev_s / (1.0 - values["share"]))
