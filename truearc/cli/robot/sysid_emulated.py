"""Drive the emulated robot by the program of [identify]: real frames, a button box, a MuJoCo world."""

from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from truearc.cli.robot.sysid_drive import Say, Watch, open_recorder
from truearc.hw.devices.button_box.emulator import open_button_box
from truearc.hw.emulated.clock import StepClock
from truearc.hw.emulated.emulated_robot import Twin
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.serial_port import open_serial
from truearc.hw.reason import Reason
from truearc.robot.config.can_policy import guard
from truearc.robot.config.schema import Config
from truearc.robot.recording.candump import TappedBus
from truearc.robot.rig import HardwareRig
from truearc.robot.runtime import run
from truearc.robot.sysid.tick import make_step
from truearc.robot.vision_source import NoEyes
from truearc.sim.world.emulated_robot import CHANNELS, MakeNodes, make_nodes
from truearc.sim.world.world import World

Press = tuple[int, str]               # when (ns) and which button
ARM: tuple[Press, ...] = ((500_000_000, "arm"),)
LONGEST_NS = 900_000_000_000


def drive_twin(config: Config, folder: Path, world: World, tell: Say, presses: Sequence[Press] = ARM,
               nodes_of: MakeNodes = make_nodes) -> Reason | None:
    """Drive `world` until the program is over; returns how it ended. `nodes_of` makes the devices."""
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
        twin = Twin(world, far, tuple(nodes_of(config, world).values()), (box.step, operate))
        stream = open_serial(box.port, config.buttons.baud)
        wires.callback(stream.close)
        watch = Watch(recorder, config, tell)
        bus = guard(near, config, clock, Counter())
        rig = HardwareRig(config, TappedBus(bus, recorder.tap), stream, NoEyes(), clock,
                          lambda: watch.over is not None or clock.now_ns() > LONGEST_NS)
        run(rig, config, None, watch, step)
    if recorder.failed is not None:
        raise recorder.failed
    return watch.over
