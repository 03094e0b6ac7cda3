"""Commands that run, check and emulate a launcher: `run`, `doctor`, `emulate`."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

import truearc as ta
from truearc.cli.common import SHIPPED, make_progress, number, refuse
from truearc.errors import InputError
from truearc.robot.aim_file import load_plan, with_plan
from truearc.robot.config.schema import Config, load_config
from truearc.robot.operator_ui import OFF, PORT, add_page_argument, parse_page

if TYPE_CHECKING:
    from truearc.api.emulation import Emulation

VIRTUAL = "virtual"
WATCHDOG_MS = 100                     # without --watchdog-ms


def run_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--can", metavar="INTERFACE:CHANNEL", help="instead of [can], such as slcan:/dev/ttyACM0")
    parser.add_argument("--buttons", metavar="PORT", help="instead of [buttons] port")
    parser.add_argument("--camera", metavar="DEVICE", help="instead of [camera] device; a URL, too")
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


def run(args: argparse.Namespace) -> int:
    """Run the launcher on its real wires and record it; ends on Ctrl-C or SIGTERM with the motors idle."""
    from truearc.cli.run_robot import run_robot
    return run_robot(args)


def doctor_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--gate", type=Path, help="model, as for truearc run")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim file, as for truearc run")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder for sessions, as for truearc run")
    parser.add_argument("--endpoints", type=Path, metavar="JSON", help="flat_endpoints.json of the axes' firmware: "
                        "their watchdogs and encoder filters are asked, too")
    parser.add_argument("--move", action="store_true", help="also turn the wheels slowly, and the hood to its limit "
                        "switch and back, once you have typed yes: directions, scales, lags, the switch")
    parser.add_argument("--priority", type=number(int, 1, 99), default=50, metavar="P", help="as for truearc run")
    parser.add_argument("--seconds", type=number(float, 0.5, 600.0), default=2.0, metavar="S",
                        help="to listen to the bus")
    parser.add_argument("--set", action="store_true", help="compare the watchdogs and limits that the axes keep with "
                        "the rig, and write and save what differs after a yes; with --endpoints")
    parser.add_argument("--yes", action="store_true", help="with --set or --move: do not ask; with --move, "
                        "all balls are out, and hands away")
    parser.add_argument("--json", action="store_true", help="findings as JSON")


def doctor(args: argparse.Namespace) -> int:
    """Look at everything a run needs and say in one line each how it is and what to do about it.

    Without --set it changes nothing but an exposure that the configuration fixes, without --move it moves nothing; stop
    a running robot first, which holds camera and button box. Exit 1 if anything fails.
    """
    from truearc.cli.doctor_checks import check_robot, set_devices
    if args.set:
        refuse(args, ("--move",), "apart from --set: what is written first is looked at first")
        return set_devices(args)
    return check_robot(args)


def emulate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--trials", type=number(int, 1), metavar="N", help="needed without --plan")
    parser.add_argument("--plan", type=Path, metavar="TABLE", help="shoot these configurations instead of walking: a "
                        "CSV file with distance_m, motor_ratio, hood_deg, or a dataset directory")
    parser.add_argument("--repeats", type=int, metavar="N", help="shots at each configuration (default: [collect])")
    parser.add_argument("--out", type=Path, metavar="SESSION", help="folder to make; needed unless --bus is another "
                        "than virtual")
    parser.add_argument("--bus", default=VIRTUAL, metavar="INTERFACE:CHANNEL", help="slcan:auto (a serial adapter on "
                        "a pseudo-terminal), slcan:socket or socketcan:vcan0: play the devices alone, in real time, "
                        "for `truearc run` in another process, which records (default: virtual, all in this process)")
    parser.add_argument("--watchdog-ms", type=number(int, 1), metavar="MS", help="with --bus: watchdog timeout of "
                        "the motor drivers; more on a machine that stalls (default: 100)")
    parser.add_argument("--config", type=Path, default=SHIPPED, help="launcher.toml (default: the shipped one)")
    parser.add_argument("--world", type=Path, help="world.toml; the robot never sees it (default: an honest world)")
    parser.add_argument("--gate", type=Path, help="model that must agree before the robot fires")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim by this file of `truearc aim --robot`")
    parser.add_argument("--seed", type=number(int, 0), default=0, help="seed of the world")
    add_page_argument(parser, OFF, ", for which time passes no faster than it does")


def emulate(args: argparse.Namespace) -> int:
    """Record trials of the emulated robot: the real runtime, real frames and images, a MuJoCo world."""
    config = load_config(args.config)
    # the emulated robot stands still, and sees with a camera of its own
    config = replace(config, readings={
        name: {key: value for key, value in table.items() if key not in ("vision", "velocity")}
        for name, table in config.readings.items()})
    config = with_plan(config, load_plan(args.plan, config) if args.plan else (), args.repeats)
    trials = _trials(args.trials, config)
    print(_serve(args, config, trials) if args.bus != VIRTUAL else _emulate(args, config, trials))
    return 0


def _emulate(args: argparse.Namespace, config: Config, trials: int) -> "Emulation":
    refuse(args, ("--watchdog-ms",), "applies with --bus only")
    if args.out is None:
        raise InputError("--out is needed: the folder to record into")
    if config.gate.policy == "model" and args.gate is None:
        raise InputError(f"{args.config}: gate.policy is 'model', so --gate is needed")
    from truearc.cli.gate import make_command
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.eyes import open_their_screens
    from truearc.robot.operator_ui.server import open_page
    from truearc.robot.runtime import open_screens
    from truearc.sim.world.options import load_options
    asks = make_command(args.gate, config) if args.gate else ()
    page = open_screens((partial(open_page, args.page, config, args.out.name, gate_command=asks),
                         partial(open_their_screens, config, args.gate, True)), MonotonicClock())
    try:
        return ta.emulate(config, args.out, trials, args.seed, load_options(args.world), args.gate,
                          make_progress("emulate", args.quiet), page=page, aim_path=args.aim)
    finally:
        if page is not None:
            page.close()


def _serve(args: argparse.Namespace, config: Config, trials: int) -> "Emulation":
    refuse(args, ("--quiet",), "does not apply with --bus: no progress is shown")
    for option, value in (("--out", args.out), ("--gate", args.gate), ("--aim", args.aim),
                          ("--page", parse_page(args.page))):
        if value is not None:
            raise InputError(f"{option} is for `truearc run` with --bus {args.bus}: that process is the robot")
    from truearc.api.emulation import Emulation
    from truearc.sim.world.emulated_robot import serve
    from truearc.sim.world.options import load_options

    def say(command: str) -> None:
        needed = {" --gate GATE.onnx": config.gate.policy == "model", " --aim AIM.json": config.aim.policy == "belief"}
        files = "".join(option for option, is_needed in needed.items() if is_needed)
        print(f"the devices wait on {args.bus}; start the robot in another terminal:\n  {command}{files}", flush=True)

    return Emulation(args.bus, tuple(serve(config, args.config, args.bus, args.watchdog_ms or WATCHDOG_MS, trials,
                                           args.seed, load_options(args.world), say)))


def _trials(asked: int | None, config: Config) -> int:
    """How many: as asked, or every prescribed shot."""
    prescribed = len(config.collect.prescribed) * config.collect.repeats
    if asked is None and not prescribed:
        raise InputError("--trials is needed, or --plan, which says how many by itself")
    if asked is not None and 0 < prescribed < asked:
        raise InputError(f"--trials {asked}: the plan has {prescribed} shots, repeats included")
    return prescribed if asked is None else asked
