"""Tracks in closed form: nothing but a constant acceleration, so that every derivative is known exactly."""

import numpy as np

from truearc_proof.rivals.claim import Flights, Moments, accelerations, gravity
from truearc_proof.truth.world import make_world

FACTS = make_world().facts
FRAMES, STEP_S = 40, 1.0 / 60.0
KNOWN = ("drag", "magnus")


def constant(push: float, shots: int = 30, noise_m: float = 0.0, seed: int = 0) -> Flights:
    """Balls in vacuum with `push` usual buoyancies."""
    rng = np.random.default_rng(seed)
    time_s = np.tile(STEP_S * np.arange(FRAMES), (shots, 1))
    pull = gravity(FACTS) + push * column("buoyancy")
    start = np.stack([rng.uniform(4.0, 9.0, shots), rng.normal(0.0, 0.1, shots), rng.uniform(2.0, 7.0, shots)], axis=1)
    position = start[:, None] * time_s[..., None] + 0.5 * pull * time_s[..., None]**2
    position += noise_m * rng.normal(size=position.shape)
    return Flights(FACTS, time_s, position, np.ones(time_s.shape, dtype=bool), rng.uniform(2.0, 8.0, shots),
                   rng.uniform(0.0, 1.0, shots), rng.normal(0.0, 0.02, shots), *sizes(np.ones(shots)))


def column(name: str) -> np.ndarray:
    """[3] for a ball that flies straight ahead."""
    one = np.ones(())
    return accelerations(FACTS, (name,), Moments(np.array([8.0, 0.0, 0.0]), one, one, one, one, *sizes(one)))[..., 0]


def sizes(one: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(radius_m, mass_kg) of the rig's ball."""
    return FACTS.ball.radius_m * one, FACTS.ball.mass_kg * one
