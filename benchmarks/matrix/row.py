"""What one row of the catalogue says, and the words and bounds that rows have in common."""

import math
import struct

from msgspec import Struct

from benchmarks.matrix.breaking import Both, Breaking, Device
from benchmarks.matrix.signs import Signs, says
from truearc.hw.fault_codes import ENCODER_MISMATCH

ITSELF = "by itself"                  # fires again when the fault is over
REARM = "arm again"                   # fires again when the driver has armed again, and not before
DISARMS = "disarmed: arm"             # what happened has disarmed it; fires again when the driver has armed
KEEPS = "keeps firing"                # there is nothing to recover from
REFUSED = "does not start"            # truearc run ends with exit code 2

STALE_S = 0.15                        # a reading may be 0.1 s old; ticks come every 5 ms
BEAT_S = 0.35                         # heartbeats come every 0.1 s, two may be lost
SEEN_S = 0.5                          # a sighting may be 0.3 s old, images come every 0.1 s
DEVICES = {"flywheel_a": "flywheel motor 1", "flywheel_b": "flywheel motor 2", "hood": "hood motor",
           "feeder": "feeder motor", "hood_encoder": "hood encoder"}
AXES = tuple(DEVICES)[:4]
NAN, HUGE = struct.pack("<f", math.nan), struct.pack("<f", 1e20)
TURNS_AT = says(ENCODER_MISMATCH, motor="flywheel motor 1")
WANTED_RAD_S = 0.3 * 594.0            # what the robot is asked to fire with


class Row(Struct, frozen=True):
    """One fault. `reason`: what a verdict says, one of these; of a fault that does not hold, what is seen of it, if
    anything (none asks for nothing). `refusal`: of one with which it does not start, a pattern of what it says.
    `within_s`: of its begin. `real`: needs real time on the virtual bus, too. `first`:
    it stands from before the robot starts. `launcher`: of benchmarks.matrix.launchers."""

    name: str
    family: str
    breaking: Breaking
    reason: Signs
    within_s: float
    after: str = ITSELF
    lasts_s: float = 0.6
    real: bool = False
    buses: tuple[str, ...] = ("virtual", "slcan", "socketcan")
    first: bool = False
    launcher: str = "odrive"
    refusal: str = ""


def tell_wanted(message: str, at: int, unit_rad_s: float) -> Both:
    """Both flywheel motors say from the start that they turn as is wanted, so that nothing spins them up; the second
    one is mounted the other way round."""
    speeds = (struct.pack("<f", sign * WANTED_RAD_S / unit_rad_s) for sign in (1.0, -1.0))
    one, other = (Device(name, "overwritten", message, at=at, data=speed)
                  for name, speed in zip(("flywheel_a", "flywheel_b"), speeds, strict=True))
    return Both(one, other)
