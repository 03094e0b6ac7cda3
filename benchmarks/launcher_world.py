"""Discovery on the MuJoCo world, whose slip, droop and compression the paper's simulation lacks.

    python -m benchmarks.launcher_world --level L1,L2 --worlds 10 --seed 1001 --out FILE
    python -m benchmarks.launcher_world --table FILE

In an unmodified world, with the paper's baseline (gravity, drag, magnus): is the mismatch found, in which stage, by
which terms, and how well does the adopted simulation forecast another session's heights at the plane, beside the
world's shot-to-shot scatter (the same shots with and without it) and beside the fitted baseline. World number N has the
seed 1000 N; development used seeds below 1000.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np

from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.cli.common import SHIPPED
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import load_config
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover, make_belief
from truearc.sim.infer.belief import Belief, before_the_shot
from truearc.sim.physics.simulate import predict
from truearc.sim.world.options import Options
from truearc.sim.world.world import Season
from truearc_proof.table import Table
from truearc_proof.world.season import ORDINARY, Sensors, plan_season, play_season

BELIEVED = ("gravity", "drag", "magnus")
EXACT = Sensors(0.0, 0.0, 0.0)        # so that heights are missed for the simulation's sake alone
APART = 1000                          # seeds of one number of world from the next's
TARGET = 1.5                          # times the world's own scatter, for the adopted simulation's heights
HEADER = ("level", "seed", "p-value", "verdict", "stage", "names", "heights off before", "adopted", "own scatter",
                "ratio")


Job = tuple[str, int, int, int]       # level, shots, seed, and shots of the other session


def heights_m(season: Season) -> np.ndarray:
    """Where each ball crossed the target's plane [n], in m above the floor; NaN where it fell before it."""
    return np.array([np.nan if one.z_m is None else one.z_m for one in season.results])


def off_m(facts: Rig, belief: Belief, season: Season) -> float:
    """Return the RMS error in m of the heights forecast by the belief from each shot's readings."""
    shots = season.dataset.shots
    around = before_the_shot(belief.curves, facts, shots)
    told = np.asarray(predict(facts, belief.coefficients, shots, circumstances=around).height_m)
    return float(np.sqrt(np.nanmean((heights_m(season) - told)**2)))


def run(facts: Rig, job: Job) -> Line:
    """What was found, and RMS errors in m of heights in a session that nothing was fitted to."""
    keep_compiled()
    level, shots, seed, unseen = job
    dataset = play_season(facts, Options(), seed, plan_season(seed, shots), level, ORDINARY).dataset
    found = discover(dataset, BELIEVED, seed=seed)
    after, before = make_belief(found)[0], make_belief(replace(found, steps=()))[0]
    settings = plan_season(seed + 1, unseen)
    other = play_season(facts, Options(), seed + 1, settings, "L0", EXACT)
    still = play_season(facts, Options(scatter_scale=0.0), seed + 1, settings, "L0", EXACT)
    finding = msgspec.json.decode(make_json(found.finding))
    return {"level": level, "shots": shots, "seed": seed,
            **{key: finding[key] for key in ("verdict", "sentence", "where", "what", "set", "also", "fit")},
            "found": finding["mismatch"]["found"], "p_value": finding["mismatch"]["p_value"],
            "before_m": off_m(facts, before, other), "after_m": off_m(facts, after, other),
            "scatter_m": float(np.nanstd(heights_m(other) - heights_m(still)))}


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: one row a world."""
    lines = sorted(lines, key=lambda one: (one["level"], one["seed"]))
    rows = [[one["level"], str(one["seed"]), f"{one['p_value']:.2g}", one["verdict"], str(one["where"]["stage"]),
             ", ".join(map(_name, (one, *one["also"]))),
             *(f"{one[name]:.3f} m" for name in ("before_m", "after_m", "scatter_m")),
             f"{one['after_m'] / one['scatter_m']:.2f}"] for one in lines]
    good = sum(one["after_m"] <= TARGET * one["scatter_m"] for one in lines)
    launch = sum(one["where"]["stage"] == "launch" for one in lines)
    return "\n".join([Table("As it is", HEADER, rows).markdown(), "",
                      f"Adopted within {TARGET} x the own scatter: {good} of {len(lines)}; placed at the launch: "
                      f"{launch} of {len(lines)}."])


def _name(effect: Line) -> str:
    """The first term of an effect with its amplitude, or "unexplained effect"."""
    if not effect["set"] or not effect["what"]:
        return "unexplained effect"
    size = next(iter(effect["what"][0]["parameters"].values()))
    return f"{effect['what'][0]['term']} {size['value']:.3g} {size['unit']}"


def main() -> int:
    args = read_args(__doc__, level="L1,L2", shots=300, unseen=(200, "shots of the other session"),
                     worlds=(10, "of each kind"), seed=(11, "of the first number of world; the next has the next"))

    seeds = [APART * (args.seed + number) for number in range(args.worlds)]
    return fill_and_tell(args, lambda: {f"{level}/{args.shots}/{seed}": (level, args.shots, seed, args.unseen)
                                        for seed in seeds for level in args.level.split(",")},
                         partial(run, load_config(SHIPPED).rig), make_table)


if __name__ == "__main__":
    sys.exit(main())
