"""The grid's law of motion in numbers against the terms' own, in JAX."""

import msgspec
import numpy as np
import pytest

from tests.sim.physics.rigs import GUPPY
from truearc.robot.config.rig_spec import Rig
from truearc.sim.paper.grid_kernel import acceleration, facts_of
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.flight import make_law
from truearc.sim.physics.term import BallState, Vec

OTHER = msgspec.structs.replace(GUPPY, ball=msgspec.structs.replace(GUPPY.ball, mass_kg=0.3, radius_m=0.12),
                                air=msgspec.structs.replace(GUPPY.air, density_kg_m3=0.9),
                                world=msgspec.structs.replace(GUPPY.world, gravity_m_s2=3.7))


@pytest.mark.parametrize("rig", [GUPPY, OTHER])
def test_it_is_the_law_of_the_terms(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    vx, vz, spin = rng.uniform(0.1, 20, 60), rng.uniform(-20, 20, 60), rng.uniform(-5, 35, 60)
    cd, cl = rng.uniform(0, 5, (2, 60))
    law = make_law(rig, flight_terms(("gravity", "drag", "magnus")), {"drag": {"cd": cd}, "magnus": {"cl": cl}})
    pushed = law(BallState(Vec(0.0 * vx, 0.0, 0.0 * vx), Vec(vx, 0.0, vz), Vec(0.0, -spin, 0.0)))
    found = np.array([acceleration(*state, pair, facts_of(rig)) for *state, pair in zip(
        vx, vz, spin, zip(cd, cl, strict=True), strict=True)])
    np.testing.assert_allclose(found, np.stack([pushed.x, pushed.z], axis=1), rtol=1e-12, atol=1e-12)
