"""Heights at the plane as smooth functions of parameters and of small deviations of the launch (JAX, forward mode)."""

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from robot.facts import Facts
from sim.fit.given import Given
from sim.physics.catalogue import flight_terms, launch_terms
from sim.physics.flight import fly
from sim.physics.launch import Exit
from sim.physics.scales import from_scale
from sim.physics.shot import leave
from sim.physics.term import FlightTerm

# Coarser than sim.physics.flight's own: heights within 1e-4 m, which no shot's scatter notices, at a tenth of the cost.
STEP_S, TURN_RAD = 0.03, 0.15
LIMIT_S = 8.0                         # a ball that takes longer has fallen hundreds of metres

Values = Mapping[str, Mapping[str, Any]]


class Deviation(NamedTuple):
    """What makes one shot differ from its configuration; numbers, or arrays [n]."""

    log_speed: Any
    elevation_rad: Any
    spin_rev_s: Any
    distance_m: Any


NONE = Deviation(0.0, 0.0, 0.0, 0.0)


def height_at(facts: Facts, values: Values, given: Given, deviation: Deviation = NONE) -> Any:
    """Height at the plane [n] in m, through the floor if need be; nan where the ball turns back.

    values: {term: {parameter: value}}, gravity always among them. `deviation` acts on the ball as it leaves.
    """
    terms: tuple[FlightTerm, ...] = flight_terms({"gravity", *values})
    exit = leave(facts, values, Exit(*map(jnp.asarray, given.rolling)), given.rolled)
    leaving = Exit(exit.speed_m_s * jnp.exp(deviation.log_speed),
                   exit.elevation_rad + deviation.elevation_rad, exit.spin_rev_s + deviation.spin_rev_s)
    params = {name: part for name, part in values.items() if name not in {term.name for term in launch_terms(values)}}
    return fly(facts, terms, params, leaving, given.distance_m + deviation.distance_m, step_s=STEP_S,
               turn_rad=TURN_RAD, limit_s=LIMIT_S, floor=False).height_m


def speed_gain(facts: Facts, values: Values, given: Given) -> Any:
    """d log(exit speed) / d log(speed by the wheels) [n]: 1 where there is no launch term that depends on the speed."""
    def log_speed(change: Any) -> Any:
        exit = Exit(*map(jnp.asarray, given.rolling))
        return jnp.log(leave(facts, values, exit._replace(speed_m_s=exit.speed_m_s * jnp.exp(change)),
                             given.rolled).speed_m_s)

    return jax.jacfwd(log_speed)(0.0)


class Slopes(NamedTuple):
    """Height [n] and its derivatives: by a Deviation [n, 4], by numbers on the parameters' scales [n, p]."""

    height_m: np.ndarray
    by_launch: np.ndarray
    by_number: np.ndarray
    gain: np.ndarray


Number = tuple[str, str, str]         # term, parameter, scale


@partial(jax.jit, static_argnames=("facts", "numbers"))
def slopes_at(facts: Facts, fixed: Values, numbers: tuple[Number, ...], at: Any, given: Given) -> Slopes:
    """Heights and exact derivatives; `numbers` names what `at` [p] holds, `fixed` the values of the rest."""
    def height(number: Any, launch: Any) -> Any:
        return height_at(facts, with_numbers(fixed, numbers, number), given, Deviation(*launch))

    launch = jnp.zeros(4)
    by_number, by_launch = jax.jacfwd(height, argnums=(0, 1))(at, launch)
    return Slopes(height(at, launch), by_launch, by_number, speed_gain(facts, with_numbers(fixed, numbers, at), given))


def with_numbers(fixed: Values, numbers: tuple[Number, ...], at: Any) -> dict[str, dict[str, Any]]:
    """`fixed` with the numbers' values in it."""
    values = {name: dict(part) for name, part in fixed.items()}
    for index, (term, parameter, scale) in enumerate(numbers):
        values.setdefault(term, {})[parameter] = from_scale(scale, at[index])
    return values


def sensor_variance(by_launch: Any, gain: Any, given: Given) -> Any:
    """Variance of the height [n] in m2 that the instruments' noise makes: wheels, elevation, distance."""
    wheels = (by_launch[:, 0] * gain)[:, None] * given.wheel_log_speed + by_launch[:, 2:3] * given.wheel_spin_rev_s
    others = (by_launch[:, 1] * given.elevation_sd_rad)**2 + (by_launch[:, 3] * given.distance_sd_m)**2
    return (wheels**2).sum(1) + others
