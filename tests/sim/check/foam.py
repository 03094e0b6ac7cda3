"""Balls of foam that are plausible, flown by laws that share nothing with truearc.sim, and ways to spoil them."""

from dataclasses import replace
from typing import Any

import numpy as np
from msgspec.structs import replace as changed
from scipy.integrate import solve_ivp

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots, Tracks

FOAM = Ball(0.142, 0.0889)
WHEELS = (Wheel("upper", 0.05, 1.0, 0.0), Wheel("lower", 0.05, 1.0, 180.0))
RIG = Rig(FOAM, LauncherFacts(0.6, None, WHEELS), Target(2.5))
RHO = 1.2
LIFT = 0.3                            # of backspin, over drag
GEARED = (Wheel("upper", 0.05, 0.4, 0.0), Wheel("lower", 0.05, 0.4, 180.0))


def fly(speed_m_s: float, hood_deg: float, drag_m: float, t_s: np.ndarray) -> np.ndarray:
    """Positions [t, 3] by DOP853; drag_m: rho cd A / 2 m, in 1/m."""
    angle = np.radians(hood_deg)
    start = [0.0, 0.0, 0.6, speed_m_s * np.cos(angle), 0.0, speed_m_s * np.sin(angle)]
    found = solve_ivp(lambda t, y: [*y[3:], *(-drag_m * np.linalg.norm(y[3:]) * y[3:] - [0.0, 0.0, 9.81])],
                      (0.0, t_s[-1]), start, method="DOP853", t_eval=t_s, rtol=1e-9)
    return np.asarray(found.y[:3].T)


def film() -> Dataset:
    """Twelve tracks of a foam ball with 1 cm of noise at 100 Hz."""
    rng = np.random.default_rng(4)
    speed, hood = rng.uniform(7.0, 11.0, 12), rng.uniform(35.0, 60.0, 12)
    t_s = np.arange(0.0, 0.7, 0.01)
    points = np.concatenate([fly(v, h, 0.03, t_s) for v, h in zip(speed, hood, strict=True)])
    points += 0.01 * rng.standard_normal(points.shape)
    wheels = {f"wheel_{name}_rad_s": speed / 0.05 / 0.85 for name in ("upper", "lower")}
    shots = Shots(tuple(f"{k:02d}" for k in range(12)), {"hood_deg": hood, "distance_m": np.full(12, 6.0),
                                                            **wheels}, {})
    return Dataset("filmed", RIG, shots, Tracks(np.repeat(np.arange(12), len(t_s)), np.tile(t_s, 12), *points.T))


def season(rng: np.random.Generator, rigs: int, shots: int = 40, near: bool = False) -> list[Dataset]:
    """Random rigs, each with shots that pass the target's middle through air, by Runge-Kutta of all at once; near: flat
    throws of light balls with backspin at low targets, with 5 % of scatter."""
    radius = rng.uniform(0.02, 0.15, (rigs, 1))
    mass = rng.uniform(*((18.0, 30.0) if near else (30.0, 900.0)), (rigs, 1)) * 4.0 / 3.0 * np.pi * radius**3
    drag = RHO * rng.uniform(*((0.4, 0.8) if near else (0.1, 0.6)), (rigs, 1)) * np.pi * radius**2 / 2.0 / mass
    rise = rng.uniform(*((0.3, 0.8) if near else (0.5, 2.2)), (rigs, 1))
    distance = rng.uniform(*((1.0, 3.5) if near else (2.0, 8.0)), (rigs, shots))
    steepest = np.degrees(np.arctan2(rise, distance))
    hood = np.clip(rng.uniform(*((30.0, 55.0) if near else (35.0, 65.0)), (rigs, shots)), steepest + 10.0, 80.0)
    low, high = np.full((rigs, shots), 3.0), np.full((rigs, shots), 60.0)
    for _ in range(18):
        middle = (low + high) / 2.0
        above = height_at(middle, hood, drag, distance, LIFT if near else 0.0) > rise
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    slip = rng.uniform(0.7, 1.0, (rigs, 1)) * rng.normal(1.0, 0.05 if near else 0.02, (rigs, shots))
    kept = high < 40.0
    return [Dataset(f"rig {k}", Rig(Ball(float(mass[k, 0]), float(radius[k, 0])), LauncherFacts(0.6, None, WHEELS),
                                    Target(0.6 + float(rise[k, 0]))), Shots(tuple(map(str, range(kept[k].sum()))),
                          {"distance_m": distance[k, kept[k]], "hood_deg": hood[k, kept[k]],
                           **{f"wheel_{name}_rad_s": (high / slip)[k, kept[k]] / 0.05 for name in ("upper", "lower")}},
                          {"outcome": ("two", "three") * (kept[k].sum() // 2) + ("two",) * (kept[k].sum() % 2)}))
            for k in range(rigs)]


def height_at(speed: np.ndarray, hood: np.ndarray, drag: np.ndarray, distance: np.ndarray, lift: float) -> np.ndarray:
    """Height above the muzzle where a ball passes a distance; minus infinity where it never gets there; lift: by
    backspin in proportion to speed, over drag."""
    vx, vz = speed * np.cos(np.radians(hood)), speed * np.sin(np.radians(hood))
    x, z, height = np.zeros_like(speed), np.zeros_like(speed), np.full_like(speed, -np.inf)
    for _ in range(60):
        step = 0.05
        v = np.hypot(vx, vz)
        mx, mz = vx - 0.5 * step * drag * v * (vx + lift * vz), vz - 0.5 * step * (drag * v * (vz - lift * vx) + 9.81)
        v = np.hypot(mx, mz)
        new_x, new_z = x + step * mx, z + step * mz
        passed = (x < distance) & (new_x >= distance)
        height = np.where(passed, z + (distance - x) / np.maximum(new_x - x, 1e-9) * (new_z - z), height)
        x, z = new_x, new_z
        vx, vz = vx - step * drag * v * (mx + lift * mz), vz - step * (drag * v * (mz - lift * mx) + 9.81)
    return height


def tracks(dataset: Dataset, **columns: Any) -> Dataset:
    assert dataset.tracks is not None
    return replace(dataset, tracks=replace(dataset.tracks, **columns))


def scaled(dataset: Dataset, factor: float) -> Dataset:
    assert dataset.tracks is not None
    return tracks(dataset, **{name: getattr(dataset.tracks, name) * factor for name in ("x_m", "y_m", "z_m")})


def numbers(dataset: Dataset, **columns: Any) -> Dataset:
    return replace(dataset, shots=replace(dataset.shots, numbers={**dataset.shots.numbers, **columns}))


def by_motor(dataset: Dataset, free_speed_rad_s: float) -> Dataset:
    """The same shots stated by motor_ratio, of motors that turn freely at 5500 rpm."""
    ratio = dataset.shots.number("wheel_upper_rad_s") / (5500.0 * np.pi / 30.0)
    columns = {name: column for name, column in dataset.shots.numbers.items() if not name.startswith("wheel_")}
    launcher = changed(dataset.rig.launcher, free_speed_rad_s=free_speed_rad_s)
    return replace(dataset, facts=changed(dataset.rig, launcher=launcher),
                   shots=replace(dataset.shots, numbers={**columns, "motor_ratio": ratio}))


def ball(dataset: Dataset, **keys: float) -> Dataset:
    return replace(dataset, facts=changed(dataset.rig, ball=changed(dataset.rig.ball, **keys)))


def faster(dataset: Dataset, factor: float) -> dict[str, np.ndarray]:
    return {name: factor * column for name, column in dataset.shots.numbers.items() if name.startswith("wheel_")}


def wheels(dataset: Dataset, turning: Any) -> Dataset:
    launcher = changed(dataset.rig.launcher, wheel=tuple(turning))
    return replace(dataset, facts=changed(dataset.rig, launcher=launcher))
