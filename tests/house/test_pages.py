"""Tables of pages that restate code say what the code says."""

import math
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

import truearc
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.table import NO_RANGE, RANGES, TEXTS, WORDS

ROOT = Path(__file__).parents[2]
DATASET = (ROOT / "docs" / "reference" / "dataset.md").read_text(encoding="utf-8")
REQUIRED = "required"


def rows_of(text: str, heading: str) -> dict[str, list[str]]:
    """Rows of the first table below a heading of the second level: first cell without backticks -> other cells."""
    part = text.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip()[1:-1].split("|")] for line in part.splitlines()
            if line.startswith("| `")]
    return {row[0].strip("`"): row[1:] for row in rows}


def values_of(name: str) -> str:
    if name in WORDS:
        return ", ".join(WORDS[name])
    if name in (*TEXTS, "shot_id", "config_id"):
        return "text"
    low, high = RANGES.get(name, NO_RANGE)
    if math.isinf(high):
        return "any" if math.isinf(low) else f"from {low:g}"
    return f"{low:g} to {high:g}"


def columns_read() -> set[str]:
    """Columns of shots that code under sim/ reads by name."""
    read = re.compile(r'shots\.(?:number|text)\("(\w+)"\)')
    return {name for path in (ROOT / "sim").rglob("*.py") for name in read.findall(path.read_text(encoding="utf-8"))}


def leaves(kind: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """(dotted key, default as the page writes it) of every key of rig.toml."""
    for one in msgspec.structs.fields(kind):
        parts = (one.type, *getattr(one.type, "__args__", ()))
        inner = next((part for part in parts if isinstance(part, type) and issubclass(part, msgspec.Struct)), None)
        if inner is not None:
            yield from leaves(inner, f"{prefix}{one.name}.")
        else:
            yield prefix + one.name, default_text(one.default)


def default_text(default: Any) -> str:
    if default is msgspec.NODEFAULT:
        return REQUIRED
    if isinstance(default, tuple):
        return ", ".join(default)
    if isinstance(default, bool):
        return str(default).lower()
    return "none" if default is None else f"{default:g}"


def test_every_column_is_on_the_page_of_datasets() -> None:
    rows = rows_of(DATASET, "shots.csv")
    assert {*RANGES, *WORDS, *TEXTS, "shot_id", *columns_read()} - set(rows) == set()
    assert {name: cells[1] for name, cells in rows.items()} == {name: values_of(name) for name in rows}


def test_every_key_of_the_rig_is_on_the_page_of_datasets() -> None:
    assert {name: cells[1] for name, cells in rows_of(DATASET, "rig.toml").items()} == dict(leaves(Rig))


def test_architecture_lists_every_public_name_and_its_file() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").split("\n## Python API\n")[1].split("\n## ")[0]
    listed = {name: row[1] for row in re.findall(r"^\| (`.*`) \| `(.*)` \|$", text, re.MULTILINE)
              for name in re.findall(r"`(\w+)`", row[0])}
    assert set(listed) == set(truearc.__all__)
    for name, path in listed.items():
        module = import_module("truearc." + path.removeprefix("truearc/").removesuffix(".py").replace("/", "."))
        value = getattr(truearc, name)
        assert value is module or (value.__module__, getattr(module, name)) == (module.__name__, value), name
