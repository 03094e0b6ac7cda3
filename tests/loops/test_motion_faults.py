"""Motion in the fault matrix: the judge, a short form of its rows, and no false release whatever is ugly but not wrong.

TRUEARC_SOAK_S: emulated seconds of each case of the latter (800: two hours in all); TRUEARC_SOAK_LAUNCHER: or spark.
"""

import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from benchmarks.matrix import motion as moving
from benchmarks.matrix.fault import REARM, Motion, Row
from benchmarks.matrix.judge import Result, judge
from benchmarks.matrix.play import play
from benchmarks.matrix.rows import INTERLOCKS, MOTION_ROWS
from benchmarks.matrix.run import with_launcher
from tests.hw.host_speed import excuse_stalls
from truearc.cli.common import SHIPPED
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.emulated.nodes import StepClock
from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config, Prescribed, load_config
from truearc.robot.runtime import run as run_loop
from truearc.robot.types import Sent, Tick
from truearc.sim.world import drive
from truearc.sim.world.emulated_robot import emulated_rig
from truearc.sim.world.options import Options

posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals and signals")
NAMES = {row.name: row for row in MOTION_ROWS}
# every row of the table and every interlock
QUICK = ("wheels: both encoders read 0, since rest", "wheels: both speeds read 40 % too low, since rest",
         "wheels: both motors turn the other way, since rest", "wheels: no estimates of motor 1 since the start",
         "wheels: both encoders: readings stop, heartbeats go on while spinning up",
         "wheels: both encoders: readings freeze while spinning up",
         "wheels: both encoders: readings jump to 0 while spinning up",
         "wheels: both encoders: readings turn big-endian while spinning up",
         "wheels: motor 2 keeps its torque, whatever it is asked for",
         "wheels: motor 1's readings stop for 0.25 s, again and again",
         "wheels: motor 2 gives up with an error while spinning up",
         "wheels: no target and no request for more than 10 s", "hood: no angles while it rises",
         "hood: its encoder is frozen while it rises", "hood: its encoder jumps by 10 degrees at the set point",
         "hood: is jammed", "hood: is jammed for 0.45 s", "hood: its limit switch never closes",
         "hood: its limit switch never answers", "hood: its screw has come loose of the motor",
         "hood: its screw is stiff", "hood: its encoder reads 0.8 degrees low, set point at the soft limit",
         "hood: rises from its switch to 70 degrees", "hood: its encoder is frozen while it homes from 60 degrees",
         "hood: its encoder is reversed while it homes from 60 degrees",
         "hood: its motor's encoder reads 0 while it homes from 60 degrees",
         "hood: is jammed 0.6 degrees below its set point: a small push is dropped",
         "hood: its limit switch sticks closed while it rises", "hood: creeps from 60 degrees: homing ends by time",
         "hood: has no encoder, and its screw has come loose of the motor: homing ends by travel",
         "hood: its driver gives full torque, however little it is asked for, since it rises",
         "hood: has no encoder, and its motor's reads 0", "hood: has no encoder, homes from 60 degrees and rises")
SPARK = ("wheels: both encoders read 0, since rest", "hood: its encoder is frozen while it rises")
REAL = ("motion, wheels: both encoders read 0, since rest",
        "motion, wheels: both encoders: readings stop, heartbeats go on while spinning up",
        "motion, hood: its encoder is frozen while it rises", "motion, SPARK wheels: both encoders read 0, since rest")
def run(row: Row, bus: str, folder: Path) -> Result:
    stepped = bus == "virtual"
    play(row, bus, folder / "run", stepped)
    return judge(row, bus, stepped, folder / "run")


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", [*(f"motion, {name}" for name in QUICK), *(f"motion, SPARK {name}" for name in SPARK)])
def test_what_moves_is_released_in_time(name: str, tmp_path: Path) -> None:
    result = run(NAMES[name], "virtual", tmp_path)
    assert not result.wrong, result


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_what_moves_is_released_in_real_time(name: str, tmp_path: Path) -> None:
    with excuse_stalls():
        results = []
        for tries in range(3):                    # a machine that stalls is not a robot
            results.append(run(NAMES[name], "slcan", tmp_path / str(tries)))
            if not results[-1].wrong:
                return
        raise AssertionError(results)


STEP_S = 0.001                        # of the log


def log_of(seconds: float, torque_until_s: float, wheel_rad_s: float = moving.SET_RAD_S,
           hood_deg: float = 45.0) -> np.ndarray:
    log = np.zeros((round(seconds / STEP_S), len(moving.COLUMNS)))
    log[:, 0] = np.arange(1, len(log) + 1) * STEP_S
    log[:, 1] = log[:, 2] = np.where((log[:, 0] <= torque_until_s) | (log[:, 0] > seconds - 2.0), 0.8, 0.0)
    log[:, 4], log[:, 5] = wheel_rad_s, hood_deg
    return log


def judged(tmp_path: Path, log: np.ndarray, **changes: float) -> Result:
    motion = Motion("frozen", ("flywheel_a",), "spinning", "wheels", "fault", "none")
    row = Row("motion", "motion", motion, (), 0.08, REARM, 3.0)
    moved = moving.Moved(begin_s=2.0, end_s=5.0, rearm_s=6.2, over_s=9.0, true_s=1.99)
    for name, value in changes.items():
        setattr(moved, name, value)
    (tmp_path / "devices.json").write_bytes(msgspec.json.encode(moved))
    np.save(tmp_path / "devices.npy", log)
    result = Result(row.name, row.family, "virtual", bound_s=row.within_s)
    moving.judge_motion(row, motion, tmp_path, result, [])
    return result


def test_the_judge_measures_on_the_plant(tmp_path: Path) -> None:
    good = judged(tmp_path, log_of(9.0, 2.07))
    assert not good.wrong and good.hold_s == pytest.approx(0.07, abs=0.002), good
    assert "driven for 0.12 s, 0.08 allowed" in "; ".join(judged(tmp_path, log_of(9.0, 2.12)).wrong)
    assert "before it was armed again" in "; ".join(judged(tmp_path, log_of(9.0, 5.3)).wrong)
    assert "wheels at 420 rad/s, 1.17" in "; ".join(judged(tmp_path, log_of(9.0, 2.07, 420.0)).wrong)
    assert "pushed for 2.07 s without motion" in "; ".join(judged(tmp_path, log_of(9.0, 2.07, 0.0)).wrong)
    assert "hood 2.0 deg past" in "; ".join(judged(tmp_path, log_of(9.0, 2.07, hood_deg=77.0)).wrong)
    fast = log_of(9.0, 2.07)
    fast[:, 5] += np.clip(fast[:, 0] - 3.0, 0.0, 0.5) * 30.0
    assert "hood at 30 deg/s" in "; ".join(judged(tmp_path, fast).wrong)
    assert "never ready" in "; ".join(judged(tmp_path, log_of(9.0, 2.07), begin_s=0.0, over_s=0.0).wrong)


# --- no false release: on the plant an axis is without torque off its set point only while it is released

NS = 1e-9
SETTLE_S, FIRE_S, MARK_S = 1.0, 2.0, 1.2      # the driver arms, asks for a ball so often, and marks it so much later
SHORT_WHEEL, SHORT_DEG = 0.03, 1.0    # an axis that is further from its set point is to be driven
DISARM_S, ARM_S = 0.2, 0.3            # after a mark; after that, while the wheels coast
SEEN_S, HIDDEN_S = 13.0, 17.0         # the target, in turn: hidden for longer than the wheels then stay at speed


class Case(msgspec.Struct, frozen=True):
    """What is ugly: the world's options and trouble, of the devices' frames, and (rad/s, deg) to be shot at in turn."""

    points: tuple[tuple[float, float], ...] = ((moving.SET_RAD_S, 45.0),)
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
    "9 V at 80 % of free speed": Case(((0.8 * moving.FREE_RAD_S, 45.0),), Options(battery_start_v=9.0), is_shot=False),
    "10 % slip": Case(world="motor 2 slips", is_shot=False),
    "stiction": Case(((moving.SET_RAD_S, 40.0), (moving.SET_RAD_S, 50.0)), world="stiction"),
    "half the frames lost": Case(frames="half the frames lost"),
    "gaps of 70 ms": Case(frames="gaps of 70 ms"),
    "hood at its speed limit": Case(((moving.SET_RAD_S, 20.0), (moving.SET_RAD_S, 70.0))),
    "armed again while the wheels coast": Case(((520.0, 45.0), (400.0, 45.0), (250.0, 45.0)), arms_again=True),
    "speeds noisy, armed again, no target for a time": Case(world="speeds are noisy", arms_again=True, is_hidden=True,
                                                            is_shot=False)}


class Watcher:
    """Keeps nothing of a tick, but looks at it and at the plant."""

    def __init__(self, world: moving.MovingWorld) -> None:
        self.fires, self.gaps_s = 0, [0.0, 0.0]   # the longest time without torque of wheels and hood while needed
        self.interlocks: Counter[str] = Counter()
        self._world = world
        self._since_s, self._was_driven = [0.0, 0.0], [False, False]
        self._was_armed = False

    def record(self, tick: Tick, sent: Sent) -> None:
        self.fires += tick.verdict.fire
        for reason in tick.verdict.reasons:
            if reason.code in INTERLOCKS and (any(self._was_driven) or not is_set_up(reason)):
                self.interlocks[reason.code] += 1
        memory = tick.memory
        is_idle = memory.motion is not UNSET and memory.motion.is_idle
        wanted_rad_s = tick.aim.motor_ratio * moving.FREE_RAD_S if memory.armed and not is_idle else 0.0
        if memory.armed != self._was_armed:
            self._was_armed, self._was_driven = memory.armed, [False, False]
        for t_s, a_nm, b_nm, hood_nm, wheel_rad_s, hood_deg, _ in self._world.lines:
            is_short = (wanted_rad_s > 0.0 and wheel_rad_s < (1.0 - SHORT_WHEEL) * wanted_rad_s and not (a_nm and b_nm),
                        wanted_rad_s > 0.0 and memory.homed and not hood_nm
                        and abs(hood_deg - tick.aim.hood_deg) > SHORT_DEG)
            for axis, short in enumerate(is_short):
                self._was_driven[axis] |= bool(hood_nm if axis else a_nm and b_nm)    # a SPARK is set up first
                since_s = (self._since_s[axis] or t_s) if short and self._was_driven[axis] else 0.0
                self._since_s[axis] = since_s
                self.gaps_s[axis] = max(self.gaps_s[axis], t_s - since_s if since_s else 0.0)
        self._world.lines.clear()

    def keep_picture(self, picture: CameraFrame) -> None: ...


def is_set_up(reason: Reason) -> bool:
    """Whether an axis is released because its SPARK is still being set up, which answers that are lost delay."""
    cause = reason.params.get("cause")
    return isinstance(cause, Reason) and cause.code in (
        "spark_firmware_unknown", "spark_status_off", "spark_settings_unconfirmed")


def presses_of(arms_again: bool) -> Iterator[tuple[float, str]]:
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


def play_world(world: moving.MovingWorld, config: Config, seconds: float, watcher: Watcher, *, frames: str = "",
               arms_again: bool = False, is_hidden: bool = False) -> None:
    """Run the robot in that world for so long in stepped time; the driver arms it and shoots."""
    box, nodes = open_button_box(), moving.make_sick_nodes(config, world)
    for node in nodes.values():
        node.suffer(frames, 0)
    presses = presses_of(arms_again)
    due_s, button = next(presses)

    def press(t_ns: int) -> None:
        nonlocal due_s, button
        if t_ns * NS >= due_s:
            box.press(button)
            due_s, button = next(presses)

    def hidden() -> bool:
        return is_hidden and eyes.clock.now_ns() * NS % (SEEN_S + HIDDEN_S) > SEEN_S

    eyes = moving.ToldEyes(StepClock(lambda t_ns: None), hidden)
    with emulated_rig(config, world, nodes, box, eyes, (press,), lambda frame, sent: None,
                      lambda now_ns: now_ns * NS >= seconds) as (rig, clock):
        eyes.clock = clock
        run_loop(rig, config, None, watcher)


def configured(case: Case, launcher: str) -> Config:
    config = load_config(SHIPPED)
    rows = tuple(Prescribed(moving.PLACE_M, rad_s / moving.FREE_RAD_S, hood_deg) for rad_s, hood_deg in case.points)
    return with_launcher(replace(config, collect=replace(config.collect, prescribed=rows * 10_000)), launcher)


@posix
@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_no_false_release(name: str) -> None:
    case, seconds = CASES[name], float(os.environ.get("TRUEARC_SOAK_S", "40"))
    config = configured(case, os.environ.get("TRUEARC_SOAK_LAUNCHER", "odrive"))
    world = moving.MovingWorld(1, case.options)
    watcher = Watcher(world)
    world.suffer(case.world)
    play_world(world, config, seconds, watcher, frames=case.frames, arms_again=case.arms_again,
               is_hidden=case.is_hidden)
    assert not watcher.interlocks and max(watcher.gaps_s) <= moving.GOOD_S
    assert not case.is_shot or watcher.fires * 4 * FIRE_S >= seconds


class Lowest(Watcher):
    """Notes how low the hood has been, and why an axis was released for good."""

    def __init__(self, world: moving.MovingWorld) -> None:
        super().__init__(world)
        self.lowest_deg, self.causes = 90.0, set[str]()

    def record(self, tick: Tick, sent: Sent) -> None:
        self.lowest_deg = min(self.lowest_deg, *(line[5] for line in self._world.lines or [(90.0,) * 6]))
        self.causes |= {cause.code for reason in tick.verdict.reasons
                        if isinstance(cause := reason.params.get("cause"), Reason)}
        super().record(tick, sent)


@posix
@pytest.mark.parametrize(("start_deg", "inertia_kg_m2"), [(25.0, 6e-5), (60.0, 6e-5), (60.0, 2e-5)])
def test_homing_stops_below_a_switch_that_never_closes(start_deg: float, inertia_kg_m2: float,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "LOW_DEG", 10.0)           # the stop is far below the switch
    monkeypatch.setattr(drive, "LOW_RAD", drive.screw_rad(10.0))
    monkeypatch.setattr(drive, "SCREW_INERTIA_KG_M2", inertia_kg_m2)
    config = configured(Case(), "odrive")
    world = moving.MovingWorld(1, Options(), start_deg)
    watcher = Lowest(world)
    play_world(world, config, SETTLE_S + 6.0, watcher)
    assert watcher.causes == {because.SWITCH_NOT_REACHED.name}
    assert watcher.lowest_deg >= config.hood.low_deg - 1.0
