"""A target that stands higher or lower than stated."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.sim.physics.term import ArrivalTerm, Opening, Parameter, Prior


@final
@dataclass(frozen=True)
class TargetHeight(ArrivalTerm):
    """The opening's centre is rise_m over rig.toml's."""

    name: ClassVar[str] = "target_height"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rise_m", "m", -1.0, 1.0, 0.0, "fields are built to a few centimetres, floors are not level",
                  Prior("linear", 0.0, 0.04, "a few centimetres by tape and floor")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = "The target stands higher or lower than stated."

    def arrive(self, values: Mapping[str, Any], opening: Opening) -> Opening:
        return opening._replace(centre_m=opening.centre_m + values["rise_m"])
