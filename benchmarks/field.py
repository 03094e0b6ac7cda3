"""truearc's discovery beside the field: the same concealed worlds, tracks and all, put to rivals in one run.

    python -m benchmarks.field --worlds 20 --seed 11 --out FILE
    python -m benchmarks.field --table FILE

Worlds are L2 with what belongs to the flight hidden, at its typical size and a quarter of it, and nulls. A world is a
line of FILE; one that is there with all rivals asked for is not run again. Rivals are in proof/truearc_proof/rivals;
pysindy comes with the extra `field`.
"""

import argparse
import sys
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.archives import stored_file
from benchmarks.field_table import KINDS, LEVEL, claim_of, flight_names, make_table
from benchmarks.suite import Job, plan_jobs, true_parameter, world_of
from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.discover.adopt import Investigation
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc_proof.parallel import fan_out
from truearc_proof.rivals.claim import Claim, believed_of
from truearc_proof.rivals.registry import OURS, RIVALS, check_rivals, find_rival
from truearc_proof.rounds.jsonl_store import append_line, lines_of, mend
from truearc_proof.scoring.oracle import FALSE_ALARM, ceiling_of
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import as_table


def run(path: str, rivals: tuple[str, ...], job: Job) -> None:
    """Make one world, put it to truearc and the rivals, and append the line of it."""
    keep_compiled()
    world = world_of(job)
    dataset = shoot(world)
    line: dict[str, Any] = {"key": job.key, "job": job, "truth": as_table(world), "ceiling": None, "claims": {},
                            "errors": {}}
    found: list[Investigation] = []

    def ours() -> Claim:
        found.append(discover(dataset, None, FALSE_ALARM, seed=job.index))
        return claim_of(msgspec.json.decode(make_json(found[0].finding)))

    _put(line, OURS, ours)
    believed = believed_of(found[0]) if found else None
    if believed is None:
        line["errors"] |= dict.fromkeys(rivals, "there is no believed fit to start from")
    else:
        line["ceiling"] = _ceiling(job, found[0])
        for rival in rivals:
            _put(line, rival, partial(find_rival(rival), dataset, believed, job.index))
    append_line(path, line)


def _put(line: dict[str, Any], entrant: str, answer: Callable[[], Claim]) -> None:
    """Return the entrant's claim, or its traceback, so that the others still run."""
    begin = time.perf_counter()
    try:
        claim = answer()
    except Exception:
        line["errors"][entrant] = traceback.format_exc()
    else:
        line["claims"][entrant] = {"claim": claim, "seconds": time.perf_counter() - begin}


def _ceiling(job: Job, found: Investigation) -> Any:
    """Return the information bound of these data; None where nothing is hidden."""
    wanted = true_parameter(job)
    if wanted is None or found.fitted is None:
        return None
    return ceiling_of(found.fitted.evidence, job.level, f"{job.name}.{wanted[0]}", wanted[1], job.index)


def plan(args: argparse.Namespace) -> list[Job]:
    """Nulls once, hidden effects at every scale; beliefs cut short have no scale."""
    only = args.only.split(",") if args.only else ()
    jobs: list[Job] = []
    for kind in args.what.split(","):
        if kind not in KINDS:
            raise InputError(f"there is no kind {kind!r} here; there are {', '.join(KINDS)}")
        names = [name for name in flight_names(kind) if not only or name in only]
        for scale in [float(part) for part in args.scale.split(",")] if kind == "effects" else [1.0]:
            jobs += plan_jobs([kind], [LEVEL], [args.shots], args.worlds, args.seed, {LEVEL: scale}, names) \
                if names else []
    if not jobs:
        raise InputError(f"no world of {args.what} is called {args.only}")
    return sorted(jobs, key=lambda job: job.index)


def main() -> int:
    args = _arguments()
    try:
        if args.table is None:
            _run_all(args)
        _tell(Path(args.table or args.out), args.everywhere)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _run_all(args: argparse.Namespace) -> None:
    rivals, jobs, path = check_rivals(args.rivals.split(",") if args.rivals else ()), plan(args), Path(args.out)
    done = {key for key, line in _whole(path).items()
            if {OURS, *rivals} <= set(line["claims"]) | (set() if args.again else set(line["errors"]))}
    todo = [job for job in jobs if job.key not in done]
    print(f"{len(jobs)} worlds, {len(jobs) - len(todo)} there already", file=sys.stderr)
    mend(path)
    fan_out(partial(run, str(path.resolve()), rivals), todo, progress=make_progress("worlds"), workers=args.processes)


def _whole(path: Path) -> dict[str, dict[str, Any]]:
    """{key: its line}; where a world is there twice, with the entrants of both, the later one's claims first."""
    worlds: dict[str, dict[str, Any]] = {}
    for line in lines_of(path):
        before = worlds.get(line["key"], {"claims": {}, "errors": {}})
        claims = {**before["claims"], **line["claims"]}
        errors = {name: text for name, text in {**before["errors"], **line["errors"]}.items() if name not in claims}
        worlds[line["key"]] = {**before, **line, "claims": claims, "errors": errors}
    return worlds


def _tell(path: Path, everywhere: bool) -> None:
    worlds = list(_whole(path).values())
    if not worlds:
        raise InputError(f"{path}: no world is in it")
    print(make_table(worlds, everywhere))
    for line in worlds:
        for entrant, error in line["errors"].items():
            print(f"{entrant} failed in {line['key']}: {error.strip().splitlines()[-1]}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rivals", default=",".join(RIVALS), help=f"comma-separated, of {', '.join(RIVALS)} (all)")
    parser.add_argument("--what", default="nulls,effects", help=f"of {', '.join(KINDS)} (nulls,effects)")
    parser.add_argument("--only", help="names of nulls or effects, comma-separated")
    parser.add_argument("--scale", default="1,0.25", help="of the typical effects, comma-separated (1,0.25)")
    parser.add_argument("--shots", type=int, default=300, help="shots a world (300)")
    parser.add_argument("--worlds", type=int, default=20, help="of every name and scale (20)")
    parser.add_argument("--seed", type=int, default=0, help="below 1000 to develop on (0)")
    parser.add_argument("--processes", type=int, help="at a time (one a core)")
    parser.add_argument("--again", action="store_true", help="run worlds again in which an entrant failed")
    parser.add_argument("--everywhere", action="store_true", help="count worlds that cannot be resolved, too")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="FILE", help="file of worlds to add to")
    where.add_argument("--table", type=stored_file, metavar="FILE", help="only print the table of a file of worlds")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
