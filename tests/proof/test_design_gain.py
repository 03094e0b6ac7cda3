"""Random shots are worth as many random shots; such as tell nothing are worth none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from truearc_proof.scoring.design_gain import random_worth
from truearc_proof.truth.followup import Asked, follow
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
WORLD = make_world({"hood_offset": 2.0}, "L0", 200, 31, side=True)


def claimed(**sizes: float) -> dict[str, Any]:
    parameter = {"hood_offset": "angle_deg", "wheel_slip": "loss_per_m_s", "wind_x": "speed_m_s"}
    return {"set": list(sizes), "what": [{"term": name, "probability": 0.5, "parameters": {
        parameter[name]: {"value": size}}} for name, size in sizes.items()]}


def test_shots_like_the_first_are_worth_their_number() -> None:
    first, more = shoot(WORLD), shoot(replace(WORLD, seed=77, shots=100))
    more = replace(more, shots=replace(more.shots, shot_id=tuple(f"m{k}" for k in range(100))))
    worth = random_worth(first, more, claimed(hood_offset=2.0, wheel_slip=0.01))
    assert worth is not None and 60 <= worth <= 160


def test_shots_that_are_sure_to_fall_short_are_worth_next_to_none() -> None:
    shots = shoot(WORLD).shots
    place = int(np.argmax(shots.number("distance_m")))
    dull = Asked(float(shots.number("distance_m")[place]), float(shots.number("hood_deg")[place]), 0.2, 100)
    worth = random_worth(shoot(WORLD), follow(WORLD, [dull]), claimed(hood_offset=2.0, wheel_slip=0.01))
    assert worth is not None and worth < 25


def test_one_name_alone_needs_no_shots() -> None:
    assert random_worth(shoot(WORLD), follow(WORLD, [Asked(4.0, 48.0, 0.55, 20)]), claimed(hood_offset=2.0)) is None
