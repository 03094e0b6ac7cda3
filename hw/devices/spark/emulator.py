"""An emulated SPARK with byte-exact frames and the documented rates, which produces no output without a heartbeat."""

import math
from collections import deque
from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw.codec import Values, load_codec
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.frames import CONTROLLER_HEARTBEAT, RPM_RAD_S, SparkAxis
from truearc.hw.emulated.nodes import NEVER_NS, MotorTruth, Plant, Report, ReportingNode, take_reports
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import BadFrame, Frame

PHASE_NS = 3 * MS                                 # of the reports, as the other axes'
LOOP_NS = 1 * MS                                  # the device works out its output this often while it is enabled
SAMPLE_NS = MS // 2                               # unit of the sample delta
UINT, FLOAT = 2, 3                                # parameter types
FULL_DUTY = 0.99998                               # the most that STATUS_0 says is applied: 32442 of its 16 bits
HIGHEST_V, HIGHEST_A = 29.99, 149.9               # what its twelve bits can say
TEMPERATURE_DEGC = 25
# A new device's parameters
DEFAULTS = {spark.IDLE_MODE: 0.0, spark.FORWARD_LIMIT: 1.0, spark.REVERSE_LIMIT: 1.0, spark.STALL_LIMIT: 80.0,
            spark.AVERAGE_DEPTH: 64.0, spark.SAMPLE_DELTA: 200.0, spark.HALL_PERIOD: 0.03125, spark.HALL_DEPTH: 3.0,
            spark.STATUS_2_PERIOD: 20.0, spark.STATUS_5_PERIOD: 20.0, spark.DUTY_FACTOR: 1.0}
PERIODS = {2: spark.STATUS_2_PERIOD, 5: spark.STATUS_5_PERIOD}    # status -> parameter
NO_MOTOR = MotorTruth(0.0, 0.0, 0.0, 0.0)
DUTY_PERIOD_US, STEPS = 1025, 1024                # of REV's through-bore encoder


class SparkSettings(Struct, frozen=True):
    """The device and its motor, as they really are."""

    kt_nm_a: float = 0.02
    resistance_ohm: float = 0.1
    firmware: tuple[int, int, int] = (26, 1, 0)
    faults: int = 0                               # standing, as in STATUS_1


class SparkNode(ReportingNode):
    """One device with one motor of the plant, or none. Takes duties only; at 0 it coasts or brakes, as it is set.

    It applies its set point, which it keeps, only while secondary heartbeats name it: one that does not, or none for
    100 ms, and the output is 0. One that has met a competition controller ignores them until its power is cycled, and
    what that controller would have it do is not emulated. A closed limit switch stops it in that direction.
    Speed is what the position did over the sample delta; averaging over samples is not emulated, for at what moments
    they are taken is not public. Firmware before 25 answers for its version and has no other frame in common.
    `absolute_rev` is the angle of the encoder on its data port, in turns; None: no signal.
    """

    absolute_rev: Callable[[], float] | None = None

    def __init__(self, axis: SparkAxis, motor: str | None, plant: Plant, settings: SparkSettings | None = None,
                 endstop: Callable[[], bool] | None = None) -> None:
        self.motor = motor
        self.endstop = endstop                    # reads the limit switch on its data port
        self.device, self._axis, self._name, self._plant = axis.device, axis, motor, plant
        self.settings = settings or SparkSettings()
        self._codec = load_codec("spark")
        self._takers = {spark.frame_id(axis, name): (name, take) for name, take in (
            ("DUTY_CYCLE_SETPOINT", self._take_duty), ("SET_STATUSES_ENABLED", self._take_statuses),
            ("CLEAR_FAULTS", self._take_clear), ("PARAMETER_WRITE", self._take_parameter),
            (spark.HEARTBEAT, self._take_heartbeat))}
        self._version_id = spark.frame_id(axis, "GET_FIRMWARE_VERSION")
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Restore power: settings are lost, turns count from 0, and STATUS_1 reports the reset."""
        self._is_old = self.settings.firmware[0] < spark.OLDEST_FIRMWARE
        self.is_locked = False
        self.parameters = dict(DEFAULTS)
        self.has_reset = True
        self._sticky = self.settings.faults
        self._duty = 0.0
        self._expires_ns = NEVER_NS
        self._enabled = False
        self._truth = self._look()
        self._start_rad = self._truth.position_rad
        self._seen = deque([(t_ns, self._truth.position_rad)])
        self._torque_nm = self.output = 0.0       # output: applied duty, the device's own sign
        self._statuses = {number: Report(0 if self._is_old else period_ms * MS, t_ns + PHASE_NS, make)
                          for number, period_ms, make in (
                              (0, 10, self._make_status_0), (1, 250, self._make_status_1), (2, 0, self._make_status_2),
                              (5, 0, self._make_status_5), (6, 0, self._make_status_6))}
        self._reports = tuple(self._statuses.values())
        self._plan(t_ns)

    def fail(self, faults: int) -> None:
        """Set the present faults (0: none); they stay sticky until they are cleared."""
        self.settings = replace(self.settings, faults=faults)
        self._sticky |= faults

    def clear_faults(self) -> None:
        """Clear sticky faults and the reset flag, as a frame on the bus may request."""
        self.has_reset, self._sticky = False, self.settings.faults

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((frame_id, True) for frame_id in (*self._takers, self._version_id, CONTROLLER_HEARTBEAT))

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        """Obey one frame; a malformed one is ignored and counted."""
        if frame.arbitration_id == self._version_id:
            return [self._make_version()] if frame.is_remote else []
        if self._is_old or frame.is_remote:
            return []
        if frame.arbitration_id == CONTROLLER_HEARTBEAT:
            self.is_locked, self._enabled = True, False
            self._drive(t_ns)
            return []
        name, take = self._takers[frame.arbitration_id]
        values = self._parse(self._codec, name, frame)
        if values is None:
            return []
        answers = take(values, t_ns)
        self._drive(t_ns)
        return answers or []

    def step(self, t_ns: int) -> list[Frame]:
        if t_ns < self._due_ns:
            return []
        if t_ns >= self._expires_ns:
            self._enabled, self._expires_ns = False, NEVER_NS
        self._drive(t_ns)
        frames = take_reports(self._reports, t_ns)
        self._plan_loop(t_ns)
        return frames

    def _look(self) -> MotorTruth:
        return NO_MOTOR if self._name is None else self._plant.motor(self._name)

    def _plan_loop(self, t_ns: int) -> None:
        self._plan(self._expires_ns, t_ns + LOOP_NS if self._enabled or self._torque_nm else NEVER_NS)

    # --- output

    def _drive(self, t_ns: int) -> None:
        """Look at the motor, and work out the output and what torque comes of it."""
        self._truth = truth = self._look()
        self._remember(t_ns)
        self.output = self._limited(self._duty) if self._enabled else 0.0
        settings, sign = self.settings, self._axis.direction
        if self.output == 0.0 and not (self.parameters[spark.IDLE_MODE] and truth.velocity_rad_s):
            self._torque_nm = 0.0     # the windings are open, or nothing turns; else a short circuit brakes
        else:
            back_v = settings.kt_nm_a * sign * truth.velocity_rad_s
            current_a = (self.output * self._plant.bus_v() - back_v) / settings.resistance_ohm
            most_a = self.parameters[spark.STALL_LIMIT]
            self._torque_nm = sign * settings.kt_nm_a * min(max(current_a, -most_a), most_a)
        self._plan_loop(t_ns)

    def _limited(self, duty: float) -> float:
        forward, reverse = self._switches()
        stopped = (duty > 0.0 and forward and self.parameters[spark.FORWARD_LIMIT]) or (
            duty < 0.0 and reverse and self.parameters[spark.REVERSE_LIMIT])
        return 0.0 if stopped else duty

    def _switches(self) -> tuple[bool, bool]:
        """(forward, reverse): the one switch that there is ends the robot's negative direction."""
        closed = self.endstop is not None and self.endstop()
        return closed and self._axis.direction < 0, closed and self._axis.direction > 0

    def _remember(self, t_ns: int) -> None:
        seen = self._seen
        if t_ns > seen[-1][0]:
            seen.append((t_ns, self._truth.position_rad))
        while len(seen) > 2 and seen[1][0] <= t_ns - self._window_ns():
            seen.popleft()

    def _window_ns(self) -> int:
        return max(1, int(self.parameters[spark.SAMPLE_DELTA])) * SAMPLE_NS

    def _velocity_rpm(self, t_ns: int) -> float:
        (first_ns, first_rad), (next_ns, next_rad) = self._seen[0], self._seen[min(1, len(self._seen) - 1)]
        begin_ns = max(first_ns, t_ns - self._window_ns())
        if begin_ns >= t_ns:
            return 0.0
        share = (begin_ns - first_ns) / (next_ns - first_ns)
        turned_rad = self._truth.position_rad - (first_rad + share * (next_rad - first_rad))
        return self._axis.direction * turned_rad / ((t_ns - begin_ns) * 1e-9) / RPM_RAD_S

    # --- frames that it takes

    def _take_heartbeat(self, values: Values, t_ns: int) -> None:
        bits = int(values["devices_0_31"]) | int(values["devices_32_63"]) << 32
        self._enabled = bool(bits >> self._axis.device & 1) and not self.is_locked
        self._expires_ns = t_ns + spark.HEARTBEAT_LOST_MS * MS if self._enabled else NEVER_NS

    def _take_duty(self, values: Values, t_ns: int) -> None:
        self._duty = values["duty"]

    def _take_statuses(self, values: Values, t_ns: int) -> list[Frame]:
        mask, wanted = int(values["mask"]), int(values["enabled"])
        for number, report in self._statuses.items():
            if mask >> number & 1:
                report.set_period(self._period_ms(number) * MS if wanted >> number & 1 else 0, t_ns)
        enabled = sum(1 << number for number, report in self._statuses.items() if report.due_ns < NEVER_NS)
        unavailable = mask & wanted & ~sum(1 << number for number in self._statuses)
        return [spark.make(self._axis, "SET_STATUSES_ENABLED_RESPONSE", {
            "result": int(unavailable != 0), "mask": mask, "enabled": enabled})]

    def _period_ms(self, number: int) -> int:
        return int(self.parameters[PERIODS[number]]) if number in PERIODS else {0: 10, 1: 250, 6: 20}[number]

    def _take_clear(self, values: Values, t_ns: int) -> None:
        self.clear_faults()

    def _take_parameter(self, values: Values, t_ns: int) -> list[Frame]:
        parameter, bits = int(values["parameter"]), int(values["value"])
        try:
            taken, value = parameter in self.parameters, spark.setting_value(parameter, bits)
        except BadFrame:
            taken, value = False, 0.0
        if taken:
            self.parameters[parameter] = value
            for number in (number for number, period in PERIODS.items() if period == parameter):
                if self._statuses[number].due_ns < NEVER_NS:
                    self._statuses[number].set_period(self._period_ms(number) * MS, t_ns)
        now = self.parameters.get(parameter, 0.0)
        kind = FLOAT if parameter in spark.FLOATS else UINT
        return [spark.make(self._axis, "PARAMETER_WRITE_RESPONSE", {
            "parameter": parameter, "type": kind if parameter in self.parameters else 0,
            "value": spark.setting_bits(parameter, now), "result": int(not taken)})]

    # --- frames that it sends

    def _make_status_0(self) -> Frame:
        forward, reverse = self._switches()
        return spark.make(self._axis, "STATUS_0", {
            "applied_duty": min(max(self.output, -FULL_DUTY), FULL_DUTY),
            "bus_v": min(max(self._plant.bus_v(), 0.0), HIGHEST_V), "motor_degc": TEMPERATURE_DEGC,
            "current_a": min(abs(self._truth.current_a), HIGHEST_A),
            "hard_forward": int(forward), "hard_reverse": int(reverse), "soft_forward": 0, "soft_reverse": 0,
            "inverted": 0, "primary_heartbeat_lock": int(self.is_locked), "model": 0})

    def _make_status_1(self) -> Frame:
        reset = spark.RESET_WARNING if self.has_reset else 0
        return spark.make(self._axis, "STATUS_1", {
            "faults": self.settings.faults, "warnings": reset, "sticky_faults": self._sticky, "sticky_warnings": reset,
            "is_follower": 0})

    def _make_status_2(self) -> Frame:
        turned_rad = self._truth.position_rad - self._start_rad
        return spark.make(self._axis, "STATUS_2", {
            "velocity_rpm": self._velocity_rpm(self._seen[-1][0]),
            "position_rev": self._axis.direction * turned_rad / math.tau})

    def _turned(self) -> float:
        """The encoder's angle in turns, in the steps in which it signals it."""
        return 0.0 if self.absolute_rev is None else round(self.absolute_rev() * STEPS) % STEPS / STEPS

    def _make_status_5(self) -> Frame:
        return spark.make(self._axis, "STATUS_5", {
            "velocity_rpm": 0.0, "position_rev": self.parameters[spark.DUTY_FACTOR] * self._turned()})

    def _make_status_6(self) -> Frame:
        lost = self.absolute_rev is None
        return spark.make(self._axis, "STATUS_6", {
            "raw_duty": 0.0 if lost else (1.0 + (DUTY_PERIOD_US - 2) * self._turned()) / DUTY_PERIOD_US,
            "period_us": 0 if lost else DUTY_PERIOD_US, "no_signal": int(lost)})

    def _make_version(self) -> Frame:
        major, minor, build = self.settings.firmware
        return spark.make(self._axis, "GET_FIRMWARE_VERSION", {
            "major": major, "minor": minor, "build": build, "debug_build": 0, "hardware": 0})
