"""ODrive as a MotorFamily."""

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta
from msgspec.structs import replace

from truearc.hw.codec import DBC
from truearc.hw.devices.axis import Axis, Bounds, TorquePerAmp, current_limit_a, speed_limit_rad_s
from truearc.hw.devices.family import AttachedMotor, MotorFamily
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.bus_rules import make_rules
from truearc.hw.devices.odrive.doctor import examine, questions
from truearc.hw.devices.odrive.emulator import SETTINGS, OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.motor import OdriveMotor
from truearc.hw.devices.odrive.stored import stored_settings
from truearc.hw.protocols import Frame


class OdriveConfig(odrive.OdriveAxis, Axis, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                   tag_field="driver", tag="odrive"):
    """An ODrive, given torques."""

    endstop_endpoint: Annotated[int, Meta(ge=0, le=65535)]    # SDO endpoint that reads the limit switch; 0 = none
    torque_nm_a: TorquePerAmp = 0.0   # its torque_constant; 0: not known, its own limits stay as they are stored


def make_motors(axes: Sequence[OdriveConfig], bounds: Sequence[Bounds]) -> tuple[OdriveMotor, ...]:
    return tuple(OdriveMotor(axis, make_limits(axis, one)) for axis, one in zip(axes, bounds, strict=True))


def make_limits(axis: OdriveConfig, bounds: Bounds) -> Frame | None:
    """The device's own limits; None where one of them is not known, for the frame sets both."""
    speed_rad_s, current_a = speed_limit_rad_s(bounds), current_limit_a(bounds, axis.torque_nm_a)
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
