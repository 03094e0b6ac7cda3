"""Button box and camera; the computer: its clock, its promises to a process that must be on time, its disk."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.devices.button_box.frames import parse_lines
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.machine import Exposure
from truearc.hw.protocols import Camera, CameraFrame, Clock, LinkLost, Stream
from truearc.robot.config.schema import CameraConfig
from truearc.robot.reasons import text

NS_PER_S = 1_000_000_000
LOOK_NS = 20_000_000
BOX_S, CAMERA_S = 1.6, 3.0            # three heartbeats of the box; a camera that starts slowly
GLARE = 0.25                          # of the image at full brightness: no target can be measured in it
# A covered lens gives black, and the sensor's noise on it. Means of blocks of 32 pixels then differ by 2.3 of 255 at
# most (noise of 20, JPEG of quality 50), in emulated pictures with and without the target by 40 at least.
BLOCK_PX, FLAT, DARK = 32, 4.0, 32.0
EXPOSURE_DO = "set it: `v4l2-ctl -d {} -c auto_exposure=1 -c exposure_time_absolute=50` (5 ms), or deploy --exposure-ms"
RECORDING_BYTES_S = 100_000           # ticks and CAN frames: 90 kB/s on the emulated robot, and half a MB a shot
FULL_BYTES = 200_000_000              # half an hour
SCARCE_BYTES = 2_000_000_000          # half a day


def check_box(box: Stream, clock: Clock) -> Finding:
    """Whether the button box says that it is there."""
    check, pending, wrong = "button box", b"", None
    began_ns = clock.now_ns()
    while clock.now_ns() - began_ns < BOX_S * NS_PER_S:
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
        try:
            events, pending, faults = parse_lines(pending, box.read(), clock.now_ns())
        except LinkLost as error:
            return failure(check, str(error), "look at its plug")
        if events:
            return ok(check, "it says that it is there")
        wrong = faults[0] if faults else wrong
    if wrong is not None:
        return failure(check, f"its lines cannot be read ({text(wrong)})",
                       "compare its program with docs/how-to/button-box.md")
    return failure(check, f"silent for {BOX_S:g} s", "look at its power and at [buttons] port and baud")


def check_calibration(camera: CameraConfig) -> Finding:
    """Whether a camera that sees tags has a calibration that says how good it is."""
    check = "camera for tags"
    if camera.focal_sigma > 0.0 or any(camera.distortion):
        return ok(check, "[camera] has a calibration with its uncertainty")
    return warning(check, "[camera] states neither distortion nor how well its focal length is known",
                   "`truearc vision-calibrate` finds both")


def check_exposure(camera: CameraConfig, exposure: Exposure | None) -> Finding:
    """Whether images are taken with a fixed exposure that ends before the next begins."""
    check, do = "camera exposure", EXPOSURE_DO.format(camera.device)
    if "://" in camera.device:
        return warning(check, "a network camera: nothing here fixes its exposure or reads it back" +
                       (", [camera] exposure_s only stamps its images" if camera.exposure_s > 0.0 else ""),
                       "fix it in the camera's own settings: a few ms, not automatic")
    if camera.exposure_s > 0.0:
        return ok(check, f"the configuration fixes it at {camera.exposure_s * 1e3:g} ms; a camera that will not have "
                  "it does not open")
    if exposure is None or exposure.automatic is None:
        return warning(check, "the camera does not say how it exposes", do)
    if exposure.automatic:
        return failure(check, "automatic: a bright tape in a dark hall will be blurred and washed out", do)
    if exposure.length_s is None:
        return ok(check, "fixed")
    if exposure.length_s * camera.fps > 1.0:
        return failure(check, f"{exposure.length_s * 1e3:g} ms are longer than from one image to the next "
                       f"({1e3 / camera.fps:g} ms)", do)
    return ok(check, f"fixed at {exposure.length_s * 1e3:g} ms")


def check_camera(camera: Camera, clock: Clock) -> Finding:
    """Whether images come, and whether anything can be seen in them."""
    check = "camera"
    began_ns = clock.now_ns()
    try:
        while (picture := camera.read()) is None and clock.now_ns() - began_ns < CAMERA_S * NS_PER_S:
            clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
    except LinkLost as error:
        return failure(check, str(error), "look at its plug")
    if picture is None:
        return failure(check, f"no image within {CAMERA_S:g} s", "look at its plug; does another program use it?")
    return _judge(check, picture)


def _judge(check: str, picture: CameraFrame) -> Finding:
    height, width = picture.image.shape[:2]
    glare = float(np.mean(picture.image.max(axis=2) >= 255))
    if glare > GLARE:
        return warning(check, f"{glare:.0%} of its image are at full brightness", "shorten the exposure")
    if _is_black(picture.image):
        return warning(check, "its image is black all over, but for noise", "take the cap off, switch the ring light "
                       "on, point it at something bright")
    return ok(check, f"images of {width} x {height} pixels come")


def _is_black(image: npt.NDArray[np.uint8]) -> bool:
    """Whether an image (h, w, 3) is dark and without anything to see in it: what is left of its blocks' means."""
    high, wide = (max(side // BLOCK_PX, 1) for side in image.shape[:2])
    blocks = cv2.resize(image, (wide, high), interpolation=cv2.INTER_AREA).astype(np.float32)
    return bool(image.mean() < DARK and np.abs(blocks - np.median(blocks, axis=(0, 1))).max() < FLAT)


def check_clock(synchronised: bool | None) -> Finding:
    """The time of day only names recordings, so a wrong one is never a failure."""
    check = "time of day"
    if synchronised:
        return ok(check, "set by a time server")
    says = "not known whether it is right" if synchronised is None else "not set since the computer was started"
    return warning(check, f"{says}: recordings may bear wrong dates",
                   "connect it to a network with a time server once, or give it a battery-backed clock")


def check_real_time(answers: Sequence[tuple[str, str]]) -> list[Finding]:
    """`answers`: (the request to the system, why it was refused, "" = it was granted)."""
    return [warning("real time", f"{asked} is refused ({refused}): ticks may come late",
                    "run it as the service of `truearc deploy`, which is allowed to") if refused
            else ok("real time", f"{asked} is allowed") for asked, refused in answers]


def check_disk(folder: Path, free_bytes: int | None, writable: bool) -> Finding:
    """Room for recordings; `free_bytes` is None when the place cannot be asked."""
    check = "disk"
    if free_bytes is None or not writable:
        return failure(check, f"{folder} cannot be written to", "give --out a folder that this user may write to")
    room = f"{free_bytes / 1e9:.1f} GB are free in {folder}, {free_bytes / RECORDING_BYTES_S / 3600:.1f} h of recording"
    if free_bytes < FULL_BYTES:
        return failure(check, room, "copy recordings elsewhere and delete them here")
    if free_bytes < SCARCE_BYTES:
        return warning(check, room, "make room before a long day")
    return ok(check, room)
