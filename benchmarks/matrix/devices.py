"""The device side of a run: a small launcher, its nodes on a bus, a driver, and the injection of the fault."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from benchmarks.matrix.broken import BrokenBox, FarWire, begin_trouble, end_trouble
from benchmarks.matrix.fault import Both, Box, Device, Inside, Row, Wire
from benchmarks.matrix.run import Span, frame_id
from truearc.hw.codec import load_codec
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.emulator import OdriveNode
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode
from truearc.hw.devices.spark.family import SparkConfig
from truearc.hw.emulated.nodes import NEVER_NS, MotorTruth, Twin, View
from truearc.robot.config.schema import Config
from truearc.robot.motors import elevation_from_screw_deg, name_axes
from truearc.robot.recording.files import TappedBus
from truearc.sim.world.emulated_robot import WATCHDOG_MS, make_nodes
from truearc_proof.world.faults import Fault, FaultyNode

MS = 1_000_000
NS_PER_S = 1_000_000_000
NAMES = ("flywheel_a", "flywheel_b", "hood", "feeder", "hood_encoder")
BALLS = 3                             # have gone in: the robot would fire; and again: it has recovered
SPINOUT = 0x04000000
SETTLE_NS = NS_PER_S // 2             # from when the robot is heard until it is armed
PRESS_NS = 40 * MS
ARM_NS = 200 * MS
AGAIN_NS = 8 * NS_PER_S               # without a fault by then the driver arms again
PAUSE_NS = NS_PER_S                   # from the end of a fault until the driver arms again
PATIENCE_S = 12.0                     # for either of the two
READY_S = 40.0


class Seen(msgspec.Struct):
    """Facts of a run that the devices' side reports to the judge; times are the run's clock's."""

    balls: list[tuple[int, float, float]] = []    # when, true wheel speed (rad/s), true elevation (deg)
    idle_ns: int = 0                              # the first time since the fault that no motor was driven


class Side:
    """The devices' end of a run; call `advance` as time goes on until `over`."""

    heard = False                     # anything of the robot
    _span: Span
    _twin: Twin

    def advance(self, t_ns: int) -> None:
        """Bring the world, the devices and the driver to `t_ns`."""
        self._twin.advance(t_ns)

    @property
    def over(self) -> bool:
        return self._span.over_ns > 0

    def _listen(self, frame: object, sent: bool) -> None:
        self.heard = self.heard or not sent


class FarSide(Side):
    """A launcher that fires, and something that breaks; `now_ns` tells the run's clock."""

    def __init__(self, config: Config, row: Row, arms: int, wire: FarWire, box: BrokenBox, span: Span,
                 now_ns: Callable[[], int], watchdog_ms: int = WATCHDOG_MS) -> None:
        """`arms`: how often the driver presses that button once the fault is over. With a span that has begun these
        devices take the place of others, whose driver had armed."""
        self.seen = Seen()
        self._config, self._arms = config, arms
        self._breaking, self._lasts_ns, self._is_first = row.breaking, round(row.lasts_s * 1e9), row.first
        self._wire, self._box, self._span, self._now_ns = wire, box, span, now_ns
        self._plant = AdvisedPlant(config, span.advice) if row.launcher == "advisory" else SmallPlant(config)
        self._nodes: dict[str, Any] = {name: FaultyNode(node, ()) for name, node
                                       in make_nodes(config, self._plant, watchdog_ms).items()}
        self._twin = Twin(self._plant, TappedBus(wire, self._listen), tuple(self._nodes.values()),
                          (box.step, self._drive))
        self._began_ns = self._due_ns = 0
        self._then_ns = self._balls_then = 0
        self._armed_ns, self._to_arm = -AGAIN_NS if not span.begin_ns else 0, 0
        self._turn = self._ended = False
        self._is_advised = row.launcher == "advisory"
        if self._is_advised:
            self._set_up()
        if row.first and not span.begin_ns:
            self._break(0)

    def advance(self, t_ns: int) -> None:
        if self._span.stands() and isinstance(self._breaking, Wire):
            self._wire.chatter(t_ns)
        super().advance(t_ns)
        self._note()

    def save(self, path: Path) -> None:
        path.write_bytes(msgspec.json.encode(self.seen))

    def _note(self) -> None:
        for ball in self._plant.balls[len(self.seen.balls):]:
            self.seen.balls.append(Ball(self._now_ns(), ball.motor_rad_s, ball.hood_deg))
        if self._span.begin_ns and not self.seen.idle_ns and not any(
                is_driving(node.node) for node in self._nodes.values()):
            self.seen.idle_ns = self._now_ns()

    # --- the driver, who also knows when it is time for something to break

    def _drive(self, t_ns: int) -> None:
        if not (self.heard or self._span.is_advised):
            return
        if not self._began_ns:
            self._began_ns, self._due_ns = t_ns, t_ns + SETTLE_NS
            if self._is_first:
                self._then_ns = t_ns
                self._span.begin(self._now_ns())
        if t_ns < self._due_ns:
            return
        self._press(t_ns)
        self._direct(t_ns)

    def _press(self, t_ns: int) -> None:
        """Arm; then ask and mark, ask and mark. Where a machine stalled at the start, watchdogs bit: arm again."""
        self._due_ns = t_ns + PRESS_NS
        if (self._armed_ns < 0 if self._is_first else
                not self._span.begin_ns and t_ns - self._armed_ns > AGAIN_NS):
            self._armed_ns, self._to_arm = t_ns, 1 if self._armed_ns < 0 else 2
        if self._to_arm:
            self._to_arm -= 1
            self._due_ns = t_ns + ARM_NS
            self._box.press("arm")
            return
        self._turn = not self._turn
        self._box.press(("two", "fire")[self._turn])

    def _direct(self, t_ns: int) -> None:
        """Begin the fault when the robot is seen to fire, end it, and wait until it fires again."""
        span, balls = self._span, len(self._plant.balls)
        if not span.begin_ns:
            if balls >= BALLS:
                self._then_ns = t_ns
                self._break(t_ns)
                span.begin(self._now_ns())
            elif t_ns - self._began_ns > READY_S * 1e9:
                span.finish(self._now_ns())
        elif not span.end_ns:
            if t_ns - self._then_ns >= self._lasts_ns:
                span.end(self._now_ns())
                self._mend(t_ns)
        elif not self._ended:                     # it may have been another who ended it
            self._ended, self._then_ns, self._balls_then = True, t_ns, balls
        elif self._arms:
            self._arm_anew(t_ns, balls)
        elif balls >= self._balls_then + BALLS or t_ns - self._then_ns > PATIENCE_S * 1e9:
            span.finish(self._now_ns())

    def _arm_anew(self, t_ns: int, balls: int) -> None:
        """Disarm and arm, as a person would: after a while, and not both at once."""
        if t_ns - self._then_ns < (ARM_NS if self._span.rearm_ns else PAUSE_NS):
            return
        if not self._span.rearm_ns:
            self._span.rearm(self._now_ns())
        self._then_ns, self._balls_then = t_ns, balls
        self._due_ns = t_ns + ARM_NS
        self._arms -= 1
        self._box.press("arm")

    # --- what breaks

    def _break(self, t_ns: int) -> None:
        match self._breaking:
            case Device() | Both():
                one = self._breaking
                for breaking in (one.one, one.other) if isinstance(one, Both) else (one,):
                    self._nodes[breaking.name].suffer(self._fault(breaking, t_ns))
            case Inside(name=name, what=what):
                node = self._nodes[name].node
                if isinstance(node, SparkNode):
                    begin_trouble(node, what, t_ns)
                else:
                    self._inside(node, what, t_ns)
            case Wire():
                self._wire.begin(self._breaking.what)
            case Box():
                self._box.begin(self._breaking.what)

    def _mend(self, t_ns: int) -> None:
        match self._breaking:
            case Inside(name=name, what=what) if isinstance(theirs := self._nodes[name].node, SparkNode):
                end_trouble(theirs, what, t_ns)
                if self._is_advised:              # what was sticky its own controller clears
                    theirs.clear_faults()
            case Inside(name=name, what="magnet"):
                self._nodes[name].node.magnet_ok = True
            case Inside(name=name, what="settings lost"):
                node = self._nodes[name].node
                node.settings = self._settings
                node.restart(t_ns)
            case Wire(what=what):
                self._wire.end()
                for node in self._sparks() if what == "competition controller" else ():
                    node.restart(t_ns)
            case Box():
                self._box.end()

    def _inside(self, node: Any, what: str, t_ns: int) -> None:
        match what:
            case "error":
                node.disarm(SPINOUT)
            case "idle":
                node.disarm(0)
            case "magnet":
                node.magnet_ok = False
            case "settings lost":             # reporting rates are stored settings of an ODrive
                self._settings = node.settings
                node.settings = msgspec.structs.replace(node.settings, encoder_ms=0, current_ms=0, bus_ms=0)
                node.restart(t_ns)

    def _fault(self, breaking: Device, t_ns: int) -> Fault:
        end_ns = t_ns + self._lasts_ns
        frame_id = self._frame_id(breaking) if breaking.message else None
        return Fault(breaking.kind, t_ns, min(end_ns, NEVER_NS), frame_id, breaking.length, breaking.at, breaking.data,
                     breaking.by)

    def _frame_id(self, breaking: Device) -> int:
        if breaking.name == "hood_encoder":
            return load_codec("canandmag").base_id(breaking.message) + self._config.hood_encoder.device
        axes = self._config.axes
        axis = dict(zip(NAMES, (*axes.flywheels, axes.hood, axes.feeder), strict=False))[breaking.name]
        return frame_id(axis, breaking.message)

    def _set_up(self) -> None:
        """What another controller's program asks of its SPARKs."""
        for (_, axis), node in zip(name_axes(self._config), self._sparks(), strict=True):
            theirs = spark.SparkAxis(axis.device, axis.direction)         # type: ignore[union-attr]
            node.receive(spark.make_statuses(theirs, spark.STATUSES), 0)
            for parameter, value in spark.QUICK_SPEED.items():
                node.receive(spark.make_setting(theirs, parameter, value), 0)

    def _sparks(self) -> list[SparkNode]:
        return [node.node for node in self._nodes.values() if isinstance(node.node, SparkNode)]


def is_driving(node: object) -> bool:
    """Whether a device has its motor in hand."""
    match node:
        case OdriveNode():
            return node.state == odrive.CLOSED_LOOP
        case SparkNode():
            return node.output != 0.0
    return False


TORQUE_NM_A = 0.02
BELT_KG_M2 = 0.0067                   # both flywheels, both motors
SCREW_NM_S = 0.0015                   # what the hood's screw needs to turn ...
STIFF_NM_S = 0.006                    # ... that is without inertia, so on a duty more than the motor's own 0.0044
START_DEG = 1.0                       # above its limit switch the hood is found
BALL_NM = 0.05                        # with this on the feeder a ball goes in
STEP_S = 0.005


class Ball(NamedTuple):
    """True values when a ball went in."""

    t_ns: int
    motor_rad_s: float
    hood_deg: float


class SmallPlant:
    """truearc.hw.emulated.nodes.Plant: two motors on one belt, a hood on a screw that locks itself, a feeder."""

    motors = ("flywheel_a", "flywheel_b", "hood", "feeder")

    def __init__(self, config: Config) -> None:
        self.balls: list[Ball] = []
        self._config = config
        self._screw_nm_s = STIFF_NM_S if isinstance(config.axes.hood, SparkConfig) else SCREW_NM_S
        self._t_ns = 0
        self._belt_rad = self._belt_rad_s = 0.0
        self._screw_rad = START_DEG / 0.2
        self._feeder_rad = self._screw_rad_s = self._feeder_rad_s = 0.0
        self._torque_nm = dict.fromkeys(self.motors, 0.0)

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        before_nm = self._torque_nm["feeder"]
        self._torque_nm = {name: torque_nm.get(name, 0.0) for name in self.motors}
        left_s = (t_ns - self._t_ns) * 1e-9
        while left_s > 0.0:
            self._step(min(left_s, STEP_S))
            left_s -= STEP_S
        self._t_ns = t_ns
        if self._torque_nm["feeder"] > BALL_NM >= before_nm:
            self.balls.append(Ball(t_ns, self._belt_rad_s, self.hood_deg()))

    def motor(self, name: str) -> MotorTruth:
        torque_nm = self._torque_nm[name]
        position_rad, velocity_rad_s = {"hood": (self._screw_rad, self._screw_rad_s), "feeder": (self._feeder_rad,
            self._feeder_rad_s)}.get(name, (self._belt_rad, self._belt_rad_s))
        return MotorTruth(position_rad, velocity_rad_s, torque_nm, torque_nm / TORQUE_NM_A)

    def bus_v(self) -> float:
        return 12.25

    def hood_deg(self) -> float:
        hood = self._config.hood
        return elevation_from_screw_deg(self._screw_rad, hood) or hood.high_deg

    def hood_encoder_rad(self) -> float:
        return math.radians(self.hood_deg())

    def hood_at_limit(self) -> bool:
        return self._screw_rad <= 0.0

    def view(self) -> View:
        return View(np.eye(4), 1.0, 1.0)

    def _step(self, step_s: float) -> None:
        wheel, torque_nm = self._config.flywheel, self._torque_nm
        drag_nm = 2.0 * (wheel.ks_nm + wheel.kv_nm_s * self._belt_rad_s) if self._belt_rad_s > 0.0 else 0.0
        push_nm = torque_nm["flywheel_a"] + torque_nm["flywheel_b"] - drag_nm
        self._belt_rad_s = max(self._belt_rad_s + push_nm / BELT_KG_M2 * step_s, 0.0)
        self._belt_rad += self._belt_rad_s * step_s
        hood_nm = torque_nm["hood"]
        free_nm = math.copysign(max(abs(hood_nm) - self._config.hood.friction_nm, 0.0), hood_nm)
        screw_rad = max(self._screw_rad + free_nm / self._screw_nm_s * step_s, 0.0)
        self._screw_rad, self._screw_rad_s = screw_rad, (screw_rad - self._screw_rad) / step_s
        self._feeder_rad_s = torque_nm["feeder"] * 100.0
        self._feeder_rad += self._feeder_rad_s * step_s


class AdvisedPlant(SmallPlant):
    """The launcher of another controller, which does as it is advised; what hangs on the bus drives nothing."""

    def __init__(self, config: Config, advice: Callable[[], tuple[float, float, float]]) -> None:
        """`advice`: torques for each flywheel motor, the hood and the feeder."""
        super().__init__(config)
        self._advice = advice

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        wheel_nm, hood_nm, feeder_nm = self._advice()
        super().advance(t_ns, dict(zip(self.motors, (wheel_nm, wheel_nm, hood_nm, feeder_nm), strict=True)))
