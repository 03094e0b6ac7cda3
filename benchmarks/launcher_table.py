"""Tables of what discovery made of the MuJoCo world, as it is and changed."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from truearc_proof.report.tables import said
from truearc_proof.table import Table
from truearc_proof.worlds.sampling_plan import CHANGES, Change

TARGET = 1.5                          # times the world's own scatter, for the adopted simulation's heights
AS_IS = "as-is"
AS_IS_HEADER = ("level", "seed", "p-value", "verdict", "stage", "names", "heights off before", "adopted", "own scatter",
                "ratio")
CHANGED_HEADER = ("changed", "found", "stage", "first name right", "right name in the set", "verdicts", "first names")

Line = Mapping[str, Any]


def make_tables(lines: Sequence[Line]) -> str:
    """Markdown: the world as it is, one row a world; and changed, one row a change and level."""
    as_is = sorted((one for one in lines if one["name"] == AS_IS), key=lambda one: (one["level"], one["seed"]))
    parts = [_as_is_table(as_is)] if as_is else []
    changed = [one for one in lines if one["name"] != AS_IS]
    parts += [_changed_table(level, [one for one in changed if one["level"] == level])
              for level in sorted({one["level"] for one in changed})]
    return "\n\n".join(parts)


def _as_is_table(lines: Sequence[Line]) -> str:
    rows = [[one["level"], str(one["seed"]), f"{one['p_value']:.2g}", one["verdict"], str(one["where"]["stage"]),
             ", ".join(_names(one)), *(f"{one[name]:.3f} m" for name in ("before_m", "after_m", "scatter_m")),
             f"{one['after_m'] / one['scatter_m']:.2f}"] for one in lines]
    good = sum(one["after_m"] <= TARGET * one["scatter_m"] for one in lines)
    launch = sum(one["where"]["stage"] == "launch" for one in lines)
    return "\n".join([Table("As it is", AS_IS_HEADER, rows).markdown(), "",
                      f"Adopted within {TARGET} x the own scatter: {good} of {len(lines)}; placed at the launch: "
                      f"{launch} of {len(lines)}."])


def _names(one: Line) -> list[str]:
    """Return the terms found with their amplitudes, or "unexplained effect"."""
    parts = []
    for each in (one, *one["also"]):
        if not each["set"] or not each["what"]:
            parts.append("unexplained effect")
            continue
        size = next(iter(each["what"][0]["parameters"].values()))
        parts.append(f"{each['what'][0]['term']} {size['value']:.3g} {size['unit']}")
    return parts


def _changed_table(level: str, lines: Sequence[Line]) -> str:
    rows = []
    for change in CHANGES:
        mine = [one for one in lines if one["name"] == change.name]
        if mine:
            rows.append(_changed_row(change, mine))
    return Table(f"Changed, {level}", CHANGED_HEADER, rows).markdown()


def _changed_row(change: Change, lines: Sequence[Line]) -> list[str]:
    found = [one for one in lines if one["found"]]
    first = [one["what"][0]["term"] if one["what"] else "-" for one in found]
    told = [one["set"] or () for one in found]
    marks = [sum(one["where"]["stage"] in change.stages for one in found), sum(name in change.names for name in first),
             sum(bool(set(names) & set(change.names)) for names in told)]
    cells = [f"{mark}/{len(found)}" if change.names else "-" for mark in marks]
    return [change.name, said(len(found), len(lines)), *cells, counted(one["verdict"] for one in lines), counted(first)]


def counted(words: Iterable[str]) -> str:
    """How often each word comes, the commonest first; "-" where there is none."""
    counts: dict[str, int] = {}
    for word in words:
        counts[word] = counts.get(word, 0) + 1
    return ", ".join(f"{count} {word}" for word, count in sorted(counts.items(), key=lambda item: -item[1])) or "-"
