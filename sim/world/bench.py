"""A launcher on the bench: brings a world's wheels and hood to set points with torques and feeds balls.

It looks at the truth instead of at sensors, so that surveys and tests measure the world and nothing else.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from truearc.sim.world.field import BallResult
from truearc.sim.world.hood import COULOMB_NM
from truearc.sim.world.world import World

TICK_NS = 5_000_000
FEED_NM = 0.2
FEED_TICKS = 50
CLEAR_TICKS = 160                 # from one feeding to the next, at least
DEADBAND_DEG = 0.03
LAG_TICKS = 1                     # how old a wheel's speed is when a torque answers to it, as over the robot's bus


Ball = tuple[float, float, float, float]      # s since it left, x, y, z in the launcher's axes; in the air
Watch = Callable[[World], Ball | None]


class Sample(NamedTuple):
    """The bench's record of one tick."""

    t_s: float
    wheel_rad_s: float
    hood_deg: float
    bus_v: float
    ball: Ball | None


class NotReady(TimeoutError):
    """The robot does not get to the set points; no ball was fed."""


class Bench:
    """Torque control of one world: proportional plus integral on the wheels, proportional-derivative on the screw."""

    def __init__(self, world: World, watch: Watch = lambda world: None) -> None:
        """watch: gives where the ball in the air is, for whoever needs it."""
        self.world, self._watch = world, watch
        self.t_ns = 0
        self.samples: list[Sample] = []
        self._integral_nm = 0.0
        self._speeds = deque([world.belt.speed_rad_s], LAG_TICKS + 1)
        self._steady = 0

    def fire(self, wheel_rad_s: float, hood_deg: float, shots: int, longest_s: float = 120.0,
             ready_s: float = 120.0) -> list[BallResult]:
        """Hold both set points, feed that many balls one at a time, and wait until they have arrived.

        Raises NotReady if the set points are not reached within ready_s, TimeoutError if balls do not arrive.
        """
        world, had = self.world, len(self.world.results)
        until_ns, ready_ns = (self.t_ns + round(one * 1e9) for one in (longest_s, ready_s))
        fed, since = 0, CLEAR_TICKS
        self._steady = 0                              # that was at other set points
        while len(world.results) < had + shots:
            if fed == 0 and self.t_ns > ready_ns:
                raise NotReady(f"not at {wheel_rad_s:.0f} rad/s and {hood_deg:.1f} deg after {ready_s} s")
            if self.t_ns > until_ns:
                raise TimeoutError(f"{len(world.results) - had} of {shots} balls after {longest_s} s")
            if fed < shots and since >= CLEAR_TICKS and self._steady > 20 and len(world.results) == had + fed:
                fed, since = fed + 1, 0
            self.tick(wheel_rad_s, hood_deg, FEED_NM if since < FEED_TICKS and fed else 0.0)
            since += 1
        return world.results[had:]

    def tick(self, wheel_rad_s: float, hood_deg: float, feeder_nm: float = 0.0) -> None:
        """One control period towards the set points."""
        world = self.world
        wheel_nm, wheel_off = self._wheels(wheel_rad_s)
        hood_nm, hood_off = self._hood(hood_deg)
        self._steady = self._steady + 1 if wheel_off < 1.0 and hood_off < 2.0 * DEADBAND_DEG else 0
        self.t_ns += TICK_NS
        world.advance(self.t_ns, {"flywheel_a": wheel_nm, "flywheel_b": wheel_nm, "hood": hood_nm, "feeder": feeder_nm})
        self.samples.append(Sample(self.t_ns * 1e-9, world.belt.speed_rad_s, world.hood.elevation_deg, world.bus_v(),
                                   self._watch(world)))

    def _wheels(self, wanted_rad_s: float) -> tuple[float, float]:
        self._speeds.append(self.world.belt.speed_rad_s)
        error = wanted_rad_s - self._speeds[0]
        if abs(error) < 20.0:
            self._integral_nm = min(max(self._integral_nm + 0.1 * error * TICK_NS * 1e-9, -0.3), 0.3)
        ahead_nm = 0.02 + 1.5e-4 * wanted_rad_s
        return min(max(ahead_nm + 0.03 * error + self._integral_nm, 0.0), 1.2), abs(error)

    def _hood(self, wanted_deg: float) -> tuple[float, float]:
        error = wanted_deg - self.world.hood.elevation_deg
        speed_deg_s = 0.2 * self.world.motor("hood").velocity_rad_s
        if abs(error) < DEADBAND_DEG:
            return -0.002 * speed_deg_s, abs(error)
        friction_nm = COULOMB_NM if error > 0.0 else -COULOMB_NM
        return min(max(0.05 * error - 0.004 * speed_deg_s, -0.3), 0.3) + friction_nm, abs(error)
