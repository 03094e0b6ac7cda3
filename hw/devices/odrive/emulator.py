"""An emulated ODrive axis with byte-exact frames, the documented rates and the device's own safety limits."""

import math
from collections.abc import Callable
from functools import partial
from types import MappingProxyType

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw.codec import Values, load_codec
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.emulated.nodes import NEVER_NS, Plant, Report, ReportingNode, take_reports
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import Frame

DISARMED = 3                                      # procedure_result
PHASE_NS = 3 * MS                                 # of every axis's reports: each moment of its own would cost time
OVERSPEED = 1.2                                   # times the velocity limit: the axis gives up


class OdriveSettings(Struct, frozen=True):
    """The device's configuration; periods of 0 are off. These are the values that truearc requires of a real one."""

    heartbeat_ms: int = 100
    encoder_ms: int = 10
    current_ms: int = 10
    bus_ms: int = 100
    error_ms: int = 0
    watchdog_ms: int = 100            # 0: off
    is_absolute: bool = False         # its encoder knows its position after a restart
    velocity_limit_rad_s: float = 1000.0
    current_limit_a: float = 100.0
    torque_nm_a: float = 0.02                     # the motor's torque constant, as the device believes it
    velocity_gain_nm_s: float = 0.02              # torque per rad/s off the set velocity, or towards the limit
    velocity_integrator_nm: float = 0.05          # and per rad off it, in velocity control
    temperatures_degc: tuple[float, float] = (25.0, 25.0)     # inverter, motor; the plant has no heat
    firmware: tuple[int, int, int] = (0, 6, 10)
    serial: int = 0x385F324D3037
    parameters: tuple[tuple[int, int], ...] = ()  # (endpoint, its four bytes as a number) of what else it keeps
    save_endpoint: int = 0                        # of the function that keeps what was written, and restarts; 0: none


# How the axes report, if not as a flywheel; set once on a real one with its maker's tool. Currents matter on the
# flywheels only.
SETTINGS = MappingProxyType({"hood": OdriveSettings(encoder_ms=10, current_ms=100),
                             "feeder": OdriveSettings(encoder_ms=50, current_ms=100)})


class OdriveNode(ReportingNode):
    """One axis, attached to one motor of the plant.

    Idle at power-up. It drives only in closed loop, with torque or velocity control and passthrough input; it leaves
    closed loop when its watchdog, its velocity limit or an estop says so, and will not return until the error has been
    cleared.
    `endstop` reads the limit switch wired to it. All axes report at the same moments, between the robot's ticks.
    """

    def __init__(self, axis: OdriveAxis, motor: str, plant: Plant, settings: OdriveSettings | None = None,
                 endstop: Callable[[], bool] | None = None) -> None:
        self.motor = motor
        self._axis, self._name, self._plant, self._endstop = axis, motor, plant, endstop
        self.settings = settings or OdriveSettings()
        self._codec = load_codec("odrive")
        self._base_id = axis.node << 5
        self._handlers = {self._codec.base_id(name): (name, take) for name, take in (
            ("Estop", self._take_estop), ("RxSdo", self._take_sdo), ("Set_Axis_State", self._take_state),
            ("Set_Controller_Mode", self._take_mode), ("Set_Input_Torque", self._take_torque),
            ("Set_Input_Vel", self._take_velocity), ("Set_Limits", self._take_limits),
            ("Clear_Errors", self._take_clear))}
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Restore power: idle, without errors, modes and limits as in `settings`, and the position counts from 0."""
        self.state = odrive.IDLE
        self.errors = self.disarm_reason = self._procedure_result = 0
        self._control_mode, self._input_mode = odrive.POSITION, odrive.PASSTHROUGH     # a new device's own
        self._velocity_limit_rad_s = self.settings.velocity_limit_rad_s
        self._current_limit_a = self.settings.current_limit_a
        self._asked_nm = self._asked_rad_s = 0.0  # the device's own sign, as the float32 that came
        self._sum_nm, self._driven_ns = 0.0, 0    # of the velocity controller
        self._torque_nm = 0.0                     # the robot's sign
        self._truth = self._plant.motor(self._name)
        self._start_rad = 0.0 if self.settings.is_absolute else self._truth.position_rad
        self._expires_ns = NEVER_NS
        self._parameters = dict(self.settings.parameters)
        self._says = self._table()
        self._reports = tuple(Report(period_ms * MS, t_ns + PHASE_NS, partial(self._make, message))
                              for message, (period_ms, _) in self._says.items())
        self._plan()

    def ids(self) -> tuple[tuple[int, bool], ...]:
        questions = map(self._codec.base_id, self._says)
        return tuple((self._base_id | command, False) for command in (*self._handlers, *questions))

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        """Obey one frame; a malformed one is ignored and counted, and does not feed the watchdog."""
        command = frame.arbitration_id - self._base_id
        if frame.is_remote:
            self._truth = self._plant.motor(self._name)
            return [self._make(name) for name in self._says if self._codec.base_id(name) == command]
        if command not in self._handlers:
            return []
        name, take = self._handlers[command]
        if name == "RxSdo" and 4 <= len(frame.data) < 8:
            frame = frame._replace(data=frame.data.ljust(8, b"\0"))    # as long as the parameter
        values = self._parse(self._codec, name, frame)
        if values is None:
            return []
        answers = take(values, t_ns)
        self._drive(t_ns)
        self._due_ns = min(self._due_ns, self._expires_ns)
        return answers or []

    def step(self, t_ns: int) -> list[Frame]:
        if t_ns < self._due_ns:
            return []
        self._truth = self._plant.motor(self._name)
        if t_ns >= self._expires_ns:
            self.disarm(odrive.WATCHDOG_EXPIRED)
        self._drive(t_ns)
        frames = take_reports(self._reports, t_ns)
        self._plan(self._expires_ns)
        return frames

    def _drive(self, t_ns: int) -> None:
        """Work out the torque from the set point, the current limit and the velocity limit, towards which it fades."""
        since_s, self._driven_ns = (t_ns - self._driven_ns) * 1e-9, t_ns
        if self.state != odrive.CLOSED_LOOP or self._input_mode != odrive.PASSTHROUGH or (
                self._control_mode not in (odrive.TORQUE, odrive.VELOCITY)):
            self._torque_nm = self._sum_nm = 0.0
            return
        velocity, limit = self._axis.direction * self._truth.velocity_rad_s, self._velocity_limit_rad_s
        if abs(velocity) > OVERSPEED * limit:
            self.disarm(odrive.VELOCITY_LIMIT)
            return
        most, gain = self._current_limit_a * self.settings.torque_nm_a, self.settings.velocity_gain_nm_s
        if self._control_mode == odrive.VELOCITY:
            off_rad_s = min(max(self._asked_rad_s, -limit), limit) - velocity
            self._sum_nm += self.settings.velocity_integrator_nm * off_rad_s * since_s
            self._sum_nm = min(max(self._sum_nm, -most), most)
            wanted = self._asked_nm + gain * off_rad_s + self._sum_nm
            self._torque_nm = self._axis.direction * min(max(wanted, -most), most)
            return
        asked = min(max(self._asked_nm, (-limit - velocity) * gain), (limit - velocity) * gain)
        self._torque_nm = self._axis.direction * min(max(asked, -most), most)

    def disarm(self, error: int) -> None:
        """Leave closed-loop control; an error of 0 is not reported."""
        self.state = odrive.IDLE
        self.errors |= error
        self.disarm_reason = error
        self._asked_nm = self._asked_rad_s = self._torque_nm = 0.0
        self._expires_ns = NEVER_NS

    def _take_estop(self, values: Values, t_ns: int) -> None:
        self.disarm(odrive.ESTOP_REQUESTED)

    def _take_state(self, values: Values, t_ns: int) -> None:
        wanted = int(values["axis_state"])
        if wanted == odrive.IDLE:
            self.state, self._expires_ns, self._procedure_result = odrive.IDLE, NEVER_NS, 0
            self._asked_nm = self._asked_rad_s = 0.0
        elif wanted == odrive.CLOSED_LOOP and not self.errors:
            if self.state != odrive.CLOSED_LOOP:
                self._asked_nm = self._asked_rad_s = self._sum_nm = 0.0
                self.disarm_reason = 0
                self._feed(t_ns)
            self.state, self._procedure_result = odrive.CLOSED_LOOP, 0
        else:
            self._procedure_result = DISARMED

    def _take_mode(self, values: Values, t_ns: int) -> None:
        self._control_mode, self._input_mode = int(values["control_mode"]), int(values["input_mode"])

    def _take_torque(self, values: Values, t_ns: int) -> None:
        if self.state == odrive.CLOSED_LOOP:
            self._asked_nm = values["torque_nm"]
            self._feed(t_ns)

    def _take_velocity(self, values: Values, t_ns: int) -> None:
        if self.state == odrive.CLOSED_LOOP:
            self._asked_rad_s, self._asked_nm = values["velocity_rev_s"] * math.tau, values["torque_nm"]
            self._feed(t_ns)

    def _take_limits(self, values: Values, t_ns: int) -> None:
        self._velocity_limit_rad_s = values["velocity_rev_s"] * math.tau
        self._current_limit_a = values["current_a"]

    def _take_clear(self, values: Values, t_ns: int) -> None:
        self.errors = self.disarm_reason = 0

    def _take_sdo(self, values: Values, t_ns: int) -> list[Frame]:
        endpoint = int(values["endpoint"])
        if values["opcode"] == odrive.SDO_WRITE:
            self._write(endpoint, int(values["value"]), t_ns)
            return []
        table = dict(self._parameters)
        if self._endstop is not None:
            table[self._axis.endstop_endpoint] = int(self._endstop())
        if values["opcode"] != odrive.SDO_READ or endpoint not in table:
            return []                             # a parameter that this device does not have
        return [odrive.make(self._axis, "TxSdo", {"endpoint": endpoint, "value": table[endpoint]})]

    def _write(self, endpoint: int, bits: int, t_ns: int) -> None:
        if endpoint in self._parameters:
            self._parameters[endpoint] = bits
        elif endpoint and endpoint == self.settings.save_endpoint and self.state == odrive.IDLE:
            self.settings = replace(self.settings, parameters=tuple(self._parameters.items()))
            self.restart(t_ns)

    def _feed(self, t_ns: int) -> None:
        self._expires_ns = t_ns + self.settings.watchdog_ms * MS if self.settings.watchdog_ms else NEVER_NS

    def _table(self) -> dict[str, tuple[int, Callable[[], Values]]]:
        """Messages that it sends: their periods in ms, 0 where they are asked for only, and their values."""
        settings, sign = self.settings, self._axis.direction
        return {
            "Heartbeat": (settings.heartbeat_ms, lambda: {
                "axis_error": self.errors | self.disarm_reason, "axis_state": self.state,
                "procedure_result": self._procedure_result, "trajectory_done": 0}),
            "Get_Error": (settings.error_ms, lambda: {
                "active_errors": self.errors, "disarm_reason": self.disarm_reason}),
            "Get_Encoder_Estimates": (settings.encoder_ms, lambda: {
                "position_rev": sign * (self._truth.position_rad - self._start_rad) / math.tau,
                "velocity_rev_s": sign * self._truth.velocity_rad_s / math.tau}),
            "Get_Temperature": (0, lambda: dict(zip(
                ("inverter_degc", "motor_degc"), self.settings.temperatures_degc, strict=True))),
            "Get_Iq": (settings.current_ms, lambda: {
                "setpoint_a": self._asked_nm / self.settings.torque_nm_a, "measured_a": sign * self._truth.current_a}),
            "Get_Bus_Voltage_Current": (settings.bus_ms, self._supply),
            "Get_Version": (0, lambda: {
                "protocol": 2, "hardware_line": 5, "hardware_version": 2, "hardware_variant": 0,
                "firmware_unreleased": 0, **dict(zip(
                    ("firmware_major", "firmware_minor", "firmware_revision"), self.settings.firmware, strict=True))}),
            "Address": (0, lambda: {"node": self._axis.node, "serial": self.settings.serial})}

    def _supply(self) -> Values:
        """Power at the shaft only: the plant does not report the losses in the windings."""
        truth, bus_v = self._truth, self._plant.bus_v()
        return {"bus_v": bus_v, "bus_a": truth.torque_nm * truth.velocity_rad_s / bus_v if bus_v > 0.0 else 0.0}

    def _make(self, message: str) -> Frame:
        return odrive.make(self._axis, message, self._says[message][1]())
