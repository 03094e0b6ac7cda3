"""Likely slips, from one table of quantities, their usual sizes and the units that people give them in."""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from truearc.sim.check.believable import Reading
from truearc.sim.check.motion import Motion
from truearc.sim.data.dataset import Dataset, Floats
from truearc.sim.data.table import SPIN_VECTOR, WHEEL
from truearc.sim.physics.simulate import launch_state

RPM = math.pi / 30.0                  # definition
# Definitions; in the order of how often people have them
LENGTHS = {"feet": ("ft", 0.3048), "inches": ("in", 0.0254), "centimetres": ("cm", 0.01), "millimetres": ("mm", 1e-3),
           "metres": ("m", 1.0)}
SMALL = {unit: LENGTHS[unit] for unit in LENGTHS if unit != "feet"}
TURNS = {"revolutions per minute": ("rpm", RPM), "revolutions per second": ("rev_s", 2.0 * math.pi),
         "radians per second": ("rad_s", 1.0)}
SPINS = {unit: (suffix, size / 2.0 / math.pi) for unit, (suffix, size) in TURNS.items()}
SPEEDS = {"feet per second": ("ft_s", 0.3048), "miles per hour": ("mph", 0.44704),
          "kilometres per hour": ("km_h", 1.0 / 3.6), "metres per second": ("m_s", 1.0)}
ANGLES = {"radians": ("rad", math.degrees(1.0)), "turns": ("", 360.0), "degrees": ("deg", 1.0)}
MASSES = {"grams": ("g", 1e-3), "kilograms": ("kg", 1.0)}
RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 90.0, 100.0, 120.0, 180.0, 200.0, 240.0, 300.0)          # of cameras
TILT = 0.27                           # derived: tan of the 15 degrees that the term track_tilt allows
TALLEST = 0.25                        # share of the target's height; chosen: heights from the floor scatter by less


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

    sure: how many times the usual evidence refuses it; inf: it may well be so, and is only warned of.
    """

    flaw: Flaw
    undone: Reading
    rare: float
    single: str = ""
    sure: float = 1.0


class Quantity(NamedTuple):
    """Usual size, deviations of its log below and above, the check that judges it, and its units (name: suffix, size).

    rare: nats that a slip in its unit costs; usual sizes are chosen from launchers of schools, ball machines and arms.
    """

    usual: float
    below: float
    above: float
    check: str
    units: dict[str, tuple[str, float]]
    rare: float = 0.0


QUANTITIES = {
    "distance_m": Quantity(4.0, 0.8, 0.8, "reach", LENGTHS),
    "hood_deg": Quantity(42.0, 0.8, 0.3, "hood", ANGLES),
    "exit_deg": Quantity(42.0, 0.8, 0.3, "hood", ANGLES),
    "wheel": Quantity(math.nan, 1.0, 1.0, "wheels", TURNS, 0.2),
    "exit_speed_m_s": Quantity(10.0, 0.6, 0.6, "reach", SPEEDS),
    "exit_spin_rev_s": Quantity(math.nan, 1.0, 1.0, "spin", SPINS, 0.3),
    SPIN_VECTOR[0]: Quantity(math.nan, 1.0, 1.0, "spin", SPINS, 0.3),
    "miss_height_m": Quantity(math.nan, 1.0, 1.0, "height", LENGTHS),
    "ball.radius_m": Quantity(0.045, 0.5, 0.7, "radius", SMALL, 0.5),
    "ball.mass_kg": Quantity(math.nan, 1.0, 1.0, "mass", MASSES, 0.5),
    "launcher.wheel.radius_m": Quantity(0.05, 0.5, 0.5, "radius", SMALL, 0.5),
    "launcher.free_speed_rad_s": Quantity(600.0, 0.5, 0.5, "speed", TURNS, 0.2),
    "launcher.release_height_m": Quantity(0.7, 0.6, 0.6, "release", LENGTHS, 0.5),
    "target.centre_height_m": Quantity(2.0, 0.5, 0.5, "target", LENGTHS, 0.5),
    "target.two_half_height_m": Quantity(0.25, 0.9, 0.7, "target", {}),
    "air.density_kg_m3": Quantity(1.2, 0.2, 0.15, "air", {}),
    "world.gravity_m_s2": Quantity(9.81, 0.5, 0.4, "gravity", {}),
    # of what is derived from these: rims by flights, wheels by their motors, heights by what the outcome allows
    "density": Quantity(90.0, 0.85, 1.5, "mass", {}),
    "speed": Quantity(10.0, 0.6, 0.6, "speed", {}),
    "rim": Quantity(0.4, 9.0, 0.6, "spin", {}),
    "motor": Quantity(1.0, 0.12, 0.12, "wheels", {}),
    "allowed": Quantity(1.0, 0.8, 0.2, "height", {}),
}


def sizes(dataset: Dataset) -> dict[str, float]:
    """Return the size of each quantity in a dataset: the rig's number, or the median of a column."""
    rig, shots = dataset.rig, dataset.shots
    found: dict[str, Any] = {"density": rig.ball.mass_kg / (4.0 / 3.0 * np.pi * np.float64(rig.ball.radius_m)**3)}
    for key in QUANTITIES:
        found[key] = found[key] if key in found else value_of(dataset, key) if "." in key else shots.number(key)
    speed = launch_state(rig, shots).get("exit_speed_m_s", np.full(len(shots), np.nan))
    around = {name: 2.0 * math.pi * rig.ball.radius_m * turned / np.where(speed > 0.0, speed, np.nan)
              for name, turned in (("rim", np.abs(shots.number("exit_spin_rev_s"))),
        ("rim of all", np.sqrt(sum(shots.number(name)**2 for name in SPIN_VECTOR))))}
    motor = shots.number("motor_ratio") * (rig.launcher.free_speed_rad_s or math.nan)
    with np.errstate(all="ignore"):
        ratios = {f"motor of {wheel.name}": np.abs(shots.number(f"wheel_{wheel.name}_rad_s") / (motor * wheel.gear))
                  for wheel in rig.launcher.wheel}
    found |= {"speed": speed, **around, **ratios}
    if rig.target is None:            # balls may be dropped from a tower
        del found["launcher.release_height_m"]
    if rig.target is not None and np.isfinite(height := shots.number("miss_height_m")).sum() > 2:
        half = {"two": rig.target.two_half_height_m, "three": rig.target.three_half_height_m}
        allowed = np.array([half.get(word, 0.5) + 0.03 for word in shots.text("outcome")])
        most = float(np.sqrt(np.nanmean((height / allowed)**2)))
        spread = float(np.nanstd(height) / np.median(allowed))
        aside = abs(float(np.nanmedian(height))) / np.nanstd(height) / 3.0 if spread > 1e-9 * most else 0.0
        found["allowed"] = most if aside == 0.0 else (
            max(most, 1.0) * max(aside, 1.0) if max(most, aside) > 1.0 else spread)
    return {key: size for key, value in found.items() if np.isfinite(value).any()
            and (size := float(np.nanmedian(np.abs(value)))) > 0.0}


def unusual(dataset: Dataset) -> dict[str, float]:
    """Return how unusual the size of each quantity is, in nats."""
    found = {}
    for key, size in sizes(dataset).items():
        about = QUANTITIES[key.partition(" of")[0]]
        off = math.log(min(max(size, 1e-12), 1e12) / about.usual) if not math.isnan(about.usual) else 0.0
        found[key] = min(0.5 * (off / (about.below if off < 0.0 else about.above))**2, 100.0)
    return found


def value_of(dataset: Dataset, key: str) -> float:
    """Return a number of the rig by its dotted key, for wheels the first one's; nan if it is not stated."""
    value: Any = dataset.rig
    for name in key.split("."):
        value = getattr(value, name, None)
        value = value[0] if isinstance(value, tuple) and value else value or None
    return math.nan if value is None else float(value)


def with_numbers(reading: Reading, **columns: Floats) -> Reading:
    """Return the reading with other columns of shots."""
    shots = reading.dataset.shots
    new = replace(shots, numbers={**shots.numbers, **columns})
    return reading._replace(dataset=replace(reading.dataset, shots=new))


def _with_rig(reading: Reading, key: str, by: Callable[[float], float]) -> Reading:
    """Return the reading with another number in the rig, for wheels in each of them."""
    *path, name = key.split(".")

    def put(table: Any, path: list[str]) -> Any:
        if isinstance(table, tuple):
            return tuple(put(one, path) for one in table)
        if not path:
            return structs.replace(table, **{name: by(getattr(table, name))})
        return structs.replace(table, **{path[0]: put(getattr(table, path[0]), path[1:])})
    return reading._replace(dataset=replace(reading.dataset, facts=put(reading.dataset.rig, path)))


def causes(reading: Reading) -> Iterator[Cause]:
    """Yield every slip that the dataset may have."""
    dataset = reading.dataset
    known = {name for name, column in dataset.shots.numbers.items() if np.isfinite(column).any()}
    turning = sorted(name for name in known if WHEEL.fullmatch(name))
    for key, about in QUANTITIES.items():
        names = turning if key == "wheel" else list(SPIN_VECTOR) if key == SPIN_VECTOR[0] else [key]
        if "." in key and not math.isnan(size := value_of(dataset, key)):
            for unit, (_, factor) in about.units.items():
                if factor != 1.0 and (key != "launcher.free_speed_rad_s" or "motor_ratio" in known):
                    yield Cause(Flaw(about.check, f"rig.toml: {key}", f"this looks like {unit}: {size * factor:.3g}"
                                     f"{' ' + key.rpartition('_')[2] if key.endswith(('_m', '_kg')) else ' rad/s'}"),
                                _with_rig(reading, key, factor.__mul__), about.rare)
        elif "." not in key and names and set(names) <= known:
            yield from _units(reading, names, about)
    yield from _angles(reading, known, turning)
    yield from _parts(reading, turning, "motor_ratio" in known)
    if reading.motion is not None:
        yield from _of_tracks(reading, reading.motion)


def _units(reading: Reading, names: list[str], about: Quantity) -> Iterator[Cause]:
    """Yield other units for columns, in all rows or in some."""
    shots, target = reading.dataset.shots, reading.dataset.rig.target
    place = f"{shots.source}: {', '.join(names)}"
    written = shots.written.get(names[0], names[0]).lower()
    own = next(unit for unit, (_, factor) in about.units.items() if abs(factor - 1.0) < 1e-9)
    read = next((unit for unit, (suffix, _) in about.units.items()
                 if suffix and re.search(rf"[_ (\[]{suffix}[)\]]?$", written)), own)
    stem = names[0].removesuffix(f"_{about.units[own][0]}")
    for unit, (suffix, factor) in about.units.items():
        by = factor / about.units[read][1]
        if unit == read:
            continue
        undone = with_numbers(reading, **{name: shots.number(name) * by for name in names})
        rename = f"rename {'each' if len(names) > 1 else 'the column'} to {stem}_{suffix}"
        rename = rename if suffix else f"multiply them by {factor:g}"
        rename += f" or multiply it by {factor:.3g}" if unit == "radians" else ""
        # a column says its unit or, in metres, has it by default
        yield Cause(Flaw(about.check, place, f"these look like {unit}: {rename}"), undone,
                    about.rare + (0.5 if unit in ("metres", "turns") else 0.0), unit)
        if names == ["miss_height_m"] and target is not None:
            yield from _from_floor(undone, unit, by, suffix)
        if names == ["distance_m"] and unit != "metres":
            some = with_numbers(reading, distance_m=shots.number("distance_m") / by)
            yield Cause(Flaw(about.check, place, f"these look like metres among {unit}"), some, about.rare + 99.0,
                        f"metres among {unit}")
    if names == ["miss_height_m"] and target is not None:
        yield from _from_floor(reading, read, 1.0, "")


def _from_floor(undone: Reading, unit: str, by: float, suffix: str) -> Iterator[Cause]:
    """Heights above the floor."""
    dataset = undone.dataset
    target = dataset.rig.target
    height = dataset.shots.number("miss_height_m") - (target.centre_height_m if target else 0.0)
    if target and abs(float(np.nanmedian(height))) < max(TALLEST * target.centre_height_m, target.two_half_height_m):
        yield Cause(Flaw("height", f"{dataset.shots.source}: miss_height_m", f"these look like heights above the floor "
                         f"in {unit}: subtract that of the target's centre, {target.centre_height_m / by:.4g}"
                         + (f", and rename the column to miss_height_{suffix}" if suffix else "")),
                    with_numbers(undone, miss_height_m=height), 0.7)


def _angles(reading: Reading, known: set[str], turning: list[str]) -> Iterator[Cause]:
    """Yield angles from the vertical, exchanged columns and halved distances."""
    shots = reading.dataset.shots
    for name in {"hood_deg", "exit_deg"} & known:
        yield Cause(Flaw("hood", f"{shots.source}: {name}", "the angle is from the vertical; it is the elevation above "
                         "the horizontal: 90 less that"),
                    with_numbers(reading, **{name: 90.0 - shots.number(name)}), 0.5)
    pairs = [(first, second) for first in ("distance_m", "hood_deg") for second in (*turning, "exit_speed_m_s")]
    for first, second in [("distance_m", "hood_deg"), *pairs]:
        if {first, second} <= known:
            check = "hood" if first == "hood_deg" else "reach"
            yield Cause(Flaw(check, f"{shots.source}: {first}, {second}", "these look exchanged: exchange "
                             f"{first} and {second}"), with_numbers(reading, **{
                                 first: shots.number(second), second: shots.number(first)}), 1.5)
    if "distance_m" in known:
        yield Cause(Flaw("track-length", f"{shots.source}: distance_m", "make sure that it is not half of the distance "
                         "from the exit to the target's side"),
                    with_numbers(reading, distance_m=2.0 * shots.number("distance_m")), 3.5, sure=math.inf)


def _parts(reading: Reading, turning: list[str], by_ratio: bool) -> Iterator[Cause]:
    """Yield diameters given as radii, halved radii and wrong gears."""
    launcher, shots = reading.dataset.rig.launcher, reading.dataset.shots
    moving = bool(turning or by_ratio) and "exit_speed_m_s" not in shots.numbers
    for key in ("ball.radius_m", *(["launcher.wheel.radius_m"] if moving else [])):
        for by, what, rare, sure in ((0.5, "the diameter, given as the radius", 1.2, 4.0),
                                     (2.0, "half of the radius", 3.0, 1.0)):
            yield Cause(Flaw("radius", f"rig.toml: {key}", f"this looks like {what}: "
                             f"{value_of(reading.dataset, key) * by:.3g} m"),
                        _with_rig(reading, key, by.__mul__), rare, sure=sure)
    if all(wheel.gear in (0.0, 1.0, -1.0) for wheel in launcher.wheel):
        return
    if turning:
        yield Cause(Flaw("wheels", f"{shots.source}: {', '.join(turning)}", "these look like the motors' speeds, "
                         "before the gears: multiply each by its gear"), with_numbers(reading, **{
                             name: wheel.gear * shots.number(name) for wheel in launcher.wheel
                             if (name := f"wheel_{wheel.name}_rad_s") in shots.numbers}), 2.5)
    if by_ratio and moving:
        yield Cause(Flaw("wheels", "rig.toml: launcher.wheel.gear", "gears look upside down: launcher.wheel.gear is "
                         "wheel speed / motor speed"), _with_rig(reading, "launcher.wheel.gear",
                                                           lambda old: 1.0 / old if old else 0.0), 2.5)


def _of_tracks(reading: Reading, motion: Motion) -> Iterator[Cause]:
    """Yield other units, axes, origins and times of tracks, and tracks of the wrong shots."""
    def cause(check: str, keys: str, what: str, rare: float, matrix: Floats, single: str = "", **more: Any) -> Cause:
        return Cause(Flaw(check, f"tracks: {keys}", what), reading._replace(motion=motion.read(matrix, **more)), rare,
                     single)
    same = np.eye(3)
    for unit, (suffix, metres) in LENGTHS.items():
        for axes in ("xyz", "z") if metres != 1.0 else ():
            names = [f"{axis}_m" for axis in axes]
            yield cause("gravity", ", ".join(names), f"these look like {unit}: rename " + ", ".join(
                f"{name} to {name[0]}_{suffix}" for name in names), 0.0 if axes == "xyz" else 2.0,
                np.diag([metres if axis in axes else 1.0 for axis in "xyz"]), unit if axes == "xyz" else "")
    for first, second in ("xz", "yz", "xy"):
        order = ["xyz".index({first: second, second: first}.get(axis, axis)) for axis in "xyz"]
        yield cause("axes", f"{first}_m, {second}_m", "z_m must point up and x_m to the target: exchange "
                    f"{second}_m and {first}_m", 1.0, same[order])
    yield cause("axes", "x_m, y_m, z_m", "z points down: change its sign", 1.0, np.diag([1.0, 1.0, -1.0]),
                "upside down")
    yield cause("axes", "x_m", "balls travel backwards; x_m must point to the target: change its sign, and that of y_m",
                1.0, np.diag([-1.0, -1.0, 1.0]), "those of balls that travel backwards")
    turn = math.atan2(*np.median(motion.to_m - motion.from_m, axis=0)[1::-1])
    cosine, sine = math.cos(turn), math.sin(turn)
    yield cause("axes", "x_m, y_m", f"balls travel {abs(math.degrees(turn)):.0f} degrees to the "
                f"{'left' if turn > 0.0 else 'right'} of x; x_m must point to the target: turn the axes", 3.0,
                np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]))
    for unit, seconds, column in (("milliseconds", 1e-3, "t_ms"), ("microseconds", 1e-6, "t_us")):
        yield cause("gravity", "t_s", f"these look like {unit}: rename the column to {column}", 1.0, same,
                    seconds=seconds)
    yield cause("gravity", "t_s", "times look like half of what they were, by a camera's rate that was treated as "
                "twice as high: double them", 1.5, same, seconds=2.0)
    for rate in RATES:
        yield cause("gravity", "t_s", f"these look like numbers of pictures, about {rate:.0f} per second: divide them "
                    "by the camera's rate", 2.0, same, seconds=1.0 / rate)
    rig = reading.dataset.rig
    back = motion.from_m[:, 0] / np.where(motion.start_m_s[:, 0] > 0.0, motion.start_m_s[:, 0], np.inf)
    begin = motion.from_m - motion.start_m_s * back[:, None]
    begin[:, 2] -= 0.5 * rig.world.gravity_m_s2 * back**2
    stated, (_, aside_m, height_m) = rig.launcher.release_height_m, np.median(begin, axis=0)
    behind_m, tilted_m = -float(np.median(motion.from_m[:, 0])), TILT * abs(float(np.median(motion.from_m[:, 2])))
    for axis, what, by_m in (
            ("z", f"balls leave at {height_m:.2f} m by their tracks, at {stated:g} m by rig.toml "
             "(launcher.release_height_m): " + (
                 "state that height there" if stated == 0.0 else "z_m is measured from the exit; add that height"
                 if abs(height_m) < 0.3 * stated else "z_m is the height above the floor, x_m the distance from the "
                 "exit; correct these or that height"), [0.0, 0.0, stated - height_m]),
            ("y", f"balls leave at y = {aside_m:.2f} m; y_m is measured from the exit: subtract where the exit is",
             [0.0, -aside_m, 0.0]),
            ("x", f"balls are first seen {behind_m:.2f} m behind the exit; x_m is measured from the exit: subtract "
             "where the exit is", [behind_m if behind_m > tilted_m else 0.0, 0.0, 0.0])):
        if axis != "z" or stated or rig.target is not None:       # else the height of a tower, maybe, is not stated
            yield cause("release", f"{axis}_m", what, 2.5, same, by_m=np.array(by_m))
    yield Cause(Flaw("track-shots", "tracks: shot_id", "the tracks do not rise as the hood angles of their shots say: "
                     "make sure that each track has the shot_id of its shot"), reading._replace(
                         motion=replace(motion, unlinked=True)), 3.0)
