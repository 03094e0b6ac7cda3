"""Whether the machine that runs a test in real time is fast enough for it: its slowness is no defect of ours.

`why_too_slow` asks a bus whether it carries frames at the robot's rate; `excuse_stalls` turns the failure of a test
into a skip that says so where the machine itself stood still meanwhile.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from truearc.hw.protocols import Bus, Frame

RATE_HZ = 2000.0                      # two flywheels, hood, feeder and encoder at their fastest, with commands
LATEST_S = 0.05                       # from one end to the other: half of the shortest reading age of the tests
BATCH = 50                            # frames at once, after a stall: SocketCAN keeps 278 unread ones, measured
STALL_S = 0.25                        # asleep for this long beyond what was asked: readings are old by then
NAP_S = 0.005


def why_too_slow(near: Bus, far: Bus, seconds: float = 0.5, wait_s: float = 1.0) -> str:
    """Why the bus cannot carry a robot's frames; "" where it can. A frame not there `wait_s` after the last is lost.

    A host that stalls sends the frames due meanwhile in batches: all at once they would not fit into the queue of the
    other end, which nobody reads meanwhile, and a late frame would pass for a lost one.
    """
    sent_at: list[float] = []
    slowest_s, received = 0.0, 0
    begin = time.monotonic()
    count = int(seconds * RATE_HZ)
    while received < count and time.monotonic() < begin + seconds + wait_s:
        due = min(count, int((time.monotonic() - begin) * RATE_HZ) + 1, len(sent_at) + BATCH)
        while len(sent_at) < due:
            sent_at.append(time.monotonic())
            near.write(Frame(0, 0x100, (len(sent_at) - 1).to_bytes(4, "little")))
        for frame in far.read():
            slowest_s = max(slowest_s, time.monotonic() - sent_at[int.from_bytes(frame.data, "little")])
            received += 1
        time.sleep(0.0005)
    if len(sent_at) < count:
        return f"host too slow: it sent {len(sent_at)} of {count} frames at {RATE_HZ:g} per second"
    if received < count:
        return f"host too slow: {count - received} of {count} frames at {RATE_HZ:g} per second lost"
    return f"host too slow: a frame took {slowest_s:.3f} s to the other end" if slowest_s > LATEST_S else ""


class _Watch(threading.Thread):
    """Sleeps in short naps and keeps by how much the longest was too long."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.longest_s = 0.0
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.is_set():
            before = time.monotonic()
            time.sleep(NAP_S)
            self.longest_s = max(self.longest_s, time.monotonic() - before - NAP_S)


@contextmanager
def excuse_stalls(limit_s: float = STALL_S) -> Iterator[None]:
    """Skip instead of failing where the machine stood still for longer than the limit while the body ran."""
    watch = _Watch()
    watch.start()
    try:
        yield
    except (AssertionError, TimeoutError) as error:
        watch.over.set()
        watch.join()
        if watch.longest_s > limit_s:
            pytest.skip(f"host too slow: it stood still for {watch.longest_s:.2f} s; {str(error)[:200]}")
        raise
    finally:
        watch.over.set()
