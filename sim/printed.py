"""Results that print as a report: on a terminal as text, in a notebook as HTML."""

import html
from abc import ABC, abstractmethod


class Printed(ABC):
    """A value whose `str` is a report that a person reads, and whose `repr` in a notebook is the same report."""

    @abstractmethod
    def lines(self) -> list[str]:
        """Return the report, line by line."""

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"
