"""Directions that move with the ball."""

import jax.numpy as jnp

from truearc.sim.physics.vector import Vec


def axes(velocity: Vec) -> tuple[Vec, Vec, Vec]:
    """Unit vectors along the velocity, across it and up, and to the left; across ones fade as it becomes vertical."""
    flat = velocity.x**2 + velocity.y**2
    speed = jnp.sqrt(flat + velocity.z**2 + 1e-12)
    along = Vec(velocity.x / speed, velocity.y / speed, velocity.z / speed)
    level = jnp.sqrt(along.x**2 + along.y**2 + 1e-6)
    left = Vec(-along.y / level, along.x / level, 0.0 * level)
    up = Vec(-along.z * left.y, along.z * left.x, along.x * left.y - along.y * left.x)
    return along, up, left
