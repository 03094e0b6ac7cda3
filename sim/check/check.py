"""Plausibility checks of a dataset before inference: wrong units, axes and angles, which a fit mistakes for physics.

Each check has a name, by which its warning can be accepted. A check passes if the data cannot decide it.
"""

import math
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.errors import InputError
from truearc.robot.config.rig_spec import DENSEST_KG_M3, MOST, Rig, too_large
from truearc.sim.check import tracks
from truearc.sim.check.tracks import LENGTHS, TRACKS, Flaw, judge_tracks
from truearc.sim.data.dataset import Dataset, Floats, Shots, Times
from truearc.sim.data.table import SPIN_VECTOR
from truearc.sim.physics.simulate import by_wheels, has_wheels, launch_state

CHECKS = ("gravity", "axes", "bounce", "sample-interval", "track-length", "track-shots", "speed", "hood", "mass",
          "radius", "reach", "air", "target", "noise", "wheels", "height", "release", "balls", "spin")
TOWER = 20.0                          # times as high as a launcher balls are dropped from; chosen: 100 m
LIGHTEST_KG_M3 = 3.0                  # of a ball: lighter is a balloon; chosen: 2.5 times the air's
# Derived: above the 6 to 10 that foam and table-tennis balls have whose radius is their diameter
LIGHT_KG_M3 = 12.0                    # below this the radius may be the diameter
HEAVY_KG_M3 = 1500.0                  # above this the mass may be in ounces; a bowling ball has 1400, a golf ball 1150
# Derived: 1.05 to 1.7 for a foam ball of 7 inches (drag 0.5) at 2 to 9 m, times 1.15 to 1.5 of slip (team 971);
# chosen: room of a half for lighter balls
REACH = (0.9, 4.0)                    # launch speed of scoring shots, by the least that carries a ball so far in vacuum
# Chosen: above TYPICAL and slip
DOUBLED = 1.9                         # of it: a light ball, or the wheels' diameters for their radii
TYPICAL = 1.3                         # of foam balls; derived: 1.2 by air, and a little slip
# Derived: as REACH, without slip
MEASURED = (0.85, 2.0)                # of it where the speed itself was measured: slip does not add to drag
# Chosen: beyond chance in a dozen shots, whose spread is known to a fifth
STRAIGHTER = 0.65                     # spread of that ratio with the other angle, by its spread as recorded
UNEVEN = 0.04                         # and the least spread that is judged; chosen: above launches' scatter of 2 to 3 %
SCORES = 6                            # fewest scoring shots that are judged; chosen: twice TRACKS
FASTEST_RIM = 3.0                     # surface speed of a ball over its speed; hard topspin has 1.5; chosen: twice that
LOWEST_M = 0.3                        # of a target's height in another unit; chosen: nobody aims at the floor
# Chosen: above a basket's 3 m, and above a launcher's usual exit
USUAL_TARGET_M, USUAL_RELEASE_M = 4.0, 1.2  # heights above these may be in another unit
THIN_KG_M3 = 0.5                      # air at 8 km; source: standard atmosphere (ICAO 1993)
SPEEDS = (("miles per hour", "exit_speed_mph", 0.44704), ("feet per second", "exit_speed_ft_s", 0.3048),
          ("kilometres per hour", "exit_speed_km_h", 1.0 / 3.6))
MISSED = "miss_height_m"
OUNCE_KG = 0.0283495                  # definition
OF_KEY = {"world.gravity_m_s2": "gravity", "launcher.wheel.clock_deg": "wheels",
          "launcher.free_speed_rad_s": "speed", "tracker.scale_sd": "noise", "tracker.tilt_sd_deg": "noise",
          "tracker.clock_sd": "noise"}                    # key of the rig -> its check
# Source: the Moon's
WEAKEST_M_S2 = 1.2                    # gravity below this may be a multiple of the Earth's; the Moon has 1.6
# Chosen: as scales and calipers err
ALIKE_BALLS = 0.02                    # share by which masses and radii may differ from the rig's
# Chosen: feet and yards are farther off
FROM_FLOOR = 0.25                     # share of the target's height to which those above the floor come near it
# Chosen: slips are fewer
IMPOSSIBLE = 0.2                      # share of heights that cannot be, above which their unit is another
# Derived: 0.1 s too little of 1.5 s
FASTEST = 1.15                        # acceleration of a fall from rest, by the rig's gravity: times err
# Derived: a fall that takes seven times as long as without air
SLOWEST = 0.02                        # of a shuttlecock's last metres: slower are times in another unit
# Chosen: drag takes up to two thirds; an error of 5 %
LIKELY = (0.3, 1.05)                  # of a ball's, in the unit that a message names


def check_plausible(dataset: Dataset, accept: Collection[str] = ()) -> Dataset:
    """Return the dataset with the objections that were accepted, or only warn.

    Args:
        accept: Names of checks whose objections are accepted.

    Raises:
        InputError: names every other objection with its file, key, likeliest cause and check; or an unknown check.
    """
    accept = (accept,) if isinstance(accept, str) else accept
    for name in accept:
        if name not in CHECKS:
            raise InputError(f"accept: there is no check {name!r}; there are {', '.join(CHECKS)}")
    objections = [_named(objection, dataset) for objection in _objections(dataset)]
    refused = [objection for objection in objections if not objection.warns and objection.check not in accept]
    if refused:
        raise InputError("\n".join(f"{_placed(objection, dataset.shots.source)} (check {objection.check!r}; accept it "
                                   "by name if it is so)" for objection in refused))
    return replace(dataset, accepted=tuple(f"{objection.check}: {objection}" for objection in objections))


def _named(objection: Flaw, dataset: Dataset) -> Flaw:
    """With columns as the files name them, and what they are read as."""
    file, _, keys = objection.place.rpartition(": ")
    names = {"tracks": dataset.track_columns, dataset.shots.source: dataset.shots.written}.get(file, {})
    read = [f"{names[key]} is read as {key}" for key in re.findall(r"\w+", keys) if key in names]
    if not read:
        return objection
    own = re.sub(r"\w+", lambda key: names.get(key[0], key[0]), keys)
    return objection._replace(place=f"{file}: {own}", what=f"{objection.what} ({', '.join(read)})")


def _placed(objection: Flaw, shots: str) -> str:
    """With the folder of the shots' file before the names of files beside it."""
    folder = Path(shots).parent if Path(shots).suffix in (".csv", ".parquet") else None
    table = objection.place.partition(":")[0]
    if folder is None or table not in ("rig.toml", "tracks", "times"):
        return str(objection)
    kind = Path(shots).suffix if (folder / f"{table}{Path(shots).suffix}").exists() else ".csv"
    file = table if table == "rig.toml" else f"{table}{kind}"
    return f"{folder}/{objection._replace(place=objection.place.replace(table, file, 1))}"


def _objections(dataset: Dataset) -> Iterator[Flaw]:
    ball = list(_ball(dataset.rig))
    yield from ball
    yield from _balls(dataset.rig, dataset.shots) if all(one.warns for one in ball) else ()
    launcher = [*_launcher(dataset.rig), *tracks.judge_wheels(dataset.rig, dataset.shots)]
    yield from launcher
    hood = list(_hood(dataset.shots))
    yield from hood
    yield from _spins(dataset.rig, dataset.shots)
    yield from () if hood else _heights(dataset.rig, dataset.shots)
    if not hood and all(one.warns for one in launcher):
        yield from _reach(dataset.rig, dataset.shots)
    if dataset.tracks is not None:
        yield from judge_tracks(dataset, dataset.tracks)
    if dataset.times is not None:
        yield from judge_times(dataset, dataset.times)


def _ball(rig: Rig) -> Iterator[Flaw]:
    ball = rig.ball
    said = f"a ball of {ball.mass_kg:g} kg and {ball.radius_m:g} m radius"
    density = ball.density_kg_m3
    if density > DENSEST_KG_M3:
        yield Flaw("mass", "rig.toml: ball.mass_kg", f"{said} is denser than any metal; this looks like grams: "
                    f"{ball.mass_kg / 1000.0:g} kg")
    elif density > HEAVY_KG_M3:
        yield Flaw("mass", "rig.toml: ball.mass_kg", f"{said} is as dense as stone or metal; make sure that it is not "
                   f"in ounces, which would be {ball.mass_kg * OUNCE_KG:.3g} kg, and that ball.radius_m is not half of "
                   "the radius", warns=True)
    elif density < LIGHTEST_KG_M3:
        units = {name: ball.radius_m * metres for name, (_, metres) in LENGTHS.items()
                 if LIGHT_KG_M3 < density / metres**3 < DENSEST_KG_M3} or {"millimetres": ball.radius_m / 1000.0}
        yield Flaw("radius", "rig.toml: ball.radius_m", f"{said} weighs little more than the air in its place; this "
                   f"looks like {' or '.join(f'{name} ({radius_m:.4g} m)' for name, radius_m in units.items())}")
    elif density < LIGHT_KG_M3:
        yield Flaw("radius", "rig.toml: ball.radius_m", f"{ball.radius_m:g} m is much for a ball of {ball.mass_kg:g} "
                    "kg; make sure that it is not the diameter", warns=True)


def _balls(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """The ball of each shot, where shots state it."""
    mass_kg, radius_m = (np.where(np.isfinite(given := shots.number(name)), given, own) for name, own in (
        ("mass_kg", rig.ball.mass_kg), ("radius_m", rig.ball.radius_m)))
    density = mass_kg / (4.0 / 3.0 * math.pi * radius_m**3)
    for check, wrong, what, slip in (("mass", density > DENSEST_KG_M3, "denser than any metal", "mass_kg to mass_g"),
                                     ("radius", density < LIGHTEST_KG_M3, "hardly heavier than the air in its place",
                                      "radius_m to radius_cm or radius_in")):
        if wrong.any():
            row = int(np.argmax(wrong))
            yield Flaw(check, f"{shots.source}: mass_kg, radius_m", f"the ball of shot {shots.shot_id[row]} "
                       f"({mass_kg[row]:g} kg, {radius_m[row]:g} m radius) is {what}; if this is another unit, rename "
                       f"the column {slip}")
            return
    if (density < LIGHT_KG_M3).any() and rig.ball.density_kg_m3 >= LIGHT_KG_M3:
        yield Flaw("radius", f"{shots.source}: mass_kg, radius_m", f"a ball of {mass_kg[density.argmin()]:g} kg has a "
                   f"radius of {radius_m[density.argmin()]:g} m; make sure that it is not the diameter", warns=True)
    if max(np.ptp(np.log(np.append(mass_kg, rig.ball.mass_kg))),
           np.ptp(np.log(np.append(radius_m, rig.ball.radius_m)))) > ALIKE_BALLS:
        yield Flaw("balls", f"{shots.source}: mass_kg, radius_m", "differ from the ball of rig.toml, which train, "
                   "aim, gates and paper fit simulate; fit, discover and predict by coefficients simulate each shot's. "
                   "State in rig.toml the ball that the robot will shoot", warns=True)


def _launcher(rig: Rig) -> Iterator[Flaw]:
    release_m = rig.launcher.release_height_m
    if rig.target is not None and release_m == 0.0:
        yield Flaw("release", "rig.toml: launcher.release_height_m", "is not stated, so balls are taken to leave at "
                   "the floor; state it", warns=True)
    if release_m > MOST["launcher.release_height_m"] * (1.0 if rig.target is not None else TOWER):
        yield Flaw("reach", "rig.toml: launcher.release_height_m", f"{release_m:g} m is high for a launcher; this "
                   f"looks like {_smaller(release_m, 2.0)}")
    for key, what in too_large(rig):
        check = OF_KEY.get(key, key.partition(".")[0])
        if check in CHECKS:
            yield Flaw(check, f"rig.toml: {key}", what)
    if rig.world.gravity_m_s2 < WEAKEST_M_S2:
        yield Flaw("gravity", "rig.toml: world.gravity_m_s2", f"{rig.world.gravity_m_s2:g} is less than the Moon's; "
                   "on Earth it is 9.81")
    if 0.0 < rig.air.density_kg_m3 < THIN_KG_M3:
        yield Flaw("air", "rig.toml: air.density_kg_m3", f"{rig.air.density_kg_m3:g} is not air on Earth; at sea level "
                   "it is 1.2")
    for wheel in rig.launcher.wheel:
        if wheel.radius_m > MOST["launcher.wheel.radius_m"]:
            yield Flaw("radius", "rig.toml: launcher.wheel.radius_m", f"{wheel.radius_m:g} m is much for a wheel; this "
                       f"looks like {_smaller(wheel.radius_m, 0.25)}")


def _smaller(value: float, most_m: float) -> str:
    """The largest units in which a value is at most `most_m`."""
    likely = [f"{name} ({value * metres:g} m)" for name, (_, metres) in reversed(LENGTHS.items())
              if value * metres <= most_m and name != "feet"]
    return " or ".join(likely[:2]) or "another unit"


def _heights(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """Heights at the target that cannot be: below the floor, far above the line of launch, or beside the outcome."""
    if rig.target is None:
        return
    centre_m, outcome, height_m = rig.target.centre_height_m, np.array(shots.text("outcome")), shots.number(MISSED)
    line_m = shots.number("distance_m") * np.tan(np.radians(shots.number("hood_deg")))
    # chosen: half and 1 m beyond the line of launch, and a tape's slip below the floor
    above_m = max(rig.launcher.release_height_m - centre_m, 0.0) + 1.0
    least_m, most_m = np.full(len(shots), -centre_m - 0.5), np.nan_to_num(1.5 * line_m + above_m, nan=np.inf)
    for word, half_m in (("two", rig.target.two_half_height_m), ("three", rig.target.three_half_height_m)):
        wide_m = np.where(outcome == word, 1.5 * half_m + 0.1, np.inf)       # chosen: a rim and a tape err by less
        least_m, most_m = np.maximum(least_m, -wide_m), np.minimum(most_m, wide_m)

    def beyond(metres: float, zero_m: float = 0.0) -> int:
        return int(((height_m * metres - zero_m < least_m) | (height_m * metres - zero_m > most_m)).sum())

    wrong, known = beyond(1.0), int(np.isfinite(height_m).sum())
    middle_m = float(np.nanmedian(height_m)) if known >= TRACKS and np.nanmin(height_m) >= 0.0 else 0.0
    floor = [(name, suffix, metres) for name, (suffix, metres) in {"metres": ("m", 1.0), **LENGTHS}.items()
             if middle_m > 1.5 * rig.target.two_half_height_m + 0.1 and beyond(metres, centre_m) < IMPOSSIBLE * known
             and abs(middle_m * metres - centre_m) < max(FROM_FLOOR * centre_m, rig.target.two_half_height_m)]
    for name, suffix, metres in floor[:1]:
        yield Flaw("height", f"{shots.source}: {MISSED}", f"these look like heights above the floor in {name}: "
                   f"subtract that of the target's centre, {centre_m / metres:.4g}"
                   + (f", and rename the column to miss_height_{suffix}" if metres != 1.0 else ""))
    if floor or wrong < max(TRACKS, IMPOSSIBLE * known):
        return
    likely = [f"{name}, rename the column to miss_height_{suffix}" for name, (suffix, metres) in
              reversed(LENGTHS.items()) if beyond(metres) < 0.1 * wrong]
    yield Flaw("height", f"{shots.source}: {MISSED}", f"{wrong} of {known} are below the floor, above the line of "
               "launch, or contradict the outcome; " + (f"if these are {'; if '.join(likely)}" if likely else
                                                        "it is the height less that of the target's centre, in metres"))


def _hood(shots: Shots) -> Iterator[Flaw]:
    for name in ("hood_deg", "exit_deg"):
        angle_deg = shots.number(name)
        known = np.abs(angle_deg[np.isfinite(angle_deg)])
        # radians: none is above a right angle; turns: a quarter; flat throws, of 3 degrees, are neither
        if len(known) >= TRACKS and known.max() <= math.pi / 2 and np.median(known) > 0.05:
            turns = "turns: multiply them by 360; or like " if known.max() <= 0.25 else ""
            yield Flaw("hood", f"{shots.source}: {name}", f"no shot exceeds {known.max():.2f} degrees; these look like "
                       f"{turns}radians: rename the column to {name.removesuffix('_deg')}_rad or multiply it by 57.3")


def needed_speed(distance_m: Floats, rise_m: float, hood_deg: Floats, gravity_m_s2: float) -> Floats:
    """Return the speed [m/s] that carries a ball through a point in vacuum; inf where that angle never does."""
    angle = np.radians(hood_deg)
    above_m = distance_m * np.tan(angle) - rise_m
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.sqrt(gravity_m_s2 * distance_m**2 / (2.0 * np.cos(angle)**2 * above_m))
    return np.where(above_m > 0.0, speed, np.inf)


def judges_reach(dataset: Dataset) -> bool:
    """Whether enough shots score, with known distance, angle and speed, to compare these with each other."""
    return dataset.rig.target is not None and len(_scoring(dataset.rig, dataset.shots)[1]) >= SCORES


def _scoring(rig: Rig, shots: Shots) -> tuple[Bool[np.ndarray, " n"], Int[np.ndarray, " m"], Float[np.ndarray, "3 m"]]:
    """Which shots score; rows, and distance [m], angle [deg] and launch speed [m/s], of those where all are known."""
    scoring = np.isin(shots.text("outcome"), ("two", "three"))
    height_m = shots.number(MISSED)
    if rig.target is not None and len(set(height_m[np.isfinite(height_m)].tolist())) > 1:     # not a table of aims
        scoring |= np.abs(height_m) <= rig.target.two_half_height_m
    speed_m_s = launch_state(rig, shots).get("exit_speed_m_s", np.full(len(shots), np.nan))
    seen_deg = shots.number("exit_deg")
    columns = np.array([shots.number("distance_m"),
                        np.where(np.isfinite(seen_deg), seen_deg, shots.number("hood_deg")), speed_m_s])
    rows = np.flatnonzero(scoring & np.isfinite(columns).all(axis=0))
    return scoring, rows, columns[:, rows]


def _reach(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """Scoring shots got to the target: their launch speed must have been enough, and not many times as much."""
    scoring, rows, (distance_m, hood_deg, speed_m_s) = _scoring(rig, shots)
    if rig.target is None or len(distance_m) < SCORES:
        return
    centre_m = rig.target.centre_height_m

    def ratios(distance: Floats, hood: Floats, speed: Floats, height: float = 1.0, release: float = 1.0) -> Floats:
        rise_m = height * centre_m - release * rig.launcher.release_height_m
        return np.asarray(speed / needed_speed(distance, rise_m, hood, rig.world.gravity_m_s2))

    ratio = ratios(distance_m, hood_deg, speed_m_s)
    middle = float(np.median(ratio))
    path_m, other_m = (distance_m / np.maximum(part(np.radians(hood_deg)), 1e-3) for part in (np.cos, np.sin))
    uneven = _uneven(ratio, path_m, tracks.ALL_BUT)
    unstated = "" if rig.launcher.release_height_m > 0.0 else "; or state launcher.release_height_m, which may be why"
    if _is_straighter(_uneven(ratios(distance_m, 90.0 - hood_deg, speed_m_s), other_m), uneven):
        yield Flaw("hood", f"{shots.source}: hood_deg", "the speeds of scoring shots fit their distances far better "
                    "if the angle is from the vertical; hood_deg is the elevation above the horizontal: 90 less that"
                    + unstated)
        return
    for place, what in _straightest(rig, f"{shots.source}: distance_m", path_m, uneven, lambda metres, release: ratios(
            distance_m * metres, hood_deg, speed_m_s, release=release)):
        yield Flaw("reach", place, f"the speeds of scoring shots fit their distances far better if {what}{unstated}")
        return
    if mixed := tracks.mixed_units(ratio, lambda far, metres: ratios(distance_m[far] * metres, hood_deg[far],
                                                                     speed_m_s[far])):
        yield Flaw("reach", f"{shots.source}: distance_m", mixed)
        return
    if rig.launcher.release_height_m > 0.0 and (lone := tracks.lone_shots(ratio, [shots.shot_id[row] for row in rows])):
        yield Flaw("reach", f"{shots.source}: distance_m, hood_deg or speed", lone, warns=True)
    measured = np.isfinite(shots.number("exit_speed_m_s")[scoring]).all() and "exit_speed_m_s" in shots.numbers
    (low, high), causes = MEASURED if measured else REACH, tracks.speed_causes(rig, shots)
    if low <= middle <= high:
        if middle > DOUBLED and by_wheels(shots).all():
            yield Flaw("reach", "rig.toml: launcher.wheel.radius_m", f"scoring shots leave with {middle:.2g} times the "
                       "speed that gets a ball so far without air; make sure that it is not the diameter" + "".join(
                       f", nor {cause}" for cause in (tracks.MOTORS, tracks.GEARS) if causes.get(cause, 1.0) < 1.0),
                       warns=True)
        return
    if measured:
        near = sorted(SPEEDS, key=lambda one: abs(math.log(max(middle, 1e-9) * one[2] / TYPICAL)))
        yield Flaw("reach", f"{shots.source}: exit_speed_m_s", f"scoring shots leave with {middle:.2g} times the speed "
                   "that gets a ball so far without air; if this is another unit, rename the column: "
                   + " or ".join(f"{column} for {name}" for name, column, _ in near[:2]))
        return
    yield Flaw("reach", f"{shots.source}: distance_m, hood_deg and the wheels", "scoring shots leave with "
                f"{middle:.2g} times the speed that gets a ball so far without air; this looks like "
                + tracks.likeliest({
                    **{f"distance_m in {name}": float(np.median(ratios(distance_m * metres, hood_deg, speed_m_s)))
                       for name, (_, metres) in LENGTHS.items()},
                    **{f"target.centre_height_m in {name}, which would be {centre_m * metres:.3g} m":
                       float(np.median(ratios(distance_m, hood_deg, speed_m_s, metres)))
                       for name, (_, metres) in LENGTHS.items()
                       if centre_m > USUAL_TARGET_M and centre_m * metres >= LOWEST_M},
                    **{cause: middle * share for cause, share in causes.items()}}, REACH, TYPICAL,
                    "wrong distances, wheels or hood angles"))


def _straightest(rig: Rig, distances: str, path_m: Floats, uneven: float,
                 other: Callable[[float, float], Floats]) -> list[tuple[str, str]]:
    """Place and reading, in another unit, of the distances or of the release height that explains speeds best, if any;
    other: ratios where these two are multiplied by two numbers."""
    release_m, found = rig.launcher.release_height_m, {}
    for name, (suffix, metres) in LENGTHS.items():
        found[distances, f"these are {name}: rename the column to distance_{suffix}"] = other(metres, 1.0)
        if release_m > USUAL_RELEASE_M:
            found["rig.toml: launcher.release_height_m", f"this is in {name}: {release_m * metres:.3g} m"] = other(
                1.0, metres)
    likely = {read: spread for read, by in found.items()
              if _is_straighter(spread := _uneven(by, path_m), uneven) and REACH[0] <= np.median(by) <= REACH[1]}
    return sorted(likely, key=lambda read: likely[read])[:1]


def _spins(rig: Rig, shots: Shots) -> Iterator[Flaw]:
    """No ball's rim turns many times as fast as it flies; and spin in a column of another name is not read as such."""
    if "exit_spin_rev_s" not in shots.numbers and not any(name in shots.numbers for name in SPIN_VECTOR):
        for name in (name for name in shots.numbers if "spin" in name.lower()):
            yield Flaw("spin", f"{shots.source}: {name}", "is not read as the ball's spin; if it is that, rename it to "
                       "exit_spin_rev_s, backspin positive", warns=True)
    spin, speed_m_s = (launch_state(rig, shots).get(name, np.full(len(shots), np.nan)) for name in
                       ("exit_spin_rev_s", "exit_speed_m_s"))
    whole = np.sqrt(sum(shots.number(name)**2 for name in SPIN_VECTOR))
    for name, given, turns in (("exit_spin_rev_s", shots.number("exit_spin_rev_s"), np.abs(spin)),
                               (SPIN_VECTOR[0], whole, whole)):
        rim = 2.0 * math.pi * rig.ball.radius_m * turns / np.where(speed_m_s > 0.0, speed_m_s, np.nan)
        if np.isfinite(rim).sum() >= TRACKS and np.isfinite(given).any() and (
                times := float(np.nanmedian(rim))) > FASTEST_RIM:
            stem = name.removesuffix("_rev_s")
            yield Flaw("spin", f"{shots.source}: {name}", f"rims of balls turn {times:.2g} times as fast as they fly; "
                       f"if these are revolutions per minute, rename the column to {stem}_rpm; if radians per second, "
                       f"to {stem}_rad_s")


def _is_straighter(other: float, uneven: float) -> bool:
    """Whether another reading explains the speeds much better."""
    return uneven > UNEVEN and other < STRAIGHTER * uneven


def _uneven(ratio: Floats, path_m: Floats, least: float = 1.0) -> float:
    """Spread of the log ratios beyond what drag takes along the path; inf for few shots, or where fewer than `least` of
    them get there at any speed (those that do not have 0)."""
    flies = ratio > 0.0
    if len(ratio) < 2 * SCORES or flies.mean() < least:
        return math.inf
    logs, along_m = np.log(ratio[flies]), path_m[flies] - path_m[flies].mean()
    return _spread(logs - max(0.0, float(along_m @ logs) / max(float(along_m @ along_m), 1e-12)) * along_m)


def _spread(values: Floats) -> float:
    """Standard deviation by what the middle 90 % take: one shot with a lucky bounce does not widen it."""
    return float(np.ptp(np.quantile(values, (0.05, 0.95)))) / 3.29             # 2 Z90


def judge_times(dataset: Dataset, times: Times) -> Iterator[Flaw]:
    """Those of shots of which no launch is known: they were dropped from the release height."""
    rig, shots = dataset.rig, dataset.shots
    sped = has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))
    dropped = ~(sped & (np.isfinite(shots.number("hood_deg")) | np.isfinite(shots.number("exit_deg"))))[times.shot]
    fallen_m = (rig.launcher.release_height_m - times.height_m)[dropped]
    if not len(fallen_m):
        return
    if (fallen_m <= 0.0).any():
        yield Flaw("release", "times: height_m", "balls of which no launch is known are taken as dropped from "
                   f"launcher.release_height_m = {rig.launcher.release_height_m:g} of rig.toml, and one is timed at "
                   f"{times.height_m[dropped].max():g} m; state the height that they fell from, or their launch")
        return
    each = 2.0 * fallen_m / times.t_s[dropped]**2 / rig.world.gravity_m_s2
    pull = float(np.median(each))
    if pull > FASTEST:
        units = [name for name, (_, metres) in LENGTHS.items() if LIKELY[0] < pull * metres < LIKELY[1]]
        yield Flaw("gravity", "times: height_m", f"balls dropped from rest fall {pull:.3g} times as fast as gravity "
                   f"has it{'; heights look like ' + ' or '.join(units) if units else '; times may be halved'}")
    elif pull < SLOWEST:
        looks = "milliseconds" if LIKELY[0] < pull * 1e6 < LIKELY[1] else "another unit"
        yield Flaw("gravity", "times: t_s", f"balls dropped from rest fall with {pull:.2g} of gravity; times look like "
                   f"{looks}")
    elif len(odd := np.flatnonzero((each > FASTEST) | (each < SLOWEST))):
        name = shots.shot_id[times.shot[np.flatnonzero(dropped)[odd[0]]]]
        yield Flaw("gravity", "times: t_s", f"{name} falls with {each[odd[0]]:.2g} of gravity, where drops have "
                   f"{pull:.2g} in the middle ({len(odd)} of {len(each)} are so far off); correct its time or height")
