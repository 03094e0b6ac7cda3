"""The monotonic clock, the wall clock, and the pauses between retries."""

import time
from collections.abc import Iterator
from datetime import datetime


class MonotonicClock:
    """The machine's monotonic clock, in whole microseconds; setting the wall clock does not affect it.

    Candump files have six decimals, so no time has more.
    """

    def now_ns(self) -> int:
        return time.monotonic_ns() // 1000 * 1000

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return at `t_ns` or as soon afterwards as the machine allows; at once if that is past.

        Deadlines are absolute, so being late once does not delay the next one. The caller skips missed deadlines
        instead of running them in a burst.
        """
        while (left_ns := t_ns - self.now_ns()) > 0:
            time.sleep(left_ns / 1e9)


def wall_clock() -> str:
    """Return the local time of day, ISO 8601 to the second: for names and headers, never for calculations."""
    return datetime.now().astimezone().isoformat(timespec="seconds")


def wall_offset_ns() -> int:
    """Return the wall clock (Unix) minus the clock above, which dates a recording; it changes when the wall clock is
    set."""
    return time.time_ns() - time.monotonic_ns()


def make_pauses_s(first_s: float, longest_s: float) -> Iterator[float]:
    """Yield the pause before each attempt, which doubles up to `longest_s`."""
    pause_s = first_s
    while True:
        yield pause_s
        pause_s = min(2.0 * pause_s, longest_s)
