"""The robot's own velocity from keys of NetworkTables, in the robot's axes."""

import math
from collections.abc import Mapping
from typing import Protocol

from truearc.hw.protocols import Clock
from truearc.robot.advice.advice_io import NS_PER_S, Keys
from truearc.robot.advice.nt_keys import NtKeys, Reading
from truearc.robot.advice.tick import CALM_S
from truearc.robot.config.nt4 import Nt4Velocity
from truearc.robot.config.schema import Config
from truearc.robot.types import RobotVelocity

# Most that a robot's velocity and heading can change by: at once, and on top of it per second
STEP_M_S, RATE_M_S2 = 1.0, 15.0
STEP_RAD, RATE_RAD_S = 0.3, 20.0


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
        assert config.nt4 is not None and config.nt4.velocity is not None
        self._asked, self._keys, self._clock = config.nt4.velocity, keys, clock
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
        assert config.nt4 is not None and config.nt4.velocity is not None
        self._own = NtKeys(config.nt4.server, keys_of_velocity(config.nt4.velocity))
        super().__init__(config, self._own, clock)

    def close(self) -> None:
        self._own.close()
