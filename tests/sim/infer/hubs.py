"""Made shots at an opening that faces up: the paper's launcher before a hub of today's games."""

import math

import msgspec
import numpy as np

from tests.sim.physics.rigs import GUPPY
from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.facing_up import land, outcome_of
from truearc.sim.physics.simulate import launch_of
from truearc.sim.physics.term import Exit, Opening

HUB = Target(1.83, facing="up", shape="polygon", across_flats_m=1.06, sides=6)
RIG: Rig = msgspec.structs.replace(GUPPY, target=HUB)
CD, CL, LOSS = 0.5, 0.06, 0.25
TERMS = flight_terms(("gravity", "drag", "magnus"))


def make_shots(seed: int, n: int, rig: Rig = RIG, spread: float = 0.06, side: bool = True, angle_deg: float = 0.0,
               aside_rad: float = 0.0) -> Dataset:
    """Shots about the middle; angle_deg: by how much they leave steeper than the hood says, and aside_rad to the left."""
    rng = np.random.default_rng(seed)
    distance_m, hood_deg = rng.uniform(1.5, 5.0, n), rng.uniform(55.0, 70.0, n)
    low, high = np.full(n, 0.2), np.full(n, 1.0)
    exact = np.zeros(n)
    for _ in range(14):
        middle = 0.5 * (low + high)
        far = np.nan_to_num(_land(rig, distance_m, hood_deg, middle, exact, exact, exact).along_m, nan=-9.0) > 0.05
        low, high = np.where(far, low, middle), np.where(far, middle, high)
    ratio = low * np.exp(rng.normal(0.0, spread, n))
    landing = _land(rig, distance_m + rng.normal(0.0, 0.05, n), hood_deg + angle_deg + rng.normal(0.0, 0.45, n), ratio,
                    rng.normal(0.0, 0.015, n), rng.normal(aside_rad, 0.007, n), exact)
    assert rig.target is not None
    opening = Opening(rig.target.centre_height_m, rig.target.three_half_height_m, rig.target.two_half_height_m)
    level, sides = outcome_of(rig.target, rig.ball.radius_m, landing, opening)
    texts = {"outcome": tuple(np.array(["miss", "two", "three"])[level].tolist())}
    if side:
        texts["side"] = tuple(sides.tolist())
    return Dataset("hub", rig, Shots(tuple(f"s{row}" for row in range(n)), {
        "distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": ratio}, texts))


def _land(rig, distance_m, hood_deg, ratio, log_speed, azimuth, exact):
    shots = Shots(tuple(map(str, range(len(ratio)))), {"hood_deg": hood_deg, "motor_ratio": ratio}, {})
    leaving = launch_of(rig, shots)
    exit = Exit(leaving.speed_m_s * (1.0 - LOSS) * np.exp(log_speed), np.radians(hood_deg), leaving.spin_rev_s)
    landing = land(rig, TERMS, {"drag": {"cd": CD}, "magnus": {"cl": CL}}, exit, distance_m,
                   Opening(rig.target.centre_height_m, 0.0, rig.target.two_half_height_m))
    aside = np.asarray(landing.along_m) + distance_m
    return landing._replace(along_m=np.asarray(landing.along_m), across_m=aside * np.sin(azimuth + exact))


assert math.isclose(HUB.two_half_height_m, 0.53)
