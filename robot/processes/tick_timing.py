"""Lateness of ticks: counted each second, summed up at the end. Time comes with the ticks; no clock is read here."""

from bisect import bisect_left
from collections.abc import Callable
from itertools import accumulate
from typing import Protocol

from msgspec import Struct

from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.types import Inputs

NS_PER_S = 1_000_000_000
AT_MOST_US = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000)    # one more count holds what is later still
BAR = 40                              # characters


class Second(Struct, frozen=True):
    """One line of lateness.jsonl: the ticks of about a second."""

    t_ns: int                         # of the last of them
    worst_us: float
    at_most_us: tuple[int, ...]       # upper edge of each count but the last, which has none
    counts: tuple[int, ...]


class DueRig(RobotIo, Protocol):
    """A rig that knows how late its newest tick came."""

    late_ns: int


class Lateness:
    """Counts ticks by how late they came; each second's counts go to `keep`. `period_ns`: from one tick to the next."""

    def __init__(self, keep: Callable[[Second], None], period_ns: int) -> None:
        self._keep, self._period_ns = keep, period_ns
        self._counts, self._worst_us = [0] * (len(AT_MOST_US) + 1), 0.0
        self._began_ns: int | None = None
        self._t_ns = 0
        self._totals, self._worst_of_all_us, self._missed = [0] * len(self._counts), 0.0, 0

    def note(self, t_ns: int, late_ns: int) -> None:
        """One tick at `t_ns` that was due `late_ns` before."""
        if self._began_ns is not None and t_ns - self._began_ns >= NS_PER_S:
            self.close()
        if self._began_ns is None:
            self._began_ns = t_ns
        late_us = late_ns / 1000
        self._counts[bisect_left(AT_MOST_US, late_us)] += 1
        self._worst_us = max(self._worst_us, late_us)
        self._missed += late_ns >= self._period_ns
        self._t_ns = t_ns

    def close(self) -> None:
        """Hand over what has been counted since the last whole second."""
        if self._began_ns is None:
            return
        self._keep(Second(self._t_ns, self._worst_us, AT_MOST_US, tuple(self._counts)))
        self._totals = [a + b for a, b in zip(self._totals, self._counts, strict=True)]
        self._worst_of_all_us = max(self._worst_of_all_us, self._worst_us)
        self._counts, self._worst_us, self._began_ns = [0] * len(self._counts), 0.0, None

    def lines(self) -> list[str]:
        """The closed seconds as a sentence and as bars; empty before the first tick."""
        ticks = sum(self._totals)
        if not ticks:
            return []
        edges = [f"<= {edge / 1000:g} ms" for edge in AT_MOST_US] + [f" > {AT_MOST_US[-1] / 1000:g} ms"]
        return [f"ticks came late by at most {_quantile(self._totals, 0.5)} (half of them), "
                f"{_quantile(self._totals, 0.99)} (99 of 100), {self._worst_of_all_us / 1000:.2f} ms (all); "
                f"{self._missed} of {ticks} by a whole tick or more",
                *(f"  {edge:>10s} {count:9d} {'#' * -(-BAR * count // ticks)}"
                  for edge, count in zip(edges, self._totals, strict=True) if count)]


class TimedRig(RigLayer):
    """Passes everything through, and notes how late each tick came; the first one has nothing to be late for."""

    def __init__(self, rig: DueRig, lateness: Lateness) -> None:
        super().__init__(rig)
        self._due, self._lateness = rig, lateness

    def read(self) -> Inputs | None:
        inputs = self._rig.read()
        if inputs is not None and inputs.cycle > 1:
            self._lateness.note(inputs.t_ns, self._due.late_ns)
        return inputs


def _quantile(totals: list[int], share: float) -> str:
    """The upper edge of the count in which the tick lies."""
    place = bisect_left(list(accumulate(totals)), share * sum(totals))
    return f"{AT_MOST_US[place] / 1000:g} ms" if place < len(AT_MOST_US) else f"more than {AT_MOST_US[-1] / 1000:g} ms"
