"""Rig specification: the contents of rig.toml, and of [rig] in launcher.toml.

Outsiders write these files, so an absent optional key takes the default stated here, and a key that this version does
not know is reported by `unknown_keys` for the caller to warn about; a wrong type or a missing required key is an error.
"""

from typing import Any

from msgspec import Struct, field


class Ball(Struct, frozen=True):
    mass_kg: float
    radius_m: float


class Wheel(Struct, frozen=True):
    """One driven wheel; `clock_deg` is where it touches the ball, seen along the exit direction: 0 top, 180 bottom."""

    name: str
    radius_m: float
    gear: float                       # wheel speed / motor speed
    clock_deg: float


class LauncherFacts(Struct, frozen=True):
    release_height_m: float = 0.0
    free_speed_rad_s: float | None = None
    wheel: tuple[Wheel, ...] = ()


class Target(Struct, frozen=True):
    centre_height_m: float
    three_half_height_m: float = 0.07     # Eq. 13 of the paper
    two_half_height_m: float = 0.35       # Eq. 14 of the paper


class Air(Struct, frozen=True):
    density_kg_m3: float = 1.2


class WorldFacts(Struct, frozen=True):
    gravity_m_s2: float = 9.81


class Noise(Struct, frozen=True):
    """Assumed standard deviations of the sensors."""

    distance_m: float = 0.05
    hood_deg: float = 0.2
    wheel_rad_s: float = 0.5
    track_m: float = 0.015


class Believe(Struct, frozen=True):
    terms: tuple[str, ...] = ("gravity", "drag", "magnus")


class Rig(Struct, frozen=True):
    ball: Ball
    launcher: LauncherFacts = field(default_factory=LauncherFacts)
    target: Target | None = None
    air: Air = field(default_factory=Air)
    world: WorldFacts = field(default_factory=WorldFacts)
    noise: Noise = field(default_factory=Noise)
    believe: Believe = field(default_factory=Believe)


def unknown_keys(table: dict[str, Any], kind: Any = Rig, prefix: str = "") -> list[str]:
    """Dotted names in a parsed rig.toml that no field of `kind` takes."""
    known = kind.__annotations__
    names: list[str] = []
    for key, value in table.items():
        inner = _struct_in(known.get(key))
        if key not in known:
            names.append(prefix + key)
        elif inner is not None:
            for row in value if isinstance(value, list) else [value]:
                if isinstance(row, dict):
                    names += unknown_keys(row, inner, f"{prefix}{key}.")
    return names


def _struct_in(annotation: Any) -> Any:
    for part in (annotation, *getattr(annotation, "__args__", ())):
        if isinstance(part, type) and issubclass(part, Struct):
            return part
    return None
