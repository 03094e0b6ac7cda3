"""Set points from files: the aim file, used if `aim.policy` is "belief", and the table of prescribed shots.

`truearc aim --robot` writes the aim file. The file contains its own hash (see truearc.robot.gate), the hash of the
contract below, and its rig. A file that is damaged, has a different contract or is for another rig is refused. Between
two of its distances, each number follows the cubic Hermite polynomial through the values and slopes at both. The
arithmetic uses Python floats, so that a replay gives the same bits. The table of prescribed shots (`truearc run
--plan`) lists configurations to shoot exactly as given, in place of the robot's own plan.
"""

import csv
import hashlib
import io
import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import UNSET, Struct, UnsetType
from msgspec.structs import replace

from truearc.errors import MAX_TEXT_BYTES, InputError, load_bytes, naming, number_in
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target
from truearc.robot.config.schema import Config, Prescribed

SCHEMA = "truearc.aim/1"
CONTRACT = {"in": "distance_m: ball exit to target plane, horizontal",
            "out": ["hood_deg: launch elevation", "motor_ratio: motor speed / free speed",
                    "lead_deg: aim to the left of the target"],
            "between": "cubic Hermite"}
CHECKED = 8                           # places between two distances at which a file is tried when it is read
LONGEST_NOTE = 200                    # characters
ROUNDS = 16                           # to the distance of a throw on the move: each leaves a third of the error at most
CLOSE_M = 1e-3                        # what may then be left
MOST_SHARE = 0.7                      # sine of the greatest lead


class Curve(Struct, frozen=True, forbid_unknown_fields=True):
    """Value and slope (per metre) at each distance of a segment."""

    value: tuple[float, ...]          # at each distance
    slope: tuple[float, ...]          # per metre


class Motion(Struct, frozen=True, forbid_unknown_fields=True):
    """Effect of the robot's own velocity on a ball thrown with a set point."""

    carry_s: Curve                    # m per m/s along the throw, until it comes to its distance
    sideways_s: Curve                 # and across
    trim_s_m: Curve                   # change of the log of the motor's speed per m/s along
    bend_s2_m2: Curve                 # and per square of that
    sink_s2_m2: Curve                 # per square of the velocity across
    low_m: float                      # least distance for which that is known
    high_m: float                     # greatest


class Segment(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Set points from its first distance to its last, at least two, in ascending order."""

    distance_m: tuple[float, ...]     # exit to target plane, horizontal
    hood_deg: Curve                   # launch elevation
    motor_ratio: Curve                # motor speed / free speed
    lead_deg: Curve                   # aim to the left of the target
    motion: Motion | UnsetType = UNSET            # absent: not to be shot with on the move


class AimRig(Struct, frozen=True, forbid_unknown_fields=True):
    """The properties of a rig that set points depend on and no session changes."""

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
    """Launch elevation, motor speed / free speed, and the lead to the left of the target."""

    hood_deg: float
    motor_ratio: float
    lead_deg: float


class OnTheMove(NamedTuple):
    """A set point for a moving robot: the distance from which a robot at rest would make the same throw, that set
    point, the extra lead to the left of the target, and the log of the extra speed."""

    virtual_m: float
    point: SetPoint
    lead_deg: float
    trim: float


class AimFile(NamedTuple):
    """A loaded and checked aim file, made only by load_aim. `sha256`: of the file."""

    content: AimContent
    sha256: str

    def at(self, distance_m: float) -> SetPoint | None:
        """Return the set point for a distance; None if the file has none."""
        segment = self._segment(distance_m)
        return None if segment is None else _between(segment, distance_m)

    def moving(self, distance_m: float, toward_m_s: float, left_m_s: float, delay_s: float) -> OnTheMove | None:
        """Return the set point for a robot whose velocity, toward the target and to its left, carries the ball along.

        delay_s: time until the ball leaves. None if the file has none.
        """
        turn_rad, virtual_m = 0.0, distance_m
        for _ in range(ROUNDS):
            segment = self._segment(virtual_m)
            if segment is None or segment.motion is UNSET or not (
                    segment.motion.low_m <= virtual_m <= segment.motion.high_m):
                return None
            carry_s, sideways_s, trim, bend, sink = (_cubic(segment, curve, virtual_m)
                                                     for curve in _curves(segment.motion))
            along = toward_m_s * math.cos(turn_rad) + left_m_s * math.sin(turn_rad)
            across = left_m_s * math.cos(turn_rad) - toward_m_s * math.sin(turn_rad)
            share = -(sideways_s + delay_s) * across / distance_m if distance_m > 0.0 else math.inf
            if not abs(share) <= MOST_SHARE:
                return None
            before, turn_rad = virtual_m, math.asin(share)
            virtual_m = distance_m * math.cos(turn_rad) - (carry_s + delay_s) * along
        if not abs(virtual_m - before) <= CLOSE_M or (segment := self._segment(virtual_m)) is None:
            return None
        return OnTheMove(virtual_m, _between(segment, virtual_m), math.degrees(turn_rad),
                         trim * along + bend * along * along + sink * across * across)

    def _segment(self, distance_m: float) -> Segment | None:
        return next((one for one in self.content.segments if one.distance_m[0] <= distance_m <= one.distance_m[-1]),
                    None)


Aims = Mapping[str, AimFile]          # by hash; under "" the one that the robot started with
NO_AIMS: Aims = {}


def _between(segment: Segment, distance_m: float) -> SetPoint:
    return SetPoint._make(_cubic(segment, curve, distance_m)
                          for curve in (segment.hood_deg, segment.motor_ratio, segment.lead_deg))


def _curves(motion: Motion) -> list[Curve]:
    return [motion.carry_s, motion.sideways_s, motion.trim_s_m, motion.bend_s2_m2, motion.sink_s2_m2]


def _cubic(segment: Segment, curve: Curve, distance_m: float) -> float:
    x = segment.distance_m
    k = min(bisect_right(x, distance_m), len(x) - 1) - 1
    wide = x[k + 1] - x[k]
    t = (distance_m - x[k]) / wide
    u = 1.0 - t
    first, last, leaving, coming = u * u * (1.0 + 2.0 * t), t * t * (3.0 - 2.0 * t), wide * t * u * u, -wide * t * t * u
    return first * curve.value[k] + last * curve.value[k + 1] + leaving * curve.slope[k] + coming * curve.slope[k + 1]


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
    from truearc.robot.gate import is_intact  # which loads NumPy; deploy and others need the form alone
    if not is_intact(data, content.sha256):
        raise InputError(f"{path}: sha256: damaged or altered since it was made (the seal does not fit)")
    for key, what in _errors(content):
        raise InputError(f"{path}: {key}: {what}")
    return AimFile(content, hashlib.sha256(data).hexdigest())


def check_rig(path: str | Path, aim: AimFile, rig: Rig) -> None:
    """Raise InputError if the file is for another ball, launcher or target."""
    theirs, ours = (msgspec.to_builtins(one) for one in (aim.content.rig, rig_of(rig)))
    for part in ("ball", "launcher", "target"):
        if theirs[part] != ours[part]:
            raise InputError(f"{path}: rig.{part}: made for {_said(theirs[part], ours[part])}; make it again with this "
                             "launcher.toml")


def load_aim_for(path: str | Path, config: Config) -> AimFile:
    """Load an aim file as load_aim does; InputError also if it is for another rig or a hood with more travel."""
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
        moving = [] if segment.motion is UNSET else _curves(segment.motion)
        curves = (segment.hood_deg, segment.motor_ratio, segment.lead_deg, *moving)
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


# --- a table of prescribed shots

COLUMNS = ("distance_m", "motor_ratio", "hood_deg")
SHOWN = 5                             # bad rows that a message names before it only counts


def load_plan(path: str | Path, config: Config) -> tuple[Prescribed, ...]:
    """Read rows of a CSV file, or of shots.csv in a dataset directory; other columns are ignored.

    InputError names file, line and column of every row that this launcher cannot be set to: ratio in (0, 1], elevation
    within the hood's limits, distance above 0.
    """
    file = Path(path) / "shots.csv" if Path(path).is_dir() else Path(path)
    plan, bad = [], []
    for line, row in _rows(file):
        plan.append({name: number_in(cell) for name, cell in row.items()})
        bad += [f"{file}:{line}: {what}" for what in _row_errors(row, plan[-1], config)]
    if bad:
        more = [f"... and {len(bad) - SHOWN} more"] if len(bad) > SHOWN else []
        raise InputError("\n".join([*bad[:SHOWN], *more]))
    if not plan:
        raise InputError(f"{file}: no rows: there is nothing to shoot")
    return tuple(Prescribed(**values) for values in plan)


def with_plan(config: Config, plan: tuple[Prescribed, ...], repeats: int | None = None) -> Config:
    """Return the configuration with these shots prescribed, each `repeats` times (None: as [collect] states)."""
    repeats = config.collect.repeats if repeats is None else repeats
    if repeats < 1:
        raise InputError(f"--repeats {repeats}: at least 1")
    return replace(config, collect=replace(config.collect, prescribed=plan, repeats=repeats))


def _rows(file: Path) -> list[tuple[int, dict[str, str]]]:
    """(line, cells by column) of each row; InputError when it is no such table."""
    with naming(file):
        text = load_bytes(file, MAX_TEXT_BYTES).decode("utf-8-sig")
        reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
        header = reader.fieldnames or []
        if missing := [name for name in COLUMNS if name not in header]:
            raise InputError(f"{file}:1: columns {', '.join(missing)} are missing; a plan has them by these names, "
                             "with commas between cells, and no other unit is converted")
        return [(reader.line_num, {name: row[name] or "" for name in COLUMNS}) for row in reader]


def _row_errors(row: dict[str, str], values: dict[str, float], config: Config) -> Iterator[str]:
    limits = {"distance_m": (0.0, 1e3), "motor_ratio": (0.0, 1.0),
              "hood_deg": (config.hood.low_deg, config.hood.high_deg)}
    for name, value in values.items():
        low, high = limits[name]
        if math.isnan(value):
            yield f"{name}: {row[name]!r} is not a number"
        elif not low <= value <= high or (value == 0.0 and name != "hood_deg"):
            yield f"{name}: {value:g} is out of the launcher's range ({low:g} to {high:g})"
