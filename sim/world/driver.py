"""The person with the button box: drives, asks for a shot, and says what became of it."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from truearc.robot.config.schema import Config
from truearc.sim.world.world import World

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
SETTLE_S = 0.3                    # from standing still to pressing fire, and before arming
NOTICE_S = 0.4                    # from seeing where the ball went to pressing the button
BETWEEN_S = 0.2                   # from one press to the next
JAM_S = 10.0                      # a ball that has gone in and not come out is given up after this
REJECTED_SHARE = 0.02             # share of trials that the driver knows to be worthless
MAX_TRIALS_AT_A_STOP = 3


class Driver:
    """Sees only the world, never the robot's mind; call step() once a tick until `done`.

    Distances are a golden-ratio sequence over `distances` (metres, exit point to target plane), one to three trials at
    each stop, times `repeats`, so that a configuration is shot from one place; or, where `places` are given, each of
    them for one configuration. A shot that the robot has not granted after `patience_s` is given up; a ball that went
    in and has not come out is rejected.
    """

    def __init__(self, world: World, press: Callable[[str], None], trials: int, seed: int,
                 distances: tuple[float, float] = (2.6, 8.0), patience_s: float = 8.5, repeats: int = 1,
                 places: Sequence[float] = (), jam_s: float = JAM_S, rejected_share: float = REJECTED_SHARE) -> None:
        self._world = world
        self._press = press
        self._trials = trials
        self._distances = distances
        self._patience_s = patience_s
        self._repeats = repeats
        self._places = places
        self._jam_s, self._rejected_share = jam_s, rejected_share
        self._rng = np.random.default_rng([seed, 6])
        self._place = float(self._rng.uniform())
        self._left_here = 0
        self._wake_t_ns: int | None = None
        self._fired_t_ns = 0
        self._seen = 0
        self._went_in = False
        self._do: Callable[[int], None] = self._arm
        self.trial = 0                # trials begun
        self.done = trials <= 0

    def step(self, t_ns: int) -> None:
        """Do what a person would do at this moment, if anything."""
        if self.done:
            return
        if self._wake_t_ns is None:
            self._wait(t_ns, SETTLE_S, self._arm)
        if t_ns >= (self._wake_t_ns or 0):
            self._do(t_ns)

    def _wait(self, t_ns: int, seconds: float, then: Callable[[int], None]) -> None:
        self._wake_t_ns = t_ns + round(seconds * 1e9)
        self._do = then

    def _arm(self, t_ns: int) -> None:
        self._press("arm")
        self._wait(t_ns, BETWEEN_S, self._begin)

    def _begin(self, t_ns: int) -> None:
        if self.trial >= self._trials:
            self.done = True
            return
        self.trial += 1
        if self._left_here == 0:
            self._world.chassis.drive_to(self._next_place_m())
        self._left_here -= 1
        self._do = self._stop

    def _next_place_m(self) -> float:
        if self._places:
            self._left_here = self._repeats
            return self._places[(self.trial - 1) // self._repeats]
        self._left_here = self._repeats * int(self._rng.integers(1, MAX_TRIALS_AT_A_STOP + 1))
        self._place = (self._place + GOLDEN) % 1.0
        low_m, high_m = self._distances
        return low_m + (high_m - low_m) * self._place

    def _stop(self, t_ns: int) -> None:
        if not self._world.chassis.moving:
            self._wait(t_ns, SETTLE_S, self._fire)

    def _fire(self, t_ns: int) -> None:
        self._seen = len(self._world.results)
        self._fired_t_ns = t_ns
        self._went_in = False
        self._press("fire")
        self._do = self._watch

    def _watch(self, t_ns: int) -> None:
        if len(self._world.results) > self._seen:
            self._wait(t_ns, NOTICE_S, self._mark)
            return
        self._went_in = self._went_in or self._world.ball_on_its_way
        patience_s = self._patience_s + (self._jam_s if self._world.ball_on_its_way else 0.0)
        if t_ns - self._fired_t_ns > patience_s * 1e9:
            # unrejected, a ball that was thrown back would have the robot wait for its mark for ever
            self._do = self._reject if self._went_in else self._begin

    def _mark(self, t_ns: int) -> None:
        self._press(self._world.results[self._seen].outcome)
        rejected_share = bool(self._rng.uniform() < self._rejected_share)
        self._wait(t_ns, BETWEEN_S, self._reject if rejected_share else self._begin)

    def _reject(self, t_ns: int) -> None:
        self._press("reject")
        self._wait(t_ns, BETWEEN_S, self._begin)


def make_driver(config: Config, world: World, press: Callable[[str], None], trials: int, seed: int) -> Driver:
    """A driver who shoots what the configuration prescribes, if it does, and waits as long as the robot tries."""
    return Driver(world, press, trials, seed, patience_s=config.gate.request_s + 0.5, repeats=config.collect.repeats,
                  places=[row.distance_m for row in config.collect.prescribed])
