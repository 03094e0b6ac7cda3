"""How often discovery cries wolf, and how often it finds, places and names what a concealed world hides.

    python -m benchmarks.discovery --what nulls,effects --level L0,L1,L2 --shots 300 --worlds 20 --seed 11 --out FILE
    python -m benchmarks.discovery --table FILE [--brief]

Every world is a line of FILE; a world that is there already is not run again, so a run that was cut short goes on
where it stopped. --table reads packed files too; benchmarks/results/MANIFEST.md lists the published ones. Worlds
come from truearc_proof.truth, which shares no code with what is tested. L2's effects are a quarter of their typical
size, as in the design's targets, unless --scale says otherwise.
"""

import argparse
import sys
import time
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import msgspec

from benchmarks.archives import stored_file
from benchmarks.suite import KINDS, Job, mark_job, plan_jobs, true_parameter, world_of
from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.discover.adopt import Investigation
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc_proof.parallel import fan_out
from truearc_proof.report.tables import make_tables, said, share
from truearc_proof.rounds.jsonl_store import append_line, lines_of, mend
from truearc_proof.scoring.oracle import ceiling_of, oracle_gain, strength_of
from truearc_proof.scoring.score_world import NULLS, Mark
from truearc_proof.table import Table, make_markdown
from truearc_proof.truth.generate import shift_m, shoot
from truearc_proof.truth.world import World, as_table

SCALES = {"L0": 1.0, "L1": 1.0, "L2": 0.25}
FALSE_ALARM = 0.05


def run(path: str, job: Job) -> None:
    """Make one world, discover in it, and append its line to the file."""
    keep_compiled()
    world = world_of(job)
    begin = time.perf_counter()
    dataset = shoot(world)
    made = time.perf_counter()
    finding, error = None, None
    try:
        found = discover(dataset, None, FALSE_ALARM, seed=job.index)
        finding = msgspec.json.decode(make_json(found.finding))
        took = time.perf_counter() - made
        finding = _with_ceiling(finding, found, job, world)
    except Exception:  # one world that breaks the solver is a result, and must not take the night's others along
        finding, error = None, traceback.format_exc()
        took = time.perf_counter() - made
    line = {"key": job.key, "job": job, "truth": as_table(world), "seconds": took, "making_s": made - begin,
            "finding": _short(finding), "error": error}
    append_line(path, line)


def _with_ceiling(finding: dict[str, Any], found: Investigation, job: Job, world: World) -> dict[str, Any]:
    """The finding with what could have been found and gained."""
    wanted = true_parameter(job)
    if job.kind == "off" and found.fitted is not None:
        return {**finding, "strength": strength_of(found.fitted.evidence, shift_m(world))}
    if wanted is None:
        return finding
    name, amplitude = f"{job.name}.{wanted[0]}", wanted[1]
    fit = {**(finding["fit"] or {}), "oracle_gain_per_shot": oracle_gain(found, name, amplitude)}
    ceiling = found.fitted and ceiling_of(found.fitted.evidence, job.level, name, amplitude, job.index)
    return {**finding, "fit": fit, "ceiling": ceiling}


def _short(finding: dict[str, Any] | None) -> dict[str, Any] | None:
    """Without the long list of single tests."""
    return finding and {**finding, "mismatch": {**finding["mismatch"], "tests": {}}}


def marks_of(path: Path) -> tuple[list[tuple[Job, Mark]], list[float], list[str]]:
    """Marks with their jobs, seconds of each world, and keys of worlds in which the solver broke."""
    marks, seconds, broken = [], [], []
    for line in lines_of(path):
        job = msgspec.convert(line["job"], Job)
        if line["finding"] is None:
            broken.append(line["key"])
        else:
            marks.append((job, mark_job(job, line["finding"])))
            seconds.append(line["seconds"])
    return marks, seconds, broken


def main() -> int:
    args = _arguments()
    try:
        if args.table is None:
            _run_all(args)
        (_tell_briefly if args.brief else _tell)(Path(args.table or args.out))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _run_all(args: argparse.Namespace) -> None:
    kinds = tuple(KINDS) if args.what == "all" else args.what.split(",")
    levels = args.level.split(",")
    scales = {level: args.scale if args.scale is not None else SCALES.get(level, 1.0) for level in levels}
    jobs = plan_jobs(kinds, levels, [int(count) for count in args.shots.split(",")], args.worlds, args.seed, scales,
                     args.only.split(",") if args.only else (), args.side)
    done = {line["key"] for line in lines_of(Path(args.out)) if line["finding"] is not None or not args.again}
    todo = [job for job in jobs if job.key not in done]
    print(f"{len(jobs)} worlds, {len(jobs) - len(todo)} there already", file=sys.stderr)
    path = Path(args.out)
    mend(path)
    fan_out(partial(run, str(path.resolve())), todo, progress=make_progress("worlds"), workers=args.processes)


def _tell(path: Path) -> None:
    marks, seconds, broken = marks_of(path)
    if not marks:
        raise InputError(f"{path}: no world is in it")
    print(_alarms(marks).markdown())
    for level, shots, scale in sorted({(job.level, job.shots, job.scale) for job, _ in marks if job.kind != "nulls"}):
        mine = [one for job, one in marks if (job.level, job.shots) == (level, shots) and job.scale in (scale, 0.0)]
        print(f"\n## {level}, {shots} shots, effects x {scale:g}\n")
        print("\n\n".join(table.markdown() for table in make_tables(mine, scale=scale)))
    print(f"\nSeconds per world: median {median(seconds):.1f}, slowest {max(seconds):.1f}")
    if broken:
        print(f"The solver broke in {len(broken)} worlds: {', '.join(broken[:10])}")


def _tell_briefly(path: Path) -> None:
    """Hidden effects together by level and shots; each that is in no catalogue."""
    marks = [(job, one) for job, one in marks_of(path)[0] if one.kind in ("one", "off")]
    known, off = ([(job, one) for job, one in marks if (one.kind == "off") == so] for so in (False, True))
    rows = []
    for level, shots, scale in sorted({(job.level, job.shots, job.scale) for job, _ in known}):
        mine = [one for job, one in known if (job.level, job.shots, job.scale) == (level, shots, scale)]
        rows.append([level, str(shots), f"{scale:g}", said(*share(mine, lambda one: one.found)),
                     *(said(*share([one for one in mine if one.found], question))
                       for question in (lambda one: one.first, lambda one: one.covered))])
    tables = [make_markdown(("data", "shots", "times the usual size", "found", "first name right, of those found",
                             "set holds the truth"), rows)] if rows else []
    rows = []
    for name in dict.fromkeys(job.name for job, _ in off):
        mine = [one for job, one in off if job.name == name]
        found = [one for one in mine if one.found]
        rows.append([name, f"{len(found)} of {len(mine)}", str(sum(one.verdict == "unknown" for one in found)),
                     str(sum(one.goes_with is True for one in found))])
    tables += [make_markdown(("hidden", "found", "called unknown", "right covariate and direction"),
                             rows)] if rows else []
    print("\n\n".join(tables))


def _alarms(marks: Sequence[tuple[Job, Mark]]) -> Table:
    """Of worlds in which nothing is hidden, by what is wrong with their data."""
    nulls = [(job, one) for job, one in marks if one.kind in NULLS]
    rows = []
    for setting in sorted({(job.level, job.shots, job.name) for job, _ in nulls}):
        mine = [one for job, one in nulls if (job.level, job.shots, job.name) == setting]
        rows.append([*map(str, setting), said(*share(mine, lambda one: one.found)),
                     said(*share(mine, lambda one: bool(one.names)))])
    return Table(
        "False alarms (nominal 0.05)", ("level", "shots", "null", "false alarms", "a name was given"), rows
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", default="all", help=f"kinds of worlds, comma-separated: {', '.join(KINDS)}, or all")
    parser.add_argument("--level", default="L0,L1,L2")
    parser.add_argument("--shots", default="300", help="shots a world; several, comma-separated, are all run")
    parser.add_argument("--worlds", type=int, default=20, help="of every name (20)")
    parser.add_argument("--only", help="names of nulls or effects, comma-separated; also those that cannot be seen")
    parser.add_argument("--seed", type=int, default=0, help="below 1000 to develop on; the table has 4002 to 6001 (0)")
    parser.add_argument("--scale", type=float, help="of the typical effects (1; 0.25 at L2)")
    parser.add_argument("--side", action="store_true",
                        help="it is noted on which side a shot passed; keep such worlds in a file of their own")
    parser.add_argument("--processes", type=int, help="at a time (one a core)")
    parser.add_argument("--brief", action="store_true", help="print a row a level and number of shots")
    parser.add_argument("--again", action="store_true", help="run worlds again in which the solver broke")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="FILE", help="file of worlds to add to")
    where.add_argument("--table", type=stored_file, metavar="FILE", help="only print the tables of a file of worlds")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
