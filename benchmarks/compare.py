"""truearc beside other methods: on concealed worlds with tracks, and on a toolbox's ball drops.

    python -m benchmarks.compare worlds --worlds 20 --seed 11 --out FILE
    python -m benchmarks.compare worlds --table FILE
    python -m benchmarks.compare falls DIR [--steps N] [--left N]

Worlds are L2 with what belongs to the flight hidden, at its typical size and a quarter of it, and nulls; a line of FILE
each. Rivals are in proof/truearc_proof/rivals; pysindy comes with the extra `field`. DIR holds sepia_ball_drop/ with
1_field.* and 1_sim.* of SEPIA's tutorial (proof/IMPORTERS.md): each radius, then each height, is left out and forecast
by the other drops, by Kennedy and O'Hagan's calibration of its authors' runs and by truearc's drag with v^2 or v,
whichever fits these better.
"""

import argparse
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

import truearc as ta
from benchmarks import worlds
from benchmarks.worlds import Job, Line
from truearc.robot.config.rig_spec import Ball
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import Investigation, discover
from truearc.sim.physics.catalogue import BUILT_IN, Catalogue, catalogue
from truearc.sim.physics.flight import path
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.plugins import terms_of_file
from truearc_proof.importers.sepia_drops import import_sepia_drops
from truearc_proof.report.tables import said, yes_of
from truearc_proof.rivals.claim import Claim, believed_of, rms
from truearc_proof.rivals.koh import STEPS, Calibration, Emulator, Forecast, Runs
from truearc_proof.rivals.registry import OURS, RIVALS, check_rivals, find_rival
from truearc_proof.scoring.oracle import FALSE_ALARM, ceiling_of
from truearc_proof.scoring.score_finding import STAGE_OF, names_ranked
from truearc_proof.scoring.score_world import mark_rival, right_names
from truearc_proof.table import make_markdown
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import as_table

RESOLVABLE = 0.95                     # chance that these data's information lets anybody detect the effect
WANTED = 0.95                         # of resolvable worlds, that ours names right
KINDS, LEVEL = ("nulls", "effects", "cut"), "L2"
HEAD = ("hidden", "resolvable, of", "entrant", "detects", "top-1", "up to alias", "track's end, cm", "s")
QUESTIONS = (attrgetter("says"), attrgetter("right"), attrgetter("alias"))
FALLS_HEAD = ("data", "method", "detects", "names", "90 % interval of the first", "forecast error, held out")
KOH, PLAIN = "kennedy-ohagan", "kennedy-ohagan, no discrepancy"
DATA, NO_TRACKS = "SEPIA's falls", "does not apply: it reads tracks"
LAWS = ("drag", "linear_drag")        # too few drops are kept for `discover`, which needs ten: it names one of all
STEP_S, LONGEST_S = 0.005, 8.0
LINEAR_DRAG = Path(__file__).parents[1] / "examples" / "linear_drag.py"
Array = np.ndarray


def claim_of(finding: dict[str, Any]) -> Claim:
    """truearc's own finding (truearc.finding/1, decoded) as a claim like the others'; names only where its verdict
    gives them."""
    fit = finding.get("fit") or {}
    before, after = fit.get("height_rmse_before_m"), fit.get("height_rmse_after_m")
    names = tuple(names_ranked(finding)) if finding["verdict"] in ("named", "set") else ()
    return Claim(bool(finding["mismatch"]["found"]), names, before, before if after is None else after,
                 {} if finding["mismatch"]["p_value"] is None else {"p_value": float(finding["mismatch"]["p_value"])})


# --- concealed worlds

class Mark(NamedTuple):
    """One entrant in one world. right, alias: None where nothing has a name to be found (nulls)."""

    kind: str
    name: str
    scale: float
    entrant: str
    resolvable: bool
    says: bool
    right: bool | None
    alias: bool | None
    before_m: float | None
    after_m: float | None
    seconds: float


def run(rivals: tuple[str, ...], job: Job) -> Line:
    """One world put to truearc and the rivals."""
    keep_compiled()
    world = worlds.world_of(job)
    dataset = shoot(world)
    line: Line = {"job": job, "truth": as_table(world), "ceiling": None, "claims": {}, "errors": {}}
    found: list[Investigation] = []

    def ours() -> Claim:
        found.append(discover(dataset, None, FALSE_ALARM, seed=job.index))
        return claim_of(msgspec.json.decode(make_json(found[0].finding)))

    _put(line, OURS, ours)
    believed = believed_of(found[0]) if found else None
    if believed is None:
        line["errors"] |= dict.fromkeys(rivals, "there is no believed fit to start from")
        return line
    wanted, fitted = worlds.true_parameter(job), found[0].fitted
    if wanted is not None and fitted is not None:
        line["ceiling"] = ceiling_of(fitted.evidence, job.level, f"{job.name}.{wanted[0]}", wanted[1], job.index)
    for rival in rivals:
        _put(line, rival, partial(find_rival(rival), dataset, believed, job.index))
    return line


def _put(line: Line, entrant: str, answer: Callable[[], Claim]) -> None:
    """The entrant's claim, or its traceback, so that the others still run."""
    began = time.perf_counter()
    try:
        line["claims"][entrant] = {"claim": answer(), "seconds": time.perf_counter() - began}
    except Exception:
        line["errors"][entrant] = traceback.format_exc()


def plan(args: argparse.Namespace) -> dict[str, Job]:
    """Nulls once, hidden effects at every scale; beliefs cut short have no scale."""
    only = args.only.split(",") if args.only else ()
    jobs: list[Job] = []
    for kind in args.what.split(","):
        if kind not in KINDS:
            raise ta.InputError(f"there is no kind {kind!r} here; there are {', '.join(KINDS)}")
        names = [name for name in flight_names(kind) if not only or name in only]
        for scale in (map(float, args.scale.split(",")) if kind == "effects" else [1.0]) if names else ():
            jobs += worlds.plan_jobs([kind], [LEVEL], [args.shots], args.worlds, args.seed, {LEVEL: scale}, names)
    if not jobs:
        raise ta.InputError(f"no world of {args.what} is called {args.only}")
    return {job.key: job for job in sorted(jobs, key=lambda job: job.index)}


def flight_names(kind: str) -> tuple[str, ...]:
    """Return the null worlds and the terms of the flight."""
    return tuple(name for name in worlds.names_of(kind, LEVEL) if kind == "nulls" or STAGE_OF[name] == "flight")


def marks_of(line: Line) -> list[Mark]:
    """Of one world's line: every entrant's, by the proof's own rules."""
    job = msgspec.convert(line["job"], Job)
    drawn, ceiling = worlds.drawn_of(job), line.get("ceiling")
    resolvable = ceiling is not None and ceiling[0] >= RESOLVABLE
    found = []
    for entrant, each in line["claims"].items():
        claim = each["claim"]
        marks = mark_rival(drawn, claim, right_names(drawn), worlds.measured_of(ceiling, {}))
        found.append(Mark(job.kind, job.name, job.scale, entrant, resolvable, *marks,
                          claim.get("before_m"), claim.get("after_m"), each["seconds"]))
    return found


def make_table(lines: Sequence[Line], everywhere: bool = False) -> str:
    """Markdown: nulls, each hidden effect, all together; of each, every entrant. Shares with Wilson 95 % and counts.

    Of worlds with something hidden only the resolvable ones are counted, unless `everywhere`.
    """
    marks = [mark for line in lines for mark in marks_of(line)]
    entrants = [OURS, *dict.fromkeys(mark.entrant for mark in marks if mark.entrant != OURS)]
    rows: list[list[str]] = []
    nulls = [mark for mark in marks if mark.kind == "nulls"]
    for name in [*dict.fromkeys(mark.name for mark in nulls), "together"] if nulls else ():
        mine = [mark for mark in nulls if name in (mark.name, "together")]
        rows += _lines(f"nothing: {name}", mine, mine, entrants)
    hidden = [mark for mark in marks if mark.kind != "nulls"]
    for scale in sorted({mark.scale for mark in hidden}, reverse=True):
        here = [mark for mark in hidden if mark.scale == scale]
        for kind, name in [*dict.fromkeys((mark.kind, mark.name) for mark in here), ("", "")]:
            title = f"{name}{' (cut)' if kind == 'cut' else ''} x {scale:g}" if name else f"**together x {scale:g}**"
            mine = [mark for mark in here if not name or (mark.kind, mark.name) == (kind, name)]
            rows += _lines(title, mine, [mark for mark in mine if everywhere or mark.resolvable], entrants)
    failed = [f"{entrant} failed in {line['key']}: {error.strip().splitlines()[-1]}"
              for line in lines for entrant, error in line.get("errors", {}).items()]
    return "\n".join([make_markdown(HEAD, rows), "", _against_target(hidden), *failed])


def _lines(hidden: str, marks: Sequence[Mark], counted: Sequence[Mark], entrants: Sequence[str]) -> list[list[str]]:
    """A row an entrant, of the worlds that count; one row in all where none does."""
    among = max(sum(mark.entrant == one for mark in marks) for one in entrants)
    if not counted:
        return [[hidden, f"0 of {among}", *["-"] * (len(HEAD) - 2)]]
    rows = []
    for entrant in entrants:
        mine = [mark for mark in counted if mark.entrant == entrant]
        seconds = f"{np.median([mark.seconds for mark in mine]):.0f}" if mine else "-"
        rows.append([hidden, f"{sum(mark.resolvable for mark in mine)} of {among}" if mine and mine[0].kind != "nulls"
                     else f"{among}", entrant, *(said(*yes_of(map(question, mine))) for question in QUESTIONS),
                     _ends(mine), seconds])
    return rows


def _ends(marks: Iterable[Mark]) -> str:
    """The mean over worlds of the RMS forecast error before and after, of entrants that forecast."""
    pairs = [(mark.before_m, mark.after_m) for mark in marks if mark.before_m is not None and mark.after_m is not None]
    return "{:.2f} -> {:.2f}".format(*100.0 * np.mean(pairs, axis=0)) if pairs else "-"


def _against_target(hidden: Sequence[Mark]) -> str:
    """Compare with the target: truearc names the concealed flight term in 95 % of resolvable worlds."""
    mine = [mark for mark in hidden if mark.entrant == OURS and mark.resolvable]
    if not mine:
        return "No world with something hidden is resolvable."
    told = []
    for what, question in zip(("names it", "up to alias"), QUESTIONS[1:], strict=True):
        yes, of = yes_of(map(question, mine))
        told.append(f"{what} {said(yes, of)}: {'reached' if yes >= WANTED * of else 'NOT REACHED'}")
    return (f"truearc in resolvable worlds (a {FALSE_ALARM:g} test has a chance of {RESOLVABLE:g} or more, by the "
            f"information in these very data), wanted {WANTED:g}: " + "; ".join(told) + ".")


# --- a toolbox's ball drops: times at heights, computed with drag that goes with v^2; its runs' drag goes with v

class Row(NamedTuple):
    """One method on the falls, as text."""

    method: str
    detects: str
    names: str = ""
    interval: str = ""
    error: str = ""


class Left(NamedTuple):
    """Drops left out: what they have in common, and which ones they are [n]."""

    what: str
    out: Array


def falls(folder: Path, steps: int, most: int | None) -> Iterator[Row]:
    """Every method on the drops of a folder; most: leave out the first so many radii and heights only."""
    dataset = import_sepia_drops(*(folder / f"1_field.{end}" for end in ("dat", "height", "radii")))
    among = Catalogue((*catalogue(), *terms_of_file(LINEAR_DRAG, BUILT_IN)))
    found = discover(dataset, ("gravity",), seed=0, terms=among)
    finding, believed = msgspec.json.decode(make_json(found.finding)), believed_of(found)
    assert believed is not None
    lefts = [Left(f"{what} {value:g} m", column == value) for what, column in zip(("radius", "height"), inputs_of(
        dataset).T, strict=True) for value in np.unique(column)[:most]]
    ours = _error_of(dataset, lefts, [by_law(dataset, among.find(LAWS), ~left.out) for left in lefts])
    for name, claim in ((OURS, claim_of(finding)), ("argmax", find_rival("argmax")(dataset, believed, 0))):
        yield Row(name, "yes" if claim.says_something else "no", ", ".join(claim.names[:1]),
                  _interval_of(finding) if name == OURS else "", ours)
    yield from (Row(rival, NO_TRACKS) for rival in RIVALS if rival != "argmax")
    emulator = emulator_of(folder)
    for name in (KOH, PLAIN):
        fit = partial(calibrate, emulator, dataset, name == KOH, steps)
        forecasts = [fit(~left.out).forecast(inputs_of(dataset)[left.out]) for left in lefts]
        whole = fit(np.ones(len(dataset.shots), dtype=bool))
        off = whole.discrepancy(inputs_of(dataset)) if name == KOH else None     # detected: excludes 0 at any drop
        says = off is not None and bool(((off.low90 > 0.0) | (off.high90 < 0.0)).any())
        low, _, high = whole.theta90[0]
        yield Row(name, "yes" if says else "no", "", f"{low:.3g} to {high:.3g} (of the runs' law)",
                  _error_of(dataset, lefts, forecasts))


def _interval_of(finding: dict[str, Any]) -> str:
    """The likeliest named term's first number."""
    named = finding["what"] if finding["verdict"] in ("named", "set") else ()
    for term in sorted(named, key=lambda one: -one["probability"])[:1]:
        one = next(iter(term["parameters"].values()))
        return f"{one['low90']:.3g} to {one['high90']:.3g}"
    return ""


def emulator_of(folder: Path) -> Emulator:
    """Of the toolbox's runs: times over radius and height fallen, and over the runs' drag."""
    design, height_m, time_s = (np.loadtxt(folder / f"1_sim.{end}") for end in ("design", "height", "dat"))
    radius_m, drag = np.repeat(design, len(height_m), axis=0).T
    return Emulator(Runs(np.column_stack([radius_m, np.tile(height_m, len(design))]), drag[:, None], time_s.T.ravel()))


def inputs_of(dataset: Dataset) -> Array:
    """[n, 2] radius and height fallen, both in m."""
    assert dataset.times is not None
    fallen_m = dataset.rig.launcher.release_height_m - dataset.times.height_m
    return np.column_stack([dataset.shots.number("radius_m"), fallen_m])


def calibrate(emulator: Emulator, dataset: Dataset, discrepancy: bool, steps: int, kept: Array) -> Calibration:
    """With the kept drops."""
    assert dataset.times is not None
    return Calibration(emulator, inputs_of(dataset)[kept], dataset.times.t_s[kept], discrepancy, steps=steps)


def by_law(dataset: Dataset, laws: Sequence[Any], kept: Array) -> Forecast:
    """Times of the drops that are not kept, by gravity and the more probable law by the kept ones; intervals by its
    coefficient's and the stated error of a time."""
    fits = [(law, ta.fit(dataset.take(np.flatnonzero(kept).tolist()), ["gravity", law])) for law in laws]
    term, best = max(fits, key=lambda one: one[1].solution.log_posterior)
    fitted, = best.intervals
    left = dataset.take(np.flatnonzero(~kept).tolist())
    assert left.times is not None
    fallen_m, balls = inputs_of(left)[:, 1], np.column_stack([left.shots.number("mass_kg"), inputs_of(left)[:, 0]])
    values, still, times = np.array([fitted.value, fitted.low90, fitted.high90]), np.zeros(3), np.zeros((3, len(balls)))
    for ball in np.unique(balls, axis=0):
        flown = path(msgspec.structs.replace(left.rig, ball=Ball(*ball.tolist())),
                     (*catalogue().find(["gravity"]), term),
                     {"gravity": {"scale": 1.0 + still}, term.name: {fitted.name.partition(".")[2]: values}},
                     Exit(still, still - np.pi / 2.0, still), int(LONGEST_S / STEP_S), STEP_S)
        mine = (balls == ball).all(axis=1)
        times[:, mine] = [np.interp(fallen_m[mine], track[0] - track, STEP_S * np.arange(len(track)))
                          for track in np.asarray(flown.position_m.z).T]
    middle, low, high = times
    wide = np.hypot(0.5 * np.abs(high - low), 1.645 * left.times.sigma_s)
    return Forecast(middle, middle - wide, middle + wide)


def _error_of(dataset: Dataset, lefts: Sequence[Left], forecasts: Sequence[Forecast]) -> str:
    """RMS by what was left out, and how many times lie in their intervals."""
    assert dataset.times is not None
    off: dict[str, list[float]] = {"radius": [], "height": []}
    inside = []
    for left, forecast in zip(lefts, forecasts, strict=True):
        seen = dataset.times.t_s[left.out]
        off[left.what.partition(" ")[0]] += list(forecast.mean - seen)
        inside += list((forecast.low90 <= seen) & (seen <= forecast.high90))
    each = ", ".join(f"{what} {1000.0 * rms(np.array(errors)):.0f} ms" for what, errors in off.items())
    return f"{each}; {sum(inside)} of {len(inside)} in 90 %"


def main() -> int:
    if sys.argv[1:2] == ["falls"]:
        parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("dir", type=Path, help="folder of the recordings")
        parser.add_argument("--steps", type=int, default=STEPS, help=f"of the calibration's chains ({STEPS})")
        parser.add_argument("--left", type=int, help="leave out the first N radii and the first N heights only")
        args = parser.parse_args(sys.argv[2:])
        keep_compiled()
        print(make_markdown(FALLS_HEAD, [(DATA, *row) for row in falls(args.dir / "sepia_ball_drop", args.steps,
                                                                      args.left)]))
        return 0
    parser = worlds.parser_of(__doc__)
    parser.add_argument("part", choices=("worlds", "falls"))
    parser.add_argument("--rivals", default=",".join(RIVALS), help=f"comma-separated, of {', '.join(RIVALS)} (all)")
    parser.add_argument("--what", default="nulls,effects", help=f"of {', '.join(KINDS)} (nulls,effects)")
    parser.add_argument("--only", help="names of nulls or effects, comma-separated")
    parser.add_argument("--scale", default="1,0.25", help="of the typical effects, comma-separated (1,0.25)")
    parser.add_argument("--shots", type=int, default=300, help="shots a world (300)")
    parser.add_argument("--worlds", type=int, default=20, help="of every name and scale (20)")
    parser.add_argument("--seed", type=int, default=0, help="below 1000 to develop on (0)")
    parser.add_argument("--everywhere", action="store_true", help="count worlds that cannot be resolved, too")
    args = parser.parse_args()
    try:
        rivals = check_rivals(args.rivals.split(",") if args.rivals else ())
    except ta.InputError as error:
        parser.error(str(error))
    return worlds.fill_and_tell(args, partial(plan, args), partial(run, rivals),
                                partial(make_table, everywhere=args.everywhere))


if __name__ == "__main__":
    sys.exit(main())
