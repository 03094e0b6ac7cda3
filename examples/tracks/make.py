"""Generator of tracked flights of a spinning foam ball, shots.csv and tracks.csv: `python examples/tracks/make.py DIR`.

It uses NumPy without truearc: gravity, drag (coefficient 0.5) and lift (coefficient 0.10), integrated in small steps,
with 5 mm of camera noise.
"""

import sys
from pathlib import Path

import numpy as np

MASS_KG, RADIUS_M, AIR_KG_M3, CD, CL = 0.14, 0.0889, 1.2, 0.5, 0.10
STEP_S, FRAME_S, NOISE_M = 1e-4, 1 / 30, 0.005


def fly(speed: float, elevation: float, spin_rev_s: float) -> np.ndarray:
    """Return x, y, z [n, 3] of a ball with backspin at every camera frame until it is back at 1 m."""
    place, velocity = np.array([0.0, 0.75]), speed * np.array([np.cos(elevation), np.sin(elevation)])
    drag = 0.5 * CD * AIR_KG_M3 * np.pi * RADIUS_M**2 / MASS_KG
    lift = CL * (4 / 3) * 4 * np.pi**2 * RADIUS_M**3 * spin_rev_s * AIR_KG_M3 / MASS_KG
    seen = []
    for step in range(30_000):
        if step % round(FRAME_S / STEP_S) == 0:
            seen.append([place[0], 0.0, place[1]])
        along = np.array([-velocity[1], velocity[0]])
        velocity = velocity + STEP_S * (np.array([0, -9.81]) - drag * np.hypot(*velocity) * velocity + lift * along)
        place = place + STEP_S * velocity
        if place[1] < 1 and velocity[1] < 0:
            break
    return np.array(seen)


def main(folder: Path) -> None:
    """Write 24 flights."""
    random = np.random.default_rng(7)
    shots, tracks = ["shot_id,exit_spin_rev_s"], ["shot_id,t_s,x_m,y_m,z_m"]
    for shot in range(24):
        spin = random.uniform(0, 6)
        track = fly(random.uniform(8, 11), np.radians(random.uniform(40, 60)), spin)
        shots.append(f"{shot},{spin + random.normal(0, 0.1):.2f}")
        for t_s, (x, y, z) in zip(np.arange(len(track)) * FRAME_S, track + random.normal(0, NOISE_M, track.shape),
                                  strict=True):
            tracks.append(f"{shot},{t_s:.4f},{x:.3f},{y:.3f},{z:.3f}")
    (folder / "shots.csv").write_text("\n".join(shots) + "\n", encoding="utf-8")
    (folder / "tracks.csv").write_text("\n".join(tracks) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
