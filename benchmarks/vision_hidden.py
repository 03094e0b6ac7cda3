"""What vision lets through of tape that is partly hidden along its own edges, or not as wide as it is said to be.

    python -m benchmarks.vision_hidden [--frames 20] [--loose]

A row a case: how many of the frames had a distance, the mean error, and the spread and the worst of error / sigma. The
mounting is off by as much as the configuration says; --loose says 10 degrees and 0.3 m of it.
"""

import argparse

import cv2
import numpy as np
from msgspec.structs import replace

from truearc.cli.common import SHIPPED
from truearc.hw.emulated.camera import Stage, project
from truearc.robot.config.schema import Config, load_config
from truearc.robot.vision import detect
from truearc.sim.world.emulated_vision import make_lens, make_tape
from truearc_proof.world.camera_damage import USUAL, Look, Patch, StagedCamera, place

DISTANCES_M = (2.5, 5.0, 8.0, 12.0)
BLURRED = Look(blur_px=1.5)
CUTS = {"level cut": (0.02, 0.03, 0.04, 0.06, 0.1), "one arm cut": (0.02, 0.03, 0.04, 0.06, 0.1),
        "arm, outer part": (0.1, 0.25, 0.5), "bottom, outer part": (0.1, 0.25, 0.5)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=20, help="in each case")
    parser.add_argument("--loose", action="store_true", help="with a mounting that is hardly known")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    config = load_config(SHIPPED)
    if args.loose:
        config = replace(config, camera=replace(config.camera, pitch_sigma_deg=10.0, height_sigma_m=0.3))
    tell("whole", config, args.frames)
    for part, shares in CUTS.items():
        for share in shares:
            tell(f"{part} {share:.0%}", config, args.frames, hidden=cover(config, part, share))
    for times in (0.5, 0.75, 0.9, 1.1, 1.25, 1.5, 2.0):
        tell(f"{times:g} x as wide", config, args.frames, times=times)
        tell(f"{times:g} x as wide, blur 1.5 px", config, args.frames, times=times, look=BLURRED)


def cover(config: Config, part: str, share: float) -> np.ndarray:
    """What hides this share of the part, in the target's plane: (4, 3)."""
    tape, far = config.tape, 1.0
    high, flare = tape.height_m / 2, (tape.top_width_m - tape.bottom_width_m) / 2 / tape.height_m
    if part == "arm, outer part":
        inward = share * tape.tape_width_m * np.hypot(1.0, flare)
        low, up = tape.bottom_width_m / 2 - 0.1 * flare - inward, tape.top_width_m / 2 + 0.1 * flare - inward
        flat = [(low, -high - 0.1), (up, high + 0.1), (far, high + 0.1), (far, -high - 0.1)]
    elif part == "bottom, outer part":
        end = share * tape.tape_width_m - high
        flat = [(-far, end), (far, end), (far, -far), (-far, -far)]
    else:
        end, begin = high - share * tape.height_m, 0.0 if part == "one arm cut" else -far
        flat = [(begin, end), (far, end), (far, far), (begin, far)]
    return np.column_stack([flat, np.zeros(4)])


def tell(name: str, config: Config, frames: int, *, hidden: np.ndarray | None = None, times: float = 1.0,
         look: Look = USUAL) -> None:
    """One row over all the distances."""
    cells = []
    for distance_m in DISTANCES_M:
        errors, ratios = [], []
        for seed in range(frames):
            seen = see(config, distance_m, seed, hidden, times, look)
            if seen.found:
                errors.append(seen.distance_m - distance_m)
                ratios.append(errors[-1] / seen.sigma_m)
        cell = f"{len(errors):3d}/{frames}" + " " * 18 * (not errors)
        if errors:
            cell += f" {np.mean(errors):+.3f} m {np.sqrt(np.mean(np.square(ratios))):4.1f} {np.abs(ratios).max():4.1f}"
        cells.append(cell)
    print(f"{name:30s}" + "  ".join(f"{d:g} m: {cell}" for d, cell in zip(DISTANCES_M, cells, strict=True)), flush=True)


def see(config: Config, distance_m: float, seed: int, hidden: np.ndarray | None, times: float, look: Look):
    """The target up to 30 degrees aside."""
    rng = np.random.default_rng(seed)
    camera = replace(config.camera, pitch_deg=24.0 if distance_m < 6 else 14.0)
    view = place(distance_m, config.tape.centre_height_m - camera.height_m + 0.02 * rng.normal(),
                 camera.pitch_deg + 2.0 * float(np.clip(rng.normal(), -2, 2)), facing_deg=rng.uniform(-30, 30),
                 bearing_deg=rng.uniform(-5, 5), roll_deg=rng.normal())
    tape = make_tape(replace(config.tape, tape_width_m=times * config.tape.tape_width_m))
    eye = StagedCamera(Stage(view), make_lens(camera), tape, 20.0, 0.0, seed, look=look)
    if hidden is not None:
        eye.clutter((Patch(project(hidden, view.camera_from_target, make_lens(camera))[0], (0, 0, 0)),))
    return detect(eye.expose(0), camera, config.tape, config.vision)


if __name__ == "__main__":
    main()
