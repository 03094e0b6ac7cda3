"""The monotonic clock, the wall clock, and the pauses between retries."""

import time
from collections.abc import Iterator
from datetime import datetime


class MonotonicClock:
    """The machine's monotonic clock, in whole microseconds; unmoved by the wall clock being set.

    Candump files have six decimals: what they say of a time is all there is to it.
    """

    def now_ns(self) -> int:
        return time.monotonic_ns() // 1000 * 1000

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return at `t_ns` or as soon after as the machine allows; at once when that is past.

        Deadlines are absolute, so being late once does not make the next one late. Whoever keeps a cadence skips the
        deadlines that were missed rather than running them in a burst.
        """
        while (left_ns := t_ns - self.now_ns()) > 0:
            time.sleep(left_ns / 1e9)


def wall_clock() -> str:
    """The time of day where we are, ISO 8601 to the second: for names and headers, never for reckoning."""
    return datetime.now().astimezone().isoformat(timespec="seconds")


def wall_offset_ns() -> int:
    """The wall clock (Unix) less the clock above, by which a recording's times are dated; changes when it is set."""
    return time.time_ns() - time.monotonic_ns()


def make_pauses_s(first_s: float, longest_s: float) -> Iterator[float]:
    """How long to wait before each attempt: twice as long each time, up to `longest_s`."""
    pause_s = first_s
    while True:
        yield pause_s
        pause_s = min(2.0 * pause_s, longest_s)
