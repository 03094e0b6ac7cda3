"""The paper's launch (Eq. 11 and 12), and its printed Tables I and II; Figures 8 to 10 are pictures without numbers."""

from typing import Any

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit, exit_opposed, is_opposed

TABLE_I = {"Training": {"two": 1.0, "three": 0.9231, "mean_m": 0.051, "median_m": 0.058},
           "Testing": {"two": 0.9286, "three": 0.8571, "mean_m": 0.283, "median_m": 0.124}}
# size of D_s -> overall accuracy, "F1-3pt", "F1-2pt": a class's accuracy by its own arithmetic (docs/how-to/paper.md)
TABLE_II = {0: (0.4429, 0.0417, 0.6666), 500: (0.7857, 0.5000, 0.8750), 600: (0.8714, 0.7083, 0.9167),
            750: (0.9143, 0.7916, 0.9583), 900: (0.9856, 0.9583, 1.0000), 1000: (0.9571, 0.9167, 0.9583),
            1250: (0.9285, 0.8750, 0.9167)}
COEFFICIENTS = {"cd": 0.91, "cl": 0.06}
BEST_WEIGHT = 0.01                    # Figure 10's star
NOT_PRINTED = "not printed in the paper"


def exit_seed(rig: Rig, motor_ratio: Any, hood_deg: Any) -> Exit:
    """Launch of the two-wheel rig at motor speed / free speed and elevation.

    The paper's Eq. 11 and 12, the latter with its own factor (twice the spin of a ball that does not slip).
    Raises InputError when the rig has no free speed or not one wheel above and one below.
    """
    if not is_opposed(rig):
        raise InputError("rig.toml: launcher.wheel: the paper's Eq. 11 and 12 need two wheels, clock_deg 0 and 180")
    if rig.launcher.free_speed_rad_s is None:
        raise InputError("rig.toml: launcher.free_speed_rad_s is needed to turn motor_ratio into a launch")
    upper, lower = sorted(rig.launcher.wheel, key=lambda wheel: round(wheel.clock_deg % 360.0, 6))
    motor_rad_s = motor_ratio * rig.launcher.free_speed_rad_s
    return exit_opposed(rig, motor_rad_s * (upper.gear * upper.radius_m), motor_rad_s * (lower.gear * lower.radius_m),
                        hood_deg)
