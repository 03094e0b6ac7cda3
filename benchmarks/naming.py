"""Do probabilities mean what they say? Names of what was hidden in drawn worlds, by how likely they were said to be.

    python -m benchmarks.naming --level L1 --worlds 240 --seed 700 --out FILE
    python -m benchmarks.naming --table FILE

Worlds as sealed rounds draw them (truearc_proof.worlds.sampling_plan): one effect, two, aliases, decoys,
none, and some that no term has; clean and dirty. Here none is sealed, and none is MuJoCo's: these are for development
and for reliability; rounds of `truearc prove` are the proof. A line of FILE a world; none is run again.

With --scheduler the worlds run on a Dask cluster, and are kept here; each is a job of its own.

The table has the rows of the targets, over worlds in which something was found; then how often the likeliest name was
right, by the probability that was printed for it.
"""

import argparse
import itertools
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.filling import fill_and_tell, parser_of
from truearc.cli.common import make_progress
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.finding import FindingRecord
from truearc.sim.discover.investigate import discover
from truearc.sim.printed import make_text
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.scoring.score_world import right_names
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world
from truearc_proof.worlds.sampling_plan import NUMPY, Drawn, draw_round

EDGES = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)     # of the probability of the likeliest name
UNCHANGED = ("clean", "dirty")
Line = dict[str, Any]


def run(drawn: Drawn) -> Line:
    """What discovery says of one world, beside what is right."""
    keep_compiled()
    shots = shoot(make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt))
    began = time.process_time()
    answer = answer_of(discover(shots, seed=0).finding)
    seconds = time.process_time() - began
    return {"kind": drawn.kind, "dirt": drawn.dirt, "effects": drawn.effects, "right": right_names(drawn), **answer,
            "seconds": seconds, "shots": drawn.shots}


def answer_of(finding: FindingRecord) -> Line:
    """Return the fields of a finding that a line keeps."""
    return {"found": finding.mismatch.found, "p_value": finding.mismatch.p_value, "verdict": finding.verdict,
            "set": finding.set or (), "also": [one.set or () for one in finding.also],
            "names": [one.term for one in finding.what[:6]],
            "probability": [one.probability for one in finding.what[:6]],
            "unexplained": float(finding.unexplained) if finding.unexplained else 0.0}


def make_table(lines: Sequence[Line]) -> str:
    """The rows of the targets, and reliability."""
    changed = [line for line in lines if line["kind"] not in UNCHANGED]
    found = [line for line in changed if line["found"]]
    known, unknown = ([line for line in found if bool(line["right"]) == has] for has in (True, False))
    single = [line for line in found if line["verdict"] == "named"]
    named = [line for line in known if line["verdict"] in ("named", "set")]
    two = [line for line in known if line["kind"] == "two"]
    rows = [
        (f"alarms where nothing was hidden, {kind}", *_share([line["found"] for line in lines if line["kind"] == kind]))
        for kind in UNCHANGED]
    rows += [
        ("found", *_share([line["found"] for line in changed])),
        ("single names wrong", *_share([not set(line["set"]) & set(line["right"]) for line in single])),
        ("truth in the set, of what a term has", *_share([is_held(line) for line in known])),
        ("called unknown, of what a term has", *_share([line["verdict"] == "unknown" for line in known])),
        ("unknown or a set, of what no term has", *_share([line["verdict"] != "named" for line in unknown])),
        ("both of two", *_share([are_both(line) for line in two]))]
    size = np.mean([len(line["set"]) for line in named]) if named else np.nan
    told = [(line["probability"][0], line["names"][0] in line["right"]) for line in found
            if line["names"] and line["verdict"] != "unknown"]
    bins = [(f"{low:g} to {high:g}", [right for said, right in told if low <= said < high + (high == 1.0)],
             [said for said, _ in told if low <= said < high + (high == 1.0)])
            for low, high in itertools.pairwise(EDGES)]
    reliable = [(place, str(len(right)), f"{np.mean(said):.2f}", f"{np.mean(right):.2f}")
                for place, right, said in bins if right]
    costs = [line["seconds"] / line["shots"] for line in lines if "seconds" in line]
    cost = [f"processor time a shot: median {1e3 * np.median(costs):.1f} ms, mean {1e3 * np.mean(costs):.1f} ms"]
    return "\n".join([f"{len(lines)} worlds", *(cost if costs else ()),
                      *make_text(("", "share", "of"), rows, right=(1, 2)),
                      f"mean size of a set: {size:.2f}", "", "the likeliest name, where something has a name:",
                      *make_text(("said", "worlds", "mean said", "right"), reliable, right=(1, 2, 3))])


def is_held(line: Line) -> bool:
    return line["verdict"] in ("named", "set") and bool(set(line["set"]) & set(line["right"]))


def are_both(line: Line) -> bool:
    told = {*line["set"], *(name for names in line["also"] for name in names)}
    return len(line["right"]) > 1 and set(line["right"]) <= told


def _share(hits: Sequence[bool]) -> tuple[str, str]:
    return (f"{np.mean(hits):.2f}" if hits else "-"), str(len(hits))


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--level", choices=("L0", "L1", "L2"), default="L1")
    parser.add_argument("--worlds", type=int, default=240)
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--seed", type=int, default=700)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster, such as tcp://host:8786")
    args = parser.parse_args()
    return fill_and_tell(args, partial(_run_all, args), make_table)


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, Line]:
    worlds = draw_round(args.seed, args.worlds, args.level, args.shots, (NUMPY,))
    jobs = {f"{args.seed}/{args.level}/{one.name}": one for one in worlds}
    return fill(path, jobs, run, make_progress("worlds"), args.processes, args.scheduler)


if __name__ == "__main__":
    sys.exit(main())
