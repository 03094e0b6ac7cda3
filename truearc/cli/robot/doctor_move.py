"""`truearc doctor --move`: asks, moves wheels and hood a little, and says what that has shown."""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack

from truearc.cli.common import refuse
from truearc.cli.robot.run_robot import Ending, open_bus
from truearc.errors import InputError
from truearc.hw.devices.family import Heard, listen
from truearc.hw.finding import FAILURE, Finding, failure, warning
from truearc.hw.protocols import Bus, Clock, Frame, LinkLost, Stream
from truearc.hw.real.serial_port import open_serial
from truearc.robot.config.schema import Config
from truearc.robot.doctor.devices import find_hood
from truearc.robot.doctor.motion import SmallMotion, describe, plan
from truearc.robot.doctor.moved import check_motion
from truearc.robot.recording.candump import TappedBus
from truearc.robot.rig import HardwareRig
from truearc.robot.runtime import run
from truearc.robot.vision_source import NoEyes

CHECK = "motion"
LOOK_S = 0.5                          # at where the hood is, before anything is asked
WARNING_TEXT = "Take all balls out and keep hands away. Ctrl-C stops it, and so does any button of the button box."


class NoBox:
    """A button box that is not there."""

    def read(self) -> bytes:
        return b""

    def close(self) -> None: ...


def check_move(args: argparse.Namespace) -> None:
    """InputError for options that do not go together, before anything is opened."""
    if not args.move:
        refuse(args, ("--yes",), "applies with --move or --set only")
    elif not args.yes and not sys.stdin.isatty():
        raise InputError("--move: asks before it moves anything, and there is no terminal to answer; give --yes where "
                         "all balls are out and hands away")


def move_robot(config: Config, clock: Clock, found: Sequence[Finding], is_allowed: bool) -> list[Finding]:
    """Findings of the motion. found: those at rest, of which none may be a failure; is_allowed: without asking."""
    if any(finding.level == FAILURE for finding in found):
        return [warning(CHECK, "not tried: something on the bus has failed at rest", "repair that first")]
    with ExitStack() as wires:
        try:
            bus = open_bus(config, clock, wires, Counter())
        except LinkLost as error:
            return [failure(CHECK, f"not tried: {error}", "plug the adapter in; see [can]")]
        try:
            box: Stream | None = open_serial(config.buttons.port, config.buttons.baud)
        except LinkLost:
            box = None                            # a check of its own says so
        if box is not None:
            wires.callback(box.close)
        try:
            hood_deg = find_hood(config, listen(bus, clock, (), LOOK_S))[1]
        except LinkLost as error:
            return [failure(CHECK, f"not tried: {error}", "repair the adapter first")]
        program = plan(config, hood_deg)
        if not is_allowed and not _ask(describe(config, program)):
            return [warning(CHECK, "not tried: it was not allowed", "type yes when asked")]
        motion, ending = SmallMotion(config, program, box is not None), Ending()
        return move(config, motion, bus, box, clock, ending, wires)


def move(config: Config, motion: SmallMotion, bus: Bus, box: Stream | None, clock: Clock, ending: Ending,
         wires: ExitStack) -> list[Finding]:
    """Move on open wires until it is over, and release; findings."""
    heard: list[Frame] = []

    def tap(frame: Frame, sent: bool) -> None:
        if not sent:
            heard.append(frame)

    began_ns = clock.now_ns()
    rig = HardwareRig(config, TappedBus(bus, tap), box or NoBox(), NoEyes(), clock,
                      lambda: ending.asked or motion.is_finished)
    wires.callback(rig.release)                   # first of all to be done on the way out, whatever happened
    run(rig, config, None, motion, motion)
    return [*check_motion(config, motion, Heard(tuple(heard), max((clock.now_ns() - began_ns) * 1e-9, 1e-3)))]


def _ask(what: str) -> bool:
    print(f"truearc doctor --move will move\n{what}\n{WARNING_TEXT}\nType yes to go on: ", end="", file=sys.stderr,
          flush=True)
    try:
        return input().strip() == "yes"
    except (EOFError, KeyboardInterrupt):
        return False
