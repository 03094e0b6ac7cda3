"""Table of discovery's findings on tracker faults: which of them it attributed to physics of the ball."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks.launcher_table import counted
from truearc_proof.report.tables import said
from truearc_proof.table import make_markdown

AIR = "flight"
HEADER = ("fault", "tracks", "something found", "attributed to the air alone", "verdicts", "names")

Line = Mapping[str, Any]


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: one row a fault and source. Shares have Wilson 95 % intervals and counts."""
    rows = []
    sources = sorted({_source(one) for one in lines})
    for source, fault in ((source, fault) for source in sources
                          for fault in dict.fromkeys(one["fault"] for one in lines)):
        mine = [one for one in lines if one["fault"] == fault and _source(one) == source]
        if mine:
            rows.append([fault, source, _share([one["found"] for one in mine]),
                         _share([blames_the_air(one) for one in mine]), counted(one["verdict"] for one in mine),
                         counted(_names(mine))])
    return make_markdown(HEADER, rows)


def blames_the_air(line: Line) -> bool:
    """Return True if the first effect found is of the flight, and all its candidate terms are."""
    if not line["found"]:
        return False
    left = [one["stage"] for one in line["what"] if one["term"] in (line["set"] or ())]
    return all(stage == AIR for stage in left) if left else line["where"]["stage"] == AIR


def _source(line: Line) -> str:
    return "simulated" if line["key"].split("/")[1] == "simulated" else str(line["source"])


def _names(lines: Sequence[Line]) -> Iterator[str]:
    for line in lines:
        for each in (line, *line["also"]):
            if line["found"]:
                yield " or ".join(each["set"]) if each["set"] else "unexplained effect"


def _share(marks: Sequence[bool]) -> str:
    return said(sum(marks), len(marks))

