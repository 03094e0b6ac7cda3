"""How fast, how accurate and how wary vision is, beside a straightforward OpenCV pipeline.

    python -m benchmarks.vision [--frames 200] [--clutter 10000] [--files 10000] [--plot docs/images/vision.png]

Rendered images come from hw/emulated, which shares no code with robot/vision.
"""

import argparse
import os
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from msgspec.structs import replace

from benchmarks.vision_scenes import LOOKS, TURNING, WRITTEN, Shot, baseline, clutter, shoot
from truearc import robot
from truearc.cli.common import make_progress
from truearc.cli.robot.vision_tools.images import decode_image
from truearc.errors import InputError
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import Config, load_config
from truearc.robot.vision import detect

HOME = Path(robot.__file__).parent
SHARP, STATED, STATED_PX = "sharp, quiet", "sharp, stated", 0.08    # that look once more, with corner_sigma_px as it is
BANDS_M = ((1, 2), (2, 3), (3, 5), (5, 7), (7, 9), (9, 12), (12, 16))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=200, help="in each band of distance, for each look")
    parser.add_argument("--clutter", type=int, default=10_000, help="frames with distractors")
    parser.add_argument("--files", type=int, default=10_000, help="mutated image files")
    parser.add_argument("--plot", help="picture of errors over distance to write")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    config = load_config(HOME / "launcher.toml")
    speed(config, min(100, 10 * args.frames))
    errors = sweep(config, args.frames)
    if args.plot and len(errors):
        plot(errors, args.plot)
    wary(config, args.clutter)
    fuzz(config, args.files)


def speed(config: Config, frames: int) -> None:
    """Both pipelines on the same frames in one run: frame to distance, one core. Time on the core does not count what
    other processes take from it."""
    rng = np.random.default_rng(1)
    shots = [shoot(config, rng, distance_m, LOOKS["usual"]) for distance_m in rng.uniform(2, 9, frames)]
    spent: dict[str, list[tuple[float, float]]] = {"truearc": [], "OpenCV baseline": []}
    errors: dict[str, list[float]] = {"truearc": [], "OpenCV baseline": []}
    for _ in range(3):
        for shot in shots:
            for name in spent:
                began = time.perf_counter_ns(), time.thread_time_ns()
                seen_m = (baseline(shot, config) if name != "truearc" else
                          detect(shot.frame, shot.camera, config.tape, config.vision).distance_m)
                spent[name].append(((time.perf_counter_ns() - began[0]) / 1e6,
                                    (time.thread_time_ns() - began[1]) / 1e6))
                if seen_m is not None:
                    errors[name].append(seen_m - shot.distance_m)
    print(f"640x480 frame to distance on one core, {frames} rendered frames at 2-9 m, three times")
    for name, times in spent.items():
        wall, core = np.transpose(times)
        print(f"  {name:16s} wall p50 {np.median(wall):5.2f} ms  core p50 {np.median(core):5.2f} ms, p95 "
              f"{np.percentile(core, 95):5.2f} ms  found {len(errors[name]):3d}/{len(times)}  "
              f"rms error {rms(errors[name]):.3f} m")


def sweep(config: Config, frames: int) -> np.ndarray:
    """Rows of look, distance, error, error / sigma; prints the table."""
    print(f"rendered, {frames} frames in each cell, up to 35 degrees off axis: rms error (found; spread of error / "
          "sigma)\n  " + " " * 16 + "".join(f"{f'{low}-{high} m':>22s}" for low, high in BANDS_M))
    progress, rows = make_progress("sweep"), []
    looks = [*LOOKS.items(), (STATED, LOOKS[SHARP]), *WRITTEN.items(), *TURNING.items()]
    for k, (name, look) in enumerate(looks):
        vision = replace(config.vision, corner_sigma_px=STATED_PX) if name == STATED else config.vision
        cells = []
        for j, band in enumerate(BANDS_M):
            rng = np.random.default_rng([2, k, j])
            found = []
            for distance_m in rng.uniform(*band, frames):
                shot = shoot(config, rng, float(distance_m), look)
                seen = detect(shot.frame, shot.camera, config.tape, vision)
                if seen.found:
                    found.append((k, distance_m, seen.distance_m - distance_m, seen.sigma_m))
            rows += found if name in LOOKS else []     # the same look again, and what was to be avoided, do not count
            errors, sigma = np.array([row[2] for row in found]), np.array([row[3] for row in found])
            cells.append(f"{rms(errors):.3f} ({len(found) / frames:4.0%}; {rms(errors / sigma):.2f})")
            progress((k * len(BANDS_M) + j + 1) / len(looks) / len(BANDS_M), name)
        print(f"  {name:16s}" + "".join(f"{cell:>22s}" for cell in cells))
    table = np.array(rows)
    near, far = table[table[:, 1] < 9], table[table[:, 1] >= 9]
    print(f"  all: rms {rms(near[:, 2]):.3f} m up to 9 m, {rms(far[:, 2] / far[:, 1]):.2%} beyond; error / sigma "
          f"{rms(table[:, 2] / table[:, 3]):.2f}, within one sigma {np.mean(np.abs(table[:, 2]) < table[:, 3]):.0%}")
    return table


def wary(config: Config, frames: int) -> None:
    """Distractors: a wrong target is one whose corners are not those of the true one; a second goal, which is no less
    a goal, is wrong where the true one is there and nothing stands before it."""
    rng, progress = np.random.default_rng(3), make_progress("clutter")
    reasons: Counter[str] = Counter()
    right = wrong = there = other = 0
    ratios = []
    for k in range(frames):
        shot = clutter(config, rng)
        there += shot.corners_px is not None
        seen = detect(shot.frame, shot.camera, config.tape, config.vision)
        if not seen.found:
            reasons[seen.reason.code] += 1
        elif is_target(shot, seen.corners_px):
            right += 1
            ratios.append((seen.distance_m - shot.distance_m) / seen.sigma_m)
        elif is_other(shot, seen.corners_px):
            other += 1
        else:
            wrong += 1
            print(f"  wrong: frame {k} {shot.kind}: {seen.distance_m:.2f} m, truth {shot.distance_m:.2f}, "
                  f"{'there' if shot.corners_px is not None else 'absent'}")
        progress((k + 1) / frames, "")
    print(f"{frames} frames with distractors, the target in {there} of them: {wrong} wrong targets accepted, "
          f"{right} right ones (rms of error / sigma {rms(ratios):.2f}, worst {np.abs(ratios).max(initial=0):.1f}), "
          f"{other} other goals where the true one was absent or covered; refused:")
    for reason, count in reasons.most_common():
        print(f"  {count:6d}  {reason}")


def is_target(shot: Shot, corners_px: tuple) -> bool:
    """Whether these are the true target's corners, to a few pixels (the shake is not in the truth)."""
    if shot.corners_px is None:
        return False
    size_px = float(np.ptp(shot.corners_px, axis=0).max())
    return bool(np.abs(np.array(corners_px) - shot.corners_px).max() < 3.0 + 0.03 * size_px)


def is_other(shot: Shot, corners_px: tuple) -> bool:
    """Whether these are a second goal's corners, and the true one is absent or something may stand before it."""
    if shot.other_px is None or (shot.corners_px is not None and shot.kind == "second_goal"):
        return False
    low, high = shot.other_px.min(axis=0), shot.other_px.max(axis=0)
    off_px = [np.min(corners_px, axis=0) - low, np.max(corners_px, axis=0) - high]
    return bool(np.abs(off_px).max() < 4.0 + 0.05 * (high - low).max())


def fuzz(config: Config, files: int) -> None:
    """Mutated image files: each is an image or a InputError, never anything else."""
    rng = np.random.default_rng(4)
    image = shoot(config, rng, 4.0, LOOKS["usual"]).frame.image
    whole = [cv2.imencode(end, picture)[1].tobytes() for end in (".jpg", ".png", ".bmp", ".webp")
             for picture in (image, image[:, :, 1], cv2.resize(image, None, fx=0.1, fy=0.1))]
    whole += [cv2.imencode(".png", image.astype(np.uint16) * 256)[1].tobytes(), b""]
    said: Counter[str] = Counter()
    stderr = os.dup(2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)      # decoders grumble about each
    for _ in range(files):
        data = mutate(whole[int(rng.integers(len(whole)))], rng)
        try:
            seen = detect(CameraFrame(0, decode_image(data)), config.camera, config.tape, config.vision)
            said["an image: target found" if seen.found else "an image: no target"] += 1
        except InputError as error:
            said["refused: " + "".join(c for c in str(error) if not c.isdigit())] += 1
    os.dup2(stderr, 2)
    print(f"{files} mutated image files, no crash:")
    for word, count in said.most_common():
        print(f"  {count:6d}  {word}")


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes flipped (in the header as often as elsewhere), cut out, repeated, or the end lost."""
    body = bytearray(data)
    for _ in range(int(rng.integers(1, 12))):
        if not body:
            break
        at = int(rng.integers(min(len(body), 60) if rng.random() < 0.5 else len(body)))
        match int(rng.integers(6)):
            case 0 | 1 | 2:
                body[at] = int(rng.integers(256))
            case 3:
                del body[at:at + int(rng.integers(1, 200))]
            case 4:
                body[at:at] = body[at:at + int(rng.integers(1, 200))]
            case 5 if rng.random() < 0.3:
                del body[at:]
    return bytes(body)


def plot(table: np.ndarray, path: str) -> None:
    """Errors over distance, with the promise."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 4), layout="constrained")
    for k, name in enumerate(LOOKS):
        rows = table[table[:, 0] == k]
        axes.plot(rows[:, 1], 100 * rows[:, 2], ".", ms=2, alpha=0.5, label=name)
    reach = np.linspace(1, 16, 100)
    bound = np.where(reach <= 9, 5.0, reach)
    axes.plot(reach, bound, "k-", reach, -bound, "k-", lw=0.8)
    axes.set(xlabel="distance, m", ylabel="error, cm", ylim=(-30, 30), title="black: 5 cm up to 9 m, 1 % beyond (rms)")
    axes.legend(markerscale=6, ncols=3)
    figure.savefig(path, dpi=110)


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


if __name__ == "__main__":
    main()
