"""Balls fired before the wheels have recovered from the last one."""

import jax.numpy as jnp

from truearc.sim.physics.term import Circumstances, SpeedTerm, Values
from truearc.sim.physics.term_fields import SHARE, Instrument, Parameter, Prior, amplitude, either_way


class RapidFire(SpeedTerm):
    """exit speed x (1 - loss x exp(-time since the session's last shot / time_constant_s))."""

    order = 80, "a factor of the speed; these commute"
    parameters = (
        *amplitude("loss", "1", -0.5, 0.5, sd=0.05, meaning="share of the speed lost right after another shot",
                   source="teams see the second of two quick shots fall short by a few per cent of speed",
                   reason="a wheel dips by up to a tenth, and its reading recovers before the ball's grip does"),
        Parameter("time_constant_s", "s", 0.05, 10.0, 0.7, "wheels under control come back within 0.3 to 2 s",
                  Prior("log", 0.7, 0.6, "0.2 to 2.3 s at two sigma, by motor, inertia and gains"),
                  meaning="time in which that fades to a third"))
    record = "t_s or since_last_shot_s of each shot"
    positive = 0.9                    # wheels that had no time to recover are slower
    sentence = "A shot soon after another leaves slower: the wheels have not recovered."
    phrase = either_way("a shot right after another leaves {} <slower|faster>", SHARE)
    instrument = Instrument("shots_short_long_pause", "the same shot after 1 s and after 10 s", 0.02)

    def at_shot(self, values: Values, circumstances: Circumstances) -> Values:
        left = jnp.exp(-circumstances.since_last_shot_s / values["time_constant_s"])
        return {**values, "loss": values["loss"] * left}
