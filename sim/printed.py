"""Text output of results and progress: reports on a terminal and in a notebook, aligned tables, and CSV files."""

import csv
import html
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from truearc.errors import whole_file
from truearc.hw.protocols import NS
from truearc.hw.real.clock import MonotonicClock

MOST = 8                              # lines of one kind on a terminal
FIRST_S, REST_S = 2.0, 5.0            # before the first line of progress; between lines in a file
WIDE = 78                             # letters of a line of progress
Row = Sequence[str]
Progress = Callable[[float, str], None]          # share done, 0 to 1; a note


def left_out_lines(reasons: Sequence[str]) -> list[str]:
    """Return a line for each excluded thing; beyond MOST, only their number."""
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


def make_text(header: Row, rows: Iterable[Row], right: Collection[int] = ()) -> list[str]:
    """Return lines of aligned columns, header first; right: columns of numbers, aligned at their end."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return ["  ".join(cell.rjust(widths[k]) if k in right else cell.ljust(widths[k])
                      for k, cell in enumerate(line)).rstrip() for line in lines]


def save_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file in UTF-8, with "\\n" at the end of each line; OSError where it cannot be written."""
    with whole_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def show_progress(what: str, quiet: bool | None = None) -> Progress:
    """Return a progress that shows how far `what` is, and the time left, on standard error.

    One line that is rewritten on a terminal and in a notebook, a line every REST_S seconds elsewhere. quiet: None: show
    it on a terminal or in a notebook only.
    """
    live = sys.stderr.isatty() or "ipykernel" in sys.modules
    if quiet or (quiet is None and not live):
        return lambda done, note: None
    clock = MonotonicClock()
    began = clock.now_ns() * NS
    last, shown = [began if live else began - REST_S + FIRST_S], [False]

    def show(done: float, note: str = "") -> None:
        now = clock.now_ns() * NS
        over = done >= 1.0
        if not over and now - last[0] < (0.2 if live and shown[0] else FIRST_S if live else REST_S):
            return
        if over and quiet is None and not shown[0]:        # done before there was anything to wait for
            return
        last[0], shown[0] = now, True
        passed = now - began
        left = f", {_clock(passed * (1.0 - done) / done)} left" if 0.02 < done < 1.0 and passed > 1.0 else ""
        line = f"{what}: {done:4.0%}{left}  {note}"[:WIDE]
        print(f"\r{line:{WIDE}}" if live else line, end="\n" if over or not live else "", file=sys.stderr, flush=True)

    return show


def _clock(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"


def part_of(progress: Progress, begin: float, share: float) -> Progress:
    """Return the progress of a part that begins at `begin` and is `share` of the whole."""
    return lambda done, note: progress(begin + share * done, note)
