"""Discovery on the MuJoCo world, whose slip, droop and compression the paper's simulation lacks.

    python -m benchmarks.launcher_world --what as-is,changed --level L1,L2 --worlds 10 --seed 1001 --out FILE
    python -m benchmarks.launcher_world --table FILE

as-is: an unmodified world, baseline as in the paper (gravity, drag, magnus): is the mismatch found, in which stage, by
which terms, and how well does the adopted simulation forecast another session's heights at the plane, beside the
world's shot-to-shot scatter (the same shots with and without it) and beside the fitted baseline.
changed: one thing changed (truearc_proof.worlds.perturbations), compared with the belief adopted from the as-is
session of the same number and, with tracks or --since, since that session. FILE has one line per world; worlds in it
are not run again. World number N has the seed 1000 N. Development used seeds below 1000, and numbers 101 to 120 for
`since`.
"""

import argparse
import sys
import zlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.filling import fill_and_tell, parser_of
from benchmarks.launcher_table import AS_IS, make_tables
from benchmarks.unseen import heights_m, off_m
from truearc.cli.common import SHIPPED, make_progress
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import load_config
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.discover.adopt import Investigation, make_belief
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc.sim.infer.belief import as_table, from_table
from truearc.sim.world.options import Options
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.world.practice import plan_season
from truearc_proof.world.season import ORDINARY, Sensors, play_season
from truearc_proof.worlds.perturbations import Change, seen_at

BELIEVED = ("gravity", "drag", "magnus")
EXACT = Sensors(0.0, 0.0, 0.0)        # so that heights are missed for the simulation's sake alone
UNSEEN = 200                          # shots of the other session
APART = 1000                          # seeds of one number of world from the next's

Line = dict[str, Any]


def run_as_is(facts: Rig, more: int, world: tuple[str, int, int]) -> Line:
    """An unmodified world (level, shots, seed): what was found, and RMS errors in m of heights in a session of
    `more` shots that nothing was fitted to."""
    keep_compiled()
    level, shots, seed = world
    dataset = play_season(facts, Options(), seed, plan_season(seed, shots), level, ORDINARY).dataset
    found = discover(dataset, BELIEVED, seed=seed)
    after, before = make_belief(found)[0], make_belief(replace(found, steps=()))[0]
    settings = plan_season(seed + 1, more)
    other = play_season(facts, Options(), seed + 1, settings, "L0", EXACT)
    still = play_season(facts, Options(scatter_scale=0.0), seed + 1, settings, "L0", EXACT)
    return {"name": AS_IS, "level": level, "shots": shots, "seed": seed, **_said(found),
            "before_m": off_m(facts, before, other), "after_m": off_m(facts, after, other),
            "scatter_m": float(np.nanstd(heights_m(other) - heights_m(still))), "belief": as_table(after)}


def run_changed(facts: Rig, world: tuple[Change, Line, bool]) -> Line:
    """A world (its change, home, whether since home) with one thing changed, against what an unmodified one left."""
    keep_compiled()
    change, home, compared = world
    level, shots, seed = home["level"], home["shots"], home["seed"]
    own = seed + 2 + zlib.crc32(change.name.encode()) % (APART - 2)
    options = Options(**change.options)
    dataset = play_season(facts, options, own, plan_season(own, shots), level, ORDINARY).dataset
    since = play_season(facts, Options(), seed, plan_season(seed, shots), level, ORDINARY).dataset
    found = discover(dataset, seed=own, belief=from_table(home["belief"], home["key"]),
                     since=since if compared else None)
    return {"name": change.name, "level": level, "shots": shots, "seed": seed, **_said(found)}


def _said(found: Investigation) -> Line:
    finding = msgspec.json.decode(make_json(found.finding))
    return {key: finding[key] for key in ("verdict", "sentence", "where", "what", "set", "also", "fit")} | {
        "found": finding["mismatch"]["found"], "p_value": finding["mismatch"]["p_value"]}


def main() -> int:
    args = _arguments()
    return fill_and_tell(args, partial(_run_all, args), make_tables)


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, Line]:
    """All worlds as they are, then, where asked for, those changed against what each left."""
    facts = load_config(SHIPPED).rig
    progress, levels = make_progress("worlds"), args.level.split(",")
    other = "" if args.unseen == UNSEEN else f"/{args.unseen} unseen"
    homes = {_key(AS_IS, level, args.shots, seed) + other: (level, args.shots, seed)
             for seed in (APART * (args.seed + number) for number in range(args.worlds)) for level in levels}
    lines = fill(path, homes, partial(run_as_is, facts, args.unseen), progress, args.processes)
    if args.what == AS_IS:
        return lines
    compared = {level: args.since or level == "L2" for level in levels}
    changed = {_key(change.name, *home) + "/since" * args.since: (change, lines[key], compared[home[0]])
               for key, home in homes.items()
               for change in seen_at(home[0]) if args.only is None or change.name in args.only.split(",")}
    return fill(path, changed, partial(run_changed, facts), progress, args.processes)


def _key(name: str, level: str, shots: int, seed: int) -> str:
    return f"{name}/{level}/{shots}/{seed}"


def _arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("--what", default=AS_IS, choices=(AS_IS, f"{AS_IS},changed"))
    parser.add_argument("--level", default="L1,L2")
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--unseen", type=int, default=UNSEEN, help="shots of the other session (%(default)s)")
    parser.add_argument("--worlds", type=int, default=10, help="of each kind")
    parser.add_argument("--seed", type=int, default=11, help="of the first number of world; the next has the next")
    parser.add_argument("--only", help="changes, comma-separated; else all")
    parser.add_argument("--since", action="store_true", help="without tracks, too, changes are since the as-is session")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
