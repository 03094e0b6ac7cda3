"""Interfaces of wires, cameras and clocks, real or emulated."""

from typing import NamedTuple, Protocol

from truearc.hw.fault_codes import BY_NAME
from truearc.hw.readings import CameraFrame
from truearc.hw.reason import Reason, render


class _WithReason(Exception):
    """An error whose `reason` says what is wrong."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason = reason

    def __str__(self) -> str:
        return render(self.reason, BY_NAME)


class LinkLost(_WithReason):
    """The wire itself is gone (adapter unplugged, port closed); `reason` names it."""


class BadFrame(_WithReason, ValueError):
    """A frame that its device cannot have meant: wrong length, non-finite, or out of range; `reason` names it."""


class Frame(NamedTuple):
    """One CAN frame. `t_ns` is the monotonic receive time; 0 on a frame that has yet to be sent.

    A remote frame has no data on the wire; the length of `data`, all zeros, is how long an answer it asks for.
    """

    t_ns: int
    arbitration_id: int
    data: bytes
    is_extended: bool = False
    is_remote: bool = False

    @property
    def name(self) -> str:
        """Its id as people write it: 0x02e, or 0x070e00c5 when it is extended."""
        return f"0x{self.arbitration_id:08x}" if self.is_extended else f"0x{self.arbitration_id:03x}"


class Bus(Protocol):
    """A CAN bus. Neither call blocks; both raise LinkLost when the adapter is gone."""

    def read(self) -> list[Frame]:
        """All frames received since the last call, oldest first."""

    def write(self, frame: Frame) -> bool:
        """Queue one frame; False when the transmit queue refused it (counted, never retried here)."""

    def faults(self) -> list[Reason]:
        """What has been wrong with the wire since the last call; empty when nothing was."""

    def close(self) -> None: ...


class Stream(Protocol):
    """A byte stream such as a serial port. Neither call blocks; both raise LinkLost."""

    def read(self) -> bytes:
        """All bytes received since the last call; empty when there are none."""

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class Camera(Protocol):
    """A camera that keeps only its newest image."""

    def read(self) -> CameraFrame | None:
        """The newest image not yet read, or None; raises LinkLost."""

    def close(self) -> None: ...


class Clock(Protocol):
    """The one source of time. Monotonic integer nanoseconds; the zero is arbitrary."""

    def now_ns(self) -> int: ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return once now_ns() >= t_ns. On the twin this is what makes the emulated world advance."""
