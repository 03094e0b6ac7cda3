"""Worlds for tests: without scatter unless asked for, shot in from a bench."""

import msgspec

from truearc.sim.world.options import Options
from truearc.sim.world.world import Bench, World

CALM = Options(scatter_scale=0.0, pose_scale=0.0)


def calm(**changes: object) -> Options:
    return msgspec.structs.replace(CALM, **changes)


def fire(options: Options = CALM, seed: int = 1, wheel: float = 400.0, hood: float = 45.0, shots: int = 1,
         distance: float = 5.0) -> tuple[World, Bench]:
    bench = Bench(World(seed, options, distance))
    bench.fire(wheel, hood, shots)
    return bench.world, bench
