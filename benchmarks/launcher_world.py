"""What discovery makes of the MuJoCo world, which slips, droops and squeezes as the seed's simulation does not know.

    python benchmarks/launcher_world.py --what as-is,changed --level L1,L2 --worlds 10 --seed 1001 --out FILE
    python benchmarks/launcher_world.py --table FILE

as-is: an unmodified world, from the seed's belief (gravity, drag, magnus): is the mismatch found, where, by what names,
and how well does the adopted simulation foretell another session's heights at the plane, beside the world's own scatter
from shot to shot (the same shots with and without it) and beside the seed's belief, fitted.
changed: one thing changed (sim.prove.changes), asked against the belief adopted from the as-is session of the same
number. A line of FILE a world; one that is there already is not run again. Development used seeds below 1000.
"""

import argparse
import sys
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import robot
from doors.discover import keep_compiled
from doors.progress import make_progress
from robot.config import load_config
from robot.facts import Facts
from sim.belief import Belief, as_table, from_table
from sim.curve import before_the_shot
from sim.discover.adopt import make_belief
from sim.discover.discover import Investigation, discover
from sim.discover.finding import make_json
from sim.physics.shot import predict
from sim.prove.changes import Change, seen_at
from sim.prove.launcher_table import make_tables
from sim.prove.worldfile import append_line, lines_of, mend
from sim.world.options import Options
from sim.world.practice import plan_season
from sim.world.season import ORDINARY, Season, Sensors, play_season

BELIEVED = ("gravity", "drag", "magnus")
EXACT = Sensors(0.0, 0.0, 0.0)        # so that heights are missed for the simulation's sake alone
UNSEEN = 200                          # shots of the other session
APART = 1000                          # seeds of one number of world from the next's

Line = dict[str, Any]


def run_as_is(facts: Facts, level: str, shots: int, seed: int) -> Line:
    """An unmodified world: what was found, and RMS errors in m of heights in a session that nothing was fitted to."""
    dataset = play_season(facts, Options(), seed, plan_season(seed, shots), level, ORDINARY).dataset
    found = discover(dataset, BELIEVED, seed=seed)
    after, before = make_belief(found)[0], make_belief(replace(found, steps=()))[0]
    named = make_belief(replace(found, steps=tuple(step for step in found.steps if not step.unknown)))[0]
    settings = plan_season(seed + 1, UNSEEN)
    other = play_season(facts, Options(), seed + 1, settings, "L0", EXACT)
    still = play_season(facts, Options(scatter_scale=0.0), seed + 1, settings, "L0", EXACT)
    return {**_said(found), "before_m": _off_m(facts, before, other), "after_m": _off_m(facts, after, other),
            "scatter_m": float(np.nanstd(_height_m(other) - _height_m(still))), "belief": as_table(named)}


def run_changed(facts: Facts, level: str, shots: int, seed: int, change: Change, belief: Belief) -> Line:
    """A world with one thing changed, against what an unmodified one left."""
    own = seed + 2 + zlib.crc32(change.name.encode()) % (APART - 2)
    options = Options(**change.options)
    dataset = play_season(facts, options, own, plan_season(own, shots), level, ORDINARY).dataset
    return _said(discover(dataset, seed=own, belief=belief))


def _said(found: Investigation) -> Line:
    finding = msgspec.json.decode(make_json(found.finding))
    return {key: finding[key] for key in ("verdict", "sentence", "where", "what", "set", "also", "fit")} | {
        "found": finding["mismatch"]["found"], "p_value": finding["mismatch"]["p_value"]}


def _height_m(season: Season) -> np.ndarray:
    return np.array([np.nan if one.z_m is None else one.z_m for one in season.results])


def _off_m(facts: Facts, belief: Belief, season: Season) -> float:
    """RMS error of the heights that the belief foretells."""
    shots = season.dataset.shots
    around = before_the_shot(belief.curve, facts, shots)
    told = np.asarray(predict(facts, belief.coefficients, shots, circumstances=around).height_m)
    return float(np.sqrt(np.nanmean((_height_m(season) - told)**2)))


def main() -> int:
    args = _arguments()
    lines = {line["key"]: line for line in lines_of(Path(args.table or args.out))}
    if args.table is None:
        keep_compiled()
        mend(args.out)
        _run_all(args, lines)
    print(make_tables(list(lines.values())))
    return 0


def _run_all(args: argparse.Namespace, lines: dict[str, Line]) -> None:
    facts = load_config(Path(robot.__file__).parent / "launcher.toml").rig
    only, progress = args.only.split(",") if args.only else None, make_progress("worlds")
    todo = [(number, level, change) for number in range(args.worlds) for level in args.level.split(",")
            for change in (None, *(seen_at(level) if "changed" in args.what.split(",") else ()))
            if change is None or only is None or change.name in only]
    for count, (number, level, change) in enumerate(todo):
        seed, name = args.seed * APART + number * APART, "as-is" if change is None else change.name
        key, home = (f"{one}/{level}/{args.shots}/{seed}" for one in (name, "as-is"))
        if key in lines:
            continue
        progress(count / len(todo), key)
        said = (run_as_is(facts, level, args.shots, seed) if change is None else
                run_changed(facts, level, args.shots, seed, change, from_table(lines[home]["belief"], home)))
        lines[key] = {"key": key, "name": name, "level": level, "shots": args.shots, "seed": seed, **said}
        append_line(args.out, lines[key])
    progress(1.0, "done")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", default="as-is", help="as-is, or as-is,changed")
    parser.add_argument("--level", default="L1,L2")
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--worlds", type=int, default=10, help="of each kind")
    parser.add_argument("--seed", type=int, default=11, help="of the first number of world; the next has the next")
    parser.add_argument("--only", help="changes, comma-separated; else all")
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--out", metavar="FILE", help="where worlds are kept, a line each")
    place.add_argument("--table", metavar="FILE", help="print what is there, run nothing")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
