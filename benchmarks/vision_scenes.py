"""Rendered scenes for benchmarks/vision.py, and the straightforward baseline that vision is measured beside."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from truearc.hw.emulated.camera import NOTHING, Stage, outline_m, project
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraConfig, Config
from truearc.sim.world.emulated_vision import make_lens, make_tape
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

LOOKS = {
    "usual": USUAL,
    "sharp, quiet": Look(noise=0.5, blur_px=0.4, halo_share=0.0, shake_px=0.0),
    "noise 8": Look(noise=8.0),
    "blur 1.5 px": Look(blur_px=1.5),
    "smear 4 px": Look(smear_px=(3.5, 2.0)),
    "bloom 40 %": Look(halo_share=0.4),
}
WRITTEN = {"gamma 2.2": Look(gamma=2.2), "clipped 2.5 x": Look(gain=2.5)}    # not as docs/how-to/vision.md asks
SMEAR_PX = 0.0366                     # of a degree a second, in an exposure of 3 ms
TURNING = {f"turns {rate} deg/s": Look(turn_deg_s=(rate, rate / 5), readout_s=0.03,
                                       smear_px=(-SMEAR_PX * rate, SMEAR_PX * rate / 5)) for rate in (10, 30, 90)}


@dataclass(frozen=True)
class Shot:
    """One image, what was true, and the camera as its robot has it."""

    frame: CameraFrame
    camera: CameraConfig
    distance_m: float
    facing_deg: float
    corners_px: np.ndarray | None     # (4, 2) of the target, before the shake; None when it is not there
    kind: str = ""
    other_px: np.ndarray | None = None    # (n, 2) of a second goal


def pitch_for(distance_m: float, rise_m: float) -> float:
    """A mounting that has the target in view: robots look up less when they shoot from afar."""
    return float(np.clip(math.degrees(math.atan2(rise_m, distance_m)) - 6.0, 5.0, 55.0))


def shoot(config: Config, rng: np.random.Generator, distance_m: float, look: Look, *, kinds: tuple = (),
          absent: bool = False) -> Shot:
    """The target up to 35 degrees off its axis, the camera up to 9 degrees off its own, mounted as well as believed and
    turning as much, unless the look says how it turns or is of a camera that stands still."""
    tape = config.tape
    rise_m = tape.centre_height_m - config.camera.height_m
    believed = config.camera.__class__(**{**_fields(config.camera), "pitch_deg": pitch_for(distance_m, rise_m)})
    pitch_deg = believed.pitch_deg + believed.pitch_sigma_deg * float(np.clip(rng.normal(), -2, 2))
    rise_m += believed.height_sigma_m * float(np.clip(rng.normal(), -2, 2))
    facing_deg = float(rng.uniform(-35, 35))
    view = place(distance_m, rise_m, pitch_deg, facing_deg=facing_deg, bearing_deg=float(rng.uniform(-9, 9)),
                 roll_deg=float(rng.normal()), brightness=float(rng.uniform(0.6, 1.4)))
    if look.shake_px and not look.readout_s:
        look = _turned(look, believed, np.clip(rng.normal(size=2), -2, 2))
    lens = make_lens(believed)
    corners, _ = project(outline_m(make_tape(tape)), view.camera_from_target, lens)
    camera = StagedCamera(Stage(NOTHING if absent else view), lens, make_tape(tape), 20.0, 0.0,
                            int(rng.integers(1 << 31)), look=look)
    patches = {kind: kind(lens, corners, rng) for kind in kinds}
    camera.clutter(tuple(patch for some in patches.values() for patch in some))
    other = [patch.corners_px for patch in patches.get(second_goal, ())]
    return Shot(camera.expose(0), believed, distance_m, facing_deg, None if absent else corners[:4],
                " + ".join(kind.__name__ for kind in kinds), np.concatenate(other) if other else None)


def _turned(look: Look, camera: CameraConfig, sigmas: np.ndarray) -> Look:
    """The same, of a camera that turns; the little it smears is its turning's."""
    right, up = camera.turn_sigma_deg_s * sigmas * (1.0, 0.2)
    x_px, y_px = look.smear_px
    return replace(look, turn_deg_s=(right, up), readout_s=camera.readout_s,
                   smear_px=(x_px - SMEAR_PX * right, y_px + SMEAR_PX * up))


def clutter(config: Config, rng: np.random.Generator) -> Shot:
    """A scene of one to three distractors, with the target or without it."""
    kinds = tuple(KINDS[k] for k in rng.choice(len(KINDS), int(rng.integers(1, 4)), replace=False))
    look = list(LOOKS.values())[int(rng.integers(len(LOOKS)))]
    absent = bool(rng.random() < 0.5)
    if absent:
        kinds = tuple(kind for kind in kinds if kind not in (floor_reflection, in_the_way)) or (KINDS[4],)
    return shoot(config, rng, float(rng.uniform(1.0, 14.0)), look, kinds=kinds, absent=absent)


def _fields(camera: CameraConfig) -> dict:
    return {name: getattr(camera, name) for name in camera.__struct_fields__}


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
