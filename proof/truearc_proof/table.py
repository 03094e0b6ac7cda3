"""Tables of text cells with titles."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from truearc.sim.printed import Row, make_text


class Table(NamedTuple):
    """A title, a header, rows with one cell per column, and notes for the reader."""

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
