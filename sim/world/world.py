"""The concealed truth: a launcher, its battery, its balls and the air, as a Plant for the emulated devices."""

import math
from collections.abc import Mapping

import numpy as np

from truearc.hw.emulated.nodes import MotorTruth, View
from truearc.sim.world.drive import FEEDER, FLYWHEEL, HOOD, Battery, Belt, Drawn, Hood, Motor, drive_motor, flexed
from truearc.sim.world.field import BallResult, Chassis, Flight, Pose, from_exit_point, in_field, look
from truearc.sim.world.options import Options
from truearc.sim.world.scene import Feeder, Nip, Rack, Released

LONGEST_STEP_S = 0.005
START_DISTANCE_M = 4.0

_MOTORS = {"flywheel_a": FLYWHEEL, "flywheel_b": FLYWHEEL, "hood": HOOD, "feeder": FEEDER}
_STILL = Drawn(0.0, 0.0, 0.0)


class World:
    """A Plant. Same seed, options and torque history: the same bits.

    `results` lists every ball that has arrived, `flying` those in the air, oldest first. `chassis` is where the robot
    stands and how it drives; `belt` (lower wheel and motors) and `hood` are parts of the launcher. Only the driver,
    tests and benches may look at them.
    """

    motors = tuple(_MOTORS)

    def __init__(self, seed: int, options: Options | None = None, distance_m: float = START_DISTANCE_M) -> None:
        self._options = options = options or Options()
        self._t_ns = 0
        self._battery = Battery(options)
        self.belt = Belt(options)
        start_deg = float(np.random.default_rng([seed, 5]).uniform(20.0, 70.0))
        self.hood = Hood(start_deg, options)
        self._feeder = Feeder()
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
        """The motor's own view of itself, from switch-on; raises KeyError."""
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
        """The tape as the camera sees it from where the robot stands now."""
        pose = self.chassis.pose()
        if self._view is None or self._view[0] != pose:
            self._view = (pose, look(pose, self._options))
        return self._view[1]

    # --- truth, for the driver, tests and benches

    @property
    def ball_on_its_way(self) -> bool:
        """A ball is between the wheels or in the air."""
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
        return Flight(nip.ball, self._options, field, record)
