"""Wheels that run faster or slower than they read, or are larger or smaller than stated."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import Parameter, Prior, SensingTerm


@final
@dataclass(frozen=True)
class EncoderScale(SensingTerm):
    """true surface speeds = measured x (1 + share), and with them exit speed and spin."""

    name: ClassVar[str] = "encoder_scale"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.2, 0.2, 0.0, "a wheel of stated diameter wears and grows with speed; encoders "
                  "themselves are exact but for a wrong ratio",
                  Prior("linear", 0.0, 0.01, "a millimetre on a wheel of four inches is one per cent")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = ("The wheels run at other surface speeds than their encoders and stated diameters say, "
                               "by the same share.")

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        factor = 1.0 + values["share"]
        return exit._replace(speed_m_s=exit.speed_m_s * factor, spin_rev_s=exit.spin_rev_s * factor), distance_m
