"""ODrive as a MotorFamily: its table, its motor driver and its bus rules."""

from collections.abc import Sequence
from functools import partial
from typing import Annotated

from msgspec import Meta
from msgspec.structs import replace

from truearc.hw.bus_rules import Rules, allow, allow_seldom, kinds_of
from truearc.hw.codec import DBC
from truearc.hw.devices import family
from truearc.hw.devices.drivers import AskedMotor
from truearc.hw.devices.family import AttachedMotor, Axis, Bounds, MotorFamily, TorquePerAmp, current_limit_a
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.doctor import examine, questions, stored_settings
from truearc.hw.devices.odrive.emulator import SETTINGS, OdriveNode, OdriveSettings
from truearc.hw.protocols import NS_PER_MS, Frame, Order

RETRY_NS = 100_000_000                # how often orders to come up or to let go are repeated: a frame may be lost
ENDSTOP_NS = 50_000_000               # between two questions about the limit switch
FEED_NS = 25_000_000                  # an unchanged torque is repeated this often: the watchdog wants to hear it


class OdriveMotor(AskedMotor):
    """A Motor that is given torques. Its errors stand until it is wanted again: arming is the operator's re-arm.

    Released, or while its readings come too late, it is ordered to give no torque and to go idle, whatever it says of
    itself. limits: its own, set before it is driven (odrive.make_limits); none where they are not known.
    """

    def __init__(self, axis: odrive.OdriveAxis, limits: Frame | None = None) -> None:
        super().__init__(odrive.name_of(axis), odrive.frame_ids(axis), False, partial(odrive.parse, axis),
                         odrive.make_version_query(axis))
        self._axis = axis
        self._ids = (*self._ids, (self._question.arbitration_id, False))
        mode = odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH)
        self._start = (mode, *(() if limits is None else (limits,)), odrive.make_state(axis, odrive.CLOSED_LOOP))
        self._stop = (odrive.make_torque(axis, 0.0), odrive.make_state(axis, odrive.IDLE))
        self._wanted = self._driven = False
        self._asked_ns = -RETRY_NS
        self._endstop_ns = self._fed_ns = 0
        self._asked_nm = 0.0

    def take(self, frame: Frame) -> None:
        if frame.arbitration_id == self._question.arbitration_id:
            odrive.parse_version(self._axis, frame)
            self._take_answer(frame)
        else:
            super().take(frame)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        wanted = torque_nm is not None
        frames: tuple[Frame, ...] = (odrive.make_clear_errors(self._axis),) if wanted and not self._wanted else ()
        self._wanted = wanted
        driven_nm = torque_nm if self._trip.is_timely else None
        frames += self._keep_state(driven_nm is not None, t_ns) + self._asked()
        if self._axis.endstop_endpoint and t_ns - self._endstop_ns >= ENDSTOP_NS:
            self._endstop_ns = t_ns
            frames += (odrive.make_endstop_query(self._axis),)
        return Order(frames) if driven_nm is None else Order(frames + self._feed(driven_nm, t_ns), driven_nm)

    def release(self) -> tuple[Frame, ...]:
        return self._stop

    def _keep_state(self, driven: bool, t_ns: int) -> tuple[Frame, ...]:
        changed, self._driven = driven != self._driven, driven
        if not changed and ((driven and self.reading.axis_state == odrive.CLOSED_LOOP)
                            or t_ns - self._asked_ns < RETRY_NS):
            return ()
        self._asked_ns = t_ns
        if changed:
            self._fed_ns = t_ns - FEED_NS         # its torque is said at once
        return self._start if driven else self._stop

    def _feed(self, torque_nm: float, t_ns: int) -> tuple[Frame, ...]:
        if torque_nm == self._asked_nm and t_ns - self._fed_ns < FEED_NS:
            return ()
        self._asked_nm, self._fed_ns = torque_nm, t_ns
        return (odrive.make_torque(self._axis, torque_nm),)


PULSE_NS = 100 * NS_PER_MS            # heartbeat: how often an axis says how it is; its maker's own setting


def make_rules(axis: odrive.OdriveAxis, each_tick: int) -> Rules:
    """`each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once."""
    seldom = [odrive.make_clear_errors(axis), odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH),
              odrive.make_estop(axis), odrive.make_version_query(axis)]
    if axis.torque_nm_a:
        seldom.append(odrive.make_limits(axis, 0.0, 0.0))
    if axis.endstop_endpoint:
        seldom.append(odrive.make_endstop_query(axis))
    seldom.append(odrive.make_address_query(axis))
    by_host, by_device = (kinds_of(odrive.ids_sent_by(axis, node), False) for node in ("Host", "Axis"))
    always = [odrive.make_torque(axis, 0.0), odrive.make_state(axis, odrive.IDLE)]      # to let go is never refused
    return Rules((*(allow(frame, each_tick) for frame in always), *allow_seldom(seldom)), by_host, by_device,
                 {(odrive.frame_id(axis, "Heartbeat"), False, False): PULSE_NS})


class OdriveConfig(odrive.OdriveAxis, Axis, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                   tag_field="driver", tag="odrive"):
    """An ODrive, given torques."""

    endstop_endpoint: Annotated[int, Meta(ge=0, le=65535)]    # SDO endpoint that reads the limit switch; 0 = none
    torque_nm_a: TorquePerAmp = 0.0   # its torque_constant; 0: not known, its own limits stay as they are stored


def make_motors(axes: Sequence[OdriveConfig], bounds: Sequence[Bounds]) -> tuple[OdriveMotor, ...]:
    return tuple(OdriveMotor(axis, make_limits(axis, one)) for axis, one in zip(axes, bounds, strict=True))


def make_limits(axis: OdriveConfig, bounds: Bounds) -> Frame | None:
    """The device's own limits; None where one of them is not known, for the frame sets both."""
    speed_rad_s, current_a = family.speed_limit_rad_s(bounds), current_limit_a(bounds, axis.torque_nm_a)
    return None if speed_rad_s is None or current_a is None else odrive.make_limits(axis, speed_rad_s, current_a)


def make_node(axis: odrive.OdriveAxis, motor: AttachedMotor) -> OdriveNode:
    settings = replace(SETTINGS.get(motor.name, OdriveSettings()), watchdog_ms=motor.watchdog_ms,
                       is_absolute=motor.is_absolute)
    return OdriveNode(axis, motor.name, motor.plant, settings, motor.endstop if axis.endstop_endpoint else None)


ODRIVE = MotorFamily(
    driver="odrive", axis=OdriveConfig, example=OdriveConfig(4, 1, 0), dbc=DBC / "odrive.dbc", is_commanded=True,
    make_motors=make_motors, make_rules=make_rules,
    errors=lambda axis, motor: odrive.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == odrive.CLOSED_LOOP, questions=questions, examine=examine,
    make_node=make_node, stored_settings=stored_settings)
