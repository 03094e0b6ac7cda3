"""Drives the emulated robot by the program of [identify]: real frames, a button box, a world that nobody looks into."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from doors.identify_drive import Say, Watch, open_recorder
from doors.twin import CHANNELS, make_nodes
from hw.emulated.clock import StepClock
from hw.emulated.faults import Fault
from hw.emulated.serial_port import open_button_box
from hw.emulated.twin import Twin
from hw.real.can_bus import open_can
from hw.real.serial_port import open_serial
from robot.bus_rules import guard
from robot.config import Config
from robot.eyes import NoEyes
from robot.identify.tick import make_step
from robot.recording.candump import TappedBus
from robot.rig import HardwareRig
from robot.runtime import run
from sim.world.world import World

Press = tuple[int, str]               # when (ns) and which button
ARM: tuple[Press, ...] = ((500_000_000, "arm"),)
LONGEST_NS = 900_000_000_000


def drive_twin(config: Config, folder: Path, world: World, tell: Say, presses: Sequence[Press] = ARM,
               faults: Mapping[str, tuple[Fault, ...]] | None = None) -> str:
    """Drive `world` until the program is over; returns how it ended. `faults`: see doors.twin.emulate."""
    step, box, left = make_step(config), open_button_box(), list(presses)

    def operate(t_ns: int) -> None:
        while left and left[0][0] <= t_ns:
            box.press(left.pop(0)[1])

    clock = StepClock(lambda t_ns: twin.advance(t_ns))
    channel = f"truearc-{next(CHANNELS)}"
    with ExitStack() as wires:
        wires.callback(box.unplug)
        recorder = open_recorder(folder, config, None, lossless=True)
        wires.callback(recorder.close)
        near, far = (open_can("virtual", channel, config.can.bitrate, clock) for _ in range(2))
        wires.callback(near.close)
        wires.callback(far.close)
        twin = Twin(world, far, make_nodes(config, world, faults or {}), (box.step, operate))
        stream = open_serial(box.port, config.buttons.baud)
        wires.callback(stream.close)
        watch = Watch(recorder, config, tell)
        bus = guard(near, config, clock, Counter())
        rig = HardwareRig(config, TappedBus(bus, recorder.tap), stream, NoEyes(), clock,
                          lambda: bool(watch.over) or clock.now_ns() > LONGEST_NS)
        run(rig, config, None, watch, step)
    if recorder.failed is not None:
        raise recorder.failed
    return watch.over
