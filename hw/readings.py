"""What devices say, in SI, stamped with the monotonic time of arrival."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from msgspec import UNSET, Struct, UnsetType

from truearc.hw.fault_codes import ERROR_BITS
from truearc.hw.reason import Code, Reason

ErrorTable = tuple[tuple[int, Code], ...]         # bit of a controller's error field, and its meaning


class MotorReading(Struct, frozen=True):
    """Newest state of one motor axis. Each group of signals has its own stamp; 0 means never heard.

    Positive is the direction that launches a ball (or raises the hood); position is that of the motor shaft.
    `errors_t_ns` is of devices that tell their errors in a frame of their own. Where the heartbeat tells them it is
    absent, as in recordings from before it was there.
    """

    t_ns: int = 0                     # encoder estimate
    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    heartbeat_t_ns: int = 0
    # its driver's code; truearc.hw.devices.odrive.frames and truearc.hw.devices.spark.frames name theirs
    axis_state: int = 0
    axis_error: int = 0               # likewise; 0 = healthy
    current_t_ns: int = 0
    current_a: float = 0.0            # torque-producing (Iq), sign of torque
    bus_t_ns: int = 0
    bus_v: float = 0.0
    endstop_t_ns: int = 0
    endstop: bool = False             # limit switch closed
    errors_t_ns: int | UnsetType = UNSET


class AngleReading(Struct, frozen=True):
    """Newest state of an absolute angle encoder; `angle_rad` in [0, 2 pi).

    `faults_t_ns` is absent in recordings from before it was there; 0 means never heard.
    """

    t_ns: int
    angle_rad: float
    magnet_ok: bool                   # magnet in range and the device without a fault that corrupts the angle
    faults: int = 0                   # device's own bits, newest heard; truearc.hw.devices.canandmag.frames names them
    faults_t_ns: int | UnsetType = UNSET


class ButtonEvent(Struct, frozen=True):
    """One press on the operator's button box."""

    t_ns: int
    seq: int                          # counted by the box modulo 65536; a gap means lost presses
    button: str                       # one of truearc.hw.devices.button_box.frames.BUTTONS


@dataclass(frozen=True)
class CameraFrame:
    """One image; `t_ns` is the middle of the exposure."""

    t_ns: int
    image: npt.NDArray[np.uint8]      # (height, width, 3), BGR


def errors_in(bits: int, table: ErrorTable) -> tuple[Reason, ...]:
    """Return the errors of a bit field; the bits that the table lacks come last, as one number."""
    unnamed = bits & ~sum(bit for bit, _ in table)
    known = tuple(code() for bit, code in table if bits & bit)
    return (*known, ERROR_BITS(bits=unnamed)) if unnamed else known
