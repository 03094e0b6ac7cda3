"""Results that print as a report: on a terminal as text, in a notebook as HTML."""

import html
from abc import ABC, abstractmethod
from collections.abc import Sequence

MOST = 8                              # lines of one kind on a terminal


def left_out_lines(reasons: Sequence[str]) -> list[str]:
    """Return a line for each thing that was left out, beyond MOST their number."""
    more = len(reasons) - MOST
    return [f"left out: {reason}" for reason in reasons[:MOST]] + ([f"left out: {more} more"] if more > 0 else [])


class Printed(ABC):
    """A value whose `str` is a report that a person reads, and whose `repr` in a notebook is the same report."""

    @abstractmethod
    def lines(self) -> list[str]:
        """Return the report, line by line."""

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"
