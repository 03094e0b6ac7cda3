"""Likely slips: the data with each slip of slips.toml undone, and how usual the sizes of their numbers are."""

import math
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from truearc.robot.config.shot_map import in_unit
from truearc.sim.check.believable import Reading
from truearc.sim.check.motion import Motion
from truearc.sim.data.dataset import Dataset, Floats
from truearc.sim.data.table import SPIN_VECTOR, WHEEL
from truearc.sim.physics.simulate import launch_state

TABLE = tomllib.loads(Path(__file__).with_name("slips.toml").read_text(encoding="utf-8"))
UNITS: dict[str, dict[str, tuple[str, float]]] = TABLE["units"]
TILT = 0.27                           # derived: tan of the 15 degrees that the term track_tilt allows
TALLEST = 0.25                        # share of the target's height; chosen: heights from the floor scatter by less
NEAR = 0.3                            # share of a release height; chosen: tracks that begin so low are from the exit


class Flaw(NamedTuple):
    """One implausible thing: which check, the file and key, and a sentence with what to do."""

    check: str
    place: str
    what: str
    warns: bool = False               # it may well be true

    def __str__(self) -> str:
        return f"{self.place}: {self.what}"


class Cause(NamedTuple):
    """A slip: the data with it undone, how rare it is [nats], and what to call some rows alone that have it.

    sure: how many times the usual evidence refuses it; inf: it may well be so, and is only warned of; mixed: some rows
    have it.
    """

    flaw: Flaw
    undone: Reading
    rare: float
    single: str = ""
    sure: float = 1.0
    mixed: bool = False


QUANTITIES: dict[str, dict[str, Any]] = TABLE["quantities"]
# rows of units of the rig's numbers and of tracks, beside the other slips of these
OF_RIG = [{**about, "of": [key], "times": factor, "what": f"this looks like {unit}: {{size:.3g}} {about['own']}"}
          for key, about in QUANTITIES.items() if "own" in about
          for unit, (_, factor) in UNITS[about["units"]].items() if factor != 1.0] + TABLE["rig"]
OF_TRACKS = [{"of": [f"{axis}_m" for axis in axes], "check": "gravity", "rare": rare, "single": single,
              "what": f"these look like {unit}: rename " + ", ".join(f"{axis}_m to {axis}_{suffix}" for axis in axes),
              "matrix": np.diag([metres if axis in axes else 1.0 for axis in "xyz"])}
             for unit, (suffix, metres) in UNITS["length"].items() if metres != 1.0
             for axes, rare, single in (("xyz", 0.0, unit), ("z", 2.0, ""))] + TABLE["tracks"]


def unusual(dataset: Dataset) -> dict[str, float]:
    """Return how unusual the size of each quantity is, in nats; a column's size is its median."""
    rig, shots = dataset.rig, dataset.shots
    speed = launch_state(rig, shots).get("exit_speed_m_s", np.full(len(shots), np.nan))
    motor = shots.number("motor_ratio") * (rig.launcher.free_speed_rad_s or math.nan)
    with np.errstate(all="ignore"):
        around = 2.0 * math.pi * rig.ball.radius_m / np.where(speed > 0.0, speed, np.nan)
        found: dict[str, Any] = {
            "density": rig.ball.density_kg_m3, "speed": speed, "rim": around * shots.number("exit_spin_rev_s"),
            "rim of all": around * np.sqrt(sum(shots.number(name)**2 for name in SPIN_VECTOR)),
            **{f"motor of {wheel.name}": shots.number(f"wheel_{wheel.name}_rad_s") / (motor * wheel.gear)
               for wheel in rig.launcher.wheel}, "allowed": _by_allowed(dataset)}
    found |= {key: value_of(dataset, key) if "." in key else shots.number(key)
              for key in QUANTITIES if key not in found}
    if rig.target is None:            # balls may be dropped from a tower
        del found["launcher.release_height_m"]
    nats = {}
    for key, value in found.items():
        about = QUANTITIES[key.partition(" of")[0]]
        size = float(np.nanmedian(np.abs(value))) if np.isfinite(value).any() else 0.0
        if size > 0.0 and "usual" in about:
            off = math.log(min(max(size, 1e-12), 1e12) / about["usual"])
            nats[key] = min(0.5 * (off / about["below" if off < 0.0 else "above"])**2, 100.0)
    return nats


def _by_allowed(dataset: Dataset) -> float:
    """Return the size of heights by what their outcomes allow, or by how far they are aside of the target's middle."""
    target, height = dataset.rig.target, dataset.shots.number("miss_height_m")
    if target is None or np.isfinite(height).sum() < 3:
        return math.nan
    half = {"two": target.two_half_height_m, "three": target.three_half_height_m}
    allowed = np.array([half.get(word, 0.5) + 0.03 for word in dataset.shots.text("outcome")])
    most = float(np.sqrt(np.nanmean((height / allowed)**2)))
    spread = float(np.nanstd(height) / np.median(allowed))
    aside = abs(float(np.nanmedian(height))) / float(np.nanstd(height)) / 3.0 if spread > 1e-9 * most else 0.0
    return most if aside == 0.0 else max(most, 1.0) * max(aside, 1.0) if max(most, aside) > 1.0 else spread


def value_of(dataset: Dataset, key: str) -> float:
    """Return a number of the rig by its dotted key, for wheels the first one's; nan if it is not stated."""
    value: Any = dataset.rig
    for name in key.split("."):
        value = getattr(value, name, None)
        value = value[0] if isinstance(value, tuple) and value else value or None
    return math.nan if value is None else float(value)


def _with_numbers(reading: Reading, columns: dict[str, Floats]) -> Reading:
    """Return the reading with other columns of shots."""
    shots = reading.dataset.shots
    return reading._replace(dataset=replace(reading.dataset, shots=replace(shots, numbers=shots.numbers | columns)))


def _with_rig(reading: Reading, key: str, by: Callable[[float], float]) -> Reading:
    """Return the reading with another number in the rig, for wheels in each of them."""
    part, *wheels, name = key.split(".")
    table = getattr(reading.dataset.rig, part)
    changed = [structs.replace(one, **{name: by(getattr(one, name))}) for one in (table.wheel if wheels else [table])]
    new = structs.replace(table, wheel=tuple(changed)) if wheels else changed[0]
    return reading._replace(dataset=replace(reading.dataset, facts=structs.replace(reading.dataset.rig, **{part: new})))


def causes(reading: Reading) -> Iterator[Cause]:
    """Yield every slip that the dataset may have."""
    shots, wheels = reading.dataset.shots, reading.dataset.rig.launcher.wheel
    known = {name for name, column in shots.numbers.items() if np.isfinite(column).any()}
    groups = {name: [name] for name in known} | {"wheel": sorted(filter(WHEEL.fullmatch, known))}
    groups |= {"spin_vector": list(SPIN_VECTOR)} if known.issuperset(SPIN_VECTOR) else {}
    known |= {name for name, columns in groups.items() if columns}
    if any(wheel.gear not in (0.0, 1.0, -1.0) for wheel in wheels):
        known.add("gears")
    if known & {"wheel", "motor_ratio"} and "exit_speed_m_s" not in shots.numbers:
        known.add("by wheels")
    for key, about in QUANTITIES.items():
        if "units" in about and groups.get(key):
            yield from _units(reading, groups[key], about)
    for kind, rows in ((_of_rig, OF_RIG), (_of_shots, TABLE["shots"])):
        for row in rows:
            if known.issuperset(row.get("needs", ())):
                yield from kind(reading, row, groups)
    if reading.motion is not None:
        yield from _of_tracks(reading, reading.motion)


def _cause(row: dict[str, Any], place: str, undone: Reading, *names: str, **said: Any) -> Cause:
    return Cause(Flaw(row["check"], place, row["what"].format(*names, **said)), undone, row["rare"],
                 row.get("single", ""), row.get("sure", 1.0))


def _of_rig(reading: Reading, row: dict[str, Any], groups: dict[str, list[str]]) -> Iterator[Cause]:
    for key in row["of"]:
        if not math.isnan(size := value_of(reading.dataset, key)):
            by = row["times"].__mul__ if "times" in row else lambda old: old and 1.0 / old
            yield _cause(row, f"rig.toml: {key}", _with_rig(reading, key, by), size=by(size))


def _of_shots(reading: Reading, row: dict[str, Any], groups: dict[str, list[str]]) -> Iterator[Cause]:
    shots, wheels = reading.dataset.shots, reading.dataset.rig.launcher.wheel
    gears = {f"wheel_{wheel.name}_rad_s": wheel.gear for wheel in wheels}
    for first in filter(groups.get, row["of"]):
        others = [name for other in row.get("exchange", ()) for name in groups.get(other, [])]
        sizes = {name: shots.written.get(name, ("", 1.0))[1] for name in (first, *others)}
        changes = [{first: shots.number(other) / sizes[other] * sizes[first],
                    other: shots.number(first) / sizes[first] * sizes[other]} for other in others]
        if "exchange" not in row:
            changes = [{name: shots.number(name) * row.get("times", gears.get(name, 1.0)) + row.get("plus", 0.0)
                        for name in groups[first]}]
        for columns in changes:
            yield _cause(row, f"{shots.source}: {', '.join(columns)}", _with_numbers(reading, columns), *columns)


def _units(reading: Reading, names: list[str], about: dict[str, Any]) -> Iterator[Cause]:
    """Yield other units for columns, in all rows or in some; heights may be those above the floor."""
    shots, target, units = reading.dataset.shots, reading.dataset.rig.target, UNITS[about["units"]]
    place = f"{shots.source}: {', '.join(names)}"
    written, size, _ = shots.written.get(names[0], (names[0], 1.0, 0.0))
    own = next(unit for unit, (_, factor) in units.items() if factor == 1.0)
    read = next((unit for unit, (_, factor) in units.items() if math.isclose(factor, size)), own)
    for unit, (suffix, factor) in units.items():
        by = factor / units[read][1]
        undone = _with_numbers(reading, {name: shots.number(name) * by for name in names})
        if unit != read:
            rename = f"rename {'each' if len(names) > 1 else 'the column'} to {in_unit(written, suffix)}"
            rename = rename if suffix else f"multiply them by {factor:g}"
            rename += f" or multiply it by {factor:.3g}" if unit == "radians" else ""
            # a column says its unit or, in metres, has it by default
            yield Cause(Flaw(about["check"], place, f"these look like {unit}: {rename}"), undone,
                        about["rare"] + (0.5 if unit in ("metres", "turns") else 0.0), unit)
        if unit not in (read, "metres") and names == ["distance_m"]:
            yield Cause(Flaw(about["check"], place, f"these look like metres among {unit}"), _with_numbers(
                reading, {"distance_m": shots.number("distance_m") / by}), about["rare"] + 99.0, f"metres among {unit}")
        if names == ["miss_height_m"] and target is not None:
            above = undone.dataset.shots.number("miss_height_m") - target.centre_height_m
            if abs(float(np.nanmedian(above))) < max(TALLEST * target.centre_height_m, target.two_half_height_m):
                rename = f", and rename the column to miss_height_{suffix}" if unit != read else ""
                yield Cause(Flaw("height", place, f"these look like heights above the floor in {unit}: subtract that "
                                 f"of the target's centre, {target.centre_height_m / by:.4g}{rename}"),
                            _with_numbers(reading, {"miss_height_m": above}), 0.7)


def _of_tracks(reading: Reading, motion: Motion) -> Iterator[Cause]:
    """Yield other units, axes, origins and times of tracks, and tracks of the wrong shots."""
    turn = math.atan2(*np.median(motion.to_m - motion.from_m, axis=0)[1::-1])
    cosine, sine = math.cos(turn), math.sin(turn)
    back = motion.from_m[:, 0] / np.where(motion.start_m_s[:, 0] > 0.0, motion.start_m_s[:, 0], np.inf)
    begin = motion.from_m - motion.start_m_s * back[:, None]
    begin[:, 2] -= 0.5 * reading.dataset.rig.world.gravity_m_s2 * back**2
    stated, (_, y, z) = reading.dataset.rig.launcher.release_height_m, np.median(begin, axis=0)
    behind, tilted = -float(np.median(motion.from_m[:, 0])), TILT * abs(float(np.median(motion.from_m[:, 2])))
    same = np.eye(3)
    undone = {"turned": motion.read(np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])),
              "aside": motion.read(same, by_m=np.array([0.0, -y, 0.0])), "unlinked": replace(motion, unlinked=True),
              "behind": motion.read(same, by_m=np.array([behind if behind > tilted else 0.0, 0.0, 0.0]))}
    if stated or reading.dataset.rig.target is not None:          # else the height of a tower, maybe, is not stated
        name = "unstated" if stated == 0.0 else "from exit" if abs(z) < NEAR * stated else "another height"
        undone[name] = motion.read(same, by_m=np.array([0.0, 0.0, stated - z]))
    said: dict[str, Any] = {"degrees": abs(math.degrees(turn)), "side": "left" if turn > 0.0 else "right", "y": y,
                            "z": z, "stated": stated, "behind": behind}
    for row in OF_TRACKS:
        for rate in row.get("per_s", [1.0]):
            read = undone.get(row["name"]) if "name" in row else motion.read(
                np.array(row.get("matrix", same), dtype=float), row.get("seconds", 1.0) / rate)
            if read is not None:
                yield _cause(row, f"tracks: {', '.join(row['of'])}", reading._replace(motion=read), rate=rate, **said)
