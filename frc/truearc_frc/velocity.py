"""The robot's own velocity from keys of NetworkTables, in the robot's axes.

With the control loop in a process of its own another one reads the keys, so that the tick never has to do with a
network.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Protocol

import msgspec
from msgspec.structs import replace

from truearc.hw.protocols import NS_PER_S, Clock
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.processes import Capacity, Child, Line, Slots, make_shared
from truearc.robot.config.schema import Config
from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.tick import CALM_S
from truearc.robot.types import Inputs, RobotVelocity
from truearc_frc.advice import Keys
from truearc_frc.keys import NtKeys, Reading
from truearc_frc.table import Nt4Velocity, nt4_of

# Most that a robot's velocity and heading can change by: at once, and on top of it per second
STEP_M_S, RATE_M_S2 = 1.0, 15.0
STEP_RAD, RATE_RAD_S = 0.3, 20.0
LOOK_S = 0.005                        # between looks for a newer velocity, of the process that reads it
CLOSE_S = 2.0                         # for that process to end
ROOM = Capacity(4, 256)


class Velocity(Protocol):
    """Where velocities come from."""

    def read(self) -> RobotVelocity | None:
        """The newest; None where there is none that can be believed. Never waits."""


def keys_of_velocity(velocity: Nt4Velocity) -> list[str]:
    """Keys that are read, a part of an array its own."""
    return [f"{velocity.key}/0", f"{velocity.key}/1", *filter(None, [velocity.heading, velocity.alive])]


class NtVelocity:
    """Velocity on keys: none where one is missing or not finite, and for half a second after one that jumped.

    It is as old as its oldest part; with `alive`, as that key: then a velocity or a heading may stand still.
    """

    def __init__(self, config: Config, keys: Keys, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.velocity is not None
        self._asked, self._keys, self._clock = nt4.velocity, keys, clock
        self._last: tuple[RobotVelocity, float] | None = None       # and the heading, rad
        self._jumped_ns: int | None = None

    def read(self) -> RobotVelocity | None:
        return self.take(self._keys.read(self._clock.now_ns())) if self._keys.connected else None

    def take(self, found: Mapping[str, Reading]) -> RobotVelocity | None:
        """What these readings say."""
        keys = keys_of_velocity(self._asked)
        readings = [found[key] for key in keys if key in found]
        numbers = [one.value for one in readings if not isinstance(one.value, str)]
        if len(numbers) < len(keys) or not all(map(math.isfinite, numbers)):
            return None
        forward, left = numbers[:2]
        heading, stamps = 0.0, [max(one.t_ns for one in readings[:2])]      # one array: of the part that changed last
        if self._asked.heading:
            heading = numbers[2] if self._asked.heading_unit == "rad" else math.radians(numbers[2])
            c, s = math.cos(heading), math.sin(heading)
            forward, left = c * forward + s * left, c * left - s * forward
            stamps.append(readings[2].t_ns)
        new = RobotVelocity(readings[-1].t_ns if self._asked.alive else min(stamps), forward, left)
        return None if self._jumps(new, heading) else new

    def _jumps(self, new: RobotVelocity, heading: float) -> bool:
        before, self._last = self._last, (new, heading)
        if before is not None:
            last, gap_s = before[0], max(new.t_ns - before[0].t_ns, 0) / NS_PER_S
            change = math.hypot(new.forward_m_s - last.forward_m_s, new.left_m_s - last.left_m_s)
            turned = abs(math.remainder(heading - before[1], math.tau))
            if change > STEP_M_S + RATE_M_S2 * gap_s or turned > STEP_RAD + RATE_RAD_S * gap_s:
                self._jumped_ns = new.t_ns
        return self._jumped_ns is not None and (new.t_ns - self._jumped_ns) / NS_PER_S <= CALM_S


class OwnNtVelocity(NtVelocity):
    """With a connection of its own, to be closed."""

    def __init__(self, config: Config, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.velocity is not None
        self._own = NtKeys(nt4.server, keys_of_velocity(nt4.velocity))
        super().__init__(config, self._own, clock)

    def close(self) -> None:
        self._own.close()


def tell_velocity(velocity: Velocity, slots: Slots, is_over: Callable[[float], bool]) -> None:
    """Tell of every change, until `is_over`, which is asked how long to wait for that."""
    told: RobotVelocity | None = None
    while not is_over(LOOK_S):
        newest = velocity.read()
        if newest != told:
            told = newest
            slots.put(msgspec.json.encode(newest))


class FarVelocity:
    """A Velocity on what another process tells; one that has died leaves an old stamp."""

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


def open_moving(config: Config, wires: ExitStack, is_apart: bool) -> Callable[[RobotIo], RobotIo]:
    """What makes a rig whose inputs say how the robot drives; `wires` closes it. is_apart: by a process of its own."""
    if not is_apart:
        own = OwnNtVelocity(config, MonotonicClock())
        wires.callback(own.close)
        return lambda rig: MovingRig(rig, own)
    shared = make_shared(ROOM.bytes)
    far = FarVelocity(Slots(shared, ROOM))
    child = Child("velocity", _drive, (config, shared), restarts=True, mortal=True)
    wires.callback(child.close, CLOSE_S)
    return lambda rig: MovingRig(rig, far)


def _drive(line: Line, is_first: bool, config: Config, memory: object) -> None:
    """The process that reads how the robot drives."""
    velocity = OwnNtVelocity(config, MonotonicClock())
    line.say(None)
    tell_velocity(velocity, Slots(memory, ROOM), line.is_over)
    velocity.close()
