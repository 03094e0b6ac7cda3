"""Torque that the flywheel belt is expected to need, before any feedback."""

from truearc.robot.config.schema import Flywheel


def flywheel_torque_nm(flywheel: Flywheel, setpoint_rad_s: float, acceleration_rad_s2: float = 0.0) -> float:
    """ks + kv w + ka dw/dt per motor; zero at rest (the static term only where the wheel should turn)."""
    if setpoint_rad_s <= 0.0:
        return 0.0
    return flywheel.ks_nm + flywheel.kv_nm_s * setpoint_rad_s + flywheel.ka_nm_s2 * acceleration_rad_s2
