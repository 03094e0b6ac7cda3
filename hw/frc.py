"""Frames that say a competition's robot controller has the say on this bus. No IO.

Ids are 29 bits: device type, manufacturer, API, device number. A REV SPARK that has once heard the controller's
heartbeat obeys no other until its power is taken away (REV's CAN specification, STATUS_0's PRIMARY_HEARTBEAT_LOCK).
"""

from hw.link import Frame

CONTROLLER_HEARTBEAT = 0x01011840
SPARK_STATUS_0 = 0x0205B800           # of device 0
DEVICES = 0x3F
LOCK_BIT = 53


def is_controller_heartbeat(frame: Frame) -> bool:
    """Whether a robot controller (roboRIO, Systemcore) says here that it is alive."""
    return frame.is_extended and frame.arbitration_id == CONTROLLER_HEARTBEAT


def locked_spark(frame: Frame) -> int | None:
    """The number of the SPARK that says here that it is locked to a robot controller; None for any other frame."""
    if not frame.is_extended or frame.arbitration_id & ~DEVICES != SPARK_STATUS_0 or len(frame.data) != 8:
        return None
    locked = int.from_bytes(frame.data, "little") >> LOCK_BIT & 1
    return frame.arbitration_id & DEVICES if locked else None
