"""Benchmark of vision: its speed, accuracy and false detections, compared with a straightforward OpenCV pipeline.

    python -m benchmarks.vision [--frames 200] [--clutter 10000] [--files 10000] [--plot docs/images/vision.png]

The rendered images come from hw/emulated, which shares no code with robot/vision.
"""

import dataclasses
import math
import os
import time
from contextlib import suppress
from random import Random

import cv2
import numpy as np
from msgspec.structs import replace

from benchmarks.fuzz_mutators import damage
from benchmarks.options import read_options
from truearc.cli.common import SHIPPED, make_progress
from truearc.cli.vision_images import decode_image
from truearc.errors import InputError
from truearc.hw.emulated.camera import NOTHING, Stage, outline_m, project
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraConfig, Config, load_config
from truearc.robot.vision import detect
from truearc.sim.world.emulated_robot import make_lens, make_tape
from truearc_proof.world.camera_damage import (
    KINDS,
    USUAL,
    Look,
    StagedCamera,
    floor_reflection,
    in_the_way,
    place,
    second_goal,
)

BANDS_M = ((1, 2), (2, 3), (3, 5), (5, 7), (7, 9), (9, 12), (12, 16))
LOOKS = {
    "usual": USUAL,
    "sharp, quiet": Look(noise=0.5, blur_px=0.4, halo_share=0.0, shake_px=0.0),
    "noise 8": Look(noise=8.0),
    "blur 1.5 px": Look(blur_px=1.5),
    "smear 4 px": Look(smear_px=(3.5, 2.0)),
    "bloom 40 %": Look(halo_share=0.4),
}
SMEAR_PX = 0.0366                     # of a degree a second, in an exposure of 3 ms


@dataclasses.dataclass(frozen=True)
class Shot:
    """One image, what was true, and the camera as its robot has it."""

    frame: CameraFrame
    camera: CameraConfig
    distance_m: float
    corners_px: np.ndarray | None     # (4, 2) of the target, before the shake; None when it is not there
    kind: str = ""
    other_px: np.ndarray | None = None    # (n, 2) of a second goal


def shoot(config: Config, rng: np.random.Generator, distance_m: float, look: Look, *, kinds: tuple = (),
          absent: bool = False) -> Shot:
    """The target up to 35 degrees off its axis, the camera up to 9 degrees off its own, mounted to have it in view, as
    well as believed, and turning as much, unless the look is of a camera that stands still."""
    tape = config.tape
    rise_m = tape.centre_height_m - config.camera.height_m
    believed = replace(config.camera, pitch_deg=float(np.clip(math.degrees(math.atan2(rise_m, distance_m)) - 6, 5, 55)))
    pitch_deg = believed.pitch_deg + believed.pitch_sigma_deg * float(np.clip(rng.normal(), -2, 2))
    rise_m += believed.height_sigma_m * float(np.clip(rng.normal(), -2, 2))
    facing_deg = float(rng.uniform(-35, 35))
    view = place(distance_m, rise_m, pitch_deg, facing_deg=facing_deg, bearing_deg=float(rng.uniform(-9, 9)),
                 roll_deg=float(rng.normal()), brightness=float(rng.uniform(0.6, 1.4)))
    if look.shake_px:
        look = _turned(look, believed, np.clip(rng.normal(size=2), -2, 2))
    lens = make_lens(believed)
    corners, _ = project(outline_m(make_tape(tape)), view.camera_from_target, lens)
    camera = StagedCamera(Stage(NOTHING if absent else view), lens, make_tape(tape),
                            int(rng.integers(1 << 31)), look=look)
    patches = {kind: kind(lens, corners, rng) for kind in kinds}
    camera.clutter(tuple(patch for some in patches.values() for patch in some))
    other = [patch.corners_px for patch in patches.get(second_goal, ())]
    return Shot(camera.expose(0), believed, distance_m, None if absent else corners[:4],
                " + ".join(kind.__name__ for kind in kinds), np.concatenate(other) if other else None)


def _turned(look: Look, camera: CameraConfig, sigmas: np.ndarray) -> Look:
    """The same, of a camera that turns; the little it smears is its turning's."""
    right, up = camera.turn_sigma_deg_s * sigmas * (1.0, 0.2)
    x_px, y_px = look.smear_px
    return dataclasses.replace(look, turn_deg_s=(right, up), readout_s=camera.readout_s,
                               smear_px=(x_px - SMEAR_PX * right, y_px + SMEAR_PX * up))


def clutter(config: Config, rng: np.random.Generator) -> Shot:
    """A scene of one to three distractors, with the target or without it."""
    kinds = tuple(KINDS[k] for k in rng.choice(len(KINDS), int(rng.integers(1, 4)), replace=False))
    look = list(LOOKS.values())[int(rng.integers(len(LOOKS)))]
    absent = bool(rng.random() < 0.5)
    if absent:
        kinds = tuple(kind for kind in kinds if kind not in (floor_reflection, in_the_way)) or (KINDS[4],)
    return shoot(config, rng, float(rng.uniform(1.0, 14.0)), look, kinds=kinds, absent=absent)


def baseline(shot: Shot, config: Config) -> float | None:
    """What most robots do: HSV threshold, largest contour, minAreaRect, its corners to solvePnP; the mounting's pitch
    turns the pose into a horizontal distance."""
    vision, camera, tape = config.vision, shot.camera, config.tape
    hsv = cv2.cvtColor(shot.frame.image, cv2.COLOR_BGR2HSV)
    mask = cv2.inRange(hsv, (vision.hue_low, vision.saturation_low, vision.value_low), (vision.hue_high, 255, 255))
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    contours = [contour for contour in contours if cv2.contourArea(contour) >= vision.min_area_px]
    if not contours:
        return None
    box = cv2.boxPoints(cv2.minAreaRect(max(contours, key=cv2.contourArea)))
    box = box[np.argsort(box[:, 1])]
    (top_left, top_right), (low_left, low_right) = (pair[np.argsort(pair[:, 0])] for pair in (box[:2], box[2:]))
    wide, high = tape.top_width_m / 2, tape.height_m / 2
    model = np.array([[-wide, -high, 0], [wide, -high, 0], [wide, high, 0], [-wide, high, 0]])
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    ok, _, tvec = cv2.solvePnP(model, np.array([top_left, top_right, low_right, low_left], dtype=np.float64), matrix,
                               np.array(camera.distortion))
    if not ok:
        return None
    x, y, z = tvec.ravel()
    pitch = math.radians(camera.pitch_deg)
    return math.hypot(x, z * math.cos(pitch) + y * math.sin(pitch))


def main() -> None:
    args = read_options(__doc__, frames=(200, "in each band of distance, for each look"),
                        clutter=(10_000, "frames with distractors"), files=(10_000, "mutated image files"),
                        plot=(str, "picture of errors over distance to write"))
    cv2.setNumThreads(1)
    config = load_config(SHIPPED)
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
    for k, (name, look) in enumerate(LOOKS.items()):
        cells = []
        for j, band in enumerate(BANDS_M):
            rng = np.random.default_rng([2, k, j])
            found = []
            for distance_m in rng.uniform(*band, frames):
                shot = shoot(config, rng, float(distance_m), look)
                seen = detect(shot.frame, shot.camera, config.tape, config.vision)
                if seen.found:
                    found.append((k, distance_m, seen.distance_m - distance_m, seen.sigma_m))
            rows += found
            errors, sigma = np.array([row[2] for row in found]), np.array([row[3] for row in found])
            cells.append(f"{rms(errors):.3f} ({len(found) / frames:4.0%}; {rms(errors / sigma):.2f})")
            progress((k * len(BANDS_M) + j + 1) / len(LOOKS) / len(BANDS_M), name)
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
    right = wrong = there = other = 0
    ratios = []
    for k in range(frames):
        shot = clutter(config, rng)
        progress((k + 1) / frames, "")
        there += shot.corners_px is not None
        seen = detect(shot.frame, shot.camera, config.tape, config.vision)
        if not seen.found:
            continue
        if is_target(shot, seen.corners_px):
            right += 1
            ratios.append((seen.distance_m - shot.distance_m) / seen.sigma_m)
        elif is_other(shot, seen.corners_px):
            other += 1
        else:
            wrong += 1
            print(f"  wrong: frame {k} {shot.kind}: {seen.distance_m:.2f} m, truth {shot.distance_m:.2f}, "
                  f"{'there' if shot.corners_px is not None else 'absent'}")
    print(f"{frames} frames with distractors, the target in {there} of them: {wrong} wrong targets accepted, "
          f"{right} right ones (rms of error / sigma {rms(ratios):.2f}, worst {np.abs(ratios).max(initial=0):.1f}), "
          f"{other} other goals where the true one was absent or covered")


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
    rng, random = np.random.default_rng(4), Random(4)
    image = shoot(config, rng, 4.0, LOOKS["usual"]).frame.image
    whole = [cv2.imencode(end, picture)[1].tobytes() for end in (".jpg", ".png", ".bmp", ".webp")
             for picture in (image, image[:, :, 1], cv2.resize(image, None, fx=0.1, fy=0.1))]
    whole += [cv2.imencode(".png", image.astype(np.uint16) * 256)[1].tobytes(), b""]
    stderr = os.dup(2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)      # decoders grumble about each
    for _ in range(files):
        data = damage(random.choice(whole), "bytes", random)[1]
        with suppress(InputError):
            detect(CameraFrame(0, decode_image(data)), config.camera, config.tape, config.vision)
    os.dup2(stderr, 2)
    print(f"{files} mutated image files, no crash")


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
