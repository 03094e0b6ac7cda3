"""Motion faults: the emulated robot's world with a fault in it, the driver, and the judge of the plant's log.

The driver arms the robot but never requests a shot. Apart from the plant's log, only the messages on the operator page
and the replay are judged.
"""

import math
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from benchmarks.matrix.broken import BrokenBox, FarWire
from benchmarks.matrix.devices import Side
from benchmarks.matrix.fault import ITSELF, REARM, Motion, Row
from benchmarks.matrix.rows import CODES, EITHER
from benchmarks.matrix.run import Span, frame_id, is_odrive, with_launcher
from truearc.cli.common import SHIPPED
from truearc.hw.codec import load_codec
from truearc.hw.devices.canandmag import frame_id as encoder_id
from truearc.hw.devices.registry import NoEncoder
from truearc.hw.emulated.nodes import MotorTruth, Node, Twin
from truearc.hw.protocols import CameraFrame, Clock, Frame
from truearc.hw.reason import FAULT
from truearc.robot.config.schema import Config, Prescribed, load_config
from truearc.robot.operator_ui.view import find_message, tell
from truearc.robot.recording.files import TappedBus
from truearc.robot.types import Sighting, Tick
from truearc.sim.world.drive import HOOD_COULOMB_NM, Belt, Hood
from truearc.sim.world.emulated_robot import make_nodes
from truearc.sim.world.options import Options
from truearc.sim.world.world import World

NS = 1e-9
NS_PER_S = 1_000_000_000
SET_RAD_S, FREE_RAD_S, PLACE_M = 358.0, 594.0, 4.0
# Limits of what may be, on the shipped plant
MOST_WHEEL = 1.15                     # true wheel speed, times the set point
BEYOND_DEG = 1.0                      # past a soft limit
PUSH_S = 0.5                          # against something that does not move, at once
WINDOW_S = 0.1                        # the hood's mean speed over so long is judged
GOOD_S = 0.3                          # of good readings before a released axis is driven again
TOLD_S = 0.3                          # from the time in which the axis has to be released until the page says why
# What counts
TORQUE_NM, STILL_RAD_S = 1e-4, 1.0    # less is none, and does not move
APART_S = 0.02                        # between two pushes
BACK_SHARE, BACK_DEG = 0.03, 0.5      # of its set point at the end: the axis works again
SLACK_S = 0.005                       # of a tick, and of a step of the plant
SPINOUT = 0x04000000
NO_ANSWER = "switch never answers"    # that of an ODrive, which is asked for it
# The driver
SETTLE_S, PATIENCE_S, ARM_S, PAUSE_S, AFTER_S, AGAIN_S, READY_S = 0.5, 3.0, 0.2, 1.0, 4.0, 8.0, 40.0
NEAR_RAD_S, NEAR_DEG, NEAR_S = 3.0, 0.4, 0.5
SPINNING_RAD_S, RISING_DEG = 300.0, 27.0      # still at full torque; between where the hood is found and its set point
LEFT_DEG = 0.6                        # to the set point: its loop then pushes less than a jam needs


class Moved(msgspec.Struct):
    """What the devices' side reports beside the plant's log; times are the plant's, 0: not so."""

    begin_s: float = 0.0
    end_s: float = 0.0
    rearm_s: float = 0.0
    over_s: float = 0.0
    true_s: float = 0.0               # the last true reading before or while it stood
    run_s: float = 0.0                # what the run's clock is ahead


class ToldEyes:
    """truearc.robot.eyes.Eyes: the target in its place, ten times a second, as long as it is to be seen."""

    def __init__(self, clock: Clock, is_hidden: Callable[[], bool]) -> None:
        self.clock, self._is_hidden = clock, is_hidden
        self._due_ns = 0

    def read(self) -> Sighting | None:
        now_ns = self.clock.now_ns()
        if now_ns < self._due_ns or self._is_hidden():
            return None
        self._due_ns = now_ns + NS_PER_S // 10
        return Sighting(now_ns - NS_PER_S // 100, True, None, PLACE_M + 0.2, 0.01, 0.0)

    def picture(self) -> CameraFrame | None:
        return None


def make_motion_config(row: Row, motion: Motion) -> Config:
    """The row's launcher at one set point, as shipped."""
    config = load_config(SHIPPED)
    aim = Prescribed(distance_m=PLACE_M, motor_ratio=SET_RAD_S / FREE_RAD_S, hood_deg=motion.hood_deg)
    config = replace(config, collect=replace(config.collect, repeats=1 << 30, prescribed=(aim,)),
                     hood=replace(config.hood, high_deg=motion.high_deg))
    if not motion.has_encoder:
        noise = replace(config.rig.noise, hood_deg=0.6)
        config = replace(config, hood_encoder=NoEncoder(), rig=replace(config.rig, noise=noise))
    return with_launcher(config, row.launcher)


class MotionSide(Side):
    """What moves, something wrong with it, and the driver; `now_ns` tells the run's clock."""

    def __init__(self, config: Config, row: Row, wire: FarWire, box: BrokenBox, span: Span,
                 now_ns: Callable[[], int]) -> None:
        assert isinstance(row.breaking, Motion)
        self.moved = Moved()
        self._config, self._row, self._motion = config, row, row.breaking
        self._box, self._span, self._now_ns = box, span, now_ns
        is_low = self._motion.what == "encoder 0.8 degrees low"
        self._world = MovingWorld(1, Options(hood_offset_deg=-0.8 if is_low else 0.0), self._motion.start_deg)
        self._nodes = make_sick_nodes(config, self._world)
        self._endstop = self._nodes["hood"].node._endstop if self._motion.what == NO_ANSWER else None
        self._twin = Twin(self._world, TappedBus(wire, self._listen), tuple(self._nodes.values()),
                          (box.step, self._drive))
        self._is_driven = False
        self._began_s = self._armed_s = self._near_s = 0.0
        self._presses = 0             # of "arm", once it is over

    def save(self, path: Path) -> None:
        path.write_bytes(msgspec.json.encode(self.moved))
        np.save(path.with_suffix(".npy"), self._world.log())

    def _drive(self, t_ns: int) -> None:
        """The driver arms; then it goes wrong when it is time, ends, and the driver may arm again."""
        t_s, moved = t_ns * NS, self.moved
        if not self.heard:
            return
        self._began_s = self._began_s or t_s
        self._is_driven = self._is_driven or any(self._world.lines[-1][1:4])
        if not moved.begin_s and self._motion.when == "start":
            self._begin(t_ns)
        if not self._armed_s or (not self._is_driven and t_s - self._armed_s > PATIENCE_S):
            if t_s - self._began_s >= SETTLE_S:   # and again where a machine that stalled has lost the press
                self._armed_s = t_s
                self._box.press("arm")
        elif not moved.begin_s:
            if self._is_time(t_s):
                self._begin(t_ns)
            elif t_s - self._armed_s > READY_S:
                self._span.finish(self._now_ns())
        elif not moved.end_s:
            if t_s - max(moved.begin_s, self._armed_s) >= self._row.lasts_s:
                self._end(t_ns)
        else:
            self._recover(t_s)

    def _recover(self, t_s: float) -> None:
        """Arm again, where that is needed, by two presses; and see what comes of it."""
        moved = self.moved
        if self._row.after in (REARM, EITHER) and self._presses < 2:
            if t_s - moved.end_s >= PAUSE_S + self._presses * ARM_S:
                self._presses += 1
                self._box.press("arm")
                moved.rearm_s = t_s
                self._span.rearm(self._now_ns())
        elif t_s - (moved.rearm_s or moved.end_s) >= (AGAIN_S if self._presses else AFTER_S):
            moved.over_s = t_s
            self._span.finish(self._now_ns())

    def _is_time(self, t_s: float) -> bool:
        belt, hood, when = self._world.belt, self._world.hood, self._motion.when
        if when == "spinning":
            return belt.speed_rad_s > SPINNING_RAD_S
        if when == "hood homes":
            return hood.speed_rad_s < -STILL_RAD_S
        if when == "hood starts":
            return hood.speed_rad_s > STILL_RAD_S
        if when == "hood is near":
            return hood.speed_rad_s > STILL_RAD_S and hood.elevation_deg > self._motion.hood_deg - LEFT_DEG
        if when == "hood rises":
            return hood.speed_rad_s > STILL_RAD_S and hood.elevation_deg > RISING_DEG
        is_near = (abs(belt.speed_rad_s - SET_RAD_S) < NEAR_RAD_S
                   and abs(hood.elevation_deg - self._motion.hood_deg) < NEAR_DEG)
        self._near_s = (self._near_s or t_s) if is_near else 0.0
        return is_near and t_s - self._near_s >= NEAR_S

    def _begin(self, t_ns: int) -> None:
        self.moved.begin_s, self.moved.run_s = t_ns * NS, (self._now_ns() - t_ns) * NS
        self._span.begin(self._now_ns())
        for name in self._motion.names:
            if self._motion.what == "keeps its torque":
                axis = (*self._config.axes.flywheels, self._config.axes.hood)[NAMES.index(name)]
                message = "Set_Input_Torque" if is_odrive(axis) else "DUTY_CYCLE_SETPOINT"
                self._nodes[name].deaf_to = frame_id(axis, message)
            elif self._motion.what == "magnet lost":
                self._nodes[name].node.magnet_ok = False
            elif self._motion.what == NO_ANSWER:
                self._nodes[name].node._endstop = None
            elif self._motion.what == "gives up":
                self._nodes[name].node.disarm(SPINOUT)
            else:
                self._nodes[name].suffer(self._motion.what, t_ns)
        self._world.suffer("" if self._motion.names else self._motion.what)

    def _end(self, t_ns: int) -> None:
        self.moved.end_s = t_ns * NS
        self.moved.true_s = max((self._nodes[name].true_ns for name in self._motion.names), default=0) * NS
        for name in self._motion.names:
            self._nodes[name].suffer("", t_ns)
            self._nodes[name].deaf_to = -1
            if name == "hood_encoder":
                self._nodes[name].node.magnet_ok = True
        self._world.suffer("")
        if self._motion.what == NO_ANSWER:
            self._nodes["hood"].node._endstop = self._endstop
        self._span.end(self._now_ns())


# --- the judge

def judge_motion(row: Row, motion: Motion, folder: Path, result: Any, ticks: list[Tick]) -> None:
    """Fill in `result` (benchmarks.matrix.judge.Result)."""
    moved = msgspec.json.decode((folder / "devices.json").read_bytes(), type=Moved)
    log = np.load(folder / "devices.npy")
    late_s, result.bound_s = result.bound_s - row.within_s, row.within_s    # of the plant nothing is excused
    if not moved.over_s:
        result.wrong.append("was never ready for it" if not moved.begin_s else "did not come to its end")
        return
    plant = Plant(log, motion.what.endswith("backwards"))
    _judge_limits(motion, moved, plant, result)
    if motion.axis:
        since_s = _judge_release(row, motion, moved, plant, result)
        if (codes := CODES[motion.code]) is not None:
            _judge_words(codes, ticks, moved, since_s, since_s + row.within_s + TOLD_S + late_s, result)
        _judge_return(row, motion, moved, plant, result)


class Plant:
    """The log by its columns, and when each axis was driven."""

    def __init__(self, log: npt.NDArray[np.float64], is_backwards: bool) -> None:
        """`is_backwards`: torque acts against what is asked, so that an axis that opposes its motion does not brake."""
        columns = dict(zip(COLUMNS, log.T, strict=True))
        self.t_s, self.wheel_rad_s = columns["t_s"], columns["wheel_rad_s"]
        self.hood_deg, self.screw_rad_s = columns["hood_deg"], columns["screw_rad_s"]
        hood_nm = columns["asked_hood_nm"]
        before_rad_s = np.concatenate((self.screw_rad_s[:1], self.screw_rad_s[:-1]))      # in the step it comes to rest
        is_braking = ((hood_nm * self.screw_rad_s < 0.0) | (hood_nm * before_rad_s < 0.0)) & (not is_backwards)
        self.driven = {"wheels": np.maximum(np.abs(columns["asked_a_nm"]), np.abs(columns["asked_b_nm"])) > TORQUE_NM,
                       "hood": (np.abs(hood_nm) > TORQUE_NM) & ~is_braking}
        self.still = {"wheels": np.abs(self.wheel_rad_s) < STILL_RAD_S, "hood": np.abs(self.screw_rad_s) < STILL_RAD_S}

    def at(self, t_s: float) -> int:
        return min(int(np.searchsorted(self.t_s, t_s)), len(self.t_s) - 1)

    def spans(self, which: npt.NDArray[np.bool_], apart_s: float = 0.0) -> list[tuple[float, float]]:
        """(from, to) of each time that `which` holds; shorter pauses than `apart_s` count as none."""
        edges = np.flatnonzero(np.diff(np.concatenate(([0], which.astype(np.int8), [0]))))
        spans: list[tuple[float, float]] = []
        for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
            begin_s, end_s = float(self.t_s[max(first - 1, 0)]), float(self.t_s[last])
            if spans and begin_s - spans[-1][1] <= apart_s:
                begin_s = spans.pop()[0]
            spans.append((begin_s, end_s))
        return spans


def _judge_limits(motion: Motion, moved: Moved, plant: Plant, result: Any) -> None:
    """What holds in every row, whatever is wrong."""
    top_rad_s = float(np.max(np.abs(plant.wheel_rad_s)))
    if top_rad_s > MOST_WHEEL * SET_RAD_S:
        result.wrong.append(f"wheels at {top_rad_s:.0f} rad/s, {top_rad_s / SET_RAD_S:.2f} of the set point")
    for name in NAMES[1:]:
        axis = "hood" if name == "hood" else "wheels"
        pushes = plant.spans(plant.driven[axis] & plant.still[axis])
        longest_s = max((end_s - begin_s for begin_s, end_s in pushes), default=0.0)
        if longest_s > PUSH_S + SLACK_S:
            result.wrong.append(f"{axis} pushed for {longest_s:.2f} s without motion")
    beyond_deg = float(np.max(plant.hood_deg)) - motion.high_deg
    if beyond_deg > BEYOND_DEG:
        result.wrong.append(f"hood {beyond_deg:.1f} deg past its limit")
    step = round(WINDOW_S / float(np.median(np.diff(plant.t_s))))
    fastest_deg_s = float(np.max(np.abs(plant.hood_deg[step:] - plant.hood_deg[:-step]) /
                                 (plant.t_s[step:] - plant.t_s[:-step])))
    if fastest_deg_s > motion.most_deg_s:
        result.wrong.append(f"hood at {fastest_deg_s:.0f} deg/s")
    during = slice(plant.at(moved.begin_s), plant.at(moved.end_s))
    hood_deg = plant.hood_deg[during]
    travel_deg = float(np.max(np.abs(hood_deg - hood_deg[0])))
    if travel_deg > motion.travel_deg:
        result.wrong.append(f"hood went {travel_deg:.1f} deg on")
    result.outcome = (f"wheels at most {top_rad_s:.0f} rad/s" if motion.axis == "wheels"
                      else f"hood {travel_deg:.1f} deg on" if motion.travel_deg < np.inf
                      else f"hood at most {fastest_deg_s:.0f} deg/s, {max(beyond_deg, 0.0):.1f} deg past its limit")


def _judge_release(row: Row, motion: Motion, moved: Moved, plant: Plant, result: Any) -> float:
    """From when the time counts, after whether the axis is released in time, and stays so while the fault stands."""
    t_s, driven = plant.t_s, plant.driven[motion.axis]
    since_s = moved.true_s if motion.since == "reading" else moved.begin_s
    stands = (t_s > since_s) & (t_s <= moved.end_s)
    pushes = plant.spans(driven & stands, APART_S)
    if motion.since == "push" and pushes:
        since_s = pushes[0][0]
    if motion.pushes > 1:
        result.hold_s = max((end_s - begin_s for begin_s, end_s in pushes), default=0.0)
        if len(pushes) > motion.pushes:
            result.wrong.append(f"{motion.axis} driven {len(pushes)} times while it stood")
    else:
        result.hold_s = max(pushes[-1][1] - since_s, 0.0) if pushes else 0.0
    if result.hold_s > result.bound_s + SLACK_S:
        result.wrong.append(f"{motion.axis} driven for {result.hold_s:.2f} s, {result.bound_s:.2f} allowed")
    return since_s


def _judge_words(codes: tuple[str, ...], ticks: list[Tick], moved: Moved, since_s: float, until_s: float,
                 result: Any) -> None:
    for tick in ticks:
        t_s = tick.inputs.t_ns * NS - moved.run_s
        if since_s <= t_s <= until_s:
            for reason in tick.verdict.reasons:
                message = find_message(reason)
                if (not codes or reason.code in codes) and (message is None or message.kind == FAULT):
                    result.reason = tell([reason])[0].means
                    return
    result.wrong.append("the page does not say why as a fault")


def _judge_return(row: Row, motion: Motion, moved: Moved, plant: Plant, result: Any) -> None:
    """By itself, or when the driver has armed again and not before."""
    t_s, driven = plant.t_s, plant.driven[motion.axis]
    if row.after == REARM and bool(np.any(driven & (t_s > moved.end_s) & (t_s < moved.rearm_s - ARM_S - SLACK_S))):
        result.wrong.append(f"{motion.axis} driven again before it was armed again")
    since_s = moved.rearm_s or moved.end_s
    again = t_s[driven & (t_s > since_s)]
    result.recovery_s = float(again[0]) - since_s if len(again) else None
    if row.after == ITSELF and motion.since == "reading" and len(again) and again[0] - since_s < GOOD_S - 2 * SLACK_S:
        result.wrong.append(f"driven again after {again[0] - since_s:.2f} s of good readings")
    is_back = (abs(plant.wheel_rad_s[-1] - SET_RAD_S) <= BACK_SHARE * SET_RAD_S if motion.axis == "wheels"
               else abs(plant.hood_deg[-1] - motion.hood_deg) <= BACK_DEG)
    if not is_back:
        result.wrong.append(f"{motion.axis} not at the set point at the end")


STEP_NS = 1_000_000                   # the plant is looked at this often
START_DEG = 22.0                      # where the hood is found, unless a row says otherwise
STIFF_NM = 0.03                       # beside its own 0.02: twice and a half of what the configuration knows
STRONG_NM = 0.3                       # of the hood's driver in that state: all that it may be asked for
CREEP_NM_S = 0.002                    # of a hood that rubs more the faster it is: 3 degrees/s by what homing gives it
NAMES = ("flywheel_a", "flywheel_b", "hood")
COLUMNS = ("t_s", "asked_a_nm", "asked_b_nm", "asked_hood_nm", "wheel_rad_s", "hood_deg", "screw_rad_s")
PAIR = struct.Struct("<ff")
COUNTS = 16384                        # of the hood encoder, per turn
PATTERN = (1, 0, 0, 1)                # 1: lost. Half of all frames, never more than two of one kind after each other
GAP_S, GAP_EVERY_S = 0.07, 0.5
HALF_LOST = "half the frames lost"        # of what it says and of what it is told
LOSSES = (HALF_LOST, "gaps of 70 ms")
STICTION_NM = {"wheels": 0.1, "hood": 0.03}   # to break away, one and a half to two and a half times the friction
SLIP = 0.1
NOISE_RAD_S = 1.0                     # of each wheel motor's speed: a hundredth of what full torque adds in 0.1 s
STUTTER_S, STUTTER_GAP_S = 1.2, 0.25  # readings stop this often, for so long
NO_WATCHDOG = 0                       # a release is a command; a watchdog would hide that none came


class SickHood(Hood):
    """`trouble`: "" or one of "hood jams", "hood is stiff", "hood is strong", "hood creeps", "hood backwards",
    "hood comes loose", "stiction"."""

    trouble = ""

    def step(self, torque_nm: float, dt_s: float) -> None:
        if self.trouble == "hood jams" or (self.trouble == "stiction" and self.speed_rad_s == 0.0
                                           and abs(torque_nm) <= STICTION_NM["hood"]):
            self.speed_rad_s = 0.0
        elif self.trouble == "hood comes loose":      # the motor turns, the screw does not
            before_rad, elevation_deg = self._screw_rad, self.elevation_deg
            super().step(torque_nm, dt_s)
            self._start_rad -= self._screw_rad - before_rad
            self._screw_rad, self.elevation_deg = before_rad, elevation_deg
        else:
            super().step(self._felt_nm(torque_nm), dt_s)

    def _felt_nm(self, torque_nm: float) -> float:
        if self.trouble == "hood backwards":
            return -torque_nm
        if self.trouble == "hood is strong":
            return torque_nm and math.copysign(STRONG_NM, torque_nm)
        if self.trouble == "hood creeps":
            return torque_nm - CREEP_NM_S * self.speed_rad_s
        if self.trouble != "hood is stiff":
            return torque_nm
        if self.speed_rad_s:
            return torque_nm - math.copysign(STIFF_NM, self.speed_rad_s)
        return 0.0 if abs(torque_nm) <= STIFF_NM + HOOD_COULOMB_NM else torque_nm - math.copysign(STIFF_NM, torque_nm)


class SickBelt(Belt):
    """`trouble`: "" or one of "wheels jam", "wheels backwards", "wheels have no power", "stiction"."""

    trouble = ""

    def step(self, torque_nm: float, dt_s: float) -> None:
        if self.trouble == "wheels jam" or (self.trouble == "stiction" and self.speed_rad_s == 0.0
                                            and abs(torque_nm) <= STICTION_NM["wheels"]):
            self.speed_rad_s = 0.0
        else:
            sign = {"wheels backwards": -1.0, "wheels have no power": 0.0}.get(self.trouble, 1.0)
            super().step(sign * torque_nm, dt_s)


class MovingWorld(World):
    """The world, in steps of at most a millisecond, each of which leaves a line of COLUMNS."""

    def __init__(self, seed: int, options: Options | None = None, start_deg: float = START_DEG) -> None:
        super().__init__(seed, options)
        options = options or Options()
        self.belt: SickBelt = SickBelt(options)
        self.hood: SickHood = SickHood(start_deg, options)
        self.lines: list[tuple[float, ...]] = []
        self.trouble = ""
        self._random = np.random.default_rng(seed)

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        while self._t_ns < t_ns:
            super().advance(min(t_ns, self._t_ns + STEP_NS), self._felt_nm(torque_nm))
            self.lines.append((self._t_ns * 1e-9, *(torque_nm.get(name, 0.0) for name in self.motors[:3]),
                               self.belt.speed_rad_s, self.hood.elevation_deg, self.hood.speed_rad_s))

    def motor(self, name: str) -> MotorTruth:
        truth = super().motor(name)
        if self.trouble == "speeds are noisy" and name in NAMES[:2]:
            return truth._replace(velocity_rad_s=truth.velocity_rad_s + self._random.normal(0.0, NOISE_RAD_S))
        if self.trouble != "motor 2 slips" or name != "flywheel_b":
            return truth
        return truth._replace(position_rad=(1.0 - SLIP) * truth.position_rad,
                              velocity_rad_s=(1.0 - SLIP) * truth.velocity_rad_s)

    def _felt_nm(self, torque_nm: Mapping[str, float]) -> Mapping[str, float]:
        if self.trouble != "motor 2 backwards":
            return torque_nm
        return {**torque_nm, "flywheel_b": -torque_nm.get("flywheel_b", 0.0)}

    def hood_at_limit(self) -> bool:
        return self.trouble == "switch closed" or (self.trouble != "switch dead" and super().hood_at_limit())

    def suffer(self, trouble: str) -> None:
        """From now on something of SickHood or SickBelt is wrong, "switch dead", "switch closed", "motor 2 backwards",
        "motor 2 slips" or "speeds are noisy"; "" ends it."""
        self.trouble = self.hood.trouble = self.belt.trouble = trouble

    def log(self) -> npt.NDArray[np.float64]:
        return np.array(self.lines, dtype=np.float64).reshape(-1, len(COLUMNS))


class SickNode:
    """A node whose frames may say something else or get lost, and that may be deaf to commands of its torque."""

    def __init__(self, node: Node, reading_id: int, velocity_first: bool) -> None:
        """`reading_id`: of the frame with its reading. `velocity_first`: the order of that one's two floats."""
        self.node = node
        self.true_ns = 0                          # when a true reading last left it
        self.deaf_to = -1                         # an id
        self._reading_id, self._velocity_first = reading_id, velocity_first
        self._what, self._since_ns = "", 0
        self._first: Frame | None = None          # reading since something has been wrong
        self._counts: dict[int, int] = {}

    def suffer(self, what: str, t_ns: int) -> None:
        """From now on this is wrong with its frames: one of LOSSES, "stutters", or of change_reading; "" ends it."""
        self._what, self._since_ns, self._first = what, t_ns, None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.node, name)

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        is_lost = self._what == HALF_LOST and self._is_lost(-1 - frame.arbitration_id)
        if is_lost or frame.arbitration_id == self.deaf_to:
            return []
        return self._spoil(self.node.receive(frame, t_ns), t_ns)

    def step(self, t_ns: int) -> list[Frame]:
        return self._spoil(self.node.step(t_ns), t_ns)

    def _spoil(self, frames: list[Frame], t_ns: int) -> list[Frame]:
        said = []
        for frame in frames:
            spoiled = self._spoil_one(frame, (t_ns - self._since_ns) * 1e-9) if self._what else frame
            if frame.arbitration_id == self._reading_id and spoiled is frame:
                self.true_ns = t_ns
            if spoiled is not None:
                said.append(spoiled)
        return said

    def _is_lost(self, kind: int) -> bool:
        count = self._counts[kind] = self._counts.get(kind, 0) + 1
        return bool(PATTERN[count % len(PATTERN)])

    def _spoil_one(self, frame: Frame, since_s: float) -> Frame | None:
        if self._what == HALF_LOST:
            return None if self._is_lost(frame.arbitration_id) else frame
        if self._what == "gaps of 70 ms":
            return None if since_s % GAP_EVERY_S < GAP_S else frame
        if frame.arbitration_id != self._reading_id:
            return frame
        if self._what == "stutters":
            return None if since_s % STUTTER_S < STUTTER_GAP_S else frame
        self._first = self._first or frame
        return change_reading(self._what, frame, self._first, self._velocity_first)


def change_reading(what: str, frame: Frame, first: Frame, velocity_first: bool) -> Frame | None:
    """What becomes of a reading; `first` is the first one since this has been wrong. ValueError: no such trouble."""
    match what:
        case "silent":
            return None
        case "frozen":
            return first._replace(t_ns=frame.t_ns)
        case "big-endian":
            return frame._replace(data=frame.data[3::-1] + frame.data[:3:-1])
        case "10 degrees off":
            codec = load_codec("canandmag")
            values = codec.parse("POSITION_OUTPUT", frame.data)
            values["absolute_rev"] = round((values["absolute_rev"] + 10.0 / 360.0) * COUNTS) % COUNTS / COUNTS
            return frame._replace(data=codec.make("POSITION_OUTPUT", values))
        case "angle reversed":
            codec = load_codec("canandmag")
            began, values = codec.parse("POSITION_OUTPUT", first.data), codec.parse("POSITION_OUTPUT", frame.data)
            turned_rev = 2.0 * began["absolute_rev"] - values["absolute_rev"]
            values["absolute_rev"] = round(turned_rev * COUNTS) % COUNTS / COUNTS
            return frame._replace(data=codec.make("POSITION_OUTPUT", values))
    start, (velocity, position) = (
        PAIR.unpack(data)[::1 if velocity_first else -1] for data in (first.data, frame.data))
    velocity, position = {
        "zero": (0.0, 0.0), "speed zero": (0.0, position), "reversed": (-velocity, 2.0 * start[1] - position),
        "not a number": (math.nan, position), "speed x 0.6": (0.6 * velocity, position),
        "half": (0.5 * velocity, position),
        "position x 0.6": (velocity, start[1] + 0.6 * (position - start[1]))}[what]
    return frame._replace(data=PAIR.pack(*(velocity, position)[::1 if velocity_first else -1]))


def make_sick_nodes(config: Config, world: MovingWorld) -> dict[str, Any]:
    """Every device of the configuration as a SickNode, with nothing wrong; watchdogs of motor drivers are off."""
    axes = (*config.axes.flywheels, config.axes.hood, config.axes.feeder)
    readings = [(frame_id(axis, "Get_Encoder_Estimates" if is_odrive(axis) else "STATUS_2"), not is_odrive(axis))
                for axis in axes]
    if config.hood_encoder.is_heard:
        readings.append((encoder_id(config.hood_encoder.device, "POSITION_OUTPUT"), False))
    nodes = make_nodes(config, world, NO_WATCHDOG)
    return {name: SickNode(node, *reading) for (name, node), reading in zip(nodes.items(), readings, strict=True)}
