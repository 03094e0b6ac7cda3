"""What the check says of shots at an opening that faces up."""

import numpy as np
import pytest

from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots


def dataset(centre_m: float, hood_deg: float, outcome: str = "two") -> Dataset:
    n = 12
    rig = Rig(GUPPY.ball, GUPPY.launcher, Target(centre_m, facing="up", shape="circle", radius_m=0.5))
    numbers = {"distance_m": np.linspace(2.5, 3.0, n), "hood_deg": np.full(n, hood_deg),
               "motor_ratio": np.linspace(0.42, 0.45, n)}
    return Dataset("d", rig, Shots(tuple(map(str, range(n))), numbers, {"outcome": (outcome,) * n}))


def test_rim_above_all_flights_is_refused_with_its_height() -> None:
    with pytest.raises(InputError, match=r"target\.centre_height_m: is 6 m, but no ball rises above \d\.\d\d m"):
        check_plausible(dataset(6.0, 60.0, "miss"))


def test_hits_by_balls_that_still_rise_are_named() -> None:
    said = " ".join(check_plausible(dataset(1.83, 30.0), ["reach", "hood", "target", "release"]).accepted)
    assert "12 of 12 hits leave so flat that a ball without lift or drag still rises" in said
