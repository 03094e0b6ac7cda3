"""A loop that does nothing but sleep, at the highest real-time priority, and notes when it was late all the same: what
no program on this machine is spared. `python -m benchmarks.bare_loop FILE CORE`, until SIGTERM; Linux.

FILE has pairs of 64-bit integers: when it should have woken, and when it did, in monotonic nanoseconds.
"""

import gc
import os
import signal
import sys
import time
from array import array
from pathlib import Path

PERIOD_NS = 2_000_000
LATE_NS = 1_000_000
PRIORITY = 98


def main() -> None:
    os.sched_setaffinity(0, {int(sys.argv[2])})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    gc.disable()
    late, ended = array("q"), []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
    due_ns = time.monotonic_ns() + PERIOD_NS
    while not ended:
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
        now_ns = time.monotonic_ns()
        if now_ns - due_ns > LATE_NS and not ended:
            late.extend((due_ns, now_ns))
        due_ns = max(due_ns + PERIOD_NS, now_ns)
    Path(sys.argv[1]).write_bytes(late.tobytes())


if __name__ == "__main__":
    main()
