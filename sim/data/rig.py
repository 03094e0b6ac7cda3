"""rig.toml <-> Facts."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from truearc.errors import InputError, load_text, make_toml, near_key, parse_struct, parse_table, unknown_keys
from truearc.robot.config.rig_spec import Rig, rig_errors

RIG = "rig.toml"


def load_rig(path: str | Path) -> Rig:
    """Read rig.toml; unknown keys are warned of on stderr; InputError names file and key of a bad one."""
    text = load_text(path)
    for key in unknown_keys(parse_table(text, str(path)), Rig):
        print(f"warning: {path}: key {key} is not known and has no effect{near_key(key, Rig, None)}", file=sys.stderr)
    return check_rig(parse_struct(text, Rig, str(path)), path)


def states_three(rig: Rig | str | Path | Mapping[str, Any]) -> bool:
    """Whether a rig, a rig.toml or its contents give the half-height of the three."""
    if isinstance(rig, Rig):
        return True
    table = rig if isinstance(rig, Mapping) else parse_table(load_text(rig), str(rig))
    return "three_half_height_m" in table.get("target", {})


def check_rig(rig: Rig, path: str | Path) -> Rig:
    """Return the rig if its numbers can be true.

    Raises:
        InputError: names `path` and the key of each number that is not finite, out of range, or contradicts another.
    """
    wrong = [f"{path}: {key}: {what}" for key, what in rig_errors(rig)]
    if wrong:
        raise InputError("\n".join(wrong))
    return rig


def save_rig(path: str | Path, rig: Rig) -> None:
    """Write rig.toml with every key stated, so that reading it gives the same rig."""
    Path(path).write_text(make_toml(msgspec.to_builtins(rig)), encoding="utf-8")
