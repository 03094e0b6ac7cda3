"""Plausibility checks of a dataset before inference: wrong units, axes and angles, which a fit mistakes for physics.

Data and rig are compared with all believable physics, first as recorded, and then with each likely slip that slips.toml
lists undone. A dataset with a slip is refused, with the name of the slip's check, if believable physics does not
explain the data as recorded but explains them better by a factor of BETTER with the slip undone. A smaller factor only
causes a warning.
"""

import math
import re
import shlex
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Target, too_large
from truearc.robot.config.units import in_unit
from truearc.sim.check import believable
from truearc.sim.check.believable import TABLE, UNITS, Fit, Motion, Reading, elevation_deg, explain, nats_of, rows_of
from truearc.sim.data.dataset import Dataset, Floats, Times
from truearc.sim.data.table import SPIN_VECTOR, WHEEL
from truearc.sim.physics.simulate import has_wheels

CHECKS = ("gravity", "axes", "bounce", "track-length", "track-shots", "speed", "hood", "mass", "radius", "reach", "air",
          "target", "noise", "wheels", "height", "release", "balls", "spin", "fit")
BETTER = math.log(1000.0)             # a slip is refused from here; chosen: one sound dataset in a thousand
LIKELIER = math.log(50.0)             # it is warned of from here; chosen: one dataset in fifty has a slip of its kind
# Chosen: of sound rigs by the priors, one in twenty surprises by more than the first
EXPECTED, REFUSED = 5.2, 7.0          # nats of surprise: slips are looked for, and refused
ODD = 0.3                             # nats a row without sizes, from which anything is warned of; chosen: sound 0.2
PRESSED = 2.0                         # nats by which lift is negative, from which it is said; chosen: smooth balls may
PROMISING, FEW = 6, 16                # slips that are judged at their best, and shots that tell them; chosen: quick
SLACK = 8.0                           # nats by which a scatter may become more usual, too; chosen: half the scatter
MIXED = 1.5                           # nats that another unit in some rows costs; chosen: as exchanged columns
LONE = 10.0                           # standard deviations of a single row; chosen: chance once in 10^4 by Student's t
CLOSE = 2.0                           # nats within which another cause is named, too; chosen: seven times as likely
SCORED, MISSED = 0.06, 0.15           # of log speeds, from what their aim needs; chosen: few launchers scatter more
SURE = 4.0                            # standard errors by which high ones were slower; chosen: chance once in 30,000
GEARED = 0.05                         # log by which ratios of speeds are those of gears; chosen: they slow by per cents
ALIKE_BALLS = 0.02                    # share by which masses and radii may differ from the rig's; chosen: as scales err
TABLES = ".csv", ".parquet"
OUNCE_KG = 0.0283495                  # definition
LIFTED = 1.5                          # times as high as without air a ball may rise; chosen: backspin at most
UPRIGHT_DEG = 85.0                    # hood angles from which a ball need not go forwards; chosen: scatter turns it
TILT = 0.27                           # derived: tan of the 15 degrees that the term track_tilt allows
TALLEST = 0.25                        # share of the target's height; chosen: heights from the floor scatter by less
NEAR = 0.3                            # share of a release height; chosen: tracks that begin so low are from the exit
# rows of units of the rig's numbers and of tracks, beside the other slips of these
OF_RIG = [{**about, "of": key, "times": factor, "what": f"this looks like {unit}: {{size:.3g}} {about['own']}"}
          for key, about in believable.QUANTITIES.items() if "own" in about
          for unit, (_, factor) in UNITS[about["units"]].items() if factor != 1.0] + TABLE["rig"]
OF_TRACKS = [{"of": [f"{axis}_m" for axis in axes], "check": "gravity", "rare": rare, "single": single,
              "what": f"these look like {unit}: rename " + ", ".join(f"{axis}_m to {axis}_{suffix}" for axis in axes),
              "matrix": np.diag([metres if axis in axes else 1.0 for axis in "xyz"])}
             for unit, (suffix, metres) in UNITS["length"].items() if metres != 1.0
             for axes, rare, single in (("xyz", 0.0, unit), ("z", 2.0, ""))] + TABLE["tracks"]
Slips = Iterator[tuple[dict[str, Any], Any, dict[str, Any]]]            # row, what is then read, words


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


def flaw_of(row: dict[str, Any], place: str = "", **words: Any) -> Flaw:
    """Return what a row of slips.toml says, of a place or of its own."""
    return Flaw(row["check"], place or row["place"].format(**words), row["what"].format(**words),
                row.get("warns", False))


def remark(dataset: Dataset, name: str, rows: Any = None, **words: Any) -> Iterator[Flaw]:
    """Yield what slips.toml says of a finding, if there is one: with rows of shots, not where these are none."""
    ids = None if rows is None else [dataset.shots.shot_id[row] for row in rows]
    if ids != []:
        said = {"source": dataset.shots.source, "count": len(ids or ()), "shots": _listed(ids or [])}
        yield flaw_of(TABLE["remarks"][name], **{**said, **words})


def _listed(names: list[str], most: int = 5) -> str:
    """The first names, and whether there are more."""
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


def check_plausible(dataset: Dataset, accept: Collection[str] = ()) -> Dataset:
    """Return the dataset with the objections that were accepted, or only warn.

    Args:
        accept: Names of checks whose objections are accepted.

    Raises:
        InputError: names every other objection with its file, key, likeliest cause and check; or an unknown check.
    """
    accept = (accept,) if isinstance(accept, str) else accept
    if unknown := [name for name in accept if name not in CHECKS]:
        raise InputError(f"accept: there is no check {unknown[0]!r}; there are {', '.join(CHECKS)}")
    with np.errstate(all="ignore"):       # absurd numbers overflow on their way to an objection
        objections = [_named(objection, dataset) for objection in _objections(dataset)]
    if refused := [one for one in objections if not one.warns and one.check not in accept]:
        shots = Path(dataset.shots.source)
        again = f"run: truearc check {shlex.quote(str(shots.parent))}" if shots.suffix in TABLES else ""
        again = f"import it anew: {dataset.imported}" if dataset.imported else again
        raise InputError("\n".join([*(f"{_placed(one, shots)} (check {one.check!r}; if the data are right as recorded: "
                                      f"--accept {one.check})" for one in refused),
                                    *([f"Correct the file, and {again}"] if again else [])]))
    return replace(dataset, accepted=tuple(f"{objection.check}: {objection}" for objection in objections))


def _named(objection: Flaw, dataset: Dataset) -> Flaw:
    """Return the objection with the files' own column names, and what they are read as."""
    file, _, keys = objection.place.rpartition(": ")
    written = {"tracks": dataset.track_columns, dataset.shots.source: dataset.shots.written}.get(file, {})
    names = {key: name for key, (name, *_) in written.items() if name != key}
    read = [f"{key} is the file's {names[key]}" for key in re.findall(r"\w+", keys) if key in names]
    own = re.sub(r"\w+", lambda key: names.get(key[0], key[0]), keys)
    return objection._replace(place=f"{file}: {own}", what=objection.what + (f" ({', '.join(read)})" if read else ""))


def _placed(objection: Flaw, shots: Path) -> str:
    """Return the objection as text, with the folder of the shots' file before the names of files beside it."""
    table = objection.place.partition(":")[0]
    if shots.suffix not in TABLES or table not in ("rig.toml", "tracks", "times"):
        return str(objection)
    kind = shots.suffix if (shots.parent / f"{table}{shots.suffix}").exists() else ".csv"
    return f"{shots.parent}/{table}{kind if table != 'rig.toml' else ''}{str(objection).removeprefix(table)}"


def _objections(dataset: Dataset) -> Iterator[Flaw]:
    unmeasured = list(_unmeasured(dataset))
    yield from unmeasured
    motion = None
    if dataset.tracks is not None:
        touched = list(believable.jolts(dataset.tracks))
        for name, early in (("held", True), ("touched", False)):
            own = [f"{dataset.shots.shot_id[shot]} at t_s = {t_s:.4g}" for shot, t_s, at_start in touched
                   if at_start == early]
            tracks = len(set(dataset.tracks.shot))
            few = len(own) <= max(1.0, believable.JOLTED * tracks) and tracks > believable.TRACKS
            yield from (one._replace(warns=few) for one in remark(
                dataset, name, count=len(own), shots=_listed(own, 3)) if own)
        if all(flaw.warns for flaw in unmeasured):
            motion = believable.measure_motion(dataset.tracks, frozenset(shot for shot, *_ in touched))
    target = dataset.rig.target
    stated = [*_stated(dataset), *(_of_rim(dataset, target) if target and target.faces_up else ())]
    elsewhere = any(flaw.check in ("gravity", "air") and not flaw.warns for flaw in stated)
    likely = [] if elsewhere else list(_judged(Reading(dataset, motion)))
    yield from likely
    yield from (flaw for flaw in stated if flaw.place not in {one.place for one in likely})
    if dataset.times is not None:
        yield from _of_times(dataset, dataset.times)


def _judged(reading: Reading) -> Iterator[Flaw]:
    """Yield the likeliest slip if, undone, it lets believable physics explain the data better than as recorded."""
    judged = believable.judged_shots(reading.dataset)
    as_recorded = rows_of(reading, judged)
    known = explain([as_recorded])
    if reading.motion is not None and np.isfinite(reading.dataset.shots.number("exit_spin_rev_s")).any() and (
            believable.lifts_less(as_recorded, known) > PRESSED):
        yield from remark(reading.dataset, "topspin")
    if known.surprise < EXPECTED:
        yield from _each(reading, known) if len(judged) else ()
        return
    # the shots that are farthest off, and as many others, tell which slips are promising
    odd = np.argsort(-np.abs(known.rest[:len(judged)]))[:FEW // 2]
    few = judged[np.unique(np.append(odd, np.linspace(0, len(judged) - 1, min(FEW, len(judged))).astype(int)))]
    as_few = rows_of(reading, few, rough=True)
    every = list(causes(reading))
    unlikely = [one.rare + (as_few.unusual if one.mixed else believable.unusual(one.undone.dataset)) for one in every]
    tried: list[tuple[float, int]] = []
    best = as_recorded_few = explain([as_few], [known.values], 0).score
    for place in sorted(range(len(every)), key=unlikely.__getitem__):
        # even where it explained all else, it would not be the best
        if unlikely[place] > known.lower - (best - as_recorded_few) + SLACK:
            break
        undone = [*[as_few] * every[place].mixed, rows_of(every[place].undone, few, rough=True)]
        score = explain(undone, [known.values], 1, 1).score - every[place].rare
        tried.append((score, -place))
        best = max(best, score)
    found: list[tuple[float, float, Flaw]] = []
    for cause in (every[-place] for _, place in sorted(tried, reverse=True)[:PROMISING]):
        fit, flaw = explain([*[as_recorded] * cause.mixed, rows_of(cause.undone, judged)], [known.values]), cause.flaw
        if cause.mixed:
            if len(fit.otherwise) < (1 if cause.undone.dataset is reading.dataset else 2):
                continue
            ids = _listed([reading.dataset.shots.shot_id[row] for row in fit.otherwise])
            flaw = flaw._replace(what=f"{len(fit.otherwise)} of {len(set(as_recorded.whose))} judged look like "
                                 f"{cause.single}: convert these: {ids}")
        found.append((fit.score - known.score - cause.rare, cause.sure, flaw))
    found.sort(reverse=True)
    gain, sure, flaw = found[0] if found else (-math.inf, 1.0, Flaw("", "", ""))
    if gain > LIKELIER:
        others = [other.what.partition(":")[0] for score, _, other in found[1:3] if score > gain - CLOSE]
        what = flaw.what + (f"; or another: {'; '.join(others)}" if others else "")
        warns = gain <= BETTER * sure or known.surprise <= REFUSED
        yield flaw._replace(warns=warns, what=what + (
            "; make sure that this is not so, for the data are then likelier" if warns else
            f"; the data are then 10^{gain / math.log(10.0):.0f} times as likely"))
        return
    far = np.unique(as_recorded.whose[np.abs(known.rest) > LONE])
    yield from remark(reading.dataset, "far", far)
    # that a size is unusual is nothing that physics has to explain
    odd_rows = known.surprise - as_recorded.unusual > ODD * as_recorded.weight.sum()
    yield from remark(reading.dataset, "unexplained") if odd_rows and not len(far) else ()
    yield from _each(reading, known) if len(judged) else ()


def _each(reading: Reading, known: Fit) -> Iterator[Flaw]:
    """Yield warnings of what the speeds of all shots tell, misses among them: another unit of some, reversed signs."""
    shots, rows = reading.dataset.shots, believable.flown_shots(reading.dataset)
    off, missed = believable.speeds_off(reading, rows, known), np.array(shots.text("outcome"))[rows] == "miss"
    width = np.where(missed, MISSED, SCORED)
    found: list[tuple[float, Flaw]] = []
    for cause in filter(lambda cause: cause.mixed, causes(reading._replace(motion=None))):
        undone = believable.speeds_off(cause.undone, rows, known)
        better = nats_of(off / width) - nats_of(undone / width) - believable.MIXED
        ids = [shots.shot_id[row] for row in rows[better > 0.0]]
        found.append((better[better > 0.0].sum() - MIXED, cause.flaw._replace(
            warns=True, what=f"{len(ids)} of {len(rows)} shots look like {cause.single}; make sure of these: "
            f"{_listed(ids)}")))
    yield from (flaw for gain, flaw in sorted(found, reverse=True)[:1] if gain > BETTER)
    side, height = np.array(shots.text("side"))[rows], np.nan_to_num(shots.number("miss_height_m"))[rows]
    up = np.select([np.isin(side, ("high", "long")), np.isin(side, ("low", "short"))], [1.0, -1.0], np.sign(height))
    if min((up > 0.0).sum(), (up < 0.0).sum()) >= believable.SCORES:
        # beside what the physics does not explain by distance and angle
        by = np.column_stack([up, np.ones(len(rows)), shots.number("distance_m")[rows],
                              elevation_deg(reading.dataset)[rows]])
        slope, *_ = np.linalg.lstsq(by, off)
        if slope[0] < -SURE * np.std(off - by @ slope) * math.sqrt(np.linalg.pinv(by.T @ by)[0, 0]):
            yield from remark(reading.dataset, "reversed", column="side" if "side" in shots.texts else "miss_height_m")


def _unmeasured(dataset: Dataset) -> Iterator[Flaw]:
    """A coordinate that never varies was not measured; a ball goes forwards unless it is thrown upright, and falls."""
    upright = not (dataset.shots.number("hood_deg") < UPRIGHT_DEG).any()
    for axis, meaning in (("x_m", "the distance from the exit to the target's side"), ("y_m", ""),
                          ("z_m", "the height above the floor")):
        values = getattr(dataset.tracks, axis, np.zeros(0))
        known = values[np.isfinite(values)]
        if len(known) > 1 and np.ptp(known) == 0.0 and not (upright and axis == "x_m"):
            yield from remark(dataset, "unmeasured" if meaning else "flat", axis=axis, value=known[0], meaning=meaning)


def _stated(dataset: Dataset) -> Iterator[Flaw]:
    """Yield numbers that are probably mistakes whatever the physics."""
    rig, shots = dataset.rig, dataset.shots
    for key, what in too_large(rig):
        check = TABLE["checks"].get(key)
        if check and (check != "release" or rig.target is not None):              # others drop balls from towers
            yield Flaw(check, f"rig.toml: {key}", what)
    for key in ("world.gravity_m_s2", "air.density_kg_m3"):
        yield from beyond(key, np.array([believable.value_of(dataset, key)]))
    yield from _balls(dataset)
    yield from remark(dataset, "floor") if rig.target and rig.launcher.release_height_m == 0.0 else ()
    for name in shots.numbers if not shots.numbers.keys() & {"exit_spin_rev_s", *SPIN_VECTOR} else ():
        yield from remark(dataset, "unread", column=name) if "spin" in name.lower() else ()
    turning = {f"wheel_{wheel.name}_rad_s": abs(wheel.gear) for wheel in rig.launcher.wheel if wheel.gear}
    speeds, gears = np.array([shots.number(name) for name in turning]), np.array([*turning.values()])
    if len(turning) > 1 and gears.max() > 1.1 * gears.min() and (
            np.isfinite(speeds).all(axis=0).sum() >= believable.SCORES):
        logs = np.log(np.maximum(np.abs(speeds), 1e-9))
        ratios = np.nanmedian(logs - logs[0], axis=1)
        off = {"equal": ratios / 1e-9, "exchanged": (ratios + np.log(gears) - np.log(gears)[0]) / GEARED}
        for name in off:
            yield from remark(dataset, name, columns=", ".join(turning)) if np.abs(off[name]).max() < 1.0 else ()
    heights, sides = shots.number("miss_height_m"), np.array(shots.text("side"))
    stated = np.isin(sides, ("low", "high")) & (np.abs(heights) > 0.0)
    wrong = np.flatnonzero(stated & (np.where(sides == "low", -heights, heights) < 0.0))
    yield from remark(dataset, "signs", wrong, all=stated.sum())


def _of_rim(dataset: Dataset, target: Target) -> Iterator[Flaw]:
    """Judge whether balls can come down into an opening that faces up."""
    rig, shots = dataset.rig, dataset.shots
    angle, release_m = np.radians(elevation_deg(dataset)), rig.launcher.release_height_m
    rise_m, up_m_s = target.centre_height_m - release_m, believable.launched(dataset)[0] * np.sin(angle)
    above_m = LIFTED * up_m_s[np.isfinite(up_m_s)]**2 / (2.0 * rig.world.gravity_m_s2)
    if len(above_m) and above_m.max() < rise_m:
        yield from remark(dataset, "ceiling", rim=target.centre_height_m, top=release_m + above_m.max())
    hits = np.isin(shots.text("outcome"), ("two", "three"))
    far_m = shots.number("distance_m") + target.half_sizes_m[0]
    flat = np.flatnonzero(hits & (np.tan(angle) < 2.0 * rise_m / far_m))        # by the parabola through its far end
    yield from remark(dataset, "rising", flat, all=int(hits.sum()))


def _balls(dataset: Dataset) -> Iterator[Flaw]:
    """Judge the rig's ball, and the balls that shots state."""
    ball, shots = dataset.rig.ball, dataset.shots
    mass_kg, radius_m = (np.append(own, np.where(np.isfinite(given := shots.number(name)), given, own))
                         for name, own in (("mass_kg", ball.mass_kg), ("radius_m", ball.radius_m)))

    def words(at: int) -> dict[str, Any]:
        whose = f"the ball of shot {shots.shot_id[at - 1]}" if at else "a ball"
        return {"place": f"{shots.source}: mass_kg, radius_m" if at else "",
                "ball": f"{whose} of {mass_kg[at]:g} kg and {radius_m[at]:g} m radius", "number": radius_m[at],
                "grams": mass_kg[at] / 1000.0, "ounces": mass_kg[at] * OUNCE_KG}
    yield from beyond("ball", mass_kg / (4.0 / 3.0 * math.pi * radius_m**3), words)
    alike = max(np.ptp(np.log(mass_kg)), np.ptp(np.log(radius_m))) <= ALIKE_BALLS
    yield from remark(dataset, "balls") if not alike else ()


def _of_times(dataset: Dataset, times: Times) -> Iterator[Flaw]:
    """Judge the times of shots without a known launch, which were dropped from the release height."""
    rig, shots = dataset.rig, dataset.shots
    sped = has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))
    dropped = ~(sped & np.isfinite(elevation_deg(dataset)))[times.shot]
    fallen_m = (rig.launcher.release_height_m - times.height_m)[dropped]
    if (fallen_m <= 0.0).any():
        yield from remark(dataset, "above", stated=rig.launcher.release_height_m, height=times.height_m[dropped].max())
    elif len(fallen_m):
        each = 2.0 * fallen_m / times.t_s[dropped]**2 / rig.world.gravity_m_s2
        middle, names = np.median(each), [shots.shot_id[row] for row in times.shot[dropped]]
        yield from list(beyond("fall", np.array([middle]))) or beyond(
            "each fall", each, lambda at: {"shot": names[at], "middle": middle, "all": len(each)})


def beyond(of: str, values: Floats, words: Callable[[int], dict[str, Any]] = lambda at: {}) -> Iterator[Flaw]:
    """Yield the first limit of slips.toml that some numbers are beyond; words: its own, of the first such number."""
    for row in TABLE["limits"]:
        wrong = np.flatnonzero((values < row.get("least", -math.inf)) | (values > row.get("most", math.inf)))
        if row["of"] == of and len(wrong):
            at, value = int(wrong[0]), values[wrong[0]]
            said: dict[str, Any] = {"number": 1.0, "todo": row.get("todo", "") if at else "", **words(at)}
            units = [row.get("each", "{unit}").format(unit=unit, number=said["number"] * size)
                     for unit, (_, size) in UNITS.get(row.get("units", ""), {}).items()
                     if row["likely"][0] < value * size**row["power"] < row["likely"][1]]
            looks = row["looks"].format(units=" or ".join(units)) if units else row.get("otherwise")
            yield flaw_of(row, value=value, count=len(wrong), looks=looks, **said)
            return


def _with_rig(reading: Reading, key: str, by: Callable[[float], float]) -> Reading:
    """Return the reading with another number in the rig, for wheels in each of them."""
    part, *wheels, name = key.split(".")
    table = getattr(reading.dataset.rig, part)
    changed = [structs.replace(one, **{name: by(getattr(one, name))}) for one in (table.wheel if wheels else [table])]
    new = structs.replace(table, wheel=tuple(changed)) if wheels else changed[0]
    return reading._replace(dataset=replace(reading.dataset, facts=structs.replace(reading.dataset.rig, **{part: new})))


def causes(reading: Reading) -> Iterator[Cause]:
    """Yield every slip that the dataset may have, in all rows or in some."""
    for row, place, undone, words in _slips(reading):
        cause = Cause(flaw_of(row, place, **words), undone, row["rare"], row.get("single", ""), row.get("sure", 1.0))
        yield cause
        if cause.single:
            yield cause._replace(rare=MIXED, mixed=True)


def _slips(reading: Reading) -> Iterator[tuple[dict[str, Any], str, Reading, dict[str, Any]]]:
    """Yield row of slips.toml, place, the data with it undone, words."""
    dataset, shots = reading.dataset, reading.dataset.shots
    known = {name for name, column in shots.numbers.items() if np.isfinite(column).any()}
    groups = {name: [name] for name in known} | {
        "wheel": sorted(filter(WHEEL.fullmatch, known)), "spin_vector": [*SPIN_VECTOR] * known.issuperset(SPIN_VECTOR)}
    known |= {name for name, columns in groups.items() if columns}
    known |= {"gears" for wheel in dataset.rig.launcher.wheel if wheel.gear not in (0.0, 1.0, -1.0)}
    if known & {"wheel", "motor_ratio"} and "exit_speed_m_s" not in shots.numbers:
        known.add("by wheels")
    of_rig, of_shots = (filter(lambda row: known.issuperset(row.get("needs", ())), rows)
                        for rows in (OF_RIG, TABLE["shots"]))
    in_units = (_units(dataset, groups[key], about) for key, about in believable.QUANTITIES.items()
                if "units" in about and groups.get(key))
    for row, columns, words in chain(*in_units, *(_of_shots(dataset, row, groups) for row in of_shots)):
        undone = replace(dataset, shots=replace(shots, numbers=shots.numbers | columns))
        yield row, f"{shots.source}: {', '.join(columns)}", reading._replace(dataset=undone), words
    for row in of_rig:
        if not math.isnan(size := believable.value_of(dataset, row["of"])):
            by = row["times"].__mul__ if "times" in row else lambda old: old and 1.0 / old
            yield row, f"rig.toml: {row['of']}", _with_rig(reading, row["of"], by), {"size": by(size)}
    for row, motion, words in _of_tracks(dataset, reading.motion) if reading.motion else ():
        yield row, f"tracks: {', '.join(row['of'])}", reading._replace(motion=motion), words


def _of_shots(dataset: Dataset, row: dict[str, Any], groups: dict[str, list[str]]) -> Slips:
    shots = dataset.shots
    gears = {f"wheel_{wheel.name}_rad_s": wheel.gear for wheel in dataset.rig.launcher.wheel}
    for first in filter(groups.get, row["of"]):
        for other in chain(*(groups.get(name, ()) for name in row.get("exchange", ()))):
            by = shots.written.get(first, ("", 1.0))[1] / shots.written.get(other, ("", 1.0))[1]
            yield row, {first: shots.number(other) * by, other: shots.number(first) / by}, {
                "both": f"{first} and {other}"}
        if "exchange" not in row:
            yield row, {name: shots.number(name) * row.get("times", gears.get(name, 1.0)) + row.get("plus", 0.0)
                        for name in groups[first]}, {}


def _units(dataset: Dataset, names: list[str], about: dict[str, Any]) -> Slips:
    """Yield other units for columns; heights may be those above the floor."""
    shots, target, units = dataset.shots, dataset.rig.target, UNITS[about["units"]]
    written, size, _ = shots.written.get(names[0], (names[0], 1.0, 0.0))
    # the last unit is the column's own
    read = next((unit for unit, (_, factor) in units.items() if math.isclose(factor, size)), [*units][-1])
    for unit, (suffix, factor) in units.items():
        by = factor / units[read][1]
        columns = {name: shots.number(name) * by for name in names}
        if unit != read:
            rename = (f"rename {'each' if names[1:] else 'the column'} to {in_unit(written, suffix)}" if suffix else
                      f"multiply them by {factor:g}") + f" or multiply it by {factor:.3g}" * (unit == "radians")
            # a column says its unit or, in metres, has it by default
            rare = about["rare"] + 0.5 * (unit in ("metres", "turns"))
            yield {**about, "what": "these look like {unit}: {rename}", "rare": rare, "single": unit}, columns, {
                "unit": unit, "rename": rename}
        if unit not in (read, "metres") and names == ["distance_m"]:
            among = {"what": "these look like {unit}", "rare": about["rare"] + 99.0, "single": f"metres among {unit}"}
            yield about | among, {"distance_m": shots.number("distance_m") / by}, {"unit": among["single"]}
        if names == ["miss_height_m"] and target is not None:
            above = columns["miss_height_m"] - target.centre_height_m
            if abs(float(np.nanmedian(above))) < max(TALLEST * target.centre_height_m, target.two_half_height_m):
                rename = f", and rename the column to miss_height_{suffix}" if unit != read else ""
                yield TABLE["remarks"]["floor heights"], {"miss_height_m": above}, {
                    "unit": unit, "height": target.centre_height_m / by, "rename": rename}


def _of_tracks(dataset: Dataset, motion: Motion) -> Slips:
    """Yield other units, axes, origins and times of tracks, and tracks of the wrong shots."""
    place, end, first = motion.vectors[:, 4:].swapaxes(0, 1)
    turn = math.atan2(*np.median(end - place, axis=0)[1::-1])
    cosine, sine = math.cos(turn), math.sin(turn)
    back = place[:, 0] / np.where(first[:, 0] > 0.0, first[:, 0], np.inf)
    begin = place - first * back[:, None]
    begin[:, 2] -= 0.5 * dataset.rig.world.gravity_m_s2 * back**2
    stated, (_, y, z) = dataset.rig.launcher.release_height_m, np.median(begin, axis=0)
    behind, tilted = -float(np.median(place[:, 0])), TILT * abs(float(np.median(place[:, 2])))
    same, shifts = np.eye(3), {"aside": [0.0, -y, 0.0], "behind": [behind if behind > tilted else 0.0, 0.0, 0.0]}
    if stated or dataset.rig.target is not None:          # else the height of a tower, maybe, is not stated
        name = "unstated" if stated == 0.0 else "from exit" if abs(z) < NEAR * stated else "another height"
        shifts[name] = [0.0, 0.0, stated - z]
    undone = {name: motion.read(same, by_m=np.array(by_m)) for name, by_m in shifts.items()} | {
        "turned": motion.read(np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])),
        "unlinked": motion._replace(unlinked=True)}
    said: dict[str, Any] = {"degrees": abs(math.degrees(turn)), "side": "left" if turn > 0.0 else "right", "y": y,
                            "z": z, "stated": stated, "behind": behind}
    for row in OF_TRACKS:
        for rate in row.get("per_s", [1.0]):
            read = undone.get(row["name"]) if "name" in row else motion.read(
                np.array(row.get("matrix", same), dtype=float), row.get("seconds", 1.0) / rate)
            if read is not None:
                yield row, read, {"rate": rate, **said}
