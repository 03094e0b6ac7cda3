"""Which frames firing needs, and how old the newest of each may be: restated here, apart from the verdict's code."""

from truearc.hw.codec import load_codec
from truearc.hw.devices.canandmag import frames as canandmag
from truearc.hw.devices.family import Axis
from truearc.hw.devices.odrive.family import OdriveConfig
from truearc.robot.config.schema import Config

AGE_S, BEAT_S, FAULTS_S = 0.1, 0.25, 1.0
ODRIVE = {"Get_Encoder_Estimates": AGE_S, "Heartbeat": BEAT_S}
SPARK = {"STATUS_2": AGE_S, "STATUS_0": BEAT_S, "STATUS_1": FAULTS_S}


def needed_frames(config: Config) -> dict[tuple[int, int], float]:
    """(arbitration id, length) of each such frame -> the age in s."""
    axes = (*config.axes.flywheels, config.axes.hood, config.axes.feeder)
    ages_s = {(frame_id(axis, message), 8): age_s for axis in axes
              for message, age_s in (ODRIVE if is_odrive(axis) else SPARK).items()}
    angle, status = canandmag.frame_ids(config.hood_encoder.device)
    return ages_s | {(angle, 6): AGE_S, (status, 8): BEAT_S}


def frame_id(axis: Axis, message: str) -> int:
    """Of one of the messages of an axis's device."""
    if isinstance(axis, OdriveConfig):
        return axis.node << 5 | load_codec("odrive").base_id(message)
    return load_codec("spark").base_id(message) + axis.device


def is_odrive(axis: Axis) -> bool:
    return isinstance(axis, OdriveConfig)
