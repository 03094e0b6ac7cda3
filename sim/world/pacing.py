"""World time that passes no faster than the clock's."""

from truearc.hw.protocols import Clock

LATE_NS = 50_000_000                  # world time stands still where this machine did, rather than catch up


class Pace:
    """World time begins at 0 when this is made."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._began_ns = clock, clock.now_ns()

    def wait_until(self, t_ns: int) -> None:
        """Return when it is `t_ns` in the world, at once where that is past."""
        behind_ns = self._clock.now_ns() - (self._began_ns + t_ns)
        if behind_ns > LATE_NS:
            self._began_ns += behind_ns
        self._clock.sleep_until_ns(self._began_ns + t_ns)
