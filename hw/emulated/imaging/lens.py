"""The emulated camera's own optics: pinhole and Brown distortion. It shares no line with the code that sees."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Plane = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Lens:
    """Image size, pinhole and Brown distortion (k1 k2 p1 p2 k3), in pixels."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


def project(points_m: Array, camera_from_points: Array, lens: Lens, focal_scale: float = 1.0) -> tuple[Array, Array]:
    """Points (n, 3) -> where a perfect pinhole sees them (n, 2), and how far ahead they are (n,)."""
    seen_m = points_m @ camera_from_points[:3, :3].T + camera_from_points[:3, 3]
    focal_px = np.array([lens.fx_px, lens.fy_px]) * focal_scale
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = seen_m[:, :2] / seen_m[:, 2:] * focal_px + np.array([lens.cx_px, lens.cy_px])
    return pixels, seen_m[:, 2]


def distort(ideal_px: Array, lens: Lens) -> Array:
    """Where a lens puts what a perfect pinhole would put at (n, 2)."""
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = (ideal_px[:, 0] - lens.cx_px) / lens.fx_px, (ideal_px[:, 1] - lens.cy_px) / lens.fy_px
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.column_stack([u * lens.fx_px + lens.cx_px, v * lens.fy_px + lens.cy_px])


def ideal_pixels(lens: Lens) -> tuple[Plane, Plane]:
    """Columns and rows, in ideal pixels, of every pixel: (1, w) and (h, 1) without distortion, else two of (h, w)."""
    columns, rows = np.arange(lens.width_px, dtype=np.float64), np.arange(lens.height_px, dtype=np.float64)
    if not any(lens.distortion):
        return columns[None, :].astype(np.float32), rows[:, None].astype(np.float32)
    seen = np.column_stack([part.ravel() for part in np.meshgrid(columns, rows)])
    ideal = seen.copy()
    for _ in range(50):                               # fixed point of distort(ideal) = seen
        miss = seen - distort(ideal, lens)
        ideal += miss
        if np.abs(miss).max() < 1e-4:
            break
    both = ideal.reshape(lens.height_px, lens.width_px, 2).astype(np.float32)
    return np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1])
