"""A ball that loses its spin in flight."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import jax.numpy as jnp

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import AirTerm, BallState, Parameter, Prior
from truearc.sim.physics.vector import scale


@final
@dataclass(frozen=True)
class SpinDecay(AirTerm):
    """spin = spin at release x exp(-rate_per_s x time since release)."""

    name: ClassVar[str] = "spin_decay"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate_per_s", "1/s", 0.0, 5.0, 0.0, "golf balls lose 3 to 4 per cent a second; by the law seen for "
                  "baseballs (Nathan 2008) a light ball of 18 cm at 10 m/s a quarter",
                  Prior("linear", 0.0, 0.4, "from golf's hundredths to the quarter by that law, and twice as much "
                        "for foam")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The ball loses spin in flight."

    def meet(self, facts: Rig, values: Mapping[str, Any], ball: BallState) -> BallState:
        left = jnp.exp(-values["rate_per_s"] * ball.time_s)
        return ball._replace(spin_rev_s=scale(left, ball.spin_rev_s))
