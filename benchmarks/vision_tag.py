"""Benchmark of AprilTag detection: errors on rendered images from 1 to 8 m, and false detections without a tag.

    python -m benchmarks.vision_tag [--frames 400] [--distractors 10000] [--seed 1]

The images are those of tests/robot/tag_scene.py (1280 x 800 pixels, blur 0.6 px, noise 3 of 255). In the images of
distractors, every id of the tag family counts as a detection.
"""

import time
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from benchmarks.options import read_options
from tests.robot.test_vision_tag import CONFIG, TAG, distractor, looking, seen
from truearc.robot.vision import find_target

BANDS_M = (1.0, 2.0, 3.5, 5.0, 6.5, 8.0)


def main() -> None:
    args = read_options(__doc__, frames=400, distractors=10_000, seed=1)
    rng = np.random.default_rng(args.seed)
    rows, spent_s = [], 0.0
    for distance_m in rng.uniform(BANDS_M[0], BANDS_M[-1], args.frames).tolist():
        camera = looking(distance_m)
        frame, config = seen(rng, distance_m, camera=camera), replace(CONFIG, camera=camera)
        began = time.process_time()
        found = find_target(frame, config)
        spent_s += time.process_time() - began
        rows.append((distance_m, found.distance_m or np.nan, found.sigma_m or np.nan))
    true, said, sigma = np.array(rows).T
    print(f"{args.frames} images, {1e3 * spent_s / args.frames:.0f} ms each\n\n"
          "| distance, m | found | error, rms | worst | within one sigma |\n|---|---|---|---|---|")
    for low, high in (*pairwise(BANDS_M), (BANDS_M[0], BANDS_M[-1])):
        mine = (true >= low) & (true <= high)
        there = mine & np.isfinite(said)
        off = (said - true)[there]
        if len(off):
            print(f"| {low:g} to {high:g} | {there.sum()} of {mine.sum()} | "
                  f"{np.sqrt(np.mean((off / true[there])**2)):.2%} | {np.abs(off / true[there]).max():.2%} | "
                  f"{np.mean(np.abs(off) <= sigma[there]):.2f} |")
    every = replace(CONFIG, apriltag=replace(TAG, ids=tuple(range(587))))
    print(f"\nwrong tags in {args.distractors} images of distractors: "
          f"{sum(find_target(distractor(rng), every).found for _ in range(args.distractors))}")


if __name__ == "__main__":
    main()
