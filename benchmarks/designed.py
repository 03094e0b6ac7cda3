"""Do 100 designed shots separate similar candidate terms as well as 300 shots taken at random?

    python -m benchmarks.designed --level L0,L1 --worlds 10 --seed 81 --out FILE
    python -m benchmarks.designed --table FILE

Worlds of truearc_proof.truth hide one effect that resembles others, at --scale times its usual size. Where discovery
finds something in 300 shots and leaves several terms, the hidden one among them, the world is shot again: at the
configurations of truearc design (5 x 20), and, as an alternative, at those of all 300 shots. Discovery is run on the
old shots together with either. The measure is the probability of the hidden term among the terms that were left. FILE
has one line per world; worlds in it are not run again.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import log_softmax

from benchmarks.filling import fill_and_tell, parser_of
from benchmarks.suite import Job, amount_of
from truearc.cli.common import make_progress
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.data.dataset import Dataset, Shots, join_datasets
from truearc.sim.discover.investigate import discover
from truearc.sim.discover.plan.next_steps import can_design, make_design
from truearc.sim.intervals import student_half
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.table import make_markdown
from truearc_proof.truth.followup import Asked, follow
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import World, make_world

ALIKE = ("hood_offset", "wheel_slip", "drag_reynolds", "spin_drag", "wind_x", "wind_z", "distance_scale",
         "distance_bias", "release_height", "target_height")
SHOTS, DESIGNED, CONFIGURATIONS = 300, 100, 5
ONCE_MORE = 2                         # number of the follow-up at random; the designed one's is 1
HEADER = ("level", "worlds, something found, several names with the hidden one", "names left",
          "mean log probability of the hidden one: before", "+ 100 designed", "+ 300 at random", "designed - random",
          "worlds better, worse")

Line = dict[str, Any]


def run(job: Job) -> Line:
    """One world: which names were left, and the log probability of the hidden one among them, three times."""
    keep_compiled()
    world = make_world({job.name: amount_of(job)}, job.level, job.shots, job.seed)
    dataset = shoot(world)
    found = discover(dataset, seed=job.index)
    line: Line = {"level": job.level, "name": job.name, "index": job.index, "found": bool(found.steps), "names": []}
    if not found.steps or not can_design(found.steps[0]):
        return line
    step = found.steps[0]
    design = make_design(step, DESIGNED, CONFIGURATIONS, job.index)
    names = [name.partition(".")[0] for name in design.names]
    if job.name not in names:
        return {**line, "names": names}
    rows = [(int(step.fitted.evidence.rows[block.row]), block.pace, block.shots) for block in design.blocks]
    again = {"designed": _asked(dataset.shots, rows),
             "random": _asked(dataset.shots, [(row, 1.0, 1) for row in range(len(dataset.shots))])}
    told = {which: _told(world, dataset, asked, number, design.names, job)
            for number, (which, asked) in enumerate(again.items(), 1)}
    return {**line, "names": names, "before": float(np.log(design.probability[names.index(job.name)])), **told}


def _asked(shots: Shots, rows: Sequence[tuple[int, float, int]]) -> list[Asked]:
    """Settings of (row, pace of its wheels, how often)."""
    distance, hood, ratio = (shots.number(name) for name in ("distance_m", "hood_deg", "motor_ratio"))
    return [Asked(float(distance[row]), float(hood[row]), float(pace * ratio[row]), count) for row, pace, count in rows]


def _told(world: World, dataset: Dataset, asked: list[Asked], number: int, names: Sequence[str], job: Job) -> float:
    """Log probability of the hidden name among the names, once these shots are there too."""
    more = replace(follow(world, asked, number), name=dataset.name)
    found = discover(join_datasets(dataset, more), seed=job.index)
    if not found.steps:
        return float(-np.log(len(names)))
    nats = found.steps[0].naming.nats
    least = min(nats.values())
    told = log_softmax([nats.get(name, least) for name in names])
    return float(told[[name.partition(".")[0] for name in names].index(job.name)])


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: a level a row, means over worlds, the paired difference with Student's 95 % interval."""
    rows = []
    for level in sorted({one["level"] for one in lines}):
        mine = [one for one in lines if one["level"] == level]
        left = [one for one in mine if "designed" in one]
        if len(left) > 1:
            before, designed, random = (np.array([one[key] for one in left])
                                        for key in ("before", "designed", "random"))
            gain = designed - random
            half = student_half(gain)
            rows.append([level, f"{len(mine)}, {sum(one['found'] for one in mine)}, {len(left)}",
                         f"{np.mean([len(one['names']) for one in left]):.1f}", f"{before.mean():.2f}",
                         f"{designed.mean():.2f}", f"{random.mean():.2f}",
                         f"{gain.mean():+.2f} ({gain.mean() - half:+.2f} to {gain.mean() + half:+.2f})",
                         f"{int((gain > 0).sum())}, {int((gain < 0).sum())}"])
    return make_markdown(HEADER, rows)


def main() -> int:
    args = _arguments()
    return fill_and_tell(args, partial(_run_all, args), make_table)


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, Line]:
    jobs = [Job("effects", name, level, SHOTS, args.scale, args.seed, index) for level in args.level.split(",")
            for index in range(args.worlds) for name in ALIKE if args.only is None or name in args.only.split(",")]
    return fill(path, {job.key: job for job in jobs}, run, make_progress("worlds"), args.processes)


def _arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("--level", default="L0,L1")
    parser.add_argument("--worlds", type=int, default=10, help="of each effect")
    parser.add_argument("--only", help="effects, comma-separated; else all")
    parser.add_argument("--scale", type=float, default=2.0, help="times the effect's usual size (%(default)s)")
    parser.add_argument("--seed", type=int, default=11, help="below 1000 to develop on")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
