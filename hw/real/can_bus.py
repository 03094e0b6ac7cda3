"""Access to the CAN bus through python-can, with reconnection when the adapter is lost.

`CanBus` uses socketcan, slcan, virtual or any other interface that python-can supports. `SupervisedBus` reads the bus
in a thread of its own and reopens it whenever it is lost. python-can's Notifier is unsuitable: an exception in it
silently ends its thread.
"""

import contextlib
import errno
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import can
import serial

from truearc.hw.fault_codes import CAN_ADAPTER_ERROR, CAN_BUS_OFF, CAN_CLOSED, CAN_OVERRUN, CAN_REOPENED, CAN_SILENT
from truearc.hw.protocols import Clock, Frame, LinkLost
from truearc.hw.real.clock import make_pauses_s
from truearc.hw.reason import Reason

ADVICE = {errno.EAFNOSUPPORT: ": this kernel has no CAN; load it with modprobe can_raw",
          errno.ENODEV: ": there is no such interface; docs/how-to/buses.md says how to bring it up"}
KNOWN = (can.CanError, NotImplementedError, OSError, ValueError, TypeError)     # say themselves what is wrong
QUEUE_FULL = (errno.ENOBUFS, errno.EAGAIN)
# python-can 4.6 raises a bare CanOperationError for these two (socketcan's send, virtual's): no code, no class of their
# own, no cause. Every other refusal is recognised by its code or class.
QUEUE_FULL_WORDS = ("Transmit buffer full", "Could not send message to one or more recipients")
HIGHEST_BASE_ID, HIGHEST_ID = 0x7FF, 0x1FFFFFFF
CLASSIC_BYTES, FD_BYTES = 8, 64
SLCAN_WRITE_S = 0.02                              # a serial adapter must not be cut off in the middle of a line

# errors in a controller's error frame; bits as in linux/can/error.h. The words are for a log
BUS_OFF = 0x040
CLASSES = ((0x001, "transmit timeout"), (0x002, "arbitration lost"), (0x008, "protocol violation"),
           (0x010, "transceiver"), (0x020, "no acknowledgement"), (BUS_OFF, "bus off"), (0x080, "bus error"),
           (0x100, "restarted"))
CONTROLLER = 0x004                                # details are in the second byte
CONTROLLER_DETAILS = ((0x01, "receive overrun"), (0x02, "transmit overrun"), (0x04, "many receive errors"),
                      (0x08, "many transmit errors"), (0x10, "error passive"), (0x20, "error passive"),
                      (0x40, "error active again"))


class NeverOpens(LinkLost):
    """A bus that plugging in an adapter would not open: no such interface, or its driver is not installed."""


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
    """truearc.hw.protocols.Bus over an open python-can bus, which it owns.

    Frames are stamped by the clock when they are read, because python-can's own timestamps are wall-clock time. `tally`
    counts frames that are not data, frames that the transmit queue refused, and invalid lines of a serial adapter
    (`serial_lines`). A controller in bus-off is a lost link: adapters recover from it in different ways, and closing
    and reopening works for all.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, name: str, write_timeout_s: float = 0.0, *,
                 serial_lines: bool = False, tally: Counter[str] | None = None) -> None:
        self.name = name
        self.tally: Counter[str] = Counter() if tally is None else tally
        self._bus, self._clock, self._write_timeout_s = bus, clock, write_timeout_s
        self._serial_lines = serial_lines

    def read(self) -> list[Frame]:
        """Return all frames received since the last call, oldest first; LinkLost when the adapter is lost."""
        frames: list[Frame] = []
        t_ns = self._clock.now_ns()
        while (message := self._take(0.0)) is not None or self._has_more():
            if message is not None and not message.is_error_frame:
                frames.append(_make_frame(message, t_ns))
        return frames

    def receive(self, wait_s: float) -> Frame | None:
        """Return the next frame after waiting at most about `wait_s`; None if there was none, or no data; else as
        `read`."""
        message = self._take(wait_s)
        if message is None or message.is_error_frame:
            return None
        return _make_frame(message, self._clock.now_ns())

    def write(self, frame: Frame) -> bool:
        """Queue one frame; return False if the queue is full; LinkLost when the adapter is lost."""
        message = _Outgoing(0.0, frame.arbitration_id, frame.is_extended, frame.is_remote,
                            dlc=len(frame.data), data=None if frame.is_remote else frame.data)
        try:
            self._bus.send(message, timeout=self._write_timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            if not _is_full(error):
                raise LinkLost(CAN_ADAPTER_ERROR(bus=self.name, detail=str(error))) from error
            self.tally["frames that found the queue full"] += 1
            return False
        return True

    def faults(self) -> list[Reason]:
        return []

    def close(self) -> None:
        with contextlib.suppress(can.CanError, OSError, ValueError):    # an unplugged adapter may refuse even this
            self._bus.shutdown()

    def _has_more(self) -> bool:
        """Whether bytes wait behind a line without a frame: a serial adapter's own answers stand between the frames."""
        try:
            return self._serial_lines and self._bus.serialPortOrig.in_waiting > 0
        except OSError as error:
            raise LinkLost(CAN_ADAPTER_ERROR(bus=self.name, detail=str(error))) from error

    def _take(self, wait_s: float) -> can.Message | None:
        try:
            message = self._bus.recv(wait_s)
        except (can.CanError, OSError, ValueError, IndexError) as error:  # ValueError: socket closed meanwhile
            if self._serial_lines and self._is_garbled(error):
                self.tally["garbled lines"] += 1
                return None
            raise LinkLost(CAN_ADAPTER_ERROR(bus=self.name, detail=str(error))) from error
        if message is not None and message.is_error_frame:
            self.tally.update(f"error frames: {word}"
                              for word in error_words(message.arbitration_id, bytes(message.data)))
            if self._is_off(message):
                raise LinkLost(CAN_BUS_OFF(bus=self.name))
        elif message is not None and not _is_possible(message):
            self.tally["garbled lines"] += 1      # the library takes hexadecimal of any sign and a length of any size
            return None
        return message

    def _is_off(self, message: can.Message) -> bool:
        """Whether the controller that sends this error frame is bus-off.

        socketcan says so in the frame; python-can's `state` of a bus is ACTIVE there, on slcan and on virtual, whatever
        happens, and tells of few adapters more (of those of IXXAT that they are bus-off).
        """
        return bool(message.arbitration_id & BUS_OFF) or self._bus.state is can.BusState.ERROR

    def _is_garbled(self, error: Exception) -> bool:
        """Whether a serial adapter's line broke its protocol, rather than that the adapter is gone."""
        if isinstance(error.__cause__, UnicodeDecodeError):
            self._bus.flush()                     # the library would stumble over the same bytes for ever
            return True
        return isinstance(error, ValueError | IndexError)


def open_can(interface: str, channel: str, bitrate: int, clock: Clock, wait_s: float = 0.0,
             tally: Counter[str] | None = None) -> CanBus:
    """Open a CAN bus; LinkLost names interface and channel if it cannot be opened now, NeverOpens if it never can.

    `bitrate` is for adapters that set their own; socketcan's is set where the interface is brought up. On `virtual`
    every bus with one channel name in one process is on the same wire, and does not hear itself. `wait_s`: how long
    `receive` will be asked to wait; a serial adapter waits for its bytes in steps of it instead of spinning.
    """
    special: dict[str, dict[str, Any]] = {
        "virtual": {"preserve_timestamps": True, "receive_own_messages": False}, "socketcan": {},
        "slcan": {"bitrate": bitrate, "sleep_after_open": 0.0, "timeout": wait_s}}
    options, is_slcan = special.get(interface, {"bitrate": bitrate}), interface == "slcan"
    name = f"CAN {interface} {channel}"
    try:
        bus = can.Bus(interface=interface, channel=channel, ignore_config=True, **options)
    except Exception as error:        # whatever an interface raises whose driver is not installed
        code = getattr(error, "errno", None) or getattr(error, "error_code", None) or 0
        advice = ADVICE.get(code, "" if isinstance(error, KNOWN) else ": is the driver of this interface installed?")
        may_come = isinstance(error, can.CanInitializationError) or (isinstance(error, OSError) and code)
        kind = LinkLost if may_come and code != errno.EAFNOSUPPORT else NeverOpens
        raise kind(CAN_ADAPTER_ERROR(bus=name, detail=f"{error}{advice}")) from error
    return CanBus(bus, clock, name, SLCAN_WRITE_S if is_slcan else 0.0, serial_lines=is_slcan, tally=tally)


def _is_possible(message: can.Message) -> bool:
    most = FD_BYTES if message.is_fd else CLASSIC_BYTES
    highest = HIGHEST_ID if message.is_extended_id else HIGHEST_BASE_ID
    is_whole = message.is_remote_frame or len(message.data) == message.dlc
    return bool(is_whole and 0 <= message.arbitration_id <= highest and 0 <= message.dlc <= most)


def _make_frame(message: can.Message, t_ns: int) -> Frame:
    data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
    return Frame(t_ns, message.arbitration_id, data, message.is_extended_id, message.is_remote_frame)


def _is_full(error: Exception) -> bool:
    # A serial port that could not be written to in time says so to python-can, which tells another story.
    if isinstance(error, can.CanTimeoutError) or isinstance(error.__cause__, serial.SerialTimeoutException):
        return True
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return code in QUEUE_FULL or (code is None and str(error) in QUEUE_FULL_WORDS)


def error_words(arbitration_id: int, data: bytes) -> tuple[str, ...]:
    """Return what an error frame reports; never empty."""
    words = [word for bit, word in CLASSES if arbitration_id & bit]
    if arbitration_id & CONTROLLER:
        details = data[1] if len(data) > 1 else 0
        words += [word for bit, word in CONTROLLER_DETAILS if details & bit] or ["controller"]
    return tuple(dict.fromkeys(words)) or ("of an unknown kind",)


# --- a bus that is opened again

WAIT_S = 0.02                         # how often a thread that receives no frames looks up
SILENT_NS = 1_000_000_000             # a bus on which nothing is heard for so long is lost: not all adapters tell
ROOM = 4096                           # frames that may wait for the tick: two seconds of a busy bus
OVERRUN = "frames lost to overrun"
FIRST_S, LONGEST_S = 0.05, 2.0        # pauses between attempts to open it again


class SupervisedBus:
    """truearc.hw.protocols.Bus over whatever `open_bus` opens, reopened whenever it is lost.

    One thread reads every frame as it arrives and stamps it at that moment, so that its age does not depend on the
    tick. When the bus is lost, or silent for a second (an adapter in bus-off may not report it), it is closed and
    reopened after increasing pauses. Meanwhile `read` and `write` raise LinkLost, and a fault is reported until
    something is received again. `tally` counts.
    """

    def __init__(self, open_bus: Callable[[], CanBus], clock: Clock, tally: Counter[str], room: int = ROOM,
                 pauses: Callable[[], Iterator[float]] | None = None, name: str | None = None) -> None:
        """Opens the bus at once, so that one that cannot be is an error here: LinkLost.

        `room`: frames that may wait for the tick. `pauses`: of s between attempts to open it again, make_pauses_s.
        `name`: of a bus that may also come later, so that only NeverOpens is an error here; None: it may not.
        """
        self._open_bus, self._clock, self._tally = open_bus, clock, tally
        self._room, self._pauses = room, pauses or partial(make_pauses_s, FIRST_S, LONGEST_S)
        self._bus: CanBus | None = None
        self._lost: Reason | None = None          # why, until something is heard again
        try:
            self._bus = open_bus()
        except LinkLost as error:
            if name is None or isinstance(error, NeverOpens):
                raise
            self._lost = error.reason
        self.name = self._bus.name if self._bus is not None else str(name)
        self._lock = threading.Lock()             # of writing to the bus and of taking it away; the thread alone reads
        self._frames: deque[Frame] = deque()
        self._broken: Reason | None = None        # why a write found the bus lost
        self._told = 0                            # frames lost to overrun of which there has been a fault
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._supervise, name=self.name, daemon=True)
        self._thread.start()

    @property
    def lost(self) -> Reason | None:
        """Why there is no bus; None while there is one."""
        return self._lost if self._bus is None else None

    def read(self) -> list[Frame]:
        """Return all frames received since the last call, oldest first; LinkLost, with the reason, while there is no
        bus."""
        if self._bus is None:
            raise self._loss()
        return [self._frames.popleft() for _ in range(len(self._frames))]

    def write(self, frame: Frame) -> bool:
        with self._lock:
            if self._bus is None:
                raise self._loss()
            try:
                return self._bus.write(frame)
            except LinkLost as error:
                self._broken = error.reason
                raise

    def faults(self) -> list[Reason]:
        before, self._told = self._told, self._tally[OVERRUN]
        late = self._told - before
        faults = [CAN_OVERRUN(bus=self.name, frames=late)] if late else []
        lost = self._lost
        if lost is not None and self._bus is not None:
            faults.append(CAN_REOPENED(bus=self.name, cause=lost))
        return faults

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=1.0)
        self._take_away(CAN_CLOSED(bus=self.name))

    def _supervise(self) -> None:
        pauses_s = self._pauses()
        while not self._stop.is_set():
            if self._bus is None:
                if not self._stop.wait(next(pauses_s)):
                    self._open_again()
            elif why := self._listen(self._bus):
                if self._lost is None:            # it had been heard: this is a new trouble
                    pauses_s = self._pauses()
                self._tally["times lost"] += 1
                self._take_away(why)

    def _open_again(self) -> None:
        try:
            bus = self._open_bus()
        except Exception as error:    # as in _listen
            self._lost = self._reason_of(error)
            return
        self._broken = None
        self._bus = bus

    def _listen(self, bus: CanBus) -> Reason | None:
        """Take frames in until the bus is lost; returns why."""
        heard_ns = self._clock.now_ns()
        try:
            while not self._stop.is_set() and not self._broken:
                frame = bus.receive(WAIT_S)
                if frame is not None:
                    heard_ns = frame.t_ns
                    self._keep(frame)
                elif self._clock.now_ns() - heard_ns >= SILENT_NS:
                    return CAN_SILENT(bus=self.name, silence_s=SILENT_NS * 1e-9)
        except Exception as error:    # whatever a driver may raise: a reader that dies in silence is what must not be
            return self._reason_of(error)
        return self._broken

    def _reason_of(self, error: Exception) -> Reason:
        if isinstance(error, LinkLost):
            return error.reason
        return CAN_ADAPTER_ERROR(bus=self.name, detail=f"{type(error).__name__}: {error}")

    def _loss(self) -> LinkLost:
        return LinkLost(self._lost or CAN_CLOSED(bus=self.name))      # meanwhile it may have been opened again

    def _keep(self, frame: Frame) -> None:
        self._lost = None
        if len(self._frames) >= self._room:       # the newest is lost, as in a controller: only the tick takes out
            self._tally[OVERRUN] += 1
        else:
            self._frames.append(frame)

    def _take_away(self, why: Reason) -> None:
        with self._lock:
            self._lost = why
            bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(Exception):  # it is gone, whatever its driver says of that
                bus.close()
