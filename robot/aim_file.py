"""The aim file: set points by distance, by which the robot aims where `aim.policy` is "belief".

`truearc aim --robot` makes it. The file carries its own hash (truearc.robot.gate.seal), that of the contract below, and
the rig that it is for; one that is damaged, of another contract or for another rig is refused. Between two of its
distances each number is the cubic whose value and slope are stated at both (Hermite). All in Python's floats, so that a
replay gives the same bits.
"""

import hashlib
import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target
from truearc.robot.config.schema import MAX_TEXT_BYTES, Config, InputError, load_bytes, naming
from truearc.robot.gate.seal import is_intact

SCHEMA = "truearc.aim/1"
CONTRACT = {"in": "distance_m: ball exit to target plane, horizontal",
            "out": ["hood_deg: launch elevation", "motor_ratio: motor speed / free speed",
                    "lead_deg: aim to the left of the target"],
            "between": "cubic Hermite"}
CHECKED = 8                           # places between two distances at which a file is tried when it is read
LONGEST_NOTE = 200                    # characters


class Curve(Struct, frozen=True, forbid_unknown_fields=True):
    """Value and slope (per metre) at each distance of a segment."""

    value: tuple[float, ...]          # at each distance
    slope: tuple[float, ...]          # per metre


class Segment(Struct, frozen=True, forbid_unknown_fields=True):
    """Set points from its first distance to its last, which ascend; two at least."""

    distance_m: tuple[float, ...]     # exit to target plane, horizontal
    hood_deg: Curve                   # launch elevation
    motor_ratio: Curve                # motor speed / free speed
    lead_deg: Curve                   # aim to the left of the target


class AimRig(Struct, frozen=True, forbid_unknown_fields=True):
    """What of a rig set points depend on and no session changes."""

    ball: Ball                        # as in rig.toml
    launcher: LauncherFacts           # as in rig.toml
    target: Target | None             # as in rig.toml


class AimContent(Struct, frozen=True, forbid_unknown_fields=True):
    """Content of the file."""

    schema: str                       # truearc.aim/1
    sha256: str                       # of the file with "seal" 16 times in this place
    contract_sha256: str              # of what goes in and comes out
    note: str                         # one line for the driver
    rig: AimRig                       # that it is for
    segments: tuple[Segment, ...]     # ascending; between two of them there is no set point
    provenance: dict[str, Any]        # version that made it, coefficients and scatter of the belief


class SetPoint(NamedTuple):
    """Launch elevation, motor speed / free speed, and by how much to aim to the left of the target."""

    hood_deg: float
    motor_ratio: float
    lead_deg: float


class AimFile(NamedTuple):
    """A loaded aim file. Made by load_aim only, which has checked it. `sha256`: of the file."""

    content: AimContent
    sha256: str

    def at(self, distance_m: float) -> SetPoint | None:
        """The set point for a distance; None where the file has none."""
        for segment in self.content.segments:
            if segment.distance_m[0] <= distance_m <= segment.distance_m[-1]:
                return _between(segment, distance_m)
        return None


Aims = Mapping[str, AimFile]          # by hash; under "" the one that the robot started with
NO_AIMS: Aims = {}


def _between(segment: Segment, distance_m: float) -> SetPoint:
    x = segment.distance_m
    k = min(bisect_right(x, distance_m), len(x) - 1) - 1
    wide = x[k + 1] - x[k]
    t = (distance_m - x[k]) / wide
    u = 1.0 - t
    first, last, leaving, coming = u * u * (1.0 + 2.0 * t), t * t * (3.0 - 2.0 * t), wide * t * u * u, -wide * t * t * u
    return SetPoint._make(
        first * curve.value[k] + last * curve.value[k + 1] + leaving * curve.slope[k] + coming * curve.slope[k + 1]
        for curve in (segment.hood_deg, segment.motor_ratio, segment.lead_deg))


def contract_hash() -> str:
    return hashlib.sha256(msgspec.json.encode(CONTRACT, order="deterministic")).hexdigest()


def rig_of(rig: Rig) -> AimRig:
    return AimRig(rig.ball, rig.launcher, rig.target)


def load_aim(path: str | Path) -> AimFile:
    """Load and check an aim file; InputError names the file and what is wrong with it.

    Refused: unreadable, not an aim file, another contract, a seal that does not fit, and set points that no launcher
    can take.
    """
    data = load_bytes(path, MAX_TEXT_BYTES)
    with naming(path):
        content = msgspec.json.decode(data, type=AimContent)
    if content.schema != SCHEMA or content.contract_sha256 != contract_hash():
        raise InputError(f"{path}: schema {content.schema!r}, contract {content.contract_sha256[:12]}...; this robot "
                         f"reads {SCHEMA!r}, contract {contract_hash()[:12]}...")
    if not is_intact(data, content.sha256):
        raise InputError(f"{path}: sha256: damaged or altered since it was made (the seal does not fit)")
    for key, what in _errors(content):
        raise InputError(f"{path}: {key}: {what}")
    return AimFile(content, hashlib.sha256(data).hexdigest())


def check_rig(path: str | Path, aim: AimFile, rig: Rig) -> None:
    """InputError where the file is for another ball, launcher or target."""
    theirs, ours = (msgspec.to_builtins(one) for one in (aim.content.rig, rig_of(rig)))
    for part in ("ball", "launcher", "target"):
        if theirs[part] != ours[part]:
            raise InputError(f"{path}: rig.{part}: made for {_said(theirs[part], ours[part])}; make it again with this "
                             "launcher.toml")


def load_aim_for(path: str | Path, config: Config) -> AimFile:
    """load_aim; InputError, too, where the file is for another rig than the configuration's, or a hood of more travel.
    """
    aim = load_aim(path)
    check_rig(path, aim, config.rig)
    hoods = [angle for segment in aim.content.segments for angle in segment.hood_deg.value]
    if not config.hood.low_deg <= min(hoods) <= max(hoods) <= config.hood.high_deg:
        raise InputError(f"{path}: hood_deg: {min(hoods):g} to {max(hoods):g}, but the hood travels from "
                         f"{config.hood.low_deg:g} to {config.hood.high_deg:g} ([hood])")
    return aim


def needs_aim(config: Config) -> bool:
    return config.aim.policy == "belief"


def _said(theirs: Any, ours: Any) -> str:
    """The parts that differ, each with both values."""
    if isinstance(theirs, dict) and isinstance(ours, dict):
        keys = [key for key in dict.fromkeys([*theirs, *ours]) if theirs.get(key) != ours.get(key)]
        return ", ".join(f"{key} {theirs.get(key)}, this robot has {ours.get(key)}" for key in keys)
    return f"{theirs}, this robot has {ours}"


def _errors(content: AimContent) -> Iterator[tuple[str, str]]:
    if not content.segments:
        yield "segments", "there is none"
    if len(content.note) > LONGEST_NOTE or not content.note.isprintable():
        yield "note", f"not a line of at most {LONGEST_NOTE} characters"
    for number, segment in enumerate(content.segments):
        x, name = segment.distance_m, f"segments[{number}]"
        curves = (segment.hood_deg, segment.motor_ratio, segment.lead_deg)
        if len(x) < 2 or any(len(part) != len(x) for curve in curves for part in (curve.value, curve.slope)):
            yield name, "two distances are needed at least, and as many of everything else"
        elif not all(map(math.isfinite, (*x, *(y for curve in curves for y in (*curve.value, *curve.slope))))):
            yield name, "a number is not finite"
        elif not (x[0] > 0.0 and all(low < high for low, high in pairwise(x))):
            yield f"{name}.distance_m", "must be above 0 and ascend"
        else:
            yield from _impossible(segment, name)
    ends = [end for segment in content.segments for end in (segment.distance_m[0], segment.distance_m[-1])]
    if ends != sorted(ends):
        yield "segments", "must ascend without overlap"


def _impossible(segment: Segment, name: str) -> Iterator[tuple[str, str]]:
    for low, high in pairwise(segment.distance_m):
        for share in range(CHECKED + 1):
            distance_m = low + (high - low) * share / CHECKED
            point = _between(segment, min(distance_m, high))
            if not (0.0 < point.motor_ratio <= 1.0 and abs(point.hood_deg) < 90.0 and abs(point.lead_deg) < 90.0):
                yield name, (f"at {distance_m:.2f} m: hood {point.hood_deg:g} deg, motor {point.motor_ratio:g} of free "
                             f"speed, lead {point.lead_deg:g} deg: no launcher can do that")
                return
