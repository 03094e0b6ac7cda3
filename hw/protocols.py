"""Interfaces to wires, cameras, clocks and motors, real or emulated. Frames and device readings are in SI units."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from msgspec import UNSET, Struct, UnsetType

from truearc.hw.fault_codes import BY_NAME, ERROR_BITS
from truearc.hw.reason import Code, Reason, render

if TYPE_CHECKING:                     # every command loads this module, and most use no arrays
    import numpy as np
    import numpy.typing as npt

NS, NS_PER_MS, NS_PER_S = 1e-9, 1_000_000, 1_000_000_000          # seconds in a nanosecond, and nanoseconds in others

ErrorTable = tuple[tuple[int, Code], ...]         # bit of a controller's error field, and its meaning


class MotorReading(Struct, frozen=True):
    """Newest state of one motor axis. Each group of signals has its own timestamp; 0 means never received.

    Positive is the direction that launches a ball (or raises the hood); position is that of the motor shaft.
    `errors_t_ns` is for devices that report errors in a separate frame. If the heartbeat reports them it is absent, as
    in recordings made before the field existed.
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

    `faults_t_ns` is absent in recordings made before the field existed; 0 means never received.
    """

    t_ns: int
    angle_rad: float
    magnet_ok: bool                   # magnet in range and the device without a fault that corrupts the angle
    faults: int = 0                   # device's own bits, newest heard; truearc.hw.devices.canandmag names them
    faults_t_ns: int | UnsetType = UNSET


class ButtonEvent(Struct, frozen=True):
    """One press on the operator's button box."""

    t_ns: int
    seq: int                          # counted by the box modulo 65536; a gap means lost presses
    button: str                       # one of truearc.hw.devices.button_box.BUTTONS


@dataclass(frozen=True)
class CameraFrame:
    """One image; `t_ns` is the middle of the exposure."""

    t_ns: int
    image: "npt.NDArray[np.uint8]"    # (height, width, 3), BGR


def errors_in(bits: int, table: ErrorTable) -> tuple[Reason, ...]:
    """Return the errors of a bit field; bits that the table lacks come last, as one number."""
    if not bits:
        return ()
    unnamed = bits & ~sum(bit for bit, _ in table)
    known = tuple(code() for bit, code in table if bits & bit)
    return (*known, ERROR_BITS(bits=unnamed)) if unnamed else known


class _WithReason(Exception):
    """An error whose `reason` says what is wrong."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason = reason

    def __str__(self) -> str:
        return render(self.reason, BY_NAME)


class LinkLost(_WithReason):
    """The wire itself is lost (adapter unplugged, port closed); `reason` names it."""


class BadFrame(_WithReason, ValueError):
    """A frame that its device cannot have sent: wrong length, non-finite, or out of range; `reason` names it."""


class Frame(NamedTuple):
    """One CAN frame. `t_ns` is the monotonic receive time; 0 on a frame that has yet to be sent.

    A remote frame has no data on the wire; the length of `data`, all zeros, is the length of the answer that it
    requests.
    """

    t_ns: int
    arbitration_id: int
    data: bytes
    is_extended: bool = False
    is_remote: bool = False

    @property
    def name(self) -> str:
        """Its id as usually written: 0x02e, or 0x070e00c5 if it is extended."""
        return f"0x{self.arbitration_id:08x}" if self.is_extended else f"0x{self.arbitration_id:03x}"


class Bus(Protocol):
    """A CAN bus. Neither call blocks; both raise LinkLost when the adapter is lost."""

    def read(self) -> list[Frame]:
        """Return all frames received since the last call, oldest first."""

    def write(self, frame: Frame) -> bool:
        """Queue one frame; return False if the transmit queue refused it (counted, never retried here)."""

    def faults(self) -> list[Reason]:
        """Return what was wrong with the wire since the last call; empty if nothing was."""


class Stream(Protocol):
    """Data from a serial port. Nothing blocks; reading raises LinkLost."""

    def read(self) -> bytes:
        """Return all bytes received since the last call; empty if there are none."""

    def close(self) -> None: ...


class Camera(Protocol):
    """A camera that keeps only its newest image."""

    def read(self) -> CameraFrame | None:
        """Return the newest image not yet read, or None; raises LinkLost."""

    def close(self) -> None: ...


class Clock(Protocol):
    """The only source of time: monotonic integer nanoseconds with an arbitrary zero."""

    def now_ns(self) -> int: ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return once now_ns() >= t_ns. On the twin this advances the emulated world."""


class Order(NamedTuple):
    """One tick's frames for a motor, and what is in force once they have arrived."""

    frames: tuple[Frame, ...] = ()
    torque_nm: float = 0.0                        # 0 while the motor is not driven
    duty: float | None = None                     # what stands for the torque on the wire of a driver that takes a duty


class Motor(Protocol):
    """One motor axis. No I/O: it receives frames and returns those to send; it reads no clock.

    Torques are at the motor shaft; positive launches a ball or raises the hood. It drives only while all readings that
    it needs are fresh and valid.
    """

    reading: MotorReading

    def ids(self) -> tuple[tuple[int, bool], ...]:
        """Return (arbitration id, is extended) of every frame that `take` understands."""

    def take(self, frame: Frame) -> None:
        """Update `reading` by one frame that is not remote; BadFrame leaves it unchanged."""

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        """Return faults, naming the device, that `reading` does not contain and that prevent driving.

        Called once a tick, at the tick's recorded time, before `order`.
        """

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        """Drive with this torque, once a tick; None: release, which is sent at once, whatever the device reports, and
        repeated from time to time."""

    def release(self) -> tuple[Frame, ...]:
        """Return the frames that leave the motor idle for good."""
