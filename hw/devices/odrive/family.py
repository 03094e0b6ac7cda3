"""ODrive as a MotorFamily."""

from msgspec.structs import replace

from truearc.hw.codec import DBC
from truearc.hw.devices.axis import Axis
from truearc.hw.devices.bus_rules import NS_PER_MS, Rules, allow_seldom, kinds_of
from truearc.hw.devices.family import AttachedMotor, MotorFamily
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.doctor import examine, questions
from truearc.hw.devices.odrive.emulator import SETTINGS, OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.motor import OdriveMotor
from truearc.hw.tx_allowlist import allow

PULSE_NS = 100 * NS_PER_MS            # heartbeat: how often an axis says how it is; its maker's own setting


class OdriveConfig(odrive.OdriveAxis, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="odrive"):
    """An ODrive, given torques."""

    endstop_endpoint: int             # SDO endpoint that reads the limit switch; 0 = none


def make_rules(axis: odrive.OdriveAxis, each_tick: int) -> Rules:
    """Frames that an axis may be sent, and those that it and hosts send.

    `each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once.
    """
    seldom = [odrive.make_state(axis, odrive.IDLE), odrive.make_clear_errors(axis),
              odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH), odrive.make_estop(axis),
              odrive.make_version_query(axis)]
    if axis.endstop_endpoint:
        seldom.append(odrive.make_endstop_query(axis))
    by_host, by_device = (kinds_of(odrive.ids_sent_by(axis, node), False) for node in ("Host", "Axis"))
    return Rules((allow(odrive.make_torque(axis, 0.0), each_tick), *allow_seldom(seldom)), by_host, by_device,
                 {(odrive.frame_id(axis, "Heartbeat"), False, False): PULSE_NS})


def make_node(axis: odrive.OdriveAxis, motor: AttachedMotor) -> OdriveNode:
    settings = replace(SETTINGS.get(motor.name, OdriveSettings()), watchdog_ms=motor.watchdog_ms)
    return OdriveNode(axis, motor.name, motor.plant, settings, motor.endstop if axis.endstop_endpoint else None)


ODRIVE = MotorFamily(
    driver="odrive", axis=OdriveConfig, example=OdriveConfig(4, 1, 0), dbc=DBC / "odrive.dbc", is_commanded=True,
    make_motors=lambda axes: tuple(map(OdriveMotor, axes)), make_rules=make_rules,
    errors=lambda axis, motor: odrive.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == odrive.CLOSED_LOOP, questions=questions, examine=examine,
    make_node=make_node)
