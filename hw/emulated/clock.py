"""Time that passes only when someone sleeps."""

from collections.abc import Callable


class StepClock:
    """truearc.hw.protocols.Clock of a twin: sleeping makes the emulated world advance, as fast as it can be
    computed."""

    def __init__(self, advance: Callable[[int], None]) -> None:
        self._advance = advance
        self._now_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Bring the world to `t_ns`, and then the clock; nothing happens when that is past."""
        if t_ns > self._now_ns:
            self._advance(t_ns)
            self._now_ns = t_ns
