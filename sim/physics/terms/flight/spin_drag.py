"""Drag that grows with the square of the spin."""

import math

from truearc.sim.physics.term import BallState, FlightTerm, Forces, Rig, Values, Vec
from truearc.sim.physics.term_fields import NUMBER, Instrument, Parameter, Phrase, Prior
from truearc.sim.physics.vector import dot, length, scale, times


class SpinDrag(FlightTerm):
    """cd grows by share S^2 with S = 2 pi r spin / speed: a = -(share S^2) (rho A / 2 m) v^2 against the velocity."""

    order = 130, "a force by itself, which shares of drag leave alone"
    parameters = (Parameter(
        "share", "1", -2.0, 5.0, 0.0, "golf balls and baseballs have it; tennis balls in the tunnel, though not in "
        "free flight (Cross & Lindsey 2013)",
        Prior("linear", 0.0, 0.3, "tunnel data of spinning balls rise by about as much as S squared"),
        meaning="growth of the drag coefficient with the spin parameter squared"),)
    direction = "along"
    symmetry = "any"
    label = "drag by spin"
    sentence = "The air slows a spinning ball more than one without spin."
    phrase = Phrase("a spinning ball has more drag: its coefficient is {} larger where the ball's rim turns as fast as "
                    "it flies", "a spinning ball has less drag: its coefficient is {} smaller where the ball's rim "
                    "turns as fast as it flies", *NUMBER)
    instrument = Instrument("shots_without_spin", "where five shots without spin go", 0.15)

    def acceleration(self, facts: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        rim_m_s = 2.0 * math.pi * facts.ball.radius_m
        area_m2 = math.pi * facts.ball.radius_m**2
        per_m = values["share"] * (0.5 * area_m2 * facts.air.density_kg_m3 / facts.ball.mass_kg * rim_m_s**2)
        pace = dot(ball.spin_rev_s, ball.spin_rev_s) / length(ball.velocity_m_s)
        return scale(times(-1.0, times(per_m, pace)), ball.velocity_m_s)
