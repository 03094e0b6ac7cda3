"""The emulated world as a Plant (launcher, battery, balls and air), and seasons of shots played directly in it.

A season is played on a bench-mounted launcher, without buses or images. The bench brings the wheels and hood of a world
to their set points and feeds balls; it uses true values, not sensors. The sensor readings come from the world as the
emulated devices read it (encoders with their errors); the camera's distance is the true distance as measured with a
wrong focal length and noise.
"""

import contextlib
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from truearc.hw.emulated.nodes import MotorTruth, View
from truearc.hw.protocols import NS
from truearc.robot.config.rig_spec import Rig, Target
from truearc.robot.config.shot_map import OUTCOMES
from truearc.sim.data.dataset import Dataset, Shots, Traces
from truearc.sim.data.recordings import AFTER_S, BEFORE_S
from truearc.sim.printed import Progress
from truearc.sim.world import drive
from truearc.sim.world.drive import FLYWHEEL, HOOD_COULOMB_NM, Battery, Belt, Drawn, Hood, Motor, drive_motor, flexed
from truearc.sim.world.field import TAPE_M, BallResult, Chassis, Flight, Pose, from_exit_point, in_field, look
from truearc.sim.world.goal import Goal
from truearc.sim.world.options import Options, with_ball
from truearc.sim.world.scene import Feeder, Nip, Rack, Released

LONGEST_STEP_S = 0.005
START_DISTANCE_M = 4.0

_MOTORS = {"flywheel_a": FLYWHEEL, "flywheel_b": FLYWHEEL, "hood": drive.HOOD, "feeder": drive.FEEDER}
_STILL = Drawn(0.0, 0.0, 0.0)


class World:
    """A Plant. The same seed, options and torque history give the same bits.

    `results` lists every ball that has arrived, `flying` those in the air, oldest first. `chassis` is the robot's
    position and motion; `belt` (lower wheel and motors) and `hood` are parts of the launcher. Only the driver, tests
    and benches may use them.
    """

    motors = tuple(_MOTORS)

    def __init__(self, seed: int, options: Options | None = None, distance_m: float = START_DISTANCE_M,
                 target: Target | None = None, mark_m: tuple[float, float] = TAPE_M) -> None:
        """target: one that faces up, in place of the usual opening. mark_m: as of truearc.sim.world.field.look."""
        self._options = options = options or Options()
        self._goal, self._mark_m = Goal(target) if target is not None and target.faces_up else None, mark_m
        self._t_ns = 0
        self._battery = Battery(options)
        self.belt = Belt(options)
        self.hood = Hood(float(np.random.default_rng([seed, 5]).uniform(20.0, 70.0)), options)
        self._feeder = Feeder(options)
        self._rack = Rack(seed, options)
        self.chassis = Chassis(seed, distance_m, options.pose_scale)
        self._shots = 0
        self._nip: Nip | None = None
        self._fed_t_ns = 0
        self._wheel_before_rad_s = 0.0
        self.flying: list[Flight] = []
        self._drawn = dict.fromkeys(_MOTORS, _STILL)
        self._view: tuple[Pose, View] | None = None
        self.results: list[BallResult] = []

    # --- Plant

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        """Bring the world to `t_ns` with these torques commanded; unknown motor names raise KeyError."""
        if not torque_nm.keys() <= _MOTORS.keys():
            raise KeyError(f"no such motor among {', '.join(torque_nm)}; there are {', '.join(_MOTORS)}")
        span_ns = t_ns - self._t_ns
        if span_ns <= 0:
            return
        steps = max(1, math.ceil(span_ns * 1e-9 / LONGEST_STEP_S - 1e-6))
        start_ns = self._t_ns
        for number in range(1, steps + 1):
            until_ns = start_ns + span_ns * number // steps
            self._step((until_ns - self._t_ns) * 1e-9, torque_nm)
            self._t_ns = until_ns

    def motor(self, name: str) -> MotorTruth:
        """Return the motor's state as it sees itself, from power-up; raises KeyError."""
        drawn = self._drawn[name]
        position_rad, speed_rad_s = self._shaft(name)
        scale = self._options.encoder_scale if _MOTORS[name] is FLYWHEEL else 1.0
        return MotorTruth(position_rad * scale, speed_rad_s * scale, drawn.torque_nm, drawn.current_a)

    def bus_v(self) -> float:
        return self._battery.bus_v

    def hood_encoder_rad(self) -> float:
        return self.hood.encoder_rad

    def hood_at_limit(self) -> bool:
        return self.hood.at_limit

    def view(self) -> View:
        """Return the tape as the camera sees it from the robot's present position."""
        pose = self.chassis.pose()
        if self._view is None or self._view[0] != pose:
            self._view = (pose, look(pose, self._options, self._mark_m))
        return self._view[1]

    # --- truth, for the driver, tests and benches

    @property
    def ball_on_its_way(self) -> bool:
        """Whether a ball is between the wheels or in the air."""
        return self._nip is not None or bool(self.flying)

    # --- one step

    def _step(self, dt_s: float, asked_nm: Mapping[str, float]) -> None:
        power_w = 0.0
        for name, motor in _MOTORS.items():
            self._drawn[name] = drawn = self._drive(name, motor, asked_nm.get(name, 0.0))
            power_w += drawn.power_w
        self._battery.draw(power_w, dt_s)
        self.chassis.step(dt_s)
        self.hood.step(self._drawn["hood"].torque_nm, dt_s)
        fed_s = self._feeder.step(self._drawn["feeder"].torque_nm, dt_s)
        for flight in self.flying:
            flight.step(dt_s)
        self._turn_wheels(fed_s, dt_s)
        self.results += [result for flight in self.flying if (result := flight.result()) is not None]
        self.flying = [flight for flight in self.flying if flight.arrival is None]

    def _drive(self, name: str, motor: Motor, asked_nm: float) -> Drawn:
        if asked_nm == 0.0:
            return _STILL
        return drive_motor(motor, asked_nm, self._shaft(name)[1], self._battery.bus_v, self._options.driver_current_a)

    def _shaft(self, name: str) -> tuple[float, float]:
        part = self._feeder if name == "feeder" else self.hood if name == "hood" else self.belt
        return part.position_rad, part.speed_rad_s

    def _turn_wheels(self, fed_s: float | None, dt_s: float) -> None:
        torque_nm = self._drawn["flywheel_a"].torque_nm + self._drawn["flywheel_b"].torque_nm
        nip_s = dt_s if self._nip is not None else fed_s or 0.0
        alone_s = dt_s - nip_s
        if alone_s > 0.0:
            self.belt.step(torque_nm, alone_s)
        if fed_s is not None:
            self._take_ball(dt_s - fed_s)
        if self._nip is not None and nip_s > 0.0:
            left_s = self._nip.step(torque_nm + self.belt.loss_nm(), self._feeder, nip_s)
            self.belt.turn(self._nip.wheel_rad_s, nip_s - left_s)
            if left_s > 0.0:
                self.belt.step(torque_nm, left_s)
            self._let_go(dt_s - left_s, left_s)

    def _take_ball(self, after_s: float) -> None:
        self._fed_t_ns = self._t_ns + round(after_s * 1e9)
        self._wheel_before_rad_s = self.belt.speed_rad_s
        elevation_deg = self.hood.elevation_deg + self._options.hood_flex_deg * flexed(self.belt.speed_rad_s)
        self._nip = Nip(self._rack.ball(self._shots), self._options, math.radians(elevation_deg),
                        self.belt.speed_rad_s, self._feeder.surface_m_s)

    def _let_go(self, after_s: float, left_s: float) -> None:
        nip = self._nip
        if nip is None or not (nip.released or nip.thrown_back):
            return
        self._nip = None
        if nip.released is None:
            self._feeder.take_back(nip.x_m)
            return
        flight = self._launch(nip, nip.released, self._t_ns + round(after_s * 1e9))
        self.flying.append(flight)
        self._rack.use(self._shots)
        self._shots += 1
        self._battery.shots += 1
        self._feeder.expect_ball()
        flight.step(left_s)

    def _launch(self, nip: Nip, released: Released, exit_t_ns: int) -> Flight:
        launcher = from_exit_point(released, nip.elevation_rad, self._options)
        field = in_field(launcher, self.chassis.pose(), self.chassis.speed_m_s)
        x_m_s, y_m_s, z_m_s = velocity_m_s = launcher.velocity_m_s
        record = BallResult(
            self._shots, nip.ball.ball_id, self.chassis.distance_m, math.degrees(nip.elevation_rad),
            self._wheel_before_rad_s, nip.wheel_rad_s, exit_speed_m_s=float(np.linalg.norm(velocity_m_s)),
            exit_deg=math.degrees(math.atan2(z_m_s, math.hypot(x_m_s, y_m_s))),
            exit_spin_rev_s=float(-launcher.spin_rad_s[1]) / (2.0 * math.pi),
            fed_t_ns=self._fed_t_ns, exit_t_ns=exit_t_ns)
        return Flight(nip.ball, self._options, field, record, self._goal)


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
    """The robot does not reach the set points; no ball was fed."""


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
        """Hold both set points, feed this many balls one at a time, and wait until they have arrived.

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
        """Run one control period towards the set points."""
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
        return min(max(0.02 + 1.5e-4 * wanted_rad_s + 0.03 * error + self._integral_nm, 0.0), 1.2), abs(error)

    def _hood(self, wanted_deg: float) -> tuple[float, float]:
        error = wanted_deg - self.world.hood.elevation_deg
        speed_deg_s = 0.2 * self.world.motor("hood").velocity_rad_s
        if abs(error) < DEADBAND_DEG:
            return -0.002 * speed_deg_s, abs(error)
        friction_nm = HOOD_COULOMB_NM if error > 0.0 else -HOOD_COULOMB_NM
        return min(max(0.05 * error - 0.004 * speed_deg_s, -0.3), 0.3) + friction_nm, abs(error)


SETTLED_TICKS = 40                    # standing before a shot
READY_S = 10.0                        # then a driver gives a shot up: the battery may not have the speed in it any more


class ShotSetting(NamedTuple):
    """One configuration as the robot would request it: elevation by its encoder, motor speed / free speed."""

    distance_m: float
    hood_deg: float
    motor_ratio: float


class Sensors(NamedTuple):
    """Standard deviations of the readings from shot to shot."""

    distance_m: float = 0.03
    hood_deg: float = 0.05
    wheel_rad_s: float = 0.3


ORDINARY = Sensors()


class Trial(NamedTuple):
    """One shot: the readings before it, its time (s) and result, telemetry and track around it."""

    read: dict[str, float]
    result: BallResult
    traces: list[tuple[float, str, float]]
    track: np.ndarray                 # [k, 4] s after the ball left, x, y, z in the launcher's axes, if watched


class Season(NamedTuple):
    """The dataset, which is all that a solver gets, and the truth about every shot in it."""

    dataset: Dataset
    results: tuple[BallResult, ...]


def play_season(rig: Rig, options: Options, seed: int, settings: Sequence[ShotSetting], level: str,
                sensors: Sensors = ORDINARY, progress: Progress = lambda done, note: None) -> Season:
    """Shoot the settings in this order with one robot on one battery. level: "L0" or "L1" (telemetry).

    A shot that the robot does not get ready for is given up, and is not in the dataset. TimeoutError when all are.
    The same arguments give the same season. `session` is "1" throughout; balls are not told apart.
    """
    trials = shoot(rig, options, seed, settings, sensors, np.random.default_rng([seed, 7]), progress)
    return season_of(rig, seed, trials, level, [mark_of(trial.result.outcome, rig) for trial in trials])


def mark_of(button: str, rig: Rig) -> tuple[str, str]:
    """Return outcome and side by a button, in the words of the rig's target."""
    return rig.target.noted(*OUTCOMES[button]) if rig.target is not None else OUTCOMES[button]


def shoot(rig: Rig, options: Options, seed: int, settings: Sequence[ShotSetting], sensors: Sensors,
          rng: np.random.Generator, progress: Progress, watch: Watch = lambda world: None) -> list[Trial]:
    """Shoot the settings; rng: of the readings; watch: for tracks. TimeoutError if the robot gets ready for none."""
    bench = Bench(World(seed, with_ball(options, rig), settings[0].distance_m, rig.target), watch)
    trials: list[Trial] = []
    for number, setting in enumerate(settings):
        progress(number / len(settings), f"{number} of {len(settings)} shots")
        before_ns = trials[-1].result.fed_t_ns if trials else None
        with contextlib.suppress(NotReady):
            trials.append(_shoot(bench, rig, options, setting, before_ns, sensors, rng))
    if not trials:
        raise TimeoutError("the robot never got ready for a shot")
    return trials


def season_of(rig: Rig, seed: int, trials: Sequence[Trial], level: str, marks: Sequence[tuple[str, str]]) -> Season:
    """Return the season of trials with their marks (outcome, side); with telemetry at levels other than "L0"."""
    rows = [(shot, *row) for shot, trial in enumerate(trials) for row in trial.traces]
    dataset = Dataset(f"world-{seed}", rig, _shots(trials, level, marks), None,
                      Traces.of(rows) if level != "L0" else None)
    return Season(dataset, tuple(trial.result for trial in trials))


def _shoot(bench: Bench, rig: Rig, options: Options, setting: ShotSetting, before_ns: int | None, sensors: Sensors,
           rng: np.random.Generator) -> Trial:
    world, free = bench.world, rig.launcher.free_speed_rad_s or 0.0
    # the robot aims by its encoders: what they say is right
    wheel_rad_s = setting.motor_ratio * free / options.encoder_scale
    hood_deg = setting.hood_deg - options.hood_offset_deg
    world.chassis.drive_to(setting.distance_m)
    while world.chassis.moving:
        bench.tick(wheel_rad_s, hood_deg)
    for _ in range(SETTLED_TICKS):
        bench.tick(wheel_rad_s, hood_deg)
    first = len(bench.samples)
    (result,) = bench.fire(wheel_rad_s, hood_deg, 1, ready_s=READY_S)
    samples = bench.samples[max(first - round(BEFORE_S * 200.0), 0):]
    bench.samples.clear()
    fed_s = result.fed_t_ns * NS
    ready = [sample for sample in samples if sample.t_s <= fed_s][-1]
    read = {"distance_m": seen_distance_m(result.distance_m, options) + sensors.distance_m * rng.normal(),
            "hood_deg": ready.hood_deg + options.hood_offset_deg + sensors.hood_deg * rng.normal(),
            "motor_ratio": (ready.wheel_rad_s * options.encoder_scale + sensors.wheel_rad_s * rng.normal()) / free,
            "battery_v": ready.bus_v, "t_s": fed_s,
            "since_last_shot_s": math.nan if before_ns is None else fed_s - before_ns * NS}
    traces = [(sample.t_s - fed_s, f"wheel_{wheel.name}_rad_s", sample.wheel_rad_s * options.encoder_scale * wheel.gear)
              for sample in samples if -BEFORE_S <= sample.t_s - fed_s <= AFTER_S for wheel in rig.launcher.wheel]
    traces += [(sample.t_s - fed_s, "battery_v", sample.bus_v) for sample in samples
               if -BEFORE_S <= sample.t_s - fed_s <= AFTER_S]
    track = [sample.ball for sample in samples if sample.ball is not None]
    return Trial(read, result, traces, np.array(track).reshape(-1, 4))


def seen_distance_m(distance_m: float, options: Options) -> float:
    """Return the measured distance: with a wrong focal length every distance from the lens is scaled by a share."""
    return (distance_m + options.camera_behind_exit_m) / options.camera_focal_scale - options.camera_behind_exit_m


def _shots(trials: Sequence[Trial], level: str, marks: Sequence[tuple[str, str]]) -> Shots:
    names = [name for name in trials[0].read if level != "L0" or name in ("distance_m", "hood_deg", "motor_ratio")]
    return Shots(tuple(f"{number:04d}" for number in range(len(trials))),
                 {name: np.array([trial.read[name] for trial in trials]) for name in names},
                 {"outcome": tuple(mark for mark, _ in marks), "side": tuple(side for _, side in marks),
                  "session": ("1",) * len(trials)})
