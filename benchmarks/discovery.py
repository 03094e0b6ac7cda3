"""Benchmark of discovery on concealed worlds: false alarms, and how often hidden effects are found, located and named.

    python -m benchmarks.discovery --what nulls,effects --level L0,L1,L2 --shots 300 --worlds 20 --seed 11 --out FILE
    python -m benchmarks.discovery --table FILE

FILE has one line per world; --table also reads packed files. The worlds come from truearc_proof.truth, which shares no
code with the code under test. At L2, effects have a quarter of their typical size unless --scale is given.
"""

import time
import traceback
from collections.abc import Sequence

import msgspec

from benchmarks.worlds import KINDS, Job, Line, fill_and_tell, mark_job, plan_jobs, read_args, world_of
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc_proof.rounds.marks import NULLS
from truearc_proof.rounds.tables import said, share
from truearc_proof.table import make_markdown
from truearc_proof.truth.generate import shoot

SCALES = {"L0": 1.0, "L1": 1.0, "L2": 0.25}
FALSE_ALARM = 0.05


def run(job: Job) -> Line:
    """What discovery says of one world; a world that breaks it is a result, and leaves its traceback."""
    keep_compiled()
    dataset = shoot(world_of(job))
    finding, error, began = None, None, time.perf_counter()
    try:
        found = discover(dataset, None, FALSE_ALARM, seed=job.index)
        took = time.perf_counter() - began
        finding = msgspec.json.decode(make_json(found.finding))
        finding["mismatch"]["tests"] = {}
    except Exception:
        finding, error, took = None, traceback.format_exc(), time.perf_counter() - began
    return {"job": job, "seconds": took, "finding": finding, "error": error}


def make_table(lines: Sequence[Line]) -> str:
    """Alarms where nothing is hidden; hidden effects together by level and shots; each that is in no catalogue."""
    jobs = [(msgspec.convert(line["job"], Job), line["finding"]) for line in lines if line["finding"] is not None]
    every = [(job, mark_job(job, finding)) for job, finding in jobs]      # without those in which the solver broke
    rows = []
    for setting in sorted({(job.level, job.shots, job.name) for job, one in every if one.kind in NULLS}):
        mine = [one for job, one in every if one.kind in NULLS and (job.level, job.shots, job.name) == setting]
        rows.append([*map(str, setting), said(*share(mine, lambda one: one.found))])
    tables = [make_markdown(("data", "shots", "nothing hidden", "false alarms (nominal 0.05)"), rows)] if rows else []
    marks = [(job, one) for job, one in every if one.kind in ("one", "off")]
    known, off = ([(job, one) for job, one in marks if (one.kind == "off") == so] for so in (False, True))
    rows = []
    for level, shots, scale in sorted({(job.level, job.shots, job.scale) for job, _ in known}):
        mine = [one for job, one in known if (job.level, job.shots, job.scale) == (level, shots, scale)]
        rows.append([level, str(shots), f"{scale:g}", said(*share(mine, lambda one: one.found)),
                     *(said(*share([one for one in mine if one.found], question))
                       for question in (lambda one: one.first, lambda one: one.covered))])
    tables += [make_markdown(("data", "shots", "times the usual size", "found", "first name right, of those found",
                             "set holds the truth"), rows)] if rows else []
    rows = []
    for name in dict.fromkeys(job.name for job, _ in off):
        mine = [one for job, one in off if job.name == name]
        found = [one for one in mine if one.found]
        rows.append([name, f"{len(found)} of {len(mine)}", str(sum(one.verdict == "unknown" for one in found)),
                     str(sum(one.goes_with is True for one in found))])
    tables += [make_markdown(("hidden", "found", "reported as unknown", "right covariate and direction"),
                             rows)] if rows else []
    tables += [f"The solver broke in {line['key']}" for line in lines if line["finding"] is None]
    return "\n\n".join(tables)


def main() -> int:
    args = read_args(
        __doc__, what=("all", f"kinds of worlds, comma-separated: {', '.join(KINDS)}, or all"), level="L0,L1,L2",
        shots=("300", "a world; several, comma-separated, are all run"), worlds=(20, "of every name (20)"),
        only=(str, "names of nulls or effects, comma-separated; also those that cannot be seen"),
        seed=(0, "below 1000 to develop on (0)"), scale=(float, "of the typical effects (1; 0.25 at L2)"))

    def plan() -> dict[str, Job]:
        kinds, levels = tuple(KINDS) if args.what == "all" else args.what.split(","), args.level.split(",")
        scales = {level: args.scale if args.scale is not None else SCALES.get(level, 1.0) for level in levels}
        only = args.only.split(",") if args.only else ()
        jobs = plan_jobs(kinds, levels, [*map(int, args.shots.split(","))], args.worlds, args.seed, scales, only)
        return {job.key: job for job in jobs}

    return fill_and_tell(args, plan, run, make_table)


if __name__ == "__main__":
    raise SystemExit(main())
