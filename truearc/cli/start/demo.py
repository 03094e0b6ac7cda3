"""Play the whole loop on the emulated robot, and write one report.

Record, fit, simulate, train, export, verify; say where simulation and recordings disagree, and put that into the
simulation; drive with the gate of before, with that of after, and without one.
"""

import argparse
import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import truearc as ta
from truearc.cli.common import SHIPPED, make_progress, number, write_out
from truearc.cli.outputs import OutFolder
from truearc.cli.start.demo_files import Demo
from truearc.robot.config.schema import Config, load_config

if TYPE_CHECKING:
    from truearc.sim.world.parts.target import BallResult

EXAMPLE = "truearc demo --out report"
FEWEST = 30
SIMULATED = 900                       # shots that the paper's network learns from, too
TERMS = ("gravity", "drag", "magnus", "exit_efficiency")      # what our gate's physics consists of
MARK = ".truearc-demo"                # a folder with this in it was made by us and may be made again


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=OutFolder(mark=MARK), default=Path("report"),
                        help="folder for the report and all it rests on")
    parser.add_argument("--trials", type=number(int, FEWEST), default=120,
                        help=f"trials recorded to learn from, at least {FEWEST}")
    parser.add_argument("--test-trials", type=number(int, FEWEST), default=120, help="trials of each session driven")
    parser.add_argument("--seed", type=number(int, 0), default=2026, help="seed of everything drawn")


def main(args: argparse.Namespace) -> int:
    from truearc.cli.start.demo_report import headline, save_report
    began = time.monotonic()
    demo = Demo(_marked_folder(args.out), args.seed)
    _collect(demo, args.trials, args.quiet)
    _learn(demo, args.quiet)
    found = _explain(demo, args.quiet)
    _say("7 put it in: the same gate, trained on the same shots, with what was found in its physics")
    _train_gate(demo, ta.load_dataset(demo.shots), demo.adopted, demo.weights_after, demo.gate_after, args.quiet)
    _compare(demo, args.test_trials, args.quiet)
    report = save_report(demo, found.investigation)
    print("\n".join(["", *headline(demo), f"report: {report}   ({time.monotonic() - began:.0f} s)"]))
    return 0


def _marked_folder(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    return folder


def _collect(demo: Demo, trials: int, quiet: bool) -> None:
    _say(f"1 record: {trials} trials of the emulated robot; the driver marks each outcome")
    ta.emulate(load_config(SHIPPED), demo.collect, trials, demo.seed, progress=make_progress("record", quiet))
    _save_shots(demo.collect, demo.shots)


def _save_shots(session: Path, out: Path) -> "ta.Dataset":
    """The session's shots, written as a dataset."""
    dataset = ta.shots_from_sessions([session], out.name)
    ta.save_dataset(out, dataset)
    print(dataset.lines()[0])
    return ta.load_dataset(out)


def _learn(demo: Demo, quiet: bool) -> None:
    from truearc.sim.report import make_png
    shots = ta.load_dataset(demo.shots)
    _say("2 fit: the paper's grid of 1001 x 1001 coefficient pairs")
    grid = ta.fit(shots, method="grid", progress=make_progress("fit", quiet))
    grid.belief.save(demo.coefficients)
    demo.fit_map.write_bytes(make_png(grid.plot()))
    print(grid)
    _say("3 simulate: an even sample of the paper's grid of configurations")
    made = ta.paper.write_synthetic(demo.simulated, shots.rig, demo.coefficients, SIMULATED, exclude=shots,
                                    seed=demo.seed, progress=make_progress("synth", quiet))
    print(ta.paper.say_synthetic(demo.simulated, made))
    _say("4 train: the paper's network and loss")
    network = ta.paper.train_network(shots, ta.load_dataset(demo.simulated), coefficients=grid.belief.coefficients,
                                     seed=demo.seed, progress=make_progress("train", quiet))
    network.save(demo.network_weights)
    print(network)
    _export(demo.network_weights, demo.network)
    _say("5 our gate: maximum a posteriori, then the physics inside the gate")
    fit = ta.fit(shots, TERMS, progress=make_progress("fit", quiet))
    fit.belief.save(demo.belief)
    print(fit)
    _train_gate(demo, shots, demo.belief, demo.weights, demo.gate, quiet)


def _train_gate(demo: Demo, shots: "ta.Dataset", belief: Path, weights: Path, gate: Path, quiet: bool) -> None:
    """Train, export, and check the file against its trainer; InputError where a check fails."""
    training = ta.train_gate(shots, ta.load_belief(belief), seed=demo.seed, progress=make_progress("train", quiet))
    training.save(weights)
    print(training)
    _export(weights, gate)
    found = ta.verify_gate(gate, weights, {str(demo.shots): shots})
    print(found)
    if not found.passed:
        raise ta.InputError(f"{gate}: not what was trained")


def _export(weights: Path, gate: Path) -> None:
    print(f"{gate}: {len(ta.export_weights(weights, gate))} bytes")


def _compare(demo: Demo, trials: int, quiet: bool) -> None:
    """Three sessions of another seed, alike except in the gate, side by side on two cores."""
    _say(f"8 drive: the same {trials} trials without a gate, with the first one, and with that of what was found")
    config = walked_in(load_config(SHIPPED), demo.collect)
    sessions = [(demo.ungated, None, quiet), (demo.gated, demo.gate, True), (demo.after, demo.gate_after, True)]
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        results = list(pool.map(partial(_drive, config, trials, demo.seed + 1), sessions))
    ungated, *_ = (_save_shots(session, shots) for (session, *_), shots in zip(
        sessions, (demo.ungated_shots, demo.gated_shots, demo.after_shots), strict=True))
    demo.truth.write_text(json.dumps([[one.fed_t_ns, one.z_m] for one in results[0]]), encoding="utf-8")
    for gate, ratings in ((demo.gate, demo.ratings), (demo.gate_after, demo.ratings_after),
                          (demo.network, demo.network_ratings)):
        write_out(ratings, ta.predict(ungated, gate=gate).to_csv())
    for coefficients, heights in ((demo.coefficients, demo.heights_grid), (demo.belief, demo.heights),
                                  (demo.adopted, demo.heights_after)):
        write_out(heights, ta.predict(ungated, ta.load_belief(coefficients)).to_csv())


def _drive(config: Config, trials: int, seed: int, job: tuple[Path, Path | None, bool]) -> "list[BallResult]":
    session, gate, quiet = job
    return ta.emulate(config, session, trials, seed, gate_path=gate, progress=make_progress("drive", quiet))


def walked_in(config: Config, session: Path) -> Config:
    """The configuration with the aim as the driver's marks left it at the end of a session."""
    from msgspec.structs import replace
    walk = (0.0, 0.0, 0.0)
    for tick in ta.Recording(session):
        walk = tick.memory.walk
    return replace(config, collect=replace(config.collect, walk_start=walk))


def _explain(demo: Demo, quiet: bool) -> "ta.Finding":
    from truearc.sim.discover.report.finding_text import say_adopted
    _say("6 discover: where do simulation and recordings disagree?")
    found = ta.discover(ta.load_dataset(demo.shots), seed=demo.seed, progress=make_progress("discover", quiet))
    belief = found.adopt()
    belief.save(demo.adopted)
    write_out(demo.finding, found.to_json())
    found.to_html(demo.finding_page)
    print(found)
    print(say_adopted(found.record, belief.provenance))
    return found


def _say(text: str) -> None:
    print(f"\n== {text}", flush=True)
