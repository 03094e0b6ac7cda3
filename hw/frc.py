"""Frames that say a competition's robot controller has the say on this bus. No IO.

Ids are 29 bits: device type, manufacturer, API, device number. A REV SPARK that has once heard the controller's
heartbeat obeys no other until its power is taken away (REV's CAN specification, STATUS_0's PRIMARY_HEARTBEAT_LOCK).
"""

from truearc.hw.devices.spark import frames as spark
from truearc.hw.protocols import BadFrame, Frame, MotorReading

CONTROLLER_HEARTBEAT = 0x01011840
DEVICES = 0x3F


def is_controller_heartbeat(frame: Frame) -> bool:
    """Whether a robot controller (roboRIO, Systemcore) says here that it is alive."""
    return frame.is_extended and frame.arbitration_id == CONTROLLER_HEARTBEAT


def locked_spark(frame: Frame) -> int | None:
    """The number of the SPARK that says here that it is locked to a robot controller; None for any other frame."""
    device = spark.SparkAxis(frame.arbitration_id & DEVICES, 1, False)
    if not frame.is_extended or frame.arbitration_id != spark.frame_id(device, "STATUS_0"):
        return None
    try:
        reading = spark.parse(device, frame, MotorReading())
    except BadFrame:
        return None
    return device.device if reading.axis_error & spark.LOCKED else None
