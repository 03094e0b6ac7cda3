"""Columns against the law of motion written a second time (tests/proof/law.py), differentiated numerically."""

import math

import numpy as np
import pytest

from tests.proof.law import acceleration
from tests.proof.rivals.made import sizes
from truearc_proof.rivals.claim import COLUMNS, Moments, accelerations, candidates_of, gravity, middle_of, usual_of
from truearc_proof.truth.world import make_world

VELOCITY = np.array([[7.0, 0.4, 5.0], [5.0, -0.3, -2.0], [9.0, 0.0, 1.0]])
SPIN_REV_S = 6.0                      # in the seed's convention: twice what the ball turns by
TIME_S = np.array([0.05, 0.3, 0.6])
AGE, DENSITY = 0.4, 0.03


def columns(*names: str) -> np.ndarray:
    one = np.ones(3)
    return accelerations(make_world().facts, names, Moments(VELOCITY, SPIN_REV_S * one, TIME_S, AGE * one,
                                                            DENSITY * one, *sizes(one)))


def truth(effect: str | None, amount: float) -> np.ndarray:
    """[3, 3] by the second law, drag and lift at the middle of the catalogue's priors."""
    from dataclasses import replace
    cl = middle_of("magnus")
    world = replace(make_world({effect: amount} if effect else {}), cd=middle_of("drag"), lift_slope=cl * 32.0 / 3.0)
    spin = np.array([0.0, -math.pi * SPIN_REV_S, 0.0])
    density = 1.2 * (1.0 + DENSITY * amount) if effect == "air_density" else 1.2
    used = AGE if effect == "drag_wear" else 0.0
    return np.stack([acceleration(t, v, spin, world, density, used)
                     for t, v in zip(TIME_S, VELOCITY, strict=True)])


def test_drag_lift_and_gravity_are_the_whole_law() -> None:
    both = columns("drag", "magnus") @ [middle_of("drag"), middle_of("magnus")] + gravity(make_world().facts)
    np.testing.assert_allclose(both, truth(None, 0.0), atol=1e-9)


@pytest.mark.parametrize("name", [name for name in COLUMNS if name not in ("drag", "magnus", "buoyancy")])
def test_a_column_is_the_slope_of_its_effect(name: str) -> None:
    small = 1e-5
    per = {"spin_drag": 4.0, "lift_saturation": 2.0}.get(name, 1.0)     # the catalogue's spin is twice as fast
    slope = (truth(name, small) - truth(name, 0.0)) / small
    np.testing.assert_allclose(columns(name)[..., 0] / usual_of(name), slope * per, rtol=1e-3, atol=1e-4)


def test_added_mass_is_buoyancy_once_drag_and_lift_are_free() -> None:
    change = truth("added_mass", 1e-4) - truth(None, 0.0)
    library = columns("drag", "magnus", "buoyancy").reshape(-1, 3)
    left = change.ravel() - library @ np.linalg.lstsq(library, change.ravel(), rcond=None)[0]
    assert np.abs(left).max() < 1e-3 * np.abs(change).max()


def test_what_changes_a_force_is_a_candidate_where_the_force_is_believed() -> None:
    assert candidates_of(()) == ("drag", "magnus", "buoyancy")
    assert set(candidates_of(("magnus",))) == {"drag", "buoyancy", "spin_decay", "lift_saturation"}
    assert set(candidates_of(("drag", "magnus"))) == set(COLUMNS) - {"drag", "magnus"}
