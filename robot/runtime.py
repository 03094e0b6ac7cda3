"""The loop: read -> tick -> write -> record. One identical line on hardware, on the twin and on replay."""

from collections.abc import Callable
from typing import Protocol

from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import Config
from truearc.robot.gate.model import Gate
from truearc.robot.tick import step
from truearc.robot.types import Command, Inputs, Memory, Sent, Tick

Think = Callable[[Inputs, Memory, Config, Gate | None], Tick]


class RobotIo(Protocol):
    """Whatever gives inputs and takes commands."""

    def read(self) -> Inputs | None:
        """The next tick's inputs, when they are due; None when there will be no more."""

    def write(self, command: Command) -> Sent: ...

    def picture(self) -> CameraFrame | None:
        """The newest camera image, if this rig has one."""


class RigLayer:
    """A RobotIo around another that passes everything on; a layer on top overrides what it sees or changes."""

    def __init__(self, rig: RobotIo) -> None:
        self._rig = rig

    def write(self, command: Command) -> Sent:
        return self._rig.write(command)

    def picture(self) -> CameraFrame | None:
        return self._rig.picture()


class Recorder(Protocol):
    """Whatever keeps ticks. Never blocks the loop."""

    def record(self, tick: Tick, sent: Sent) -> None: ...

    def keep_picture(self, picture: CameraFrame) -> None: ...


def run(rig: RobotIo, config: Config, gate: Gate | None, recorder: Recorder, think: Think = step) -> int:
    """Run until the rig is over; returns the number of ticks. `think` is what one tick does: launching, if not said."""
    memory = Memory()
    ticks = 0
    while (inputs := rig.read()) is not None:
        tick = think(inputs, memory, config, gate)
        recorder.record(tick, rig.write(tick.command))
        if tick.shot is not None and (picture := rig.picture()) is not None:
            recorder.keep_picture(picture)
        memory = tick.memory
        ticks += 1
    return ticks
