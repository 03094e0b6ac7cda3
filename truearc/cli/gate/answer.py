"""The process that answers the operator page's questions to a gate: `python -m truearc.cli.gate.answer FILE P [SPEED]`

P: threshold of p(three); SPEED: free speed of the motors, rad/s. It gives way to every other process.
"""

import os
import signal
import sys
from multiprocessing.connection import Connection
from pathlib import Path

from truearc.errors import InputError
from truearc.robot.config.schema import Config

NICE = 10                             # a ninth of the time of others that want the same core


def make_command(gate: Path, config: Config) -> tuple[str, ...]:
    """Command line of the process that answers as the robot of that configuration does."""
    speed_rad_s = config.rig.launcher.free_speed_rad_s
    return (sys.executable, "-m", "truearc.cli.gate.answer", str(gate), repr(config.gate.threshold),
            *(() if speed_rad_s is None else (repr(speed_rad_s),)))


def main(gate: str, threshold: str, speed_rad_s: str = "") -> int:
    """Answer until standard input ends; return 2 where the gate cannot be used."""
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.gate.model import load_gate
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
    sys.exit(main(*sys.argv[1:]))
