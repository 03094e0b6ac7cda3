"""Thousands of datasets at once: flights of many worlds in one JAX call, worlds fanned out over processes or a cluster.

    python -m benchmarks.scale --worlds 10000 --shots 100 --seed 900 --out FILE [--scheduler ADDRESS]
    python -m benchmarks.scale --worlds 200 --discover --out FILE
    python -m benchmarks.scale --table FILE

A screen: the baseline is fitted to each world by flights and steps as in `fit`, but from the usual start alone; then
all terms are tested together at 5 % with discovery's scores and sign flips, and the largest evidence after one step is
the name. It neither looks along covariates nor refits names, so it is a part of the work of `discover`, which
--discover asks about the same worlds. Flights run where JAX runs: on a GPU all worlds of a job at once, on a CPU one
after another within a call. A line of FILE is a job of WORLDS worlds; none is run again. Development worlds: none is
sealed.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import lax

from benchmarks.filling import fill_and_tell, parser_of
from truearc.cli.common import make_progress
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.detect.battery import TERMS
from truearc.sim.discover.detect.score_test import Scores, efficient_scores, judge
from truearc.sim.discover.finding import FALSE_ALARM
from truearc.sim.discover.investigate import discover
from truearc.sim.discover.select.terms import one_step
from truearc.sim.infer.fit import moved, objective, step_within, usual_spot
from truearc.sim.infer.likelihood.data import Intake, take_in
from truearc.sim.infer.likelihood.forward_model import Chain, Prediction, ShotBatch, see_slopes
from truearc.sim.infer.likelihood.layout import LinearizationPoint, ParameterLayout, groups_of, lay_out, only_shared
from truearc.sim.infer.likelihood.linearization import Linearization, linearise, multiply_out
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.intervals import wilson
from truearc.sim.report import make_png, new_panels
from truearc.sim.tables import make_text
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.scoring.score_world import right_names
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import BELIEVED, make_world
from truearc_proof.worlds.sampling_plan import NUMPY, Drawn, draw_round

WORLDS = 50                           # of a job
ROUNDS, INNER, FARTHEST = 8, 8, 1.0   # flights, steps between two flights, usual sizes that a step may go
HALVINGS = 6
SETTLED = 0.1                         # standard errors that the last step may still go
DRAWS = 999
UNCHANGED = ("clean", "dirty")
Array = np.ndarray
Line = dict[str, Any]


@dataclass
class World:
    """A dataset on its way to the top."""

    drawn: Drawn
    dataset: Dataset
    intake: Intake
    whole: ParameterLayout
    spot: LinearizationPoint
    gain: float = np.inf

    @property
    def shared(self) -> ParameterLayout:
        return only_shared(self.whole)


def run(level: str, asked: bool, worlds: Sequence[Drawn]) -> Line:
    """Screen the worlds of a job; asked: of `discover`, too."""
    keep_compiled()
    clock = {"make": 0.0, "fly": 0.0, "rest": 0.0}
    began = time.process_time()
    datasets = [shoot(make_world(one.effects, level, one.shots, one.seed, one.dirt)) for one in worlds]
    clock["make"] = time.process_time() - began
    began = time.process_time()
    taken = [_prepare(drawn, dataset) for drawn, dataset in zip(worlds, datasets, strict=True)]
    for _ in range(ROUNDS):
        for one, flown in zip(taken, fly_all(taken, [one.shared for one in taken], clock), strict=True):
            _climb(one, flown)
    said = [screen(one, flown) for one, flown in
            zip(taken, fly_all(taken, [one.whole for one in taken], clock), strict=True)]
    clock["rest"] = time.process_time() - began - clock["fly"]
    if asked:
        began = time.process_time()
        for line, dataset in zip(said, datasets, strict=True):
            finding = discover(dataset, seed=0).finding
            line |= {"discover": finding.mismatch.found, "set": list(finding.set or ())}
        clock["discover"] = time.process_time() - began
    return {"level": level, "shots": worlds[0].shots, "clock": clock, "worlds": said}


def _prepare(drawn: Drawn, dataset: Dataset) -> World:
    dataset = dataset.in_order()
    intake = take_in(dataset)
    layout = replace(lay_out(intake, BELIEVED, groups_of(dataset.shots, intake.rows)), steady=True)
    return World(drawn, dataset, intake, layout, usual_spot(intake, layout))


def fly_all(worlds: Sequence[World], layouts: Sequence[ParameterLayout],
            clock: dict[str, float]) -> list[Linearization]:
    """What `fly` gives, of all worlds in one call, without how the spread changes with the inputs."""
    chain = layouts[0].chain
    assert all(one.chain == chain for one in layouts)
    first = len(chain.slots)
    wanted = sorted({int(k) for one in layouts for k in one.inputs} | set(range(first, first + chain.deviates)))
    basis = np.zeros((chain.size, len(wanted)))
    basis[wanted, np.arange(len(wanted))] = 1.0
    most = max(len(one.intake.rows) for one in worlds)
    lanes = jax.tree.map(lambda *parts: np.stack(parts), *(_padded(one.intake.lanes, len(one.intake.rows), most)
                                                          for one in worlds))
    began = time.process_time()
    seen, slopes = jax.tree.map(np.asarray, _see_all(chain, lanes, np.stack([one.spot.values for one in worlds]),
                                                     layouts[0].edges_s, basis))
    clock["fly"] += time.process_time() - began
    found = []
    for k, (one, layout) in enumerate(zip(worlds, layouts, strict=True)):
        n = len(one.intake.rows)
        columns = [wanted.index(int(j)) for j in (*layout.inputs, *range(first, first + chain.deviates))]
        mine: Prediction = jax.tree.map(lambda part, k=k, n=n: part[k, :n], seen)
        by: Prediction = jax.tree.map(lambda part, k=k, n=n, c=columns: part[k, :n][..., c], slopes)
        exits, tracks = multiply_out(one.intake, mine, by, one.spot.deviates)
        found.append(Linearization(one.spot, mine, by, exits, tracks, np.zeros((n, len(layout.inputs)))))
    return found


def _padded(lanes: ShotBatch, n: int, most: int) -> ShotBatch:
    """Lanes [most], the first n its own, with what all share written out."""
    rows = np.resize(np.arange(n), most)
    padded: ShotBatch = jax.tree.map(lambda part: np.asarray(part)[rows] if np.ndim(part) else np.full(most, part),
                                     lanes)
    return padded


@partial(jax.jit, static_argnums=0)
def _see_all(chain: Chain, lanes: ShotBatch, points: Array, edges_s: Array,
             basis: Array) -> tuple[Prediction, Prediction]:
    """Of worlds [w, ...]: on a CPU, whose caches a world fills, one after another."""
    deviates = np.zeros((lanes.distance_m.shape[1], chain.deviates))

    def see(one: tuple[ShotBatch, Array]) -> tuple[Prediction, Prediction]:
        return see_slopes(chain, *one, deviates, edges_s, basis)

    flown: tuple[Prediction, Prediction] = (lax.map(see, (lanes, points)) if jax.default_backend() == "cpu" else
                                            jax.vmap(see)((lanes, points)))
    return flown


def _climb(one: World, flown: Linearization) -> None:
    """Steps with flights linear about where they were flown."""
    layout = one.shared
    usual = np.array([column.usual for column in layout.columns])
    free = np.full(len(layout.columns), True)
    evidence, _ = linearise(one.intake, layout, one.spot, flown)
    for number in range(INNER):
        step, gain = step_within(layout, one.spot, evidence, free)
        one.gain = gain if number == 0 else one.gain         # where it was flown: what is still to be had
        if gain < SETTLED**2 / 20.0 or not np.isfinite(step).all():
            return
        step = step * min(1.0, FARTHEST / max(np.abs(step / usual).max(), 1e-300))
        here = objective(evidence, layout)
        for halving in range(HALVINGS):
            tried = moved(layout, one.spot, step * 0.5**halving)
            there, _ = linearise(one.intake, layout, tried, flown)
            if objective(there, layout) >= here:
                one.spot, evidence = tried, there
                break
        else:
            return


def screen(one: World, flown: Linearization) -> Line:
    """The test of all terms, and the name."""
    evidence, _ = linearise(one.intake, one.whole, one.spot, flown)
    scores = term_scores(evidence, len(one.dataset.shots))
    judged = judge(scores, [TERMS] * scores.psi.shape[1], {TERMS: 1.0}, DRAWS, 0, lambda done, note: None)
    best = max(one_step(evidence)[0], key=lambda term: term.nats)
    return {"kind": one.drawn.kind, "right": sorted(right_names(one.drawn)), "name": best.name.partition(".")[0],
            "found": bool(judged.p_any <= FALSE_ALARM), "settled": bool(one.gain < 0.5 * SETTLED**2)}


def term_scores(evidence: ScoreTable, shots: int) -> Scores:
    """Of every term that the shots can test."""
    columns = [k for k in range(evidence.first_shared) if evidence.columns[k].kind == "term"]
    parts = [efficient_scores(evidence, k, np.ones((len(evidence.rows), 1)), evidence.rows, shots) for k in columns]
    every = Scores(*(np.concatenate([getattr(part, name) for part in parts], axis=-1)
                     for name in ("psi", "kappa", "stretch", "kept")))
    return every.take(np.flatnonzero(every.kept))


def make_table(lines: Sequence[Line]) -> str:
    """Alarms, power, names and what each part costs; beside `discover` where it was asked."""
    worlds = [one for line in lines for one in line["worlds"]]
    shots = sum(line["shots"] * len(line["worlds"]) for line in lines)
    changed = [one for one in worlds if one["kind"] not in UNCHANGED]
    rows = [(f"alarms, {kind}", *_share([one["found"] for one in worlds if one["kind"] == kind])) for kind in UNCHANGED]
    rows += [("found", *_share([one["found"] for one in changed])),
             ("name right, of what was found and a term has",
              *_share([one["name"] in one["right"] for one in changed if one["found"] and one["right"]])),
             ("fits that settled", *_share([one["settled"] for one in worlds]))]
    if asked := [one for one in worlds if "discover" in one]:
        rows += [("as discover: found or not", *_share([one["found"] == one["discover"] for one in asked])),
                 ("name in discover's set, of both found",
                  *_share([one["name"] in one["set"] for one in asked if one["found"] and one["set"]]))]
    cost = {part: 1e3 * sum(line["clock"].get(part, 0.0) for line in lines) / shots
            for part in ("make", "fly", "rest", "discover")}
    costs = ", ".join(f"{part} {value:.3f}" for part, value in cost.items() if value)
    return "\n".join([f"{len(worlds)} worlds, {shots} shots; processor time in ms a shot: {costs}",
                      *make_text(("", "share", "of"), rows, right=(1, 2))])


def _share(hits: Sequence[bool]) -> tuple[str, str]:
    return (f"{np.mean(hits):.3f}" if hits else "-"), str(len(hits))


def draw(path: str, lines: Sequence[Line]) -> None:
    """Of the worlds with one effect of the catalogue: the share found, and named right after one step; 95 %."""
    worlds = [world for line in lines for world in line["worlds"] if world["kind"] == "one"]
    names = sorted({world["right"][0] for world in worlds},
                   key=lambda name: np.mean([world["found"] for world in worlds if world["right"][0] == name]))
    figure, (axes,) = new_panels(7.0, 0.24 * len(names) + 1.0)
    for offset, colour, label, hit in ((0.15, "#c65d1e", "found", lambda world: world["found"]), (
            -0.15, "#1f5aa6", "found, and named right after one step",
            lambda world: world["found"] and world["name"] in world["right"])):
        for place, name in enumerate(names):
            hits = [hit(world) for world in worlds if world["right"][0] == name]
            low, high = wilson(sum(hits), len(hits))
            axes.plot([low, high], [place + offset] * 2, color=colour, linewidth=1.2)
            axes.plot(np.mean(hits), place + offset, "o", color=colour, markersize=3.5,
                      label=label if place == 0 else None)
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.set_xlabel(f"share of worlds, 95 %; {len(worlds)} worlds with one effect")
    axes.set_xlim(-0.01, 0.7)
    axes.legend(loc="lower right", frameon=False)
    Path(path).write_bytes(make_png(figure))


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--level", choices=("L0", "L1"), default="L1")
    parser.add_argument("--worlds", type=int, default=10000)
    parser.add_argument("--shots", type=int, default=100)
    parser.add_argument("--seed", type=int, default=900)
    parser.add_argument("--discover", action="store_true", help="ask `discover` about each world, too")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster, such as tcp://host:8786")
    parser.add_argument("--picture", metavar="FILE", help="draw which hidden effects were found")
    args = parser.parse_args()

    def tell(lines: Sequence[Line]) -> str:
        if args.picture:
            draw(args.picture, lines)
        return make_table(lines)

    return fill_and_tell(args, partial(_run_all, args), tell)


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, Line]:
    drawn = draw_round(args.seed, args.worlds, args.level, args.shots, (NUMPY,))
    jobs = {f"{args.seed}/{args.level}/{args.shots}/{args.worlds}/{first}": drawn[first:first + WORLDS]
            for first in range(0, len(drawn), WORLDS)}
    return fill(path, jobs, partial(run, args.level, args.discover), make_progress("jobs"), args.processes,
                args.scheduler)


if __name__ == "__main__":
    sys.exit(main())
