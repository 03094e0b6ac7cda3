"""The terms as Markdown tables, made of what they declare.

    python -m tools.term_table docs/reference/terms.md

writes the tables of the built-in terms into the page, between its two marks.
"""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.physics.term import STAGES, Parameter, Term

BEGIN, END = "<!-- generated: tables of terms -->", "<!-- end of the generated tables -->"
HEAD = ("term", "law", "parameter", "unit", "meaning", "believed before any data", "moves a shot",
        "needs in the data", "measured with")


def make_tables(terms: Iterable[Term] = BUILT_IN) -> str:
    """A table for each stage, terms in the order in which they act, a row for each parameter."""
    lines: list[str] = []
    for stage in STAGES:
        lines += [f"### {stage.capitalize()}", "", _row(HEAD), _row(["---"] * len(HEAD))]
        lines += [_row(row) for term in terms if term.stage == stage for row in _rows(term)] + [""]
    return "\n".join(lines)


def put_tables(page: str) -> str:
    """The page with the tables of the built-in terms between its marks; ValueError where it lacks one."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page lacks {BEGIN} or {END}")
    return f"{before}{BEGIN}\n\n{make_tables()}\n{END}{after}"


def _rows(term: Term) -> Iterator[list[str]]:
    law = (type(term).__doc__ or "").partition("\n\n")[0]
    about = [term.direction, term.record, term.instrument.what if term.instrument else ""]
    for number, one in enumerate(term.parameters):
        first = number == 0
        yield [f"`{term.name}`" if first else "", law if first else "", f"`{one.name}`", one.unit, one.meaning,
               _prior(one), *(about if first else ("", "", ""))]


def _prior(one: Parameter) -> str:
    if one.prior is None:
        return f"{one.default:g}, known"
    return f"{one.prior.centre:g} ± {one.prior.sd:g} ({one.prior.scale}): {one.prior.reason}"


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def main(path: str) -> None:
    """Bring a page's tables up to date."""
    page = Path(path)
    page.write_text(put_tables(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
