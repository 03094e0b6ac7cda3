"""The work of `truearc demo`: every command of the loop in turn."""

import argparse
import json
import shutil
import sys
import time
from functools import partial
from pathlib import Path

from msgspec.structs import replace

from truearc import robot
from truearc.cli.discover.discover import adopt, tell
from truearc.cli.main import main as front_door
from truearc.cli.progress import make_progress
from truearc.cli.start.demo_files import Demo
from truearc.cli.start.demo_report import headline, save_report
from truearc.robot.config.schema import Config, InputError, load_config
from truearc.robot.recording.reader import TickReader
from truearc.sim.data.dataset import load_dataset
from truearc.sim.discover.api import Investigation, discover
from truearc.sim.parallel import fan_out
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.parts.target import BallResult

SHIPPED = Path(robot.__file__).parent / "launcher.toml"
TERMS = "gravity,drag,magnus,exit_efficiency"     # what our gate's physics consists of
MARK = ".truearc-demo"                # a folder with this in it was made by us and may be made again


def run_demo(args: argparse.Namespace) -> int:
    """Play the whole loop and write the report; args: those of `truearc demo`."""
    began = time.monotonic()
    demo = Demo(_fresh_folder(args.out), args.seed)
    _collect(demo, args.trials, args.quiet)
    _learn(demo, args.quiet)
    found = _explain(demo, args.quiet)
    _adopt(demo, args.quiet)
    _compare(demo, args.test_trials, args.quiet)
    report = save_report(demo, found)
    print("\n".join(["", *headline(demo), f"report: {report}   ({time.monotonic() - began:.0f} s)"]))
    return 0


def _fresh_folder(folder: Path) -> Path:
    if folder.is_file():
        raise InputError(f"{folder}: is a file")
    if folder.exists() and any(folder.iterdir()) and not (folder / MARK).exists():
        raise InputError(f"{folder}: is not empty and was not made by a demo; name another with --out")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / MARK).touch()
    return folder


def _collect(demo: Demo, trials: int, quiet: bool) -> None:
    _say(f"1 record: {trials} trials of the emulated robot; the driver marks each outcome")
    emulate(load_config(SHIPPED), demo.collect, trials, demo.seed, progress=make_progress("record", quiet))
    _run("shots", demo.collect, "-o", demo.shots, "--quiet")


def _learn(demo: Demo, quiet: bool) -> None:
    verbs: list[tuple[str, list[object]]] = [
        ("2 fit: the paper's grid of 1001 x 1001 coefficient pairs",
         ["paper", "fit", demo.shots, "-o", demo.coefficients, "--picture", demo.fit_map]),
        ("3 simulate: an even sample of the paper's grid of configurations",
         ["paper", "synth", "--rig", demo.shots / "rig.toml", "--coefficients", demo.coefficients, "-n", 900,
          "--exclude", demo.shots, "--seed", demo.seed, "-o", demo.simulated]),
        ("4 train: the paper's network and loss",
         ["paper", "train", "--real", demo.shots, "--sim", demo.simulated, "--seed", demo.seed, "-o",
          demo.network_weights]),
        ("", ["export", demo.network_weights, "-o", demo.network]),
        ("5 our gate: maximum a posteriori, then the physics inside the gate",
         ["fit", demo.shots, "--terms", TERMS, "-o", demo.belief]),
        ("", ["train", "--real", demo.shots, "--coefficients", demo.belief, "--seed", demo.seed,
              "-o", demo.weights]),
        ("", ["export", demo.weights, "-o", demo.gate]),
        ("", ["verify", demo.gate, "--weights", demo.weights, "--data", demo.shots]),
    ]
    for title, words in verbs:
        if title:
            _say(title)
        _run(*words, *(["--quiet"] if quiet else []))


def _compare(demo: Demo, trials: int, quiet: bool) -> None:
    """Three sessions of another seed, alike but for the gate, side by side on two cores."""
    _say(f"8 drive: the same {trials} trials without a gate, with the first one, and with that of what was found")
    config = walked_in(load_config(SHIPPED), demo.collect)
    sessions = [(demo.ungated, None, quiet), (demo.gated, demo.gate, True), (demo.after, demo.gate_after, True)]
    results = fan_out(partial(_drive, config, trials, demo.seed + 1), sessions, workers=2)
    for (session, *_), shots in zip(sessions, (demo.ungated_shots, demo.gated_shots, demo.after_shots), strict=True):
        _run("shots", session, "-o", shots, "--quiet")
    demo.truth.write_text(json.dumps([[one.fed_t_ns, one.z_m] for one in results[0]]), encoding="utf-8")
    for gate, ratings in ((demo.gate, demo.ratings), (demo.gate_after, demo.ratings_after),
                          (demo.network, demo.network_ratings)):
        _run("predict", "--gate", gate, demo.ungated_shots, "-o", ratings)
    for coefficients, heights in ((demo.coefficients, demo.heights_grid), (demo.belief, demo.heights),
                                  (demo.adopted, demo.heights_after)):
        _run("predict", demo.ungated_shots, "--coefficients", coefficients, "-o", heights)


def _drive(config: Config, trials: int, seed: int, job: tuple[Path, Path | None, bool]) -> list[BallResult]:
    session, gate, quiet = job
    return emulate(config, session, trials, seed, gate_path=gate, progress=make_progress("drive", quiet))


def walked_in(config: Config, session: Path) -> Config:
    """The configuration with the aim as the driver's marks left it at the end of a session."""
    walk = (0.0, 0.0, 0.0)
    for tick, _ in TickReader(session):
        walk = tick.memory.walk
    return replace(config, collect=replace(config.collect, walk_start=walk))


def _explain(demo: Demo, quiet: bool) -> Investigation:
    _say("6 discover: where do simulation and recordings disagree?")
    print(f"$ truearc discover {demo.shots} --json {demo.finding} --report {demo.finding_page} --adopt {demo.adopted} "
          f"--seed {demo.seed}")
    found = discover(load_dataset(demo.shots), seed=demo.seed, progress=make_progress("discover", quiet))
    print(adopt(found, str(demo.shots), str(demo.adopted)))
    tell(found, demo.shots.name, demo.finding, demo.finding_page)
    return found


def _adopt(demo: Demo, quiet: bool) -> None:
    _say("7 put it in: the same gate, trained on the same shots, with what was found in its physics")
    hush = ["--quiet"] if quiet else []
    _run("train", "--real", demo.shots, "--coefficients", demo.adopted, "--seed", demo.seed, "-o",
         demo.weights_after, *hush)
    _run("export", demo.weights_after, "-o", demo.gate_after, *hush)
    _run("verify", demo.gate_after, "--weights", demo.weights_after, "--data", demo.shots, *hush)


def _say(text: str) -> None:
    print(f"\n== {text}", flush=True)


def _run(*words: object) -> None:
    """One command, as anyone could type it."""
    line = [str(word) for word in words]
    print("$ truearc " + " ".join(line), flush=True)
    code = front_door(line)
    if code != 0:
        print(f"truearc demo: that step ended with exit code {code}", file=sys.stderr)
        raise SystemExit(code)
