"""A CAN bus through python-can: socketcan, slcan, virtual and whatever else that library opens."""

import contextlib
import errno
from typing import Any

import can

from hw.link import Clock, Frame, LinkLost

QUEUE_FULL = (errno.ENOBUFS, errno.EAGAIN)
# python-can gives no code for these two (socketcan, virtual)
QUEUE_FULL_WORDS = ("Transmit buffer full", "Could not send message to one or more recipients")
SLCAN_WRITE_S = 0.02                              # a serial adapter must not be cut off in the middle of a line


class _Outgoing(can.Message):  # type: ignore[misc]  # the library is not looked into
    """A message to send.

    The virtual bus copies it for every listener, and the library's general copy takes longer than all else about a
    frame; this one makes the same object.
    """

    __slots__ = ()

    def __deepcopy__(self, memo: dict[int, Any] | None) -> can.Message:
        return can.Message(self.timestamp, self.arbitration_id, self.is_extended_id, self.is_remote_frame,
                           dlc=self.dlc, data=bytes(self.data))


class CanBus:
    """hw.link.Bus over an open python-can bus, which it owns.

    Frames are stamped with the clock's time at which they were read: python-can's own stamps are wall-clock time.
    `error_frames` and `refused` count what is not data, and what the transmit queue had no room for.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, name: str, write_timeout_s: float = 0.0) -> None:
        self.name = name
        self.error_frames = 0
        self.refused = 0
        self._bus, self._clock, self._write_timeout_s = bus, clock, write_timeout_s

    def read(self) -> list[Frame]:
        """All frames received since the last call, oldest first; LinkLost when the adapter is gone."""
        frames: list[Frame] = []
        t_ns = self._clock.now_ns()
        try:
            while (message := self._bus.recv(0)) is not None:
                if message.is_error_frame:
                    self.error_frames += 1
                else:
                    data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
                    frames.append(Frame(t_ns, message.arbitration_id, data, message.is_extended_id,
                                        message.is_remote_frame))
        except (can.CanError, OSError, ValueError) as error:    # ValueError: a socket closed under the reader
            raise LinkLost(f"{self.name}: {error}") from error
        return frames

    def write(self, frame: Frame) -> bool:
        """Queue one frame; False when the queue is full; LinkLost when the adapter is gone."""
        message = _Outgoing(0.0, frame.arbitration_id, frame.is_extended, frame.is_remote,
                            dlc=len(frame.data), data=None if frame.is_remote else frame.data)
        try:
            self._bus.send(message, timeout=self._write_timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            if not _is_full(error):
                raise LinkLost(f"{self.name}: {error}") from error
            self.refused += 1
            return False
        return True

    def close(self) -> None:
        with contextlib.suppress(can.CanError, OSError, ValueError):    # an unplugged adapter may refuse even this
            self._bus.shutdown()


def open_can(interface: str, channel: str, bitrate: int, clock: Clock) -> CanBus:
    """Open a CAN bus; LinkLost names interface and channel when it cannot be.

    `bitrate` is for adapters that set their own; socketcan's is set where the interface is brought up. On `virtual`
    every bus with one channel name in one process is on the same wire, and does not hear itself.
    """
    options: dict[str, Any] = {"bitrate": bitrate}
    write_timeout_s = 0.0
    if interface == "virtual":
        options = {"preserve_timestamps": True, "receive_own_messages": False}
    elif interface == "socketcan":
        options = {}
    elif interface == "slcan":
        options |= {"sleep_after_open": 0.0, "timeout": 0.0}
        write_timeout_s = SLCAN_WRITE_S
    name = f"CAN {interface} {channel}"
    try:
        bus = can.Bus(interface=interface, channel=channel, ignore_config=True, **options)
    except (can.CanError, NotImplementedError, OSError, ValueError, TypeError) as error:
        raise LinkLost(f"{name}: {error}") from error
    return CanBus(bus, clock, name, write_timeout_s)


def _is_full(error: Exception) -> bool:
    if isinstance(error, can.CanTimeoutError):
        return True
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return code in QUEUE_FULL or (code is None and str(error) in QUEUE_FULL_WORDS)
