"""Record trials of the emulated robot: the real runtime, real frames and images, a MuJoCo world."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

import truearc as ta
from truearc.cli.common import SHIPPED, make_progress, number, refuse
from truearc.errors import InputError
from truearc.robot.config.schema import Config, load_config
from truearc.robot.config.shot_plan import load_plan, with_plan
from truearc.robot.operator_ui.page_option import OFF, add_page_argument, parse_page

if TYPE_CHECKING:
    from truearc.api.emulation import Emulation

EXAMPLE = "truearc emulate --trials 50 --out sessions/first --world windy.toml --seed 7"
VIRTUAL = "virtual"
WATCHDOG_MS = 100                     # without --watchdog-ms


def add_arguments(parser: argparse.ArgumentParser) -> None:
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


def main(args: argparse.Namespace) -> int:
    """Return 0 when every trial is over."""
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
    from truearc.cli.gate.answer import make_command
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.operator_ui.screens import open_screens
    from truearc.robot.operator_ui.server import open_page
    from truearc.robot.readings import open_their_screens
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
    from truearc.sim.world.device_server import serve
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
