"""Drive the emulated robot by the program of [identify]: real frames, a button box, a MuJoCo world."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from truearc.cli.robot.sysid_drive import Say, Watch, open_recorder
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config
from truearc.robot.runtime import run
from truearc.robot.sysid import make_step
from truearc.robot.vision_source import NoEyes
from truearc.sim.world.emulated_robot import MakeNodes, check_emulated, emulated_rig, make_nodes
from truearc.sim.world.world import World

Press = tuple[int, str]               # when (ns) and which button
ARM: tuple[Press, ...] = ((500_000_000, "arm"),)
LONGEST_NS = 900_000_000_000


def drive_twin(config: Config, folder: Path, world: World, tell: Say, presses: Sequence[Press] = ARM,
               nodes_of: MakeNodes = make_nodes) -> Reason | None:
    """Drive `world` until the program is over; returns how it ended. `nodes_of` makes the devices."""
    step, box, left = make_step(check_emulated(config)), open_button_box(), list(presses)

    def operate(t_ns: int) -> None:
        while left and left[0][0] <= t_ns:
            box.press(left.pop(0)[1])

    with closing(open_recorder(folder, config, None, lossless=True)) as recorder:
        watch = Watch(recorder, config, tell)

        def over(now_ns: int) -> bool:
            return watch.over is not None or now_ns > LONGEST_NS

        with emulated_rig(config, world, nodes_of(config, world), box, NoEyes(), (operate,), recorder.tap,
                          over) as (rig, _):
            run(rig, config, None, watch, step)
    if recorder.failed is not None:
        raise recorder.failed
    return watch.over
