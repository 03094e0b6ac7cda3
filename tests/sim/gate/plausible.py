"""Random launchers and shots that their teams could have recorded, by a simulation that shares no code with ours."""

import numpy as np

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots

AIR_KG_M3, GRAVITY_M_S2, STEP_S = 1.2, 9.81, 0.01
FREE_RAD_S = 594.0


def pass_height(speed_m_s: np.ndarray, hood_deg: np.ndarray, drag_m: float, distance_m: np.ndarray) -> np.ndarray:
    """Heights [n] above the muzzle at a distance; -inf where a ball never gets there. Midpoint rule; drag_m in 1/m."""
    angle = np.radians(hood_deg)
    x, z, vx, vz = np.zeros_like(angle), np.zeros_like(angle), speed_m_s * np.cos(angle), speed_m_s * np.sin(angle)
    height = np.full_like(angle, -np.inf)
    for _ in range(400):
        v = np.hypot(vx, vz)
        mx, mz = vx - 0.5 * STEP_S * drag_m * v * vx, vz - 0.5 * STEP_S * (drag_m * v * vz + GRAVITY_M_S2)
        v = np.hypot(mx, mz)
        ahead, up = x + STEP_S * mx, z + STEP_S * mz
        share = (distance_m - x) / np.maximum(ahead - x, 1e-9)
        height = np.where((x < distance_m) & (ahead >= distance_m), z + share * (up - z), height)
        x, z, vx, vz = ahead, up, vx - STEP_S * drag_m * v * mx, vz - STEP_S * (drag_m * v * mz + GRAVITY_M_S2)
    return height


def aimed_speed(hood_deg: np.ndarray, drag_m: float, distance_m: np.ndarray, rise_m: float) -> np.ndarray:
    """Speeds [n] that pass the target's centre, by bisection; about 60 m/s where there is none."""
    low, high = np.full_like(hood_deg, 2.0), np.full_like(hood_deg, 60.0)
    for _ in range(25):
        middle = 0.5 * (low + high)
        above = pass_height(middle, hood_deg, drag_m, distance_m) > rise_m
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return high


def make_season(seed: int, shots: int = 80) -> Dataset:
    """A random launcher's shots: hood from a few presets, by distance, or anyhow; aimed, walked, and scattered."""
    rng = np.random.default_rng([seed, 16])
    radius_m = rng.uniform(0.03, 0.13)
    mass_kg = rng.uniform(40.0, 500.0) * 4.0 / 3.0 * np.pi * radius_m**3
    drag_m = AIR_KG_M3 * rng.uniform(0.2, 0.55) * np.pi * radius_m**2 / 2.0 / mass_kg
    release_m, rise_m = rng.uniform(0.3, 1.0), rng.uniform(0.4, 2.2)
    near_m = rng.uniform(1.2, 3.0)
    distance_m = rng.uniform(near_m, near_m + rng.uniform(1.5, 6.0), shots)
    least_deg = np.degrees(np.arctan2(rise_m, distance_m)) + 12.0
    habit = rng.integers(3)
    share = (distance_m - distance_m.min()) / np.ptp(distance_m)
    hood_deg = (rng.choice(rng.uniform(35.0, 70.0, 3), shots) if habit == 0 else
                70.0 - 30.0 * share + rng.normal(0.0, 1.5, shots) if habit == 1 else
                rng.uniform(35.0, 70.0, shots))
    hood_deg = np.clip(hood_deg, least_deg, 80.0)
    trim = rng.normal(0.0, rng.uniform(0.02, 0.06), shots)
    speed_m_s = aimed_speed(hood_deg, drag_m, distance_m, rise_m) * (1.0 + trim)
    left_m_s = speed_m_s * (1.0 + rng.normal(0.0, rng.uniform(0.008, 0.025), shots))
    left_deg = hood_deg + rng.normal(0.0, rng.uniform(0.2, 0.7), shots)
    off_m = np.abs(pass_height(left_m_s, left_deg, drag_m, distance_m) - rise_m)
    outcome = np.where(off_m <= 0.07, "three", np.where(off_m <= 0.35, "two", "miss"))
    surface_m_s = speed_m_s / rng.uniform(0.75, 0.95)
    wheel_m = float(surface_m_s.max() / FREE_RAD_S / rng.uniform(0.7, 0.95))
    wheels = tuple(Wheel(name, wheel_m, 1.0, clock) for name, clock in (("upper", 0.0), ("lower", 180.0)))
    rig = Rig(Ball(float(mass_kg), float(radius_m)), LauncherFacts(float(release_m), FREE_RAD_S, wheels),
              Target(float(release_m + rise_m)))
    numbers = {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": surface_m_s / wheel_m / FREE_RAD_S}
    return Dataset(f"season {seed}", rig, Shots(tuple(map(str, range(shots))), numbers,
                                                {"outcome": tuple(map(str, outcome))}))
