"""Is a fault of the tracker mistaken for physics of the ball?

    python -m benchmarks.faults --worlds 10 --seed 61 --out FILE
    python -m benchmarks.faults --tracks DIR --believe gravity,drag,magnus [--since] --out FILE
    python -m benchmarks.faults --table FILE

The tracks of worlds in which nothing is hidden (truearc_proof.truth, L2), or those of a recorded dataset,
are corrupted as by a bad tracker (tracker_faults.py). Discovery runs on each, and on the original tracks. --since: the
corrupted tracks are compared with the belief adopted from the original ones. FILE has one line per finding; findings
in it are not computed again.
"""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.fault_table import make_table
from benchmarks.filling import fill_and_tell, parser_of
from benchmarks.suite import Job, world_of
from benchmarks.tracker_faults import FAULTS, with_fault
from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import load_dataset
from truearc.sim.discover.adopt import make_belief
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc.sim.infer.belief import Belief
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.truth.generate import shoot

NONE = "none"
SINCE = ", since"
SHOTS = 300


def run(recorded: Dataset | None, believed: tuple[str, ...] | None, belief: Belief | None,
        job: tuple[str, Job]) -> dict[str, Any]:
    """What discovery says of one set of tracks with one fault (or none)."""
    keep_compiled()
    fault, world = job
    dataset = shoot(world_of(world)) if recorded is None else recorded
    tracks = dataset if fault == NONE else with_fault(dataset, fault)
    found = discover(tracks, believed, seed=world.index, belief=belief, since=None if belief is None else recorded)
    finding = msgspec.json.decode(make_json(found.finding))
    return {"fault": fault, "source": dataset.name + (SINCE if belief is not None else ""), "number": world.index,
            "found": finding["mismatch"]["found"],
            **{key: finding[key] for key in ("verdict", "where", "sentence", "what", "set", "also")}}


def main() -> int:
    args = _arguments()
    return fill_and_tell(args, partial(_run_all, args), make_table)


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, dict[str, Any]]:
    recorded = None if args.tracks is None else load_dataset(args.tracks)
    if recorded is not None and recorded.tracks is None:
        raise InputError(f"{args.tracks}: has no tracks")
    believed = None if args.believe is None else tuple(args.believe.split(","))
    if args.since and recorded is None:
        raise InputError("--since: of which --tracks?")
    simulated = "simulated" if args.shots == SHOTS else f"simulated, {args.shots} shots"
    name, worlds = (simulated, args.worlds) if recorded is None else (recorded.name + SINCE * args.since, 1)
    belief = make_belief(discover(recorded, believed))[0] if args.since and recorded is not None else None
    jobs = {f"{fault}/{name}/{args.seed}/{index}":
            (fault, Job("nulls", "clean", "L2", args.shots, 0.0, args.seed, index))
            for index in range(worlds) for fault in (NONE, *FAULTS)
            if args.only is None or fault in args.only.split(",")}
    return fill(path, jobs, partial(run, recorded, believed, belief), make_progress("tracks"), args.processes)


def _arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("--tracks", metavar="DIR", help="corrupt this dataset's instead of simulated ones")
    parser.add_argument("--believe", help="terms, comma-separated (as the dataset says)")
    parser.add_argument("--since", action="store_true", help="with --tracks: compare with the originals' belief")
    parser.add_argument("--worlds", type=int, default=10)
    parser.add_argument("--shots", type=int, default=SHOTS, help="of each simulated world (%(default)s)")
    parser.add_argument("--only", help="faults, comma-separated; else all, and none")
    parser.add_argument("--seed", type=int, default=11, help="of the simulated worlds; below 1000 to develop on")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
