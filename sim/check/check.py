"""Plausibility checks of a dataset before inference: wrong units, axes and angles, which a fit mistakes for physics.

Data and rig are compared with all believable physics, as recorded and with each likely slip undone. A slip is refused,
by the name of its check, if believable physics does not explain the data as recorded and explains them better by a
factor of BETTER with the slip undone. Less is a warning.
"""

import math
import re
import shlex
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import too_large
from truearc.sim.check import believable
from truearc.sim.check.believable import Fit, Reading, Rows, explain, judged_shots, rows_of
from truearc.sim.check.causes import TABLE, UNITS, Flaw, causes, unusual, value_of
from truearc.sim.check.motion import TRACKS, jolts, measure_motion
from truearc.sim.data.dataset import Dataset, Floats, Shots, Times
from truearc.sim.data.table import SPIN_VECTOR
from truearc.sim.physics.simulate import has_wheels, launch_state

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
SCORED, MISSED = 0.06, 0.15           # of log speeds, from what their aim needs; chosen: few launchers scatter more
SURE = 4.0                            # standard errors by which high ones were slower; chosen: chance once in 30,000
GEARED = 0.05                         # log by which ratios of speeds are those of gears; chosen: they slow by per cents
ALIKE_BALLS = 0.02                    # share by which masses and radii may differ from the rig's; chosen: as scales err
OUNCE_KG = 0.0283495                  # definition
LIFTED = 1.5                          # times as high as without air a ball may rise; chosen: backspin at most
UPRIGHT_DEG = 85.0                    # hood angles from which a ball need not go forwards; chosen: scatter turns it


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
        shots = Path(dataset.shots.source)
        again = f"truearc check {shlex.quote(str(shots.parent))}" if shots.suffix in (".csv", ".parquet") else ""
        anew = ([f"Correct the file, and import it anew: {dataset.imported}"] if dataset.imported else
                [f"Correct the file, and run: {again}"] if again else [])
        raise InputError("\n".join([*(f"{_placed(objection, dataset.shots.source)} (check {objection.check!r}; if the "
                                      f"data are right as recorded: --accept {objection.check})"
                                      for objection in refused), *anew]))
    return replace(dataset, accepted=tuple(f"{objection.check}: {objection}" for objection in objections))


def _named(objection: Flaw, dataset: Dataset) -> Flaw:
    """Return the objection with the files' own column names, and what they are read as."""
    file, _, keys = objection.place.rpartition(": ")
    written = {"tracks": dataset.track_columns, dataset.shots.source: dataset.shots.written}.get(file, {})
    names = {key: name for key, (name, *_) in written.items() if name != key}
    read = [f"{key} is the file's {names[key]}" for key in re.findall(r"\w+", keys) if key in names]
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


def _objections(dataset: Dataset) -> Iterator[Flaw]:
    unmeasured = list(_unmeasured(dataset))
    yield from unmeasured
    touched = [] if dataset.tracks is None else list(jolts(dataset.tracks))
    yield from _touched(dataset, touched)
    motion = None
    if dataset.tracks is not None and all(flaw.warns for flaw in unmeasured):
        motion = measure_motion(dataset.tracks, frozenset(shot for shot, *_ in touched))
    stated = [*_stated(dataset), *_of_rim(dataset)]
    elsewhere = any(flaw.check in ("gravity", "air") and not flaw.warns for flaw in stated)
    likely = [] if elsewhere else list(_judged(Reading(dataset, motion)))
    places = {flaw.place for flaw in likely}
    yield from likely
    yield from (flaw for flaw in stated if flaw.place not in places)
    if dataset.times is not None:
        yield from _of_times(dataset, dataset.times)


def _judged(reading: Reading) -> Iterator[Flaw]:
    """Yield the likeliest slip if, undone, it lets believable physics explain the data better than as recorded."""
    judged = judged_shots(reading.dataset)

    def told(undone: Reading, shots: np.ndarray, rough: bool = False) -> Rows:
        return rows_of(undone, shots, sum(unusual(undone.dataset).values()), rough)
    as_recorded = told(reading, judged)
    known = explain([as_recorded])
    yield from _topspin(reading, as_recorded, known)
    if known.surprise < EXPECTED:
        yield from _each(reading, known) if len(judged) else ()
        return
    # the shots that are farthest off, and as many others, tell which slips are promising
    odd = np.argsort(-np.abs(known.rest[:len(judged)]))[:FEW // 2]
    few = judged[np.unique(np.append(odd, np.linspace(0, len(judged) - 1, min(FEW, len(judged))).astype(int)))]
    as_few = told(reading, few, rough=True)
    every = [cause for one in causes(reading) for cause in (
        (one, one._replace(rare=MIXED, mixed=True)) if one.single else (one,))]
    unlikely = [cause.rare + (as_few.unusual if cause.mixed else sum(unusual(cause.undone.dataset).values()))
                for cause in every]
    tried: list[tuple[float, int]] = []
    best = as_recorded_few = explain([as_few], [known.values], 0).score
    for place in sorted(range(len(every)), key=unlikely.__getitem__):
        # even where it explained all else, it would not be the best
        if unlikely[place] > known.lower - (best - as_recorded_few) + SLACK:
            break
        undone = [*[as_few] * every[place].mixed, told(every[place].undone, few, rough=True)]
        score = explain(undone, [known.values], 1, 1).score - every[place].rare
        tried.append((score, -place))
        best = max(best, score)
    found: list[tuple[float, float, Flaw]] = []
    for cause in (every[-place] for _, place in sorted(tried, reverse=True)[:PROMISING]):
        fit, flaw = explain([*[as_recorded] * cause.mixed, told(cause.undone, judged)], [known.values]), cause.flaw
        if cause.mixed and len(fit.otherwise) < (1 if cause.undone.dataset is reading.dataset else 2):
            continue
        if cause.mixed:
            ids = _listed([reading.dataset.shots.shot_id[row] for row in fit.otherwise])
            flaw = flaw._replace(what=f"{len(fit.otherwise)} of {len(set(as_recorded.whose))} judged look like "
                                 f"{cause.single}: convert these: {ids}")
        found.append((fit.score - known.score - cause.rare, cause.sure, flaw))
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
        yield from _each(reading, known) if len(judged) else ()


def _topspin(reading: Reading, rows: Rows, known: Fit) -> Iterator[Flaw]:
    """Yield a warning if the stated backspin presses balls down: it may be topspin."""
    shots = reading.dataset.shots
    if reading.motion is not None and np.isfinite(shots.number("exit_spin_rev_s")).any() and (
            believable.lifts_less(rows, known) > PRESSED):
        yield remark("topspin", source=shots.source)


def _each(reading: Reading, known: Fit) -> Iterator[Flaw]:
    """Yield warnings of what the speeds of all shots tell, misses among them: another unit of some, reversed signs."""
    shots, rows = reading.dataset.shots, believable.flown_shots(reading.dataset)
    missed = np.array(shots.text("outcome"))[rows] == "miss"

    def off(undone: Reading) -> Floats:
        return believable.speeds_off(undone, rows, known)

    def nats(undone: Reading) -> Floats:
        widths = off(undone) / np.where(missed, MISSED, SCORED)
        return np.asarray(0.5 * (believable.FREEDOM + 1.0) * np.log1p(widths**2 / believable.FREEDOM))
    found: list[tuple[float, Flaw]] = []
    for cause in filter(lambda cause: cause.single, causes(reading._replace(motion=None))):
        better = nats(reading) - nats(cause.undone) - believable.MIXED
        ids = [shots.shot_id[row] for row in rows[better > 0.0]]
        found.append((better[better > 0.0].sum() - MIXED, cause.flaw._replace(
            warns=True, what=f"{len(ids)} of {len(rows)} shots look like {cause.single}; make sure of these: "
            f"{_listed(ids)}")))
    yield from (flaw for gain, flaw in sorted(found, reverse=True)[:1] if gain > BETTER)
    up = ups(shots)[rows]
    if min((up > 0.0).sum(), (up < 0.0).sum()) >= believable.SCORES:
        # beside what the physics does not explain by distance and angle
        by = np.column_stack([up, np.ones(len(rows)), shots.number("distance_m")[rows],
                              believable.elevation_deg(reading.dataset)[rows]])
        slope, *_ = np.linalg.lstsq(by, off(reading))
        spread = np.std(off(reading) - by @ slope) * math.sqrt(np.linalg.pinv(by.T @ by)[0, 0])
        if slope[0] < -SURE * spread:
            yield remark("reversed", source=shots.source, column="side" if "side" in shots.texts else "miss_height_m")


def ups(shots: Shots) -> Floats:
    """Return 1 for shots that passed high or came down long, -1 for low or short ones, by the side or else the height;
    0 where neither says it."""
    side, height = np.array(shots.text("side")), np.nan_to_num(shots.number("miss_height_m"))
    return np.select([np.isin(side, ("high", "long")), np.isin(side, ("low", "short"))], [1.0, -1.0], np.sign(height))


def _unexplained(reading: Reading, whose: np.ndarray, known: Fit) -> Iterator[Flaw]:
    """Yield rows or numbers that neither believable physics nor a known slip explains."""
    shots = reading.dataset.shots
    if len(far := np.unique(whose[np.abs(known.rest) > LONE])):
        yield remark("far", source=shots.source, count=len(far), shots=_listed([shots.shot_id[row] for row in far]))
    elif known.surprise > ODD:
        yield remark("unexplained", source=shots.source)


def _unmeasured(dataset: Dataset) -> Iterator[Flaw]:
    """A coordinate that never varies was not measured; a ball goes forwards unless it is thrown upright, and falls."""
    upright = not (dataset.shots.number("hood_deg") < UPRIGHT_DEG).any()
    for axis, meaning in (("x_m", "the distance from the exit to the target's side"), ("y_m", ""),
                          ("z_m", "the height above the floor")):
        values = getattr(dataset.tracks, axis, np.zeros(0))
        known = values[np.isfinite(values)]
        if len(known) > 1 and np.ptp(known) == 0.0 and not (upright and axis == "x_m"):
            yield remark("unmeasured" if meaning else "flat", axis=axis, value=known[0], meaning=meaning)


def _touched(dataset: Dataset, touched: list[tuple[int, float, bool]]) -> Iterator[Flaw]:
    for name, early in (("held", True), ("touched", False)):
        own = [f"{dataset.shots.shot_id[shot]} at t_s = {t_s:.4g}" for shot, t_s, at_start in touched
               if at_start == early]
        if own:
            # noise makes one of some 800 tracks look so, measured by benchmarks.plausibility: one alone is warned of
            alone = len(own) == 1 and dataset.tracks is not None and len(set(dataset.tracks.shot)) > TRACKS
            yield remark(name, count=len(own), shots=_listed(own, 3))._replace(warns=alone)


def _stated(dataset: Dataset) -> Iterator[Flaw]:
    """Yield numbers that are probably mistakes whatever the physics."""
    rig, shots = dataset.rig, dataset.shots
    for key, what in too_large(rig):
        check = TABLE["checks"].get(key)
        if check and (check != "release" or rig.target is not None):              # others drop balls from towers
            yield Flaw(check, f"rig.toml: {key}", what)
    for key in ("world.gravity_m_s2", "air.density_kg_m3"):
        yield from beyond(key, np.array([value_of(dataset, key)]), lambda row, at: {"place": f"rig.toml: {row['of']}"})
    yield from _balls(dataset)
    if rig.target is not None and rig.launcher.release_height_m == 0.0:
        yield remark("floor")
    if not shots.numbers.keys() & {"exit_spin_rev_s", *SPIN_VECTOR}:
        yield from (remark("unread", source=shots.source, column=name) for name in shots.numbers
                    if "spin" in name.lower())
    turning = {f"wheel_{wheel.name}_rad_s": abs(wheel.gear) for wheel in rig.launcher.wheel if wheel.gear}
    speeds = np.array([shots.number(name) for name in turning])
    if len(turning) > 1 and max(turning.values()) > 1.1 * min(turning.values()) and (
            np.isfinite(speeds).all(axis=0).sum() >= believable.SCORES):
        logs, gears = np.log(np.maximum(np.abs(speeds), 1e-9)), np.log([*turning.values()])
        ratios = np.nanmedian(logs - logs[0], axis=1)
        for name, off, most in (("equal", ratios, 1e-9), ("exchanged", ratios + gears - gears[0], GEARED)):
            if np.abs(off).max() < most:
                yield remark(name, source=shots.source, columns=", ".join(turning))
    heights, sides = shots.number("miss_height_m"), np.array(shots.text("side"))
    stated = np.isin(sides, ("low", "high")) & (np.abs(heights) > 0.0)
    wrong = np.flatnonzero(stated & (np.where(sides == "low", -heights, heights) < 0.0))
    if len(wrong):
        yield remark("signs", source=shots.source, count=len(wrong), all=stated.sum(),
                     shots=_listed([shots.shot_id[row] for row in wrong]))


def _of_rim(dataset: Dataset) -> Iterator[Flaw]:
    """Judge whether balls can come down into an opening that faces up."""
    rig, shots, target = dataset.rig, dataset.shots, dataset.rig.target
    if target is None or not target.faces_up:
        return
    angle = np.radians(believable.elevation_deg(dataset))
    rise_m = target.centre_height_m - rig.launcher.release_height_m
    up_m_s = launch_state(rig, shots).get("exit_speed_m_s", np.full(len(shots), np.nan)) * np.sin(angle)
    above_m = LIFTED * up_m_s[np.isfinite(up_m_s)]**2 / (2.0 * rig.world.gravity_m_s2)
    if len(above_m) and above_m.max() < rise_m:
        yield remark("ceiling", rim=target.centre_height_m, top=rig.launcher.release_height_m + above_m.max())
    hits = np.isin(shots.text("outcome"), ("two", "three"))
    far_m = shots.number("distance_m") + target.half_sizes_m[0]
    flat = np.flatnonzero(hits & (np.tan(angle) < 2.0 * rise_m / far_m))        # by the parabola through its far end
    if len(flat):
        yield remark("rising", source=shots.source, count=len(flat), all=int(hits.sum()),
                     shots=_listed([shots.shot_id[row] for row in flat]))


def _balls(dataset: Dataset) -> Iterator[Flaw]:
    """Judge the rig's ball, and the balls that shots state."""
    ball, shots = dataset.rig.ball, dataset.shots
    mass_kg, radius_m = (np.append(own, np.where(np.isfinite(given := shots.number(name)), given, own))
                         for name, own in (("mass_kg", ball.mass_kg), ("radius_m", ball.radius_m)))

    def said(row: dict[str, Any], at: int) -> dict[str, Any]:
        place, whose = (f"rig.toml: ball.{row['key']}", "a ball") if at == 0 else (
            f"{shots.source}: mass_kg, radius_m", f"the ball of shot {shots.shot_id[at - 1]}")
        return {"place": place, "ball": f"{whose} of {mass_kg[at]:g} kg and {radius_m[at]:g} m radius",
                "number": radius_m[at], "grams": mass_kg[at] / 1000.0, "ounces": mass_kg[at] * OUNCE_KG,
                "todo": row.get("todo", "") if at else ""}
    yield from beyond("ball", mass_kg / (4.0 / 3.0 * math.pi * radius_m**3), said)
    if max(np.ptp(np.log(mass_kg)), np.ptp(np.log(radius_m))) > ALIKE_BALLS:
        yield remark("balls", source=shots.source)


def _of_times(dataset: Dataset, times: Times) -> Iterator[Flaw]:
    """Judge the times of shots without a known launch, which were dropped from the release height."""
    rig, shots = dataset.rig, dataset.shots
    sped = has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))
    dropped = ~(sped & np.isfinite(believable.elevation_deg(dataset)))[times.shot]
    fallen_m = (rig.launcher.release_height_m - times.height_m)[dropped]
    if (fallen_m <= 0.0).any():
        yield remark("above", stated=rig.launcher.release_height_m, height=times.height_m[dropped].max())
    elif len(fallen_m):
        each = 2.0 * fallen_m / times.t_s[dropped]**2 / rig.world.gravity_m_s2
        middle, names = np.median(each), [shots.shot_id[row] for row in times.shot[dropped]]
        for of, values in (("fall", np.array([middle])), ("each fall", each)):
            if found := list(beyond(of, values, lambda row, at: {
                    "place": f"times: {row['key']}", "shot": names[at], "middle": middle, "all": len(each)})):
                yield from found
                return


def beyond(of: str, values: Floats, said: Callable[[dict[str, Any], int], dict[str, Any]]) -> Iterator[Flaw]:
    """Yield the first limit of slips.toml that some numbers are beyond; said: its place and words, of the first one."""
    for row in TABLE["limits"]:
        wrong = np.flatnonzero((values < row.get("least", -math.inf)) | (values > row.get("most", math.inf)))
        if row["of"] == of and len(wrong):
            value = values[wrong[0]]
            words: dict[str, Any] = {"number": 1.0, "todo": "", **said(row, int(wrong[0]))}
            units = [row.get("each", "{unit}").format(unit=unit, number=words["number"] * size)
                     for unit, (_, size) in UNITS.get(row.get("units", ""), {}).items()
                     if row["likely"][0] < value * size**row["power"] < row["likely"][1]]
            looks = row["looks"].format(units=" or ".join(units)) if units else row.get("otherwise")
            what = row["what"].format(value=value, count=len(wrong), looks=looks, **words) + words["todo"]
            yield Flaw(row["check"], words["place"], what, row.get("warns", False))
            return


def remark(name: str, **said: Any) -> Flaw:
    """Return what slips.toml says of a finding."""
    row = TABLE["remarks"][name]
    return Flaw(row["check"], row["place"].format(**said), row["what"].format(**said), row.get("warns", False))


def _listed(names: list[str], most: int = 5) -> str:
    """The first names, and whether there are more."""
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
