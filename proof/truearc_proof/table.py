"""Titled tables of text cells, and the interval of a difference of two shares."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from truearc.sim.printed import Row, make_text
from truearc.sim.statistics import wilson


class Table(NamedTuple):
    """A title, a header, rows of as many cells, and what a reader must know of them."""

    title: str
    header: tuple[str, ...]
    rows: Sequence[Row]
    note: str = ""

    def markdown(self) -> str:
        """Return a heading of the third level and the table."""
        return f"### {self.title}\n\n{make_markdown(self.header, self.rows)}"

    def text(self) -> str:
        """Return a blank line, the title and the table for a terminal."""
        return "\n".join(["", self.title, *make_text(self.header, self.rows)])


def make_markdown(header: Row, rows: Iterable[Row]) -> str:
    """Return a Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in (header, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(header), *lines[1:]])


def difference(one: tuple[int, int], other: tuple[int, int]) -> tuple[float, float]:
    """Newcombe's hybrid-score 95 % interval of share(one) - share(other), each (successes, trials) (Newcombe 1998)."""
    p, q = _share(*one), _share(*other)
    (p_low, p_high), (q_low, q_high) = wilson(*one), wilson(*other)
    gap = p - q
    return (gap - math.hypot(p - p_low, q_high - q), gap + math.hypot(p_high - p, q - q_low))


def _share(successes: int, trials: int) -> float:
    return successes / trials if trials else 0.5
