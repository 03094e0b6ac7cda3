"""Plausibility checks of a dataset before inference: wrong units, axes and angles, which a fit mistakes for physics.

Data and rig are compared with all believable physics, as recorded and with each likely slip undone. A slip is refused,
by the name of its check, if believable physics does not explain the data as recorded and explains them better by a
factor of BETTER with the slip undone. Less is a warning.
"""

import math
import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import DENSEST_KG_M3, too_large
from truearc.sim.check.believable import SCORES, Fit, Reading, Rows, explain, judged_shots, lifts_less, rows_of
from truearc.sim.check.causes import LENGTHS, Cause, Flaw, causes, unusual, value_of
from truearc.sim.check.motion import TRACKS, jolts, measure_motion
from truearc.sim.data.dataset import Dataset, Times
from truearc.sim.data.table import SPIN_VECTOR
from truearc.sim.physics.simulate import has_wheels

CHECKS = ("gravity", "axes", "bounce", "track-length", "track-shots", "speed", "hood", "mass", "radius", "reach", "air",
          "target", "noise", "wheels", "height", "release", "balls", "spin", "fit")
BETTER = math.log(1000.0)             # a slip is refused from here; chosen: one sound dataset in a thousand
LIKELIER = 1.5                        # nats, from which it is warned of; chosen: four times as likely
# Chosen: of sound rigs by the priors, one in twenty surprises by more than the first
EXPECTED, REFUSED, ODD = 5.2, 7.0, 10.0  # nats of surprise: slips are looked for, refused, and anything is warned of
PRESSED = 2.0                         # nats by which lift is negative, from which it is said; chosen: smooth balls may
PROMISING, FEW = 6, 16                # slips that are judged at their best, and shots that tell them; chosen: quick
SLACK = 8.0                           # nats by which a scatter may become more usual, too; chosen: half the scatter
MIXED = 1.5                           # nats that another unit in some rows costs; chosen: as exchanged columns
LONE = 10.0                           # standard deviations of a single row; chosen: chance once in 10^4 by Student's t
CLOSE = 2.0                           # nats within which another cause is named, too; chosen: seven times as likely
ALIKE_BALLS = 0.02                    # share by which masses and radii may differ from the rig's; chosen: as scales err
LIGHTEST_KG_M3, LIGHT_KG_M3 = 3.0, 18.0  # of a ball: below are balloons, and below the radius may be the diameter
HEAVY_KG_M3 = 1500.0                  # above this the mass may be in ounces; a bowling ball has 1400, a golf ball 1150
OUNCE_KG = 0.0283495                  # definition
THIN_KG_M3, WEAKEST_M_S2 = 0.5, 1.2   # air at 8 km (ICAO 1993), and gravity below the Moon's: not on Earth
OF_KEY = {"world.gravity_m_s2": "gravity", "launcher.wheel.clock_deg": "wheels", "launcher.release_height_m": "release",
          "launcher.free_speed_rad_s": "speed", "tracker.scale_sd": "noise", "tracker.tilt_sd_deg": "noise",
          "tracker.clock_sd": "noise", "launcher.wheel.radius_m": "radius"}          # key of the rig -> its check
UPRIGHT_DEG = 85.0                    # hood angles from which a ball need not go forwards; chosen: scatter turns it
# Derived: 0.1 s too little of 1.5 s, and a fall that takes seven times as long as without air
FASTEST, SLOWEST = 1.15, 0.02         # acceleration of a fall from rest, by the rig's gravity: beyond, units are others
LIKELY = (0.3, 1.05)                  # the same in the unit that a message names; derived: drag takes up to two thirds


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
    with np.errstate(all="ignore"):       # absurd numbers overflow on their way to an objection
        objections = [_named(objection, dataset) for objection in _objections(dataset)]
    refused = [objection for objection in objections if not objection.warns and objection.check not in accept]
    if refused:
        raise InputError("\n".join(f"{_placed(objection, dataset.shots.source)} (check {objection.check!r}; accept it "
                                   "by name if it is so)" for objection in refused))
    return replace(dataset, accepted=tuple(f"{objection.check}: {objection}" for objection in objections))


def _named(objection: Flaw, dataset: Dataset) -> Flaw:
    """Return the objection with the files' own column names, and what they are read as."""
    file, _, keys = objection.place.rpartition(": ")
    names = {"tracks": dataset.track_columns, dataset.shots.source: dataset.shots.written}.get(file, {})
    read = [f"{names[key]} is read as {key}" for key in re.findall(r"\w+", keys) if key in names]
    if not read:
        return objection
    own = re.sub(r"\w+", lambda key: names.get(key[0], key[0]), keys)
    return objection._replace(place=f"{file}: {own}", what=f"{objection.what} ({', '.join(read)})")


def _placed(objection: Flaw, shots: str) -> str:
    """Return the objection as text, with the folder of the shots' file before the names of files beside it."""
    folder = Path(shots).parent if Path(shots).suffix in (".csv", ".parquet") else None
    table = objection.place.partition(":")[0]
    if folder is None or table not in ("rig.toml", "tracks", "times"):
        return str(objection)
    kind = Path(shots).suffix if (folder / f"{table}{Path(shots).suffix}").exists() else ".csv"
    file = table if table == "rig.toml" else f"{table}{kind}"
    return f"{folder}/{objection._replace(place=objection.place.replace(table, file, 1))}"


def judges_reach(dataset: Dataset) -> bool:
    """Whether enough shots score, with known distance, angle and speed, to compare these with each other."""
    return len(judged_shots(dataset)) >= SCORES


def _objections(dataset: Dataset) -> Iterator[Flaw]:
    unmeasured = list(_unmeasured(dataset))
    yield from unmeasured
    touched = [] if dataset.tracks is None else list(jolts(dataset.tracks))
    yield from _touched(dataset, touched)
    motion = None
    if dataset.tracks is not None and all(flaw.warns for flaw in unmeasured):
        motion = measure_motion(dataset.tracks, frozenset(shot for shot, *_ in touched))
    stated = list(_stated(dataset))
    elsewhere = any(flaw.check in ("gravity", "air") and not flaw.warns for flaw in stated)
    likely = [] if elsewhere else list(_judged(Reading(dataset, motion)))
    places = {flaw.place for flaw in likely}
    yield from likely
    yield from (flaw for flaw in stated if flaw.place not in places)
    if dataset.times is not None:
        yield from judge_times(dataset, dataset.times)


def _judged(reading: Reading) -> Iterator[Flaw]:
    """Yield the likeliest slip if, undone, it lets believable physics explain the data better than as recorded."""
    judged = judged_shots(reading.dataset)
    as_recorded = rows_of(reading, judged, unusual(reading.dataset))
    known = explain([as_recorded])
    yield from _topspin(reading, as_recorded, known)
    if known.surprise < EXPECTED:
        return
    # the shots that are farthest off, and as many others, tell which slips are promising
    odd = np.argsort(-np.abs(known.rest[:len(judged)]))[:FEW // 2]
    few = judged[np.unique(np.append(odd, np.linspace(0, len(judged) - 1, min(FEW, len(judged))).astype(int)))]
    as_few = rows_of(reading, few, unusual(reading.dataset), rough=True)
    stated = sum(as_few.unusual.values())
    every = [(stated + MIXED if some else sum(unusual(cause.undone.dataset).values()) + cause.rare, place, cause, some)
             for place, cause in enumerate(causes(reading)) for some in ((False, True) if cause.single else (False,))]
    tried: list[tuple[float, int, Cause, bool]] = []
    best = as_recorded_few = explain([as_few], [known.values], 0).score
    for unlikely, place, cause, some in sorted(every, key=lambda one: one[:2]):
        # even where it explained all else, it would not be the best
        if unlikely > known.lower - (best - as_recorded_few) + SLACK:
            break
        rows = rows_of(cause.undone, few, unusual(cause.undone.dataset), rough=True)
        score = explain([as_few, rows] if some else [rows], [known.values], 1, 1).score
        score -= MIXED if some else cause.rare
        tried.append((score, -place, cause, some))
        best = max(best, score)
    tried = sorted(tried, reverse=True, key=lambda one: one[:2])[:PROMISING]
    found: list[tuple[float, float, Flaw]] = []
    for _, _, cause, some in tried:
        rows, flaw = rows_of(cause.undone, judged, unusual(cause.undone.dataset)), cause.flaw
        fit = explain([as_recorded, rows] if some else [rows], [known.values])
        if some:
            if len(fit.otherwise) < (2 if cause.undone.dataset is not reading.dataset else 1):
                continue
            ids = [reading.dataset.shots.shot_id[row] for row in fit.otherwise]
            flaw = flaw._replace(what=f"{len(ids)} of {len(set(as_recorded.whose))} judged look like {cause.single}: "
                                 f"convert these: {', '.join(ids[:5])}{', ...' if len(ids) > 5 else ''}")
        found.append((fit.score - known.score - (MIXED if some else cause.rare), cause.sure, flaw))
    found.sort(reverse=True)
    gain, sure, flaw = found[0] if found else (-math.inf, 1.0, Flaw("", "", ""))
    if gain > LIKELIER:
        others = [other.what.partition(":")[0] for score, _, other in found[1:3] if score > gain - CLOSE]
        what = flaw.what + (f"; or another: {'; '.join(others)}" if others else "")
        if gain > BETTER * sure and known.surprise > REFUSED:
            yield flaw._replace(what=f"{what}; the data are then 10^{gain / math.log(10.0):.0f} times as likely")
        else:
            yield flaw._replace(warns=True, what=f"{what}; make sure that this is not so, for the data are then "
                                "likelier")
    else:
        yield from _unexplained(reading, as_recorded.whose, known)


def _topspin(reading: Reading, rows: Rows, known: Fit) -> Iterator[Flaw]:
    """Yield a warning if the stated backspin presses balls down: it may be topspin."""
    spin = reading.dataset.shots.number("exit_spin_rev_s")
    if reading.motion is not None and np.isfinite(spin).any() and lifts_less(rows, known) > PRESSED:
        yield Flaw("spin", f"{reading.dataset.shots.source}: exit_spin_rev_s", "the more of it, the faster balls fall; "
                   "backspin, which lifts, is positive: if this is topspin, multiply it by -1", warns=True)


def _unexplained(reading: Reading, whose: np.ndarray, known: Fit) -> Iterator[Flaw]:
    """Yield rows or numbers that neither believable physics nor a known slip explains."""
    shots = reading.dataset.shots
    place = f"{shots.source}: distance_m, hood_deg or speed"
    far = np.unique(whose[np.abs(known.rest) > LONE])
    if len(far):
        ids = ", ".join(shots.shot_id[row] for row in far[:5]) + (", ..." if len(far) > 5 else "")
        yield Flaw("fit", place, f"{len(far)} shots are far from what the others and believable physics say: {ids}; "
                   "make sure of these rows", warns=True)
    elif known.surprise > ODD:
        yield Flaw("fit", place, "no believable drag, lift, slip or hood explains these; make sure of units and angles",
                   warns=True)


def _unmeasured(dataset: Dataset) -> Iterator[Flaw]:
    """A coordinate that never varies was not measured; a ball goes forwards unless it is thrown upright, and falls."""
    tracks = dataset.tracks
    if tracks is None:
        return
    upright = not (dataset.shots.number("hood_deg") < UPRIGHT_DEG).any()
    for name, values, why in (("x_m", tracks.x_m, "" if upright else "the distance from the exit to the target's side"),
                              ("y_m", tracks.y_m, ""), ("z_m", tracks.z_m, "the height above the floor")):
        known = values[np.isfinite(values)]
        if len(known) > 1 and np.ptp(known) == 0.0 and (name != "x_m" or why):
            yield Flaw("axes", f"tracks: {name}", f"is {known[0]:g} in every sample" + (
                f"; it is {why}" if why else ", so it is taken as not measured: nothing can be found that way"),
                       warns=not why)


def _touched(dataset: Dataset, touched: list[tuple[int, float, bool]]) -> Iterator[Flaw]:
    for early, what, cut in ((True, "begin before the ball is free, as in a hand", "after"),
                             (False, "turn at once, as a ball does that touches something", "before")):
        own = [f"{dataset.shots.shot_id[shot]} at t_s = {t_s:.4g}" for shot, t_s, at_start in touched
               if at_start == early]
        if own:
            # noise makes one of some 800 tracks look so, measured by benchmarks.plausibility: one alone is warned of
            alone = len(own) == 1 and dataset.tracks is not None and len(set(dataset.tracks.shot)) > TRACKS
            yield Flaw("bounce", "tracks: x_m, y_m, z_m", f"{len(own)} tracks {what} ({', '.join(own[:3])}"
                       f"{' ...' if len(own) > 3 else ''}): keep of each track what is {cut} that", warns=alone)


def _stated(dataset: Dataset) -> Iterator[Flaw]:
    """Yield numbers that are probably mistakes whatever the physics."""
    rig, shots = dataset.rig, dataset.shots
    for key, what in too_large(rig):
        check = OF_KEY.get(key, key.partition(".")[0])
        if check in CHECKS and (check != "release" or rig.target is not None):    # others drop balls from towers
            yield Flaw(check, f"rig.toml: {key}", what)
    for key, least, usual in (("world.gravity_m_s2", WEAKEST_M_S2, "gravity on Earth is 9.81"),
                              ("air.density_kg_m3", THIN_KG_M3, "air at sea level has 1.2")):
        if 0.0 < (value := value_of(dataset, key)) < least:
            yield Flaw(key.partition(".")[0].replace("world", "gravity"), f"rig.toml: {key}",
                       f"{value:g} is not of this Earth: {usual}")
    yield from _balls(dataset)
    if rig.target is not None and rig.launcher.release_height_m == 0.0:
        yield Flaw("release", "rig.toml: launcher.release_height_m", "is not stated, so balls are taken to leave at "
                   "the floor; state it", warns=True)
    if "exit_spin_rev_s" not in shots.numbers and not any(name in shots.numbers for name in SPIN_VECTOR):
        for name in (name for name in shots.numbers if "spin" in name.lower()):
            yield Flaw("spin", f"{shots.source}: {name}", "is not read as the ball's spin; if it is that, rename it to "
                       "exit_spin_rev_s, backspin positive", warns=True)
    turning = [(wheel, shots.number(f"wheel_{wheel.name}_rad_s")) for wheel in rig.launcher.wheel if wheel.gear]
    gears = [abs(wheel.gear) for wheel, _ in turning]
    if len(turning) > 1 and max(gears) > 1.3 * min(gears) and np.isfinite(turning[0][1]).sum() >= SCORES and all(
            np.allclose(turning[0][1], one, equal_nan=True) for _, one in turning):
        yield Flaw("wheels", f"{shots.source}: {', '.join(f'wheel_{wheel.name}_rad_s' for wheel, _ in turning)}", "are "
                   "equal although the wheels' gears differ; make sure that they are not the motors', before the gears",
                   warns=True)


def _balls(dataset: Dataset) -> Iterator[Flaw]:
    """Judge the rig's ball, and the balls that shots state."""
    ball, shots = dataset.rig.ball, dataset.shots
    mass_kg, radius_m = (np.append(np.where(np.isfinite(given := shots.number(name)), given, own), own)
                         for name, own in (("mass_kg", ball.mass_kg), ("radius_m", ball.radius_m)))
    density = mass_kg / (4.0 / 3.0 * math.pi * radius_m**3)
    for check, wrong, key, what, warns in (
            ("mass", density > DENSEST_KG_M3, "mass_kg", "is denser than any metal; this looks like grams: {grams:g} "
             "kg; rename the column mass_kg to mass_g", False),
            ("radius", density < LIGHTEST_KG_M3, "radius_m", "is hardly heavier than the air in its place; this looks "
             "like {units}; rename the column radius_m to radius_cm or radius_in", False),
            ("mass", density > HEAVY_KG_M3, "mass_kg", "is as dense as stone or metal; make sure that it is not in "
             "ounces, which would be {ounces:.3g} kg, and that radius_m is not half of the radius", True),
            ("radius", density < LIGHT_KG_M3, "radius_m", "is light for its size; make sure that radius_m is not the "
             "diameter", True)):
        if wrong.any():
            row = len(shots) if wrong[-1] else int(np.argmax(wrong))
            mass, radius = mass_kg[row], radius_m[row]
            units = [f"{unit} ({radius * metres:.4g} m)" for unit, (_, metres) in LENGTHS.items()
                     if LIGHT_KG_M3 < density[row] / metres**3 < DENSEST_KG_M3]
            said = what.format(grams=mass / 1000.0, ounces=mass * OUNCE_KG, units=" or ".join(units) or "another unit")
            own = row == len(shots)
            yield Flaw(check, f"rig.toml: ball.{key}" if own else f"{shots.source}: mass_kg, radius_m",
                       f"{'a ball' if own else f'the ball of shot {shots.shot_id[row]}'} of {mass:g} kg and {radius:g} "
                       f"m radius {said.partition('; rename')[0] if own else said}", warns)
            break
    if max(np.ptp(np.log(mass_kg)), np.ptp(np.log(radius_m))) > ALIKE_BALLS:
        yield Flaw("balls", f"{shots.source}: mass_kg, radius_m", "differ from the ball of rig.toml, which train, aim, "
                   "gates and paper fit simulate; fit, discover and predict by coefficients simulate each shot's. "
                   "State in rig.toml the ball that the robot will shoot", warns=True)


def judge_times(dataset: Dataset, times: Times) -> Iterator[Flaw]:
    """Judge the times of shots without a known launch, which were dropped from the release height."""
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
