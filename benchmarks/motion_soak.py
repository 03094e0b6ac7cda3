"""No false release: the emulated robot shoots, steps and waits under whatever is ugly but not wrong.

    python -m benchmarks.motion_soak [--only PATTERN] [--seconds 800] [--launcher spark] [--out FILE]

Each case takes so many emulated seconds: the eleven of them more than two hours. A line of FILE a case; one that is
there already, and right, is not run again. Wrong is a motion interlock among a verdict's reasons, and on the plant an
axis without torque for as long as a release lasts, while it is not where the robot wants it.
"""

import argparse
import re
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
from msgspec import UNSET
from msgspec.structs import replace

from benchmarks.matrix.motion import FREE_RAD_S, GOOD_S, PLACE_M, SET_RAD_S, MovingWorld, ToldEyes, make_sick_nodes
from benchmarks.matrix.rows import INTERLOCKS
from benchmarks.matrix.run import with_launcher
from benchmarks.options import add_options
from truearc.cli.common import SHIPPED
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.emulated.nodes import StepClock
from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config, Prescribed, load_config
from truearc.robot.runtime import run
from truearc.robot.types import Sent, Tick
from truearc.sim.world.emulated_robot import emulated_rig
from truearc.sim.world.options import Options
from truearc_proof.parallel import append_line, lines_of

NS = 1e-9
SETTLE_S, FIRE_S, MARK_S = 1.0, 2.0, 1.2      # the driver arms, asks for a ball so often, and marks it so much later
SHORT_WHEEL, SHORT_DEG = 0.03, 1.0    # an axis that is further from its set point is to be driven
DIP_S = 0.0009                        # a dip is what is lost in at least so long
DISARM_S, ARM_S = 0.2, 0.3            # after a mark; after that, while the wheels coast
SEEN_S, HIDDEN_S = 13.0, 17.0         # the target, in turn: hidden for longer than the wheels then stay at speed


class Case(msgspec.Struct, frozen=True):
    """What is ugly: the world's options and trouble, of the devices' frames, and (rad/s, deg) to be shot at in turn."""

    points: tuple[tuple[float, float], ...] = ((SET_RAD_S, 45.0),)
    options: Options = Options()
    world: str = ""
    frames: str = ""
    is_shot: bool = True              # balls must go
    arms_again: bool = False          # after each ball
    is_hidden: bool = False           # the target, in turn


CASES = {
    "balls": Case(),
    "balls, wheels of a fifth of their inertia": Case(options=Options(flywheel_inertia_scale=0.2)),
    "set points stepped down, no brake": Case(((520.0, 45.0), (400.0, 45.0), (250.0, 45.0))),
    "9 V at 80 % of free speed": Case(((0.8 * FREE_RAD_S, 45.0),), Options(battery_start_v=9.0), is_shot=False),
    "10 % slip": Case(world="motor 2 slips", is_shot=False),
    "stiction": Case(((SET_RAD_S, 40.0), (SET_RAD_S, 50.0)), world="stiction"),
    "half the frames lost": Case(frames="half the frames lost"),
    "gaps of 70 ms": Case(frames="gaps of 70 ms"),
    "hood at its speed limit": Case(((SET_RAD_S, 20.0), (SET_RAD_S, 70.0))),
    "armed again while the wheels coast": Case(((520.0, 45.0), (400.0, 45.0), (250.0, 45.0)), arms_again=True),
    "speeds noisy, armed again, no target for a time": Case(world="speeds are noisy", arms_again=True, is_hidden=True,
                                                            is_shot=False),
}


class Soaked(msgspec.Struct):
    """One case. `gaps_s`: longest time without torque of wheels and hood while they were to be driven."""

    case: str
    launcher: str
    emulated_s: float = 0.0
    took_s: float = 0.0
    fires: int = 0
    largest_dip: float = 0.0          # rad/s that the true wheel speed lost in one millisecond
    fastest_deg_s: float = 0.0        # of the hood, over 0.1 s
    gaps_s: tuple[float, float] = (0.0, 0.0)
    interlocks: dict[str, int] = {}   # ticks with one of these codes
    holds: dict[str, int] = {}        # ticks with each other code
    wrong: list[str] = []


class Watcher:
    """Keeps nothing of a tick, but looks at it and at the plant."""

    def __init__(self, world: MovingWorld, result: Soaked) -> None:
        self._world, self._result = world, result
        self._since_s, self._was_driven = [0.0, 0.0], [False, False]
        self._was_armed = False
        self._interlocks: Counter[str] = Counter()
        self._holds: Counter[str] = Counter()
        self._last: tuple[float, ...] = ()
        self._hood: list[tuple[float, float]] = []

    def record(self, tick: Tick, sent: Sent) -> None:
        result, lines = self._result, self._world.lines
        result.fires += tick.verdict.fire
        for reason in tick.verdict.reasons:
            is_set_up = _is_set_up(reason) and not any(self._was_driven)
            (self._interlocks if reason.code in INTERLOCKS and not is_set_up else self._holds)[reason.code] += 1
        memory = tick.memory
        wanted_rad_s = tick.aim.motor_ratio * FREE_RAD_S if memory.armed and not _is_idle(tick) else 0.0
        if memory.armed != self._was_armed:
            self._was_armed, self._was_driven = memory.armed, [False, False]
        for line in lines:
            t_s, a_nm, b_nm, hood_nm, wheel_rad_s, hood_deg, _ = line
            if not self._last or t_s - self._last[0] >= DIP_S:
                dip = (self._last[4] - wheel_rad_s) / (t_s - self._last[0]) * 1e-3 if self._last else 0.0
                result.largest_dip, self._last = max(result.largest_dip, dip), line
            is_short = (wanted_rad_s > 0.0 and wheel_rad_s < (1.0 - SHORT_WHEEL) * wanted_rad_s and not (a_nm and b_nm),
                        wanted_rad_s > 0.0 and memory.homed and not hood_nm
                        and abs(hood_deg - tick.aim.hood_deg) > SHORT_DEG)
            for axis, short in enumerate(is_short):
                self._was_driven[axis] |= bool(hood_nm if axis else a_nm and b_nm)    # a SPARK is set up first
                self._since_s[axis] = (self._since_s[axis] or t_s) if short and self._was_driven[axis] else 0.0
            gaps_s = [t_s - since_s if since_s else 0.0 for since_s in self._since_s]
            result.gaps_s = tuple(map(max, result.gaps_s, gaps_s))            # type: ignore[assignment]
        if lines:
            self._hood = [*self._hood[-20:], (lines[-1][0], lines[-1][5])]
            (begin_s, begin_deg), (end_s, end_deg) = self._hood[0], self._hood[-1]
            if len(self._hood) > 20:
                result.fastest_deg_s = max(result.fastest_deg_s, abs(end_deg - begin_deg) / (end_s - begin_s))
        lines.clear()
        result.interlocks, result.holds = dict(self._interlocks), dict(self._holds)

    def keep_picture(self, picture: CameraFrame) -> None: ...


def _is_idle(tick: Tick) -> bool:
    return tick.memory.motion is not UNSET and tick.memory.motion.is_idle


def _is_set_up(reason: Reason) -> bool:
    """Whether an axis is released because its SPARK is still being set up, which answers that are lost delay."""
    cause = reason.params.get("cause")
    return isinstance(cause, Reason) and cause.code in (
        "spark_firmware_unknown", "spark_status_off", "spark_settings_unconfirmed")


def soak(name: str, case: Case, launcher: str, seconds: float, seed: int = 1) -> Soaked:
    """Run one case for so many emulated seconds."""
    config, result = _configured(case, launcher), Soaked(name, launcher)
    world, box, began_s = MovingWorld(seed, case.options), open_button_box(), time.monotonic()
    nodes = make_sick_nodes(config, world)
    world.suffer(case.world)
    for node in nodes.values():
        node.suffer(case.frames, 0)
    presses = _presses(case.arms_again)
    due_s, button = next(presses)

    def press(t_ns: int) -> None:
        nonlocal due_s, button
        if t_ns * NS >= due_s:
            box.press(button)
            due_s, button = next(presses)

    def hidden() -> bool:
        return case.is_hidden and eyes.clock.now_ns() * NS % (SEEN_S + HIDDEN_S) > SEEN_S

    eyes = ToldEyes(StepClock(lambda t_ns: None), hidden)
    with emulated_rig(config, world, nodes, box, eyes, (press,), lambda frame, sent: None,
                      lambda now_ns: now_ns * NS >= seconds) as (rig, clock):
        eyes.clock = clock
        run(rig, config, None, Watcher(world, result))
        result.emulated_s, result.took_s = clock.now_ns() * NS, time.monotonic() - began_s
    _judge(case, result)
    return result


def _presses(arms_again: bool) -> Iterator[tuple[float, str]]:
    t_s = SETTLE_S
    yield t_s, "arm"
    while True:
        t_s += FIRE_S
        yield t_s, "fire"
        yield t_s + MARK_S, "two"
        if arms_again:
            t_s += MARK_S + DISARM_S
            yield t_s, "arm"
            t_s += ARM_S
            yield t_s, "arm"


def _configured(case: Case, launcher: str) -> Config:
    config = load_config(SHIPPED)
    rows = tuple(Prescribed(PLACE_M, rad_s / FREE_RAD_S, hood_deg) for rad_s, hood_deg in case.points)
    return with_launcher(replace(config, collect=replace(config.collect, prescribed=rows * 10_000)), launcher)


def _judge(case: Case, result: Soaked) -> None:
    if result.interlocks:
        result.wrong.append(f"interlocks: {', '.join(f'{code} in {n} ticks' for code, n in result.interlocks.items())}")
    for axis, gap_s in zip(("wheels", "hood"), result.gaps_s, strict=True):
        if gap_s > GOOD_S:
            result.wrong.append(f"{axis} without torque for {gap_s:.2f} s off their set point")
    if case.is_shot and result.fires * 4 * FIRE_S < result.emulated_s:
        result.wrong.append(f"only {result.fires} balls")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--launcher", default="odrive", choices=("odrive", "spark"))
    args = add_options(parser, only=("", "a pattern: cases whose names match"), seconds=(800.0, "emulated, of each"),
                       out=(Path, "a line a case; goes on where it ended")).parse_args()
    there = [msgspec.convert(line, Soaked) for line in lines_of(args.out)] if args.out else []
    done = {(one.case, one.launcher) for one in there if not one.wrong}
    wrong = 0
    for name, case in CASES.items():
        if re.search(args.only, name) and (name, args.launcher) not in done:
            result = soak(name, case, args.launcher, args.seconds)
            wrong += bool(result.wrong)
            print(f"{name}: {result.emulated_s:.0f} s in {result.took_s:.0f} s, {result.fires} balls, dips of "
                  f"{result.largest_dip:.1f} rad/s per ms, hood at most {result.fastest_deg_s:.0f} deg/s, gaps "
                  f"{result.gaps_s[0]:.2f} and {result.gaps_s[1]:.2f} s; "
                  f"{'; '.join(result.wrong) or 'as it should be'}", flush=True)
            if args.out:
                append_line(args.out, result)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
