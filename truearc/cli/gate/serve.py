"""Serve the operator page's map and sliders for a gate on this computer, without a robot; Ctrl-C ends it.

It answers what the gate would say of a distance, a wheel speed and a hood angle. The file is checked as the robot does.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from truearc.cli.common import SHIPPED, number
from truearc.errors import InputError

if TYPE_CHECKING:
    from truearc.robot.operator_ui.server import PageServer

EXAMPLE = "truearc serve gate.onnx"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("gate", type=Path, metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--config", type=Path, metavar="FILE", help="launcher.toml, for its gate.threshold and its "
                        "wheels' free speed (default: the shipped threshold, and wheel speeds as shares alone)")
    parser.add_argument("--threshold", type=number(float, 0, 1), metavar="P",
                        help="p(three) from which the gate fires (default: the configuration's)")
    parser.add_argument("--port", type=number(int, 0, 65535), default=5809, help="of the page; 0 picks a free one")
    parser.add_argument("--host", default="127.0.0.1", help="of the page; the default is this machine only")


def main(args: argparse.Namespace) -> int:
    """Return 0 once Ctrl-C has ended it."""
    with make_server(args) as server:
        try:
            print(f"{server.url}  (Ctrl-C ends)", flush=True)
            server.serve_forever()
        except KeyboardInterrupt:
            print("ended")
    return 0


def make_server(args: argparse.Namespace) -> "PageServer":
    """Return the server that the arguments ask for; it does not serve yet. InputError where it cannot listen."""
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.config.schema import load_config
    from truearc.robot.gate.model import load_gate
    from truearc.robot.operator_ui.server import PageServer
    from truearc.robot.operator_ui.what_if import LAPTOP_RATE_PER_S, WhatIf
    gate, config = load_gate(args.gate), load_config(args.config or SHIPPED)
    threshold = config.gate.threshold if args.threshold is None else args.threshold
    free_speed_rad_s = config.rig.launcher.free_speed_rad_s if args.config else None
    what_if = WhatIf(gate, threshold, free_speed_rad_s, MonotonicClock(), LAPTOP_RATE_PER_S)
    try:
        return PageServer(args.host, args.port, None, what_if)
    except OSError as error:
        raise InputError(f"--host {args.host} --port {args.port}: {error.strerror or error}") from error
