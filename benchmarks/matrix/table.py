"""The matrix as a table: a line a fault, a column a bus."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.matrix.judge import Result
from benchmarks.matrix.row import KEEPS, REFUSED
from benchmarks.matrix.rows import ROWS
from truearc.errors import InputError
from truearc_proof.table import make_markdown

BEGIN, END = "<!-- fault matrix: begin -->", "<!-- fault matrix: end -->"
BUSES = ("virtual", "slcan", "socketcan")


def make_table(results: Sequence[Result]) -> str:
    """Markdown. A cell: seconds from the fault to its HOLD / from its end (or from arming again) to the next FIRE."""
    cells = {(result.fault, result.bus): result for result in results}
    lines = []
    for row in ROWS:
        found = [cells.get((row.name, bus)) for bus in BUSES]
        some = next((result for result in found if result is not None), None)
        if some is None:
            continue
        reason = f"HOLD: {some.reason}" if some.outcome == "HOLD" and some.reason else some.outcome
        if some.outcome == "fires on" and some.reason:
            reason = f"fires on; {some.reason}"
        bound = f"{row.within_s:.2f} s" if row.within_s and row.after not in (KEEPS, REFUSED) else ""
        lines.append([row.name, _short(reason), bound, *map(_cell, found), row.after])
    header = ("fault", "comes to", "at most", *BUSES, "fires again")
    return "\n".join([make_markdown(header, lines), "", _summary(results)])


def write_between(page: Path, table: str) -> None:
    """Put the table between the page's markers."""
    text = page.read_text(encoding="utf-8")
    if BEGIN not in text or END not in text:
        raise InputError(f"{page}: has no place for the table ({BEGIN} ... {END})")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    page.write_text(f"{before}{BEGIN}\n{table}\n{END}{after}", encoding="utf-8")


def _cell(result: Result | None) -> str:
    if result is None:
        return "-"
    if result.wrong:
        return f"WRONG: {_short('; '.join(result.wrong))}"
    held = "" if result.hold_s is None or result.outcome == "fires on" else f"{result.hold_s:.3f}"
    again = "" if result.recovery_s is None else f"{result.recovery_s:.2f}"
    return " / ".join(part for part in (held, again) if part) or "ok"


def _short(words: str) -> str:
    words = words.replace("|", "/").replace("\n", " ")
    return words if len(words) <= 90 else words[:87] + "..."


def _summary(results: Sequence[Result]) -> str:
    faults = {result.fault for result in results}
    wrong = sum(bool(result.wrong) for result in results)
    ticks, fires, stale = (sum(getattr(result, name) for result in results) for name in ("ticks", "fires", "stale"))
    again = sum(result.tries > 1 for result in results)
    return (f"{len(faults)} faults, {len(results)} runs, {wrong} of them not as they should be; {ticks} ticks, {fires} "
            f"of them FIRE, {stale} of these on a reading that was too old. {again} runs in real time were played "
            "again, because the machine had stalled.")
