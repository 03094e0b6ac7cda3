"""The commands for the gate (`train`, `export`, `verify`, `serve`), and the process that answers the page's queries.

`python -m truearc.cli.gate FILE P [SPEED]` runs that process: P is the threshold of p(three), and SPEED is the free
speed of the motors in rad/s.
"""

import argparse
import os
import signal
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

import truearc as ta
from truearc.cli import common
from truearc.errors import InputError, load_bytes, save_whole
from truearc.model_export import NETWORK_TOLERANCE, PHYSICS_TOLERANCE
from truearc.robot.config.schema import Config

if TYPE_CHECKING:
    from truearc.robot.operator_ui.server import PageServer

NICE = 10                             # a ninth of the time of others that want the same core


def train_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--real", required=True, metavar="DIR", help="dataset of recorded shots")
    parser.add_argument("--coefficients", required=True, metavar="FILE",
                        help="coefficients.toml, as `truearc fit` (with the scatter), `truearc discover --adopt` or "
                             "`truearc paper fit` write it")
    parser.add_argument("--reliability", type=common.out_file, metavar="FILE",
                        help="picture of predicted against observed shares to write")
    common.add_accept(parser)
    parser.add_argument("--seed", type=common.number(int, 0), default=0, help="seed of split and first weights")
    parser.add_argument("-o", "--out", type=common.OutFolder(common.WEIGHTS), required=True, metavar="DIR",
                        help="weights directory to write")


def train(args: argparse.Namespace) -> int:
    """Train a gate on recorded shots: the fitted physics, a small learned correction, and a calibrated spread.

    All recorded shots are learned from; each fifth of the configurations is left out in turn to measure the gate on
    shots that it has not seen. The paper's network is `truearc paper train`.
    """
    belief, dataset = ta.load_belief(args.coefficients), ta.load_dataset(args.real)
    trained = ta.train_gate(dataset, belief, seed=args.seed, accept=args.accept,
                            progress=common.make_progress("train", args.quiet))
    for sentence in trained.left_out:
        print(sentence, file=sys.stderr)
    trained.save(args.out)
    print(trained)
    if args.reliability is not None and trained.folds is not None:
        from truearc.sim.report import make_png
        save_whole(args.reliability, make_png(trained.plot_reliability()))
        print(f"{args.reliability}: stated against true shares")
    print(f"{args.out}: the gate; next: truearc export {args.out} -o gate.onnx")
    return 0


def export_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("weights", metavar="DIR",
                        help="weights directory, as `truearc train` and `truearc paper train` write it")
    parser.add_argument("-o", "--out", type=common.out_file, required=True, metavar="FILE", help="ONNX file to write")


def export(args: argparse.Namespace) -> int:
    """Write trained weights as an ONNX file that carries its contract, domain and provenance."""
    from truearc.robot.gate import load_gate
    data = ta.export_weights(args.weights, args.out)
    print(f"{args.out}: {len(data)} bytes, sha256 {load_gate(args.out).sha256}")
    return 0


def verify_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="ONNX file, as `truearc export` writes it, or an aim file, as "
                        "`truearc aim --robot` does")
    parser.add_argument("--weights", metavar="DIR", help="the weights a gate was exported from; tolerance: "
                        f"{NETWORK_TOLERANCE:g} for a network, {PHYSICS_TOLERANCE:g} for a gate with physics")
    parser.add_argument("--data", metavar="DIR", action="append", default=[], help="datasets whose shots a gate is to "
                        "rate too")
    parser.add_argument("--belief", metavar="FILE", help="coefficients.toml that an aim file was made of")
    parser.add_argument("--rig", metavar="FILE", help="launcher.toml or rig.toml that an aim file is for")


def verify(args: argparse.Namespace) -> int:
    """Check a file for the robot: an exported gate, or an aim file.

    For a gate: its contract, its repeatability, and that rows rated alone and together agree. With --weights also that
    onnxruntime's p agrees with the trainer's own float64 within a tolerance: the graph of a gate with physics
    represents flights by a polynomial. For an aim file: that its set points score as much as the best that the
    simulator finds. Exit 1 if a check fails.
    """
    data = load_bytes(Path(args.file))
    if data.lstrip()[:1] == b"{":
        if b'"truearc.aim/' not in data:
            raise ta.InputError(f"{args.file}: neither an ONNX file nor an aim file; of weights give the file that "
                                "`truearc export` wrote, and their folder as --weights")
        return _verify_aim(args)
    common.refuse(args, ("--belief", "--rig"), "applies to an aim file only")
    found = ta.verify_gate(args.file, args.weights, {name: ta.load_dataset(name) for name in args.data})
    print(found)
    return 0 if found.passed else 1


def _verify_aim(args: argparse.Namespace) -> int:
    common.refuse(args, ("--weights", "--data"), "applies to a gate only")
    if not (args.belief and args.rig):
        raise ta.InputError(f"{args.file}: an aim file; --belief and --rig are needed to check it")
    check = ta.verify_aim(args.file, ta.load_belief(args.belief), common.load_any_rig(args.rig))
    print(f"{args.file}: {check}")
    return 0


def serve_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("gate", type=Path, metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--config", type=Path, metavar="FILE", help="launcher.toml, for its gate.threshold and its "
                        "wheels' free speed (default: the shipped threshold, and wheel speeds as shares alone)")
    parser.add_argument("--threshold", type=common.number(float, 0, 1), metavar="P",
                        help="p of full points from which the gate fires (default: the configuration's)")
    parser.add_argument("--port", type=common.number(int, 0, 65535), default=5809,
                        help="of the page; 0 picks a free one")
    parser.add_argument("--host", default="127.0.0.1", help="of the page; the default is this machine only")


def serve(args: argparse.Namespace) -> int:
    """Serve the operator page's map and sliders for a gate on this computer, without a robot; Ctrl-C ends it.

    It shows the gate's answer for a distance, a wheel speed and a hood angle. The file is checked as on the robot.
    """
    with make_server(args) as server:
        try:
            print(f"{server.url}  (Ctrl-C ends)", flush=True)
            server.serve_forever()
        except KeyboardInterrupt:
            print("ended")
    return 0


def make_server(args: argparse.Namespace) -> "PageServer":
    """Return the server that the arguments request; it does not serve yet. InputError if it cannot listen."""
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.config.schema import load_config
    from truearc.robot.gate import load_gate
    from truearc.robot.operator_ui.server import PageServer
    from truearc.robot.operator_ui.what_if import LAPTOP_RATE_PER_S, WhatIf
    gate, config = load_gate(args.gate), load_config(args.config or common.SHIPPED)
    threshold = config.gate.threshold if args.threshold is None else args.threshold
    free_speed_rad_s = config.rig.launcher.free_speed_rad_s if args.config else None
    what_if = WhatIf(gate, threshold, free_speed_rad_s, MonotonicClock(), LAPTOP_RATE_PER_S,
                     args.gate.name)
    try:
        return PageServer(args.host, args.port, None, what_if)
    except OSError as error:
        raise InputError(f"--host {args.host} --port {args.port}: {error.strerror or error}") from error


def make_command(gate: Path, config: Config) -> tuple[str, ...]:
    """Return the command line of the process that answers as the robot with that configuration does."""
    speed_rad_s = config.rig.launcher.free_speed_rad_s
    return (sys.executable, "-m", "truearc.cli.gate", str(gate), repr(config.gate.threshold),
            *(() if speed_rad_s is None else (repr(speed_rad_s),)))


def answer(gate: str, threshold: str, speed_rad_s: str = "") -> int:
    """Answer until standard input ends, at the lowest priority; return 2 if the gate cannot be used."""
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.gate import load_gate
    from truearc.robot.operator_ui.what_if import WhatIf, serve_questions
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # goes to the whole group; the page's process says when this one ends
    os.nice(NICE)
    try:
        what_if = WhatIf(load_gate(gate), float(threshold), float(speed_rad_s) if speed_rad_s else None,
                         MonotonicClock())
    except InputError as error:
        print(f"truearc: the operator's page has no gate: {error}", file=sys.stderr)
        return 2
    serve_questions(what_if, Connection(sys.stdin.fileno()))
    return 0


if __name__ == "__main__":
    sys.exit(answer(*sys.argv[1:]))
