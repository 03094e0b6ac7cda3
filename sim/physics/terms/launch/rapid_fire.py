"""Balls fired before the wheels have recovered from the last one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import jax.numpy as jnp

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.conditions import Circumstances
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import LaunchTerm, Parameter, Prior


@final
@dataclass(frozen=True)
class RapidFire(LaunchTerm):
    """exit speed x (1 - loss x exp(-time since the session's last shot / time_constant_s))."""

    name: ClassVar[str] = "rapid_fire"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("loss", "1", -0.5, 0.5, 0.0, "teams see the second of two quick shots fall short by a few per cent "
                  "of speed",
                  Prior("linear", 0.0, 0.05, "a wheel dips by up to a tenth, and its reading recovers before the "
                        "ball's grip does")),
        Parameter("time_constant_s", "s", 0.05, 10.0, 0.7, "wheels under control come back within 0.3 to 2 s",
                  Prior("log", 0.7, 0.6, "0.2 to 2.3 s at two sigma, by motor, inertia and gains")))
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "A shot soon after another leaves slower: the wheels have not recovered."

    def at_shot(self, values: Mapping[str, Any], circumstances: Circumstances) -> dict[str, Any]:
        left = jnp.exp(-circumstances.since_last_shot_s / values["time_constant_s"])
        return {**values, "loss": values["loss"] * left}

    def leave(self, facts: Rig, values: Mapping[str, Any], exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * (1.0 - values["loss"]))
