"""A rim that lets in balls that touch it, or throws out ones that should have gone in."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.sim.physics.term import ArrivalTerm, Opening, Parameter, Prior


@final
@dataclass(frozen=True)
class RimCatch(ArrivalTerm):
    """Both half heights of the opening grow by reach_m."""

    name: ClassVar[str] = "rim_catch"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("reach_m", "m", -0.05, 0.3, 0.0, "a ball that touches the rim goes in or out by a few centimetres of "
                  "its path",
                  Prior("linear", 0.0, 0.03, "none to five centimetres of a rim's or a net's give")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The rim lets in balls that touch it, as if the opening were larger."

    def arrive(self, values: Mapping[str, Any], opening: Opening) -> Opening:
        reach_m = values["reach_m"]
        return opening._replace(three_half_m=opening.three_half_m + reach_m, two_half_m=opening.two_half_m + reach_m)
