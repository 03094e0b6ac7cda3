"""Made shots at an opening that faces up: the paper's launcher before a hub of today's games."""

import msgspec
import numpy as np

from tests.sim.physics.rigs import GUPPY
from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.facing_up import Landing, land, outcome_of
from truearc.sim.physics.simulate import launch_of
from truearc.sim.physics.term import Exit, Opening

HUB = Target(1.83, facing="up", shape="polygon", across_flats_m=1.06, sides=6)
OPENING = Opening(1.83, 0.0, HUB.two_half_height_m)
RIG: Rig = msgspec.structs.replace(GUPPY, target=HUB)
CD, CL, LOSS = 0.5, 0.06, 0.25


def make_shots(seed: int, n: int, spread: float = 0.06, angle_deg: float = 0.0, far_m: float = 5.0,
               high_deg: float = 70.0) -> Dataset:
    """Shots about the middle of the hub, within `spread` of the speed; they leave angle_deg steeper than the hood says.

    far_m, high_deg: the farthest and the steepest.
    """
    rng = np.random.default_rng(seed)
    distance_m, hood_deg = rng.uniform(1.5, far_m, n), rng.uniform(55.0, high_deg, n)
    low, high = np.full(n, 0.2), np.full(n, 1.0)
    for _ in range(14):
        middle = 0.5 * (low + high)
        far = np.nan_to_num(_land(distance_m, hood_deg, middle, np.zeros(n), np.zeros(n)).along_m, nan=-9.0) > 0.05
        low, high = np.where(far, low, middle), np.where(far, middle, high)
    ratio = low * np.exp(rng.normal(0.0, spread, n))
    landing = _land(distance_m + rng.normal(0.0, 0.05, n), hood_deg + angle_deg + rng.normal(0.0, 0.45, n), ratio,
                    rng.normal(0.0, 0.015, n), rng.normal(0.0, 0.007, n))
    level, side = outcome_of(HUB, RIG.ball.radius_m, landing, OPENING)
    return Dataset("hub", RIG, Shots(
        tuple(f"s{row}" for row in range(n)), {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": ratio},
        {"outcome": tuple(np.array(["miss", "two"])[level].tolist()), "side": tuple(side.tolist())}))


def _land(distance_m: np.ndarray, hood_deg: np.ndarray, ratio: np.ndarray, log_speed: np.ndarray,
          azimuth_rad: np.ndarray) -> Landing:
    shots = Shots(tuple(map(str, range(len(ratio)))), {"hood_deg": hood_deg, "motor_ratio": ratio}, {})
    leaving = launch_of(RIG, shots)
    exit = Exit(leaving.speed_m_s * (1.0 - LOSS) * np.exp(log_speed), np.radians(hood_deg), leaving.spin_rev_s)
    landing = land(RIG, flight_terms(("gravity", "drag", "magnus")), {"drag": {"cd": CD}, "magnus": {"cl": CL}}, exit,
                   distance_m, OPENING)
    return landing._replace(across_m=(np.asarray(landing.along_m) + distance_m) * np.sin(azimuth_rad))
