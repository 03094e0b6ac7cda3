"""The robot's velocity, read in a process of its own: the tick never has to do with a network."""

from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from truearc.hw.real.processes import Capacity, Slots
from truearc.robot.advice.nt_velocity import Velocity
from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.types import Inputs, RobotVelocity

LOOK_S = 0.005
ROOM = Capacity(4, 256)


def tell_velocity(velocity: Velocity, slots: Slots, is_over: Callable[[float], bool]) -> None:
    """Tell of every change, until `is_over`, which is asked how long to wait for that."""
    told: RobotVelocity | None = None
    while not is_over(LOOK_S):
        newest = velocity.read()
        if newest != told:
            told = newest
            slots.put(msgspec.json.encode(newest))


class FarVelocity:
    """truearc.robot.advice.nt_velocity.Velocity on what another process tells; one that has died leaves an old stamp.
    """

    def __init__(self, slots: Slots) -> None:
        self._slots = slots
        self._newest: RobotVelocity | None = None
        self._decoder = msgspec.json.Decoder(RobotVelocity | None)

    def read(self) -> RobotVelocity | None:
        text = self._slots.read()
        if text is not None:
            self._newest = self._decoder.decode(text)
        return self._newest


class MovingRig(RigLayer):
    """A rig whose inputs also say how the robot drives."""

    def __init__(self, rig: RobotIo, velocity: Velocity) -> None:
        super().__init__(rig)
        self._velocity = velocity

    def read(self) -> Inputs | None:
        inputs, newest = self._rig.read(), self._velocity.read()
        return inputs if inputs is None or newest is None else replace(inputs, velocity=newest)
