"""Run the launcher on its real wires and record it; ends on Ctrl-C or SIGTERM with the motors idle."""

import argparse
from pathlib import Path

from truearc.cli.common import number
from truearc.robot.config.overrides import add_port_arguments
from truearc.robot.operator_ui import PORT, add_page_argument

EXAMPLE = "truearc run --config launcher.toml --gate gate.onnx --out sessions"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    add_port_arguments(parser)
    parser.add_argument("--plan", type=Path, metavar="TABLE", help="shoot these configurations: a CSV file with "
                        "distance_m, motor_ratio, hood_deg, or a dataset directory; it says where to stand")
    parser.add_argument("--repeats", type=int, metavar="N", help="shots at each configuration (default: [collect])")
    parser.add_argument("--gate", type=Path, help="exported model; needed when the policy is 'model'")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim file of `truearc aim --robot`, which [aim] "
                        "policy = \"belief\" needs")
    parser.add_argument("--aim-inbox", type=Path, metavar="DIR", help="offer the driver the newest aim file that is "
                        "put into this folder; the accept button takes it while disarmed")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder to make the session's folder in")
    add_page_argument(parser, str(PORT))
    parser.add_argument("--core", type=number(int, 0), metavar="N",
                        help="keep the control loop on this core (default: any)")
    parser.add_argument("--priority", type=number(int, 0, 99), default=50, metavar="P",
                        help="SCHED_FIFO priority of the control loop, where the system allows it; 0 asks for none")
    parser.add_argument("--layout", choices=("three", "one"), default="three",      # keys of run_processes.LAYOUTS
                        help="processes: three (control, vision, recorder), or all in one, to compare")


def main(args: argparse.Namespace) -> int:
    """Return 0 when a signal ended the run, its recording complete."""
    from truearc.cli.robot.run_robot import run_robot
    return run_robot(args)
