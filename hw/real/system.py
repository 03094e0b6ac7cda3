"""The interface to the operating system: facts about the machine, real-time requests, and messages to systemd.

A fact is None if the machine cannot provide it (no such tool, no such device, not Linux). A refused request is returned
as a result, never raised as an error.
"""

import contextlib
import ctypes
import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct

# --- facts

class CanLink(Struct, frozen=True):
    """A CAN network interface; None = the system does not say (a virtual one has no bitrate)."""

    is_up: bool
    queue: int | None                 # frames that may wait to be sent
    state: str | None                 # "ERROR-ACTIVE" (healthy), "ERROR-WARNING", "ERROR-PASSIVE", "BUS-OFF", ...
    bitrate: int | None
    restart_ms: int | None            # how long after bus-off the kernel tries again; 0 = never


class Exposure(Struct, frozen=True):
    """How a camera exposes; None = not reported."""

    automatic: bool | None
    length_s: float | None


def parse_link(text: str) -> CanLink | None:
    """Parse one interface from `ip -json -details link show NAME`; None if it contains none."""
    try:
        links = msgspec.json.decode(text)
    except msgspec.DecodeError:
        return None
    if not isinstance(links, list) or not links or not isinstance(links[0], dict):
        return None
    link = links[0]
    data = _table(_table(link, "linkinfo"), "info_data")
    flags = link.get("flags")
    return CanLink(isinstance(flags, list) and "UP" in flags, _whole(link, "txqlen"),
                   state if isinstance(state := data.get("state"), str) else None,
                   _whole(_table(data, "bittiming"), "bitrate"), _whole(data, "restart_ms"))


def _table(table: dict[str, Any], key: str) -> dict[str, Any]:
    value = table.get(key)
    return value if isinstance(value, dict) else {}


def _whole(table: dict[str, Any], key: str) -> int | None:
    value = table.get(key)
    return value if isinstance(value, int) and not isinstance(value, bool) else None


PATIENCE_S = 5.0
# <linux/videodev2.h>: VIDIOC_G_CTRL is _IOWR('V', 27, struct v4l2_control), two 32-bit numbers
G_CTRL = 0xC008561B
EXPOSURE_AUTO, EXPOSURE_ABSOLUTE = 0x009A0901, 0x009A0902
MANUAL = (1, 2)                       # manual, and shutter priority: either way the length stands still
UNITS_PER_S = 10_000


def read_link(name: str) -> CanLink | None:
    """Return a network interface as `ip` describes it; None if there is none of that name."""
    said = _said("ip", "-json", "-details", "link", "show", "dev", name)
    return None if said is None else parse_link(said)


def is_clock_synchronised() -> bool | None:
    """Return whether a time server has set the time of day since the machine started."""
    said = _said("timedatectl", "show", "--property=NTPSynchronized", "--value")
    return {"yes": True, "no": False}.get((said or "").strip())


def read_exposure(device: str) -> Exposure | None:
    """Return how a V4L2 camera (path or index) exposes, even while in use; None if it cannot be queried."""
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


# --- real time

CURRENT, FUTURE, ON_FAULT = 1, 2, 4               # mlockall's flags in <sys/mman.h>
ELSEWHERE = "this is not Linux"


class Answer(NamedTuple):
    """The answer to a system request; `refused` gives the reason, and is empty if it was granted."""

    asked: str
    refused: str


def ask_fifo(priority: int) -> Answer:
    """Request SCHED_FIFO for the calling thread; threads and processes that it starts are ordinary again."""
    return _ask(f"real-time scheduling (SCHED_FIFO {priority})", lambda: _set_fifo(0, priority))


def ask_fifo_beside(priority: int) -> Answer:
    """Request SCHED_FIFO, below the calling thread, for all other threads of this process: a thread that holds the
    interpreter while it waits for a core delays all others, whatever their priority."""
    def ask() -> None:
        for name in os.listdir("/proc/self/task"):
            if int(name) == threading.get_native_id():
                continue
            with contextlib.suppress(ProcessLookupError):     # it has ended meanwhile
                _set_fifo(int(name), max(priority - 1, 1))

    return _ask(f"the same for its other threads (SCHED_FIFO {priority - 1})", ask)


def ask_core(core: int) -> Answer:
    """Request one core for the calling thread only; existing threads stay unrestricted."""
    return _ask(f"core {core}", lambda: os.sched_setaffinity(0, {core}))


def ask_locked_memory() -> Answer:
    """Request that memory is never swapped out from now on.

    Requested only where memory locking is unlimited: under a limit, later allocations would fail during a run.
    """
    def ask() -> None:
        import resource  # POSIX only

        soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        if soft != resource.RLIM_INFINITY and os.geteuid() != 0:
            raise OSError(f"only {soft // 1024} KiB are allowed")
        _call("mlockall", CURRENT | FUTURE | ON_FAULT)

    return _ask("locked memory", ask)


def rehearse(priority: int) -> tuple[Answer, ...]:
    """Return which scheduling and memory requests would be granted: they are made in a separate thread and undone."""
    answers: list[Answer] = []

    def ask() -> None:
        answers.append(ask_fifo(priority))
        answers.append(ask_locked_memory())
        if sys.platform == "linux" and not answers[-1].refused:
            _call("munlockall")

    thread = threading.Thread(target=ask, name="rehearsal")
    thread.start()
    thread.join()
    return tuple(answers)


def _set_fifo(thread: int, priority: int) -> None:
    os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def _ask(asked: str, call: Callable[[], None]) -> Answer:
    if sys.platform != "linux":
        return Answer(asked, ELSEWHERE)
    try:
        call()
    except (OSError, ValueError) as error:        # ValueError: no such core at all
        return Answer(asked, (error.strerror if isinstance(error, OSError) else None) or str(error))
    return Answer(asked, "")


def _call(name: str, *arguments: int) -> None:
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*arguments) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


# --- systemd

class ServiceManager:
    """The sender to NOTIFY_SOCKET. Never blocks and never raises: an unresponsive manager must not stop the robot."""

    def __init__(self, address: str | None) -> None:
        self._socket: socket.socket | None = None
        if address and sys.platform != "win32":
            self._address = "\0" + address[1:] if address.startswith("@") else address     # @: an abstract socket
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def say(self, message: str) -> None:
        """Send a message such as "READY=1"; does nothing without a service manager."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(message.encode(), self._address)

    def close(self) -> None:
        """Report that the end has begun, whatever caused it."""
        self.say("STOPPING=1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None
