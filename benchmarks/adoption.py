"""Do the gate and the aim improve when the simulation learns what it lacked?

    python -m benchmarks.adoption --worlds 2 --shots 300 --seed 71 --out FILE
    python -m benchmarks.adoption --table FILE
    python -m benchmarks.adoption --judge points --worlds 1 --shots 120 --seed 71 --out FILE

Judged by points, balls are aimed in the same world by what was believed, by what was found and by what is adopted
(benchmarks/adoption_points.py). Judged by gates:

Worlds are MuJoCo's with one thing changed each (truearc_proof.worlds.sampling_plan), or nothing. From a recorded
session of each, by telemetry and outcomes (L1), gates are trained in pairs that are alike in all but their physics:
the paper's (gravity, drag and lift, fitted), and the finding adopted from the same session. `ours`: truearc's gate,
which adds what it learns of the rest; `network`: the paper's, from the recorded shots and 900 simulated ones with its
lambda of 0.01; `network, even`: with a lambda of 1. All are put to another session of the same world, whose shots the
rule of launcher.toml would fire or hold. Pairs of worlds, not of shots, make the intervals. A line of FILE a
world; one that is there already is not run again. Development used seeds below 1000.
"""

import argparse
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.adoption_points import make_points_table, run_points
from benchmarks.adoption_table import make_table
from benchmarks.filling import fill_and_tell, parser_of
from benchmarks.unseen import off_m
from truearc.cli.common import SHIPPED, make_progress
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config, load_config
from truearc.robot.gate.contract import NOVELTY_LIMIT
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Shots
from truearc.sim.discover.adopt import make_belief
from truearc.sim.discover.investigate import discover
from truearc.sim.gate.model import fit_novelty
from truearc.sim.gate.train import OutcomeClasses, outcome_classes_of, train_physics_gate
from truearc.sim.infer.belief import Belief
from truearc.sim.paper.network import probabilities, split_heldout, training_rows
from truearc.sim.paper.synthetic import synthesise
from truearc.sim.paper.train_many import Job, train_many
from truearc.sim.statistics import figures_of
from truearc.sim.world.options import Options
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.world.season import ORDINARY, plan_season, play_season
from truearc_proof.worlds.sampling_plan import Change, seen_at

BELIEVED = ("gravity", "drag", "magnus")
LEVEL = "L1"
UNSEEN = 400                          # shots of the other session
APART = 1000                          # seeds of one number of world from the next's

SIMULATED, VALIDATION = 900, 0.25     # as truearc paper synth and paper train have them
LAMBDAS = {"network": 0.01, "network, even": 1.0}

Line = dict[str, Any]
Gate = Callable[[np.ndarray], np.ndarray]


def run(config: Config, more: int, world: tuple[Change, int, int]) -> Line:
    """One world (its change, shots, seed): what was found, and all gates' figures on the other session's `more`."""
    keep_compiled()
    change, shots, seed = world
    own = seed + zlib.crc32(change.name.encode()) % (APART - 1)
    seen, unseen = (play_season(config.rig, Options(**change.options), own + k, plan_season(own + k, count), LEVEL,
                                ORDINARY) for k, count in enumerate((shots, more)))
    found = discover(seen.dataset, BELIEVED, seed=own)
    beliefs = {"before": make_belief(replace(found, steps=()))[0]}
    if found.steps:                   # else both are the same, and so are their gates
        beliefs["after"] = make_belief(found)[0]
    finding, marks = found.finding, _inside(seen.dataset.shots, unseen.dataset.shots)
    line: Line = {"name": change.name, "shots": shots, "seed": seed, "found": finding.mismatch.found,
                  "verdict": finding.verdict, "adopted": make_belief(found)[1]["adopted"]}
    for name, belief in beliefs.items():
        gates = _gates(config.rig, belief, seen.dataset.shots, own)
        line[name] = {"off_m": off_m(config.rig, belief, unseen),
                      "gates": {kind: _judged(config, gate, marks) for kind, gate in gates.items()}}
    return {**line, "after": line.get("after", line["before"])}


def _gates(facts: Rig, belief: Belief, shots: Shots, seed: int) -> dict[str, Gate]:
    """What turns features [n, 3] into p [n, 2], of each kind, all learnt from these shots."""
    simulated = training_rows(synthesise(facts, belief, SIMULATED, shots, seed), "simulated")[0]
    learnt, validation = split_heldout(training_rows(shots, "recorded")[0], VALIDATION, seed)
    networks = train_many([Job(learnt, simulated, validation, weight, seed) for weight in LAMBDAS.values()])
    return {"ours": train_physics_gate(facts, belief, shots, seed)[0].probabilities,
            **{name: partial(probabilities, one.network) for name, one in zip(LAMBDAS, networks, strict=True)}}


def _inside(seen: Shots, unseen: Shots) -> OutcomeClasses:
    """Judged shots of the other session that are like recorded ones: elsewhere every gate holds."""
    marks = outcome_classes_of(unseen, "unseen")[0]
    known = fit_novelty(outcome_classes_of(seen, "seen")[0].features)(marks.features) <= NOVELTY_LIMIT
    return marks.take(np.flatnonzero(known & (marks.level >= 0)))


def _judged(config: Config, gate: Gate, marks: OutcomeClasses) -> Line:
    """Figures of the gate; what it fires, and what of that scores three points."""
    p, level = gate(marks.features), marks.level
    fired = p[:, 1] >= config.gate.threshold
    return {**figures_of(p, level)._asdict(), "brier": figures_of(p, level).brier, "ece": figures_of(p, level).ece,
            "fired": int(fired.sum()), "scored": int((level[fired] == 2).sum())}


def main() -> int:
    args = _arguments()
    return fill_and_tell(args, partial(_run_all, args), lambda lines: (
        make_points_table if "points" in lines[0] else make_table)(lines))


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, Line]:
    config = load_config(SHIPPED)
    other = "" if args.unseen == UNSEEN else f"/{args.unseen} unseen"
    jobs = {f"{change.name}/{args.shots}/{seed}{other}": (change, args.shots, seed)
            for seed in (APART * (args.seed + number) for number in range(args.worlds)) for change in seen_at(LEVEL)
            if args.only is None or change.name in args.only.split(",")}
    judge = partial(run, config, args.unseen) if args.judge == "gates" else partial(run_points, config.rig, apart=APART)
    return fill(path, jobs, judge, make_progress("worlds"), args.processes)


def _arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("--judge", choices=("gates", "points"), default="gates", help="by what (default gates)")
    parser.add_argument("--shots", type=int, default=300, help="recorded in each world")
    parser.add_argument("--unseen", type=int, default=UNSEEN, help="shots of the other session (%(default)s)")
    parser.add_argument("--worlds", type=int, default=2, help="of each change")
    parser.add_argument("--only", help="changes, comma-separated; else all")
    parser.add_argument("--seed", type=int, default=11, help="of the first number of world; the next has the next")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
