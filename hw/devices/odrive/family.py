"""ODrive as a MotorFamily."""

from msgspec.structs import replace

from truearc.hw.codec import DBC
from truearc.hw.devices.axis import Axis
from truearc.hw.devices.family import AttachedMotor, MotorFamily
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.bus_rules import make_rules
from truearc.hw.devices.odrive.doctor import examine, questions
from truearc.hw.devices.odrive.emulator import SETTINGS, OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.motor import OdriveMotor


class OdriveConfig(odrive.OdriveAxis, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="odrive"):
    """An ODrive, given torques."""

    endstop_endpoint: int             # SDO endpoint that reads the limit switch; 0 = none


def make_node(axis: odrive.OdriveAxis, motor: AttachedMotor) -> OdriveNode:
    settings = replace(SETTINGS.get(motor.name, OdriveSettings()), watchdog_ms=motor.watchdog_ms,
                       is_absolute=motor.is_absolute)
    return OdriveNode(axis, motor.name, motor.plant, settings, motor.endstop if axis.endstop_endpoint else None)


ODRIVE = MotorFamily(
    driver="odrive", axis=OdriveConfig, example=OdriveConfig(4, 1, 0), dbc=DBC / "odrive.dbc", is_commanded=True,
    make_motors=lambda axes: tuple(map(OdriveMotor, axes)), make_rules=make_rules,
    errors=lambda axis, motor: odrive.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == odrive.CLOSED_LOOP, questions=questions, examine=examine,
    make_node=make_node)
