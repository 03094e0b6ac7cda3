"""How likely a set point is to score, by a belief's forecast of the height at the target."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.forecast import forecast
from truearc.sim.metrics import POINTS_THREE, POINTS_TWO
from truearc.sim.physics.catalogue import effective
from truearc.sim.physics.simulate import ORDINARY, opening_of
from truearc.sim.physics.term import Opening


@dataclass(frozen=True, eq=False)
class Chances:
    """Of set points, arrays [n].

    p_two: the ball passes the outer opening (which holds the inner one); p_three: the inner one; points: expected;
    of a hit-or-miss target p_three is 0 and a hit counts two. height_m: at the target, NaN where the ball does not
    come there, whose probabilities are 0. per_log_speed, per_rad, per_m: change of that height by the log of the
    exit speed, by the launch elevation and by the distance.
    """

    height_m: Float[np.ndarray, " n"]
    p_two: Float[np.ndarray, " n"]
    p_three: Float[np.ndarray, " n"]
    per_log_speed: Float[np.ndarray, " n"]
    per_rad: Float[np.ndarray, " n"]
    per_m: Float[np.ndarray, " n"]

    @property
    def points(self) -> Float[np.ndarray, " n"]:
        return POINTS_TWO * self.p_two + (POINTS_THREE - POINTS_TWO) * self.p_three


def chances_of(rig: Rig, belief: Belief, distance_m: Float[np.ndarray, " n"], hood_deg: Float[np.ndarray, " n"],
               motor_ratio: Float[np.ndarray, " n"]) -> Chances:
    """Probabilities under the belief's covariance, the launcher's scatter and the sensors' noise.

    InputError where the rig has no target or no free speed.
    """
    numbers = {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}
    seen = forecast(rig, belief, Shots(tuple(map(str, range(len(distance_m)))), numbers, {}))
    opening = believed_opening(rig, belief)
    two, three = (_between(seen.height_m - opening.centre_m, half_m, seen.sigma_m)
                  for half_m in (opening.two_half_m, opening.three_half_m))
    return Chances(seen.height_m, two, three, *seen.by_launch[:, [0, 1, 3]].T)


def believed_opening(rig: Rig, belief: Belief) -> Opening:
    """The opening that a ball has to pass, with the belief's arrival terms."""
    return opening_of(rig, effective(belief.coefficients, ORDINARY, belief.catalogue), belief.catalogue)


def _between(off_m: Float[np.ndarray, " n"], half_m: float,
             sigma_m: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    with np.errstate(divide="ignore", invalid="ignore"):
        p = ndtr((half_m - off_m) / sigma_m) - ndtr((-half_m - off_m) / sigma_m)
    exact = (np.abs(off_m) <= half_m).astype(float) if half_m > 0.0 else np.zeros_like(off_m)
    return np.nan_to_num(np.where(sigma_m > 0.0, p, exact))
