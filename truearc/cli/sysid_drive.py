"""The drives of `truearc sysid`: a real robot, or the emulated one."""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import UNSET
from msgspec.structs import replace

from truearc.cli.run_robot import Ending, open_bus
from truearc.errors import InputError, about
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.protocols import CameraFrame, LinkLost
from truearc.hw.real.clock import MonotonicClock, wall_clock, wall_offset_ns
from truearc.hw.real.wires import open_serial
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config
from truearc.robot.eyes import NoEyes
from truearc.robot.motors import make_motors
from truearc.robot.reasons import text
from truearc.robot.recording.files import TappedBus
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import HardwareRig
from truearc.robot.runtime import run
from truearc.robot.sysid import POLICY, make_step, phases, say
from truearc.robot.types import Progress, Sent, Tick

if TYPE_CHECKING:                     # needs MuJoCo, which a robot does without
    from truearc.sim.world.emulated_robot import MakeNodes
    from truearc.sim.world.world import World

Say = Callable[[str], None]
Press = tuple[int, str]               # when (ns) and which button
ARM: tuple[Press, ...] = ((500_000_000, "arm"),)
LONGEST_NS = 900_000_000_000


class Watch:
    """A Recorder that passes all on, says where the program stands when that changes, and knows when it is over."""

    def __init__(self, recorder: SessionWriter, config: Config, tell: Say) -> None:
        self.over: Reason | None = None
        self._recorder, self._program, self._tell = recorder, phases(config), tell
        self._told: Reason | None = None

    def record(self, tick: Tick, sent: Sent) -> None:
        self._recorder.record(tick, sent)
        progress = tick.memory.identify
        assert isinstance(progress, Progress)
        self.over = progress.over
        reason = say(progress, self._program)
        if reason != self._told:
            self._told = reason
            self._tell(text(reason))

    def keep_picture(self, picture: CameraFrame) -> None: ...


def open_recorder(folder: Path, config: Config, started: str | None, lossless: bool) -> SessionWriter:
    """Open a session whose header says that it records a sysid program, not shots."""
    offset_ns = UNSET if started is None else wall_offset_ns()
    header = replace(make_header(config, None, started, wall_offset_ns=offset_ns), policy=POLICY)
    return SessionWriter(folder, header, config, None, lossless)


def drive_robot(config: Config, folder: Path | None, tell: Say) -> Path:
    """Drive the real launcher until the program is over or Ctrl-C; returns the session's folder."""
    make_motors(config)               # refuses two axes that are one device, before there is a folder
    step, ending, started = make_step(config), Ending(), wall_clock()
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
    step, box, left = make_step(check_emulated(config)), open_button_box(), list(presses)

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
