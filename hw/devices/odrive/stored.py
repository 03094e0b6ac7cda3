"""Watchdog and limits that an ODrive axis keeps, by its firmware's own table of parameters, flat_endpoints.json."""

import math
import struct
from functools import partial

from truearc.hw.devices.axis import Bounds, current_limit_a, speed_limit_rad_s
from truearc.hw.devices.family import Endpoints, Heard, Stored, StoredSettings
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.doctor import LONGEST_S, SHORTEST_S, WATCHDOG_ON, WATCHDOG_S
from truearc.hw.protocols import BadFrame, MotorReading

SPEED, CURRENT = "axis0.controller.config.vel_limit", "axis0.config.motor.current_soft_max"
SAVE = "save_configuration"           # a function; the device restarts
GOOD_S = 0.1                          # of a watchdog: four times as long as the robot takes to feed it
NEAR = 0.01                           # a stored limit within this share is that of the rig: floats are rounded
RESTART_S = 3.0                       # until its frames are there again, with time to spare


def stored_settings(axis: odrive.OdriveAxis, bounds: Bounds, endpoints: Endpoints) -> StoredSettings:
    """The axis's watchdog, and limits where the rig knows them; KeyError names a parameter that the table lacks."""
    found = [_setting(axis, endpoints.ids[WATCHDOG_ON], WATCHDOG_ON, 1.0, 1.0, 1.0, "<?"),
             _setting(axis, endpoints.ids[WATCHDOG_S], WATCHDOG_S, GOOD_S, SHORTEST_S, LONGEST_S, "<f")]
    speed_rad_s, current_a = speed_limit_rad_s(bounds), current_limit_a(bounds, axis.torque_nm_a)
    for name, wanted in ((SPEED, None if speed_rad_s is None else speed_rad_s / math.tau), (CURRENT, current_a)):
        if wanted is not None:
            found.append(_setting(axis, endpoints.ids[name], name, wanted, wanted * (1.0 - NEAR),
                                  wanted * (1.0 + NEAR), "<f"))
    save = odrive.make_parameter_write(axis, endpoints.ids[SAVE], b"")
    return StoredSettings(tuple(found), (odrive.make_version_query(axis),), partial(_refuse, axis, endpoints), (save,),
                          RESTART_S)


def _setting(axis: odrive.OdriveAxis, number: int, name: str, wanted: float, low: float, high: float,
             form: str) -> Stored:
    def read(heard: Heard) -> float | None:
        value = None
        for frame in heard.of(odrive.frame_id(axis, "TxSdo")):
            try:
                answered, data = odrive.parse_parameter(axis, frame)
            except BadFrame:
                continue              # the doctor's other checks name it
            if answered == number:
                value = float(struct.unpack_from(form, data)[0])
        return value

    kind = bool if form == "<?" else float
    return Stored(name, wanted, low, high, odrive.make_parameter_query(axis, number),
                  odrive.make_parameter_write(axis, number, struct.pack(form, kind(wanted))), read)


def _refuse(axis: odrive.OdriveAxis, endpoints: Endpoints, heard: Heard) -> str:
    """Another firmware's table would write something else; a driven axis is in use."""
    versions = heard.of(odrive.frame_id(axis, "Get_Version"))
    try:
        firmware = ".".join(map(str, odrive.parse_version(axis, versions[-1]))) if versions else ""
    except BadFrame as error:
        return str(error)
    if firmware != endpoints.firmware:
        return (f"has firmware {firmware}, got a table of {endpoints.firmware}; expected that of its own firmware"
                if firmware else f"node {axis.node} does not answer")
    keys = [(odrive.frame_id(axis, "Heartbeat"), False)]
    reading, _ = heard.read(keys, partial(odrive.parse, axis), MotorReading())
    if reading.axis_state != odrive.IDLE:
        return f"is in state {reading.axis_state}, expected {odrive.IDLE}, idle: stop the robot first"
    return ""
