"""Implementation of `truearc run` and of the drives of `truearc sysid`: opening the wires, recording and running."""

import argparse
import gc
import itertools
import os
import shutil
import signal
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from msgspec import UNSET
from msgspec.structs import replace

from truearc.cli.gate import make_command
from truearc.cli.run_processes import LAYOUTS, ProcessLayout
from truearc.errors import InputError, about
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.protocols import NS_PER_S, Bus, CameraFrame, Clock, LinkLost, Stream
from truearc.hw.real.can_bus import WAIT_S, SupervisedBus, open_can
from truearc.hw.real.clock import MonotonicClock, wall_clock, wall_offset_ns
from truearc.hw.real.system import ServiceManager, ask_core, ask_fifo, ask_fifo_beside, ask_locked_memory
from truearc.hw.real.wires import MendedStream, open_serial
from truearc.hw.reason import Reason
from truearc.robot import aim_file, motors, reasons, sysid, types
from truearc.robot.config.schema import Config, load_config, with_ports
from truearc.robot.eyes import Eyes, NoEyes, open_their_screens, sources_of
from truearc.robot.gate import load_gate_for
from truearc.robot.operator_ui import parse_page
from truearc.robot.operator_ui.aim_inbox import AimInbox, OfferingRig
from truearc.robot.operator_ui.server import open_page
from truearc.robot.recording.files import DISK_ERRNOS, TappedBus
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import HardwareRig, RecordingRig
from truearc.robot.runtime import Lateness, RobotIo, TimedRig, WatchedRig, open_screens, run
from truearc.robot.tick import step

if TYPE_CHECKING:
    from truearc.sim.world.emulated_robot import MakeNodes
    from truearc.sim.world.world import World

ROOM_BYTES = 100 << 20                # a quarter of an hour of recording, which a session should find to begin with


class Ending:
    """A flag set by a signal and checked by the loop before each tick."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def run_robot(args: argparse.Namespace) -> int:
    """Run until a signal ends it; args: those of `truearc run`."""
    parse_page(args.page)
    config = with_ports(load_config(args.config), args.can, args.buttons, args.camera)
    config = aim_file.with_plan(config, aim_file.load_plan(args.plan, config) if args.plan else (), args.repeats)
    motors.make_motors(config)               # refuses two axes that are one device, before there is a folder
    gate = None if args.gate is None else load_gate_for(args.gate, config.rig)
    if config.gate.policy == "model" and gate is None:
        raise InputError(f"{args.config}: gate.policy is 'model', so --gate is needed")
    if config.gate.policy != "model" and gate is not None:
        _say(f"{args.config} has gate.policy {config.gate.policy!r}: the model is asked, not obeyed")
    aims = {} if args.aim is None else {"": aim_file.load_aim_for(args.aim, config)}
    if aim_file.needs_aim(config) != bool(aims):
        raise InputError(f"{args.config}: aim.policy is {config.aim.policy!r}, so --aim is "
                         + ("needed" if aim_file.needs_aim(config) else "not used"))
    started = wall_clock()
    folder = make_room(args.out, started)
    ending = Ending()
    with ExitStack() as wires:
        tally: Counter[str] = Counter()
        # with all in one process a started one would be as urgent as the tick: there the page has no gate
        asks = make_command(args.gate, config) if args.gate and args.layout != "one" else ()
        screens = (partial(open_page, args.page, config, folder.name, gate_command=asks, inbox=args.aim_inbox),
                   partial(open_their_screens, config, args.gate if asks else None, False))
        layout = LAYOUTS[args.layout](config, wires, partial(open_screens, screens))
        layers = [source.open_layer(wires, args.layout != "one") for source in sources_of(config)]
        bus, box, eyes, clock = _open_wires(config, layout, wires, tally)
        recorder = SessionWriter(folder, make_header(config, gate, started, aims.get(""), wall_offset_ns()), config,
                                 args.gate.read_bytes() if args.gate else None, lossless=False,
                                 open_keeper=layout.open_keeper, aim=args.aim.read_bytes() if args.aim else None)
        wires.callback(recorder.close)
        _say(f"control is process {os.getpid()}", *layout.lines())
        manager = ServiceManager(os.environ.get("NOTIFY_SOCKET"))
        wires.callback(manager.close)
        lateness = Lateness(recorder.keep_lateness, NS_PER_S // config.tick_hz)
        wires.callback(lateness.close)
        rig = HardwareRig(config, TappedBus(bus, recorder.tap), box, eyes, clock,
                          lambda: ending.asked or recorder.is_over())
        wires.callback(rig.release)               # first of all to be done on the way out, whatever happened
        _ask_for_real_time(args)
        kept: RobotIo = RecordingRig(TimedRig(rig, lateness), recorder.trouble)
        for layer in filter(None, layers):
            kept = layer(kept)
        watched = WatchedRig(_offering(args, config, folder, aims, kept, wires), config, manager.say)
        ticks = run(watched, config, gate, layout.show(recorder), partial(step, aims=aims))
    print(f"{folder}: {ticks} ticks" + (f", {recorder.dropped} batches lost" if recorder.dropped else ""))
    print(*lateness.lines(), sep="\n")
    for what, count in sorted(tally.items()):
        print(f"  CAN: {what}: {count}")
    if recorder.failed is not None:
        raise InputError(f"{folder}: the recording stopped: {recorder.failed}")
    return 0


def _offering(args: argparse.Namespace, config: Config, session: Path, aims: dict[str, aim_file.AimFile], rig: RobotIo,
              wires: ExitStack) -> RobotIo:
    """That rig, with the offers of --aim-inbox in its inputs."""
    if args.aim_inbox is None:
        return rig
    inbox = AimInbox(args.aim_inbox, config, session, aims)
    inbox.start()
    wires.callback(inbox.close)
    return OfferingRig(rig, inbox)


def make_room(out: Path, started: str) -> Path:
    """Choose a new folder in `out`, named by the time of day; warn if the disk is almost full.

    If the clock was set back, or starts at the same time after every power-up, the name only gets a number. OSError if
    `out` cannot be made for a reason other than its disk's.
    """
    free = 0
    try:
        out.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(out).free
    except OSError as error:
        if error.errno not in DISK_ERRNOS:
            raise
    if free < ROOM_BYTES:
        print(f"warning: {out}: {free >> 20} MB free, a recording of a quarter of an hour takes {ROOM_BYTES >> 20} MB; "
              "once the disk is full the robot holds its fire", file=sys.stderr)
    name = started.replace(":", "")
    names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
    return next(out / name for name in names if not (out / name).exists())


def _open_wires(config: Config, layout: ProcessLayout, wires: ExitStack,
                tally: Counter[str]) -> tuple[Bus, Stream, Eyes, Clock]:
    """Every wire of the configuration, to be closed by `wires`; InputError names a CAN bus that no adapter would open.

    Each may come later: until then it is a reason to hold, and is said. `tally` counts what happens on the CAN bus
    beside what should.
    """
    clock = MonotonicClock()
    with about("cannot start", LinkLost):
        bus = open_bus(config, clock, wires, tally, may_come=True)
        box = MendedStream(lambda: open_serial(config.buttons.port, config.buttons.baud))
        wires.callback(box.close)
        eyes = layout.open_eyes(clock)
    lost = [LinkLost(box.lost)] if box.lost is not None else []
    try:
        eyes.read()
    except LinkLost as error:
        lost.append(error)
    _say(*(f"{one}: holding until it can be opened" for one in lost))
    return bus, box, eyes, clock


def open_bus(config: Config, clock: Clock, wires: ExitStack, tally: Counter[str], may_come: bool = False) -> Bus:
    """Open the CAN bus behind the configuration's rules; its adapter may be lost and return; closed by `wires`.

    `tally` counts irregular events on the bus. `may_come`: the adapter may also be plugged in later.

    Raises:
        LinkLost: it cannot be opened, now or later.
    """
    can = config.can
    supervised = SupervisedBus(
        lambda: open_can(can.interface, can.channel, can.bitrate, clock, WAIT_S, tally), clock, tally,
        name=f"CAN {can.interface} {can.channel}" if may_come else None)
    wires.callback(supervised.close)
    if supervised.lost is not None:
        _say(f"{LinkLost(supervised.lost)}: holding until it can be opened")
    return motors.guard(supervised, config, clock, tally)


def _ask_for_real_time(args: argparse.Namespace) -> None:
    """Ask for all that keeps ticks on time, just before the first: what has started by now stays as it was."""
    answers = [] if args.priority == 0 else [ask_fifo(args.priority), ask_locked_memory()]
    if args.priority and args.layout != "one":    # there, files and vision have threads, which real time is not for
        answers.append(ask_fifo_beside(args.priority))
    answers += [] if args.core is None else [ask_core(args.core)]
    for asked, refused in answers:
        _say(f"{asked}: " + (f"REFUSED ({refused}); late ticks: docs/how-to/deploy.md" if refused else "granted"))
    gc.collect()
    gc.freeze()                                   # what is there by now will stay: the collector need not look again


def _say(*lines: str) -> None:
    for line in lines:
        print(f"truearc run: {line}", file=sys.stderr)


# --- the drives of `truearc sysid`: a real robot, or the emulated one

Say = Callable[[str], None]
Press = tuple[int, str]               # when (ns) and which button
ARM: tuple[Press, ...] = ((500_000_000, "arm"),)
LONGEST_NS = 900_000_000_000


class Watch:
    """A Recorder that passes everything on, reports changes of the program's state, and knows when it is over."""

    def __init__(self, recorder: SessionWriter, config: Config, tell: Say) -> None:
        self.over: Reason | None = None
        self._recorder, self._program, self._tell = recorder, sysid.phases(config), tell
        self._told: Reason | None = None

    def record(self, tick: types.Tick, sent: types.Sent) -> None:
        self._recorder.record(tick, sent)
        progress = tick.memory.identify
        assert isinstance(progress, types.Progress)
        self.over = progress.over
        reason = sysid.say(progress, self._program)
        if reason != self._told:
            self._told = reason
            self._tell(reasons.text(reason))

    def keep_picture(self, picture: CameraFrame) -> None: ...


def open_recorder(folder: Path, config: Config, started: str | None, lossless: bool) -> SessionWriter:
    """Open a session whose header says that it records a sysid program, not shots."""
    offset_ns = UNSET if started is None else wall_offset_ns()
    header = replace(make_header(config, None, started, wall_offset_ns=offset_ns), policy=sysid.POLICY)
    return SessionWriter(folder, header, config, None, lossless)


def drive_robot(config: Config, folder: Path | None, tell: Say) -> Path:
    """Drive the real launcher until the program is over or Ctrl-C; returns the session's folder."""
    motors.make_motors(config)               # refuses two axes that are one device, before there is a folder
    step, ending, started = sysid.make_step(config), Ending(), wall_clock()
    folder = folder or Path("sessions") / started.replace(":", "")
    with ExitStack() as wires:
        clock = MonotonicClock()
        with about("cannot start", LinkLost):
            bus = open_bus(config, clock, wires, Counter())
            box = open_serial(config.buttons.port, config.buttons.baud)
            wires.callback(box.close)
        recorder = open_recorder(folder, config, started, lossless=False)
        wires.callback(recorder.close)
        watch = Watch(recorder, config, tell)
        rig = HardwareRig(config, TappedBus(bus, recorder.tap), box, NoEyes(), clock,
                          lambda: ending.asked or watch.over is not None)
        wires.callback(rig.release)               # first of all to be done on the way out, whatever happened
        run(rig, config, None, watch, step)
    if recorder.failed is not None:
        raise InputError(f"{folder}: the recording stopped: {recorder.failed}")
    return folder


def drive_twin(config: Config, folder: Path, world: "World", tell: Say, presses: Sequence[Press] = ARM,
               nodes_of: "MakeNodes | None" = None) -> Reason | None:
    """Drive `world` until the program is over; returns how it ended. `nodes_of` makes devices other than its own."""
    from truearc.sim.world.emulated_robot import check_emulated, emulated_rig, make_nodes
    step, box, left = sysid.make_step(check_emulated(config)), open_button_box(), list(presses)

    def operate(t_ns: int) -> None:
        while left and left[0][0] <= t_ns:
            box.press(left.pop(0)[1])

    with closing(open_recorder(folder, config, None, lossless=True)) as recorder:
        watch = Watch(recorder, config, tell)

        def over(now_ns: int) -> bool:
            return watch.over is not None or now_ns > LONGEST_NS

        nodes = (nodes_of or make_nodes)(config, world)
        with emulated_rig(config, world, nodes, box, NoEyes(), (operate,), recorder.tap, over) as (rig, _):
            run(rig, config, None, watch, step)
    if recorder.failed is not None:
        raise recorder.failed
    return watch.over
