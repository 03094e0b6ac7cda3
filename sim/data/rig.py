"""rig.toml <-> Facts."""

import math
import sys
import tomllib
from pathlib import Path
from typing import Any

import msgspec

from truearc.robot.config.rig_spec import Rig, unknown_keys
from truearc.robot.config.schema import InputError, load_toml
from truearc.robot.config.toml_text import make_toml

RIG = "rig.toml"
POSITIVE = ("ball.mass_kg", "ball.radius_m", "launcher.free_speed_rad_s", "launcher.wheel.radius_m",
            "target.three_half_height_m", "target.two_half_height_m")
NOT_NEGATIVE = ("launcher.release_height_m", "air.density_kg_m3", "noise.distance_m", "noise.hood_deg",
                "noise.wheel_rad_s", "noise.track_m")


def load_rig(path: str | Path) -> Rig:
    """Read rig.toml; unknown keys are warned of on stderr; InputError names file and key of a bad one."""
    rig = load_toml(path, Rig)
    for key in unknown_keys(tomllib.loads(Path(path).read_text(encoding="utf-8"))):
        print(f"warning: {path}: key {key} is not known and has no effect", file=sys.stderr)
    return check_rig(rig, path)


def check_rig(rig: Rig, path: str | Path) -> Rig:
    """Return the rig if its numbers can be true.

    Raises:
        InputError: names `path` and the key of a number that is not finite, out of range, or contradicts another.
    """
    for key, value in _leaves(msgspec.to_builtins(rig), ""):
        _check(path, key, value)
    names = [wheel.name for wheel in rig.launcher.wheel]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: launcher.wheel.name: two wheels have one name")
    if rig.target and rig.target.three_half_height_m > rig.target.two_half_height_m:
        raise InputError(f"{path}: target.three_half_height_m: exceeds two_half_height_m, but three lies inside two")
    return rig


def save_rig(path: str | Path, rig: Rig) -> None:
    """Write rig.toml with every key stated, so that reading it gives the same rig."""
    Path(path).write_text(make_toml(msgspec.to_builtins(rig)), encoding="utf-8")


def _leaves(value: Any, key: str) -> list[tuple[str, Any]]:
    if isinstance(value, dict):
        return [leaf for name, part in value.items() for leaf in _leaves(part, f"{key}.{name}" if key else name)]
    if isinstance(value, list | tuple):
        return [leaf for part in value for leaf in _leaves(part, key)]
    return [(key, value)]


def _check(path: str | Path, key: str, value: Any) -> None:
    if not isinstance(value, int | float):
        return
    if not math.isfinite(value):
        raise InputError(f"{path}: {key}: {value} is not finite")
    if key in POSITIVE and value <= 0:
        raise InputError(f"{path}: {key}: {value} must be above 0")
    if key in NOT_NEGATIVE and value < 0:
        raise InputError(f"{path}: {key}: {value} must not be below 0")
