"""What discovery makes of the MuJoCo world, which slips, droops and squeezes as the seed's simulation does not know.

    python benchmarks/launcher_world.py --level L1,L2 --shots 300 --worlds 5 --seed 11 --out FILE

An unmodified world, from the seed's belief (gravity, drag, magnus): is the mismatch found, where, by what names, and
how well does the adopted simulation foretell another session's heights at the plane, beside the world's own scatter
from shot to shot (the same shots with and without it) and beside the seed's belief, fitted. A line of FILE a world; one
that is there already is not run again. Development used seeds below 1000.
"""

import argparse
import os
import sys
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
from sim.belief import Belief
from sim.discover.adopt import make_belief
from sim.discover.discover import Investigation, discover
from sim.discover.finding import make_json
from sim.physics.shot import predict
from sim.world.options import Options
from sim.world.practice import plan_season
from sim.world.season import ORDINARY, Season, Sensors, play_season

BELIEVED = ("gravity", "drag", "magnus")
EXACT = Sensors(0.0, 0.0, 0.0)        # so that heights are missed for the simulation's sake alone
UNSEEN = 200                          # shots of the other session
TARGET = 1.5                          # times the world's own scatter


def run(level: str, shots: int, seed: int) -> dict[str, Any]:
    """One world: what was found, and RMS errors in m of heights in a session that nothing was fitted to."""
    facts = load_config(Path(robot.__file__).parent / "launcher.toml").rig
    dataset = play_season(facts, Options(), seed, plan_season(seed, shots), level, ORDINARY).dataset
    found = discover(dataset, BELIEVED, seed=seed)
    after, _ = make_belief(found)
    before, _ = make_belief(replace(found, steps=()))
    settings = plan_season(seed + 1, UNSEEN)
    other = play_season(facts, Options(), seed + 1, settings, "L0", EXACT)
    still = play_season(facts, Options(scatter_scale=0.0), seed + 1, settings, "L0", EXACT)
    own = _height_m(other) - _height_m(still)
    return {"key": f"{level}/{shots}/{seed}", "level": level, "shots": shots, "seed": seed, **_said(found),
            "before_m": _rms(_height_m(other) - _told(facts, before, other)),
            "after_m": _rms(_height_m(other) - _told(facts, after, other)),
            "scatter_m": float(np.nanstd(own))}


def _said(found: Investigation) -> dict[str, Any]:
    finding = msgspec.json.decode(make_json(found.finding))
    return {key: finding[key] for key in ("verdict", "sentence", "where", "what", "also", "fit")} | {
        "found": finding["mismatch"]["found"], "p_value": finding["mismatch"]["p_value"]}


def _height_m(season: Season) -> np.ndarray:
    return np.array([np.nan if one.z_m is None else one.z_m for one in season.results])


def _told(facts: Facts, belief: Belief, season: Season) -> np.ndarray:
    return np.asarray(predict(facts, belief.coefficients, season.dataset.shots).height_m)


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))


def tell(lines: list[dict[str, Any]]) -> str:
    """One row a world."""
    rows = ["| level | seed | found | verdict | stage | names | heights before | adopted | own scatter | ratio |",
            "|---|---|---|---|---|---|---|---|---|---|"]
    for one in lines:
        ratio = one["after_m"] / one["scatter_m"]
        rows.append(f"| {one['level']} | {one['seed']} | p = {one['p_value']:.2g} | {one['verdict']} | "
                    f"{one['where']['stage']} | {', '.join(_names(one))} | {one['before_m']:.3f} m | "
                    f"{one['after_m']:.3f} m | {one['scatter_m']:.3f} m | {ratio:.2f} |")
    good = sum(one["after_m"] <= TARGET * one["scatter_m"] for one in lines)
    return "\n".join([*rows, "", f"within {TARGET} x the world's own scatter: {good} of {len(lines)} worlds"])


def _names(one: dict[str, Any]) -> list[str]:
    """Names with amplitudes, or what there is instead."""
    parts = []
    for each in ({"what": one["what"], "set": None if one["verdict"] == "unknown" else True}, *one["also"]):
        if not each["set"] or not each["what"]:
            parts.append("something without a name")
            continue
        size = next(iter(each["what"][0]["parameters"].values()))
        parts.append(f"{each['what'][0]['term']} {size['value']:.3g} {size['unit']}")
    return parts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--level", default="L1,L2")
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--worlds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=11, help="of the first world; the next is two more")
    parser.add_argument("--out", required=True, metavar="FILE")
    args = parser.parse_args()
    keep_compiled()
    lines = _lines(Path(args.out))
    todo = [(level, args.seed + 2 * k) for k in range(args.worlds) for level in args.level.split(",")
            if f"{level}/{args.shots}/{args.seed + 2 * k}" not in {one["key"] for one in lines}]
    progress = make_progress("worlds")
    for number, (level, seed) in enumerate(todo):
        progress(number / len(todo), f"{number} of {len(todo)} done")
        lines.append(run(level, args.shots, seed))
        _append(args.out, msgspec.json.encode(lines[-1]) + b"\n")
    progress(1.0, "done")
    print(tell(sorted(lines, key=lambda one: (one["level"], one["seed"]))))
    return 0


def _lines(path: Path) -> list[dict[str, Any]]:
    return [msgspec.json.decode(line) for line in path.read_bytes().splitlines()] if path.is_file() else []


def _append(path: str, data: bytes) -> None:
    with open(path, "ab") as file:
        file.write(data)
        os.fsync(file.fileno())


if __name__ == "__main__":
    sys.exit(main())
