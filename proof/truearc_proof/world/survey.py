"""Measurements of the emulated world: `python -m truearc_proof.world.survey` prints them as tables."""

import math
import statistics
import time

from truearc.sim.world.drive import UPPER_GEAR
from truearc.sim.world.field import BallResult
from truearc.sim.world.options import Options
from truearc.sim.world.scene import LOWER_RADIUS_M, UPPER_RADIUS_M
from truearc.sim.world.season import Bench
from truearc.sim.world.world import World

FULL_RAD_S = 594.0
RATIOS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
SCATTER_AT = ((3.0, 300.0, 45.0), (4.0, 310.0, 45.0), (5.0, 345.0, 40.0), (6.5, 390.0, 40.0), (8.0, 450.0, 38.0))


def ideal_speed_m_s(wheel_rad_s: float) -> float:
    """Mean surface speed of the two wheels."""
    return 0.5 * wheel_rad_s * (LOWER_RADIUS_M + UPPER_GEAR * UPPER_RADIUS_M)


def no_slip_spin_rev_s(wheel_rad_s: float, radius_m: float = 0.0889) -> float:
    """Backspin of a ball that rolls on both wheels: half the difference of their surface speeds over its radius."""
    surface_m_s = wheel_rad_s * (LOWER_RADIUS_M - UPPER_GEAR * UPPER_RADIUS_M)
    return surface_m_s / (2.0 * radius_m) / (2.0 * math.pi)


def recovery_s(bench: Bench, result: BallResult, within_rad_s: float = 3.0) -> float:
    """From the ball leaving until the wheels are back within this of their speed before it."""
    exit_s = result.exit_t_ns * 1e-9
    off = [s.t_s for s in bench.samples
           if s.t_s > exit_s and abs(s.wheel_rad_s - result.wheel_before_rad_s) > within_rad_s]
    return max(off) - exit_s if off else 0.0


def _launches() -> None:
    print("ratio  speed/ideal  droop  spin/no-slip  exit-hood deg  exit m/s  contact ms  recovery s")
    for ratio in RATIOS:
        bench = Bench(World(0, Options(scatter_scale=0.0)))
        shot = bench.fire(ratio * FULL_RAD_S, 45.0, 1)[0]
        for _ in range(300):
            bench.tick(ratio * FULL_RAD_S, 45.0)
        before = shot.wheel_before_rad_s
        print(f"{ratio:5.2f}  {shot.exit_speed_m_s / ideal_speed_m_s(before):11.3f}"
              f"  {1.0 - shot.wheel_after_rad_s / before:5.3f}"
              f"  {shot.exit_spin_rev_s / no_slip_spin_rev_s(before):12.3f}  {shot.exit_deg - shot.hood_deg:13.2f}"
              f"  {shot.exit_speed_m_s:8.2f}  {(shot.exit_t_ns - shot.fed_t_ns) * 1e-6:10.1f}"
              f"  {recovery_s(bench, shot):10.2f}")


def _scatter() -> None:
    print("\ndistance m  hood deg  wheel rad/s  mean height m  sd height m  sd sideways m   (3 worlds x 24 shots)")
    for distance_m, wheel_rad_s, hood_deg in SCATTER_AT:
        shots = [shot for seed in range(3)
                 for shot in Bench(World(seed, distance_m=distance_m)).fire(wheel_rad_s, hood_deg, 24)]
        heights = [shot.z_m for shot in shots if shot.z_m is not None]
        sides = [shot.y_m for shot in shots if shot.y_m is not None]
        print(f"{distance_m:10.1f}  {hood_deg:8.0f}  {wheel_rad_s:11.0f}  {statistics.mean(heights):13.2f}"
              f"  {statistics.stdev(heights):11.3f}  {statistics.stdev(sides):13.3f}")


def _cost() -> None:
    world, torques = World(0), {"flywheel_a": 0.3, "flywheel_b": 0.3, "hood": 0.05, "feeder": 0.0}
    began_s = time.process_time()
    for tick in range(1, 4001):
        world.advance(tick * 5_000_000, torques)
    idle_us = (time.process_time() - began_s) / 4000 * 1e6
    bench = Bench(World(0, distance_m=5.0))
    began_s = time.process_time()
    bench.fire(345.0, 40.0, 24)
    busy_us = (time.process_time() - began_s) / len(bench.samples) * 1e6
    share = 24.0 / (bench.t_ns * 1e-9)
    print(f"\nCPU per 5 ms tick: {idle_us:.1f} us with no ball; {busy_us:.1f} us on average at {share:.2f} shots a"
          " second, the bench's own control included")


if __name__ == "__main__":
    _launches()
    _scatter()
    _cost()
