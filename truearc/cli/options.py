"""Options of truearc's own commands, from tables: `options/MODULE.toml` has one for each command of a module.

A row is `"FLAGS" = {...}` with the arguments of `add_argument`, of which some are names, looked up in the command's
module, then in truearc.cli.common: `type` is a function, or a tuple of what the command writes into a folder; `choices`
may be a tuple. `{NAME}` in a text is replaced likewise. What such a name stands for is called where it takes nothing.
Beside argparse's own there are `low` and `high`, bounds of a number, and `group`: options of one exclude each other.
A table `names` has modules, by names for use in texts.
`"+NAME" = {}` stands for the rows of the table NAME of the same file, or of `common.toml`; a row that follows replaces
one of them.
"""

import argparse
import tomllib
from functools import cache
from importlib import import_module
from inspect import isfunction
from pathlib import Path
from string import Formatter
from types import ModuleType
from typing import Any

from truearc.cli import common

FOLDER = Path(__file__).with_name("options")
TYPES: dict[str, Any] = {"int": int, "float": float, "Path": Path, "names": common.listed(str)}


def add_options(parser: argparse.ArgumentParser, module: ModuleType, command: str) -> None:
    """Add the options of a command, a function of that module."""
    file, groups = module.__name__.rpartition(".")[2], dict[str, Any]()
    names = _Names(vars(common) | vars(module) | {
        name: import_module(place) for name, place in _tables(file).get("names", {}).items()})
    for flags, row in _rows(file, command).items():
        given: dict[str, Any] = {key: names.format(value) if isinstance(value, str) else value
                                 for key, value in row.items()}
        to, low, high = given.pop("group", None), given.pop("low", None), given.pop("high", None)
        if "type" in given:
            given["type"] = _type(names, given["type"], low, high)
        if isinstance(given.get("choices"), str):
            given["choices"] = names.find(given["choices"])
        if to is not None and to not in groups:
            groups[to] = parser.add_mutually_exclusive_group()
        groups.get(to, parser).add_argument(*flags.split(), **given)


class _Names(Formatter):
    """What names in a table stand for."""

    def __init__(self, known: dict[str, Any]) -> None:
        self._known = known

    def find(self, name: str) -> Any:
        return self.get_field(name, (), {})[0]

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        found = self._known[str(key)]
        return found() if isfunction(found) and not found.__code__.co_argcount else found


def _type(names: _Names, name: str, low: float | None, high: float | None) -> Any:
    if low is not None:
        return common.number(TYPES[name], low, *(() if high is None else (high,)))
    kind = TYPES[name] if name in TYPES else names.find(name)
    return common.OutFolder(kind) if isinstance(kind, tuple) else kind


def _rows(file: str, table: str) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for flags, row in (_tables(file) if table in _tables(file) else _tables("common"))[table].items():
        rows |= _rows(file, flags[1:]) if flags.startswith("+") else {flags: row}
    return rows


@cache
def _tables(file: str) -> dict[str, dict[str, Any]]:
    return tomllib.loads((FOLDER / f"{file}.toml").read_text(encoding="utf-8"))
