"""Asks the machine about itself; None where it cannot say (no such tool, no such device, not Linux)."""

import os
import struct
import subprocess
import sys

from truearc.hw.machine import CanLink, Exposure, parse_link

PATIENCE_S = 5.0
# <linux/videodev2.h>: VIDIOC_G_CTRL is _IOWR('V', 27, struct v4l2_control), two 32-bit numbers
G_CTRL = 0xC008561B
EXPOSURE_AUTO, EXPOSURE_ABSOLUTE = 0x009A0901, 0x009A0902
MANUAL = (1, 2)                       # manual, and shutter priority: either way the length stands still
UNITS_PER_S = 10_000


def read_link(name: str) -> CanLink | None:
    """A network interface as `ip` describes it; None when there is none of that name."""
    said = _said("ip", "-json", "-details", "link", "show", "dev", name)
    return None if said is None else parse_link(said)


def is_clock_synchronised() -> bool | None:
    """Whether the time of day has been set by a time server since the machine was started."""
    said = _said("timedatectl", "show", "--property=NTPSynchronized", "--value")
    return {"yes": True, "no": False}.get((said or "").strip())


def read_exposure(device: str) -> Exposure | None:
    """How a V4L2 camera (path or index) exposes, whoever else uses it; None when it cannot be asked."""
    if sys.platform != "linux":
        return None
    try:
        handle = os.open(f"/dev/video{device}" if device.isdecimal() else device, os.O_RDWR | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        mode, length = _control(handle, EXPOSURE_AUTO), _control(handle, EXPOSURE_ABSOLUTE)
    finally:
        os.close(handle)
    return Exposure(None if mode is None else mode not in MANUAL, None if length is None else length / UNITS_PER_S)


def _control(handle: int, number: int) -> int | None:
    import fcntl  # POSIX only

    try:
        return int(struct.unpack("Ii", fcntl.ioctl(handle, G_CTRL, struct.pack("Ii", number, 0)))[1])
    except OSError:                               # a camera without that control
        return None


def _said(*command: str) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
