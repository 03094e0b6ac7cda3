"""Every term's hook called alike, with states, forces and units to call it with."""

import re

import jax
import jax.numpy as jnp
import msgspec
import numpy as np

from tests.sim.physics.rigs import GUPPY
from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics import term as kinds
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.term import BallState, Exit, Opening, Vec

EXITS = Exit(np.array([0.5, 4.0, 9.0, 21.0]), np.array([0.1, 0.5, 0.9, 1.3]), np.array([-3.0, 0.0, 4.0, 11.0]),
             np.array([0.0, 0.1, -0.2, 0.3]))
DISTANCES_M = np.array([1.0, 2.5, 4.0, 7.7])
HOLE = Opening(2.44, 0.07, 0.35)
FLOWN_S = 0.7


def typical(term: kinds.Term) -> dict[str, float]:
    """Values at work: somewhere between the default of the amplitude and the end of its range."""
    first = term.parameters[0]
    values = {p.name: p.low + 0.37 * (p.high - p.low) for p in term.parameters}
    return {**values, first.name: 0.37 * first.high}


def state(seed: int) -> np.ndarray:
    """Position, velocity and spin, nine numbers."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(0, 5, 3), rng.uniform(-15, 15, 3), rng.uniform(-20, 20, 3)])


def ball_of(numbers, time_s: float = FLOWN_S) -> BallState:
    return BallState(*(Vec(*numbers[first:first + 3]) for first in (0, 3, 6)), time_s)


def call(term: kinds.Term, values, numbers=None, rig: Rig = GUPPY, exit: Exit = EXITS, distance_m=DISTANCES_M,
         hole: Opening = HOLE, time_s: float = FLOWN_S) -> np.ndarray:
    """All that a term's hook answers, as one array, whatever its stage; flight in the state `numbers`."""
    ball = ball_of(state(1) if numbers is None else numbers, time_s)
    if isinstance(term, kinds.FlightTerm):
        others = {other.name: other.acceleration(rig, kinds.complete(other, {"cd": 0.6, "cl": 0.2}), ball, {})
                  for other in find_terms(("gravity", "drag", "magnus"))}
        answer = [tuple(term.acceleration(rig, values, ball, others))]
    elif isinstance(term, kinds.AirTerm):
        met = term.meet(rig, values, ball)
        answer = [tuple(met.velocity_m_s), tuple(met.spin_rev_s)]
    elif isinstance(term, kinds.SensingTerm):
        answer = [tuple(part) for part in (*term.sense(rig, values, exit, distance_m)[0],
                                           term.sense(rig, values, exit, distance_m)[1])]
    elif isinstance(term, kinds.LaunchTerm):
        answer = [tuple(part) for part in term.leave(rig, values, exit)]
    elif isinstance(term, kinds.WatchTerm):
        answer = [tuple(term.watch(values, ball.position_m, ball.velocity_m_s, ball.time_s))]
    else:
        assert isinstance(term, kinds.ArrivalTerm)
        answer = [tuple(term.arrive(values, hole))]
    return jnp.stack([jnp.stack([jnp.asarray(part, dtype=float) for part in row]) for row in answer])


def untouched(term: kinds.Term) -> np.ndarray:
    """The answer of a hook that changes nothing."""
    ball = ball_of(state(1))
    if isinstance(term, kinds.FlightTerm):
        return np.zeros((1, 3))
    if isinstance(term, kinds.AirTerm):
        return np.array([ball.velocity_m_s, ball.spin_rev_s])
    if isinstance(term, kinds.SensingTerm):
        return np.stack([*EXITS, DISTANCES_M])
    if isinstance(term, kinds.LaunchTerm):
        return np.stack(EXITS)
    return np.array([ball.position_m if isinstance(term, kinds.WatchTerm) else HOLE])


def finite(tree) -> bool:
    return all(np.isfinite(part).all() for part in jax.tree.leaves(tree))


def factor(unit: str, length: float, time: float, mass: float) -> float:
    """The factor by which a number with this unit ("1", "m/s2", "kg/m3", ...) is multiplied by in other units."""
    bases = {"m": length, "s": time, "kg": mass, "rad": 1.0, "rev": 1.0, "deg": 1.0, "1": 1.0}
    above, _, below = unit.partition("/")
    result = 1.0
    for part, sign in ((above, 1), (below, -1)):
        for base, power in re.findall(r"(kg|rad|rev|deg|m|s|1)(\d*)", part):
            result *= bases[base] ** (sign * int(power or 1))
    return result


def rescaled(length: float, time: float, mass: float) -> Rig:
    """The rig in other units."""
    return msgspec.structs.replace(GUPPY, ball=msgspec.structs.replace(GUPPY.ball, mass_kg=GUPPY.ball.mass_kg * mass,
                                     radius_m=GUPPY.ball.radius_m * length),
        air=msgspec.structs.replace(GUPPY.air, density_kg_m3=GUPPY.air.density_kg_m3 * mass / length**3),
        world=msgspec.structs.replace(GUPPY.world, gravity_m_s2=GUPPY.world.gravity_m_s2 * length / time**2))
