"""Inputs of the physics for a launch, taken from the columns of shots, with their measurement uncertainty."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.conditions import ORDINARY, Circumstances
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.likelihood.noise import EXIT_DEG, EXIT_SPEED_M_S, EXIT_SPIN_REV_S
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.simulate import by_wheels, launch_of, require, roll

SLOWEST_M_S = 0.1                     # a slower launch goes nowhere, whatever its uncertainty


class Given(NamedTuple):
    """Launches as the robot's own instruments have them before the shot; numpy arrays.

    rolling: by the wheels without launch terms and the hood; a speed, elevation or spin that was measured on the ball
    has `rolled`, `hooded` or `spun` False, and no scatter of the launch comes on top of it. wheel_log_speed and
    wheel_spin_rev_s: what one standard deviation of each wheel's noise does to the log of that speed and to the
    spin. elevation_sd_rad and distance_sd_m: standard deviations.
    """

    rolling: Exit
    rolled: Bool[Any, " n"]
    hooded: Bool[Any, " n"]
    spun: Bool[Any, " n"]
    distance_m: Float[Any, " n"]
    wheel_log_speed: Float[Any, "n w"]
    wheel_spin_rev_s: Float[Any, "n w"]
    elevation_sd_rad: Float[Any, " n"]
    distance_sd_m: Float[Any, " n"]
    circumstances: Circumstances = ORDINARY

    @property
    def whose(self) -> Exit:
        """Which parts of the launch are the robot's own, as truearc.sim.physics.simulate wants it."""
        return Exit(self.rolled, self.hooded, self.spun, True)


def given_of(rig: Rig, shots: Shots, circumstances: Circumstances = ORDINARY) -> Given:
    """Launches of shots with wheel speeds (or motor_ratio) and hood_deg; InputError names shots that lack one.

    Measured exit columns take precedence as in truearc.sim.physics.simulate.launch_of, with the uncertainty above.
    circumstances: of these shots.
    """
    speed_m_s = shots.number("exit_speed_m_s")
    by_camera, spin_seen = (~np.isnan(shots.number(name)) for name in ("exit_deg", "exit_spin_rev_s"))
    exit = launch_of(rig, shots)
    log_speed, spin_rev_s = _by_deviation(rig, exit, ~np.isnan(speed_m_s), spin_seen)
    return Given(exit, by_wheels(shots), ~by_camera, ~spin_seen, require(shots, "distance_m"), log_speed, spin_rev_s,
                 np.radians(np.where(by_camera, EXIT_DEG, rig.noise.hood_deg)),
                 np.full(len(shots), rig.noise.distance_m), circumstances)


def _by_deviation(rig: Rig, exit: Exit, speed_seen: Bool[np.ndarray, " n"],
                  spin_seen: Bool[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n w"], Float[np.ndarray, "n w"]]:
    """What one deviation of each wheel, of a measured speed and of a measured spin does: [n, wheels + 2] twice.

    Launches are linear in the wheels' speeds, so that of one wheel alone is the derivative. Wheels are read apart;
    for those on one belt (speeds by motor_ratio) this overstates the uncertainty of the spin a little.
    """
    radius_m = np.array([wheel.radius_m for wheel in rig.launcher.wheel])
    one_speed, one_spin = np.zeros((2, 0))
    if radius_m.size:
        one_speed, one_spin = roll(rig, np.diag(radius_m) * rig.noise.wheel_rad_s)
    per_m_s = 1.0 / np.maximum(exit.speed_m_s, SLOWEST_M_S)
    zero = np.zeros_like(per_m_s)
    speed = np.outer(~speed_seen * per_m_s, one_speed)
    spin = np.outer(~spin_seen, one_spin)
    return (np.column_stack([speed, speed_seen * per_m_s * EXIT_SPEED_M_S, zero]),
            np.column_stack([spin, zero, spin_seen * EXIT_SPIN_REV_S]))
