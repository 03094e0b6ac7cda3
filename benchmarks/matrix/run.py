"""What all processes of a run share: times in a mapped file, the launcher, and the frames that are needed to fire."""

import contextlib
import mmap
import os
import struct
import sys
from collections.abc import Iterator
from functools import partialmethod
from pathlib import Path

from msgspec.structs import replace

from truearc.hw.codec import load_codec
from truearc.hw.devices import canandmag
from truearc.hw.devices.family import Axis
from truearc.hw.devices.odrive.family import OdriveConfig
from truearc.hw.devices.registry import AdvisoryConfig
from truearc.hw.devices.spark.family import SparkConfig
from truearc.robot.config.schema import Axes, Config

WORDS = struct.Struct("<qqqq")
ADVICE = struct.Struct("<?ddd")


class Span:
    """Numbers in a file that every process of a run maps. Times are the run's clock's; 0: not yet.

    begin_ns, end_ns: of the fault. rearm_ns: when the driver armed again after it. over_ns: when all that was to be
    seen had been seen, and the robot is to end.
    """

    begin_ns, end_ns, rearm_ns, over_ns = (
        property(lambda self, at=at: int(struct.unpack_from("<q", self._words, at)[0])) for at in range(0, 32, 8))

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(WORDS.size + ADVICE.size))
        with path.open("r+b") as file:
            self._words = mmap.mmap(file.fileno(), WORDS.size + ADVICE.size)

    begin, end, rearm, finish = (
        partialmethod(lambda self, at, t_ns: struct.pack_into("<q", self._words, at, t_ns), at)
        for at in range(0, 32, 8))

    def stands(self) -> bool:
        return self.begin_ns > 0 and self.end_ns == 0

    def advise(self, *torques_nm: float) -> None:
        """Torques that the robot commands: flywheels, hood and feeder."""
        ADVICE.pack_into(self._words, WORDS.size, True, *torques_nm)

    def advice(self) -> tuple[float, float, float]:
        return ADVICE.unpack_from(self._words, WORDS.size)[1:]

    @property
    def is_advised(self) -> bool:
        """Whether the robot has said anything yet; on the bus one that only advises never does."""
        return bool(ADVICE.unpack_from(self._words, WORDS.size)[0])


WHEEL = SparkConfig(device=11, direction=1, has_endstop=False, stall_torque_nm=2.6, free_speed_rad_s=594.0,
                    rated_v=12.0)
SPARKS = Axes((WHEEL, replace(WHEEL, device=12, direction=-1)), replace(WHEEL, device=3, has_endstop=True),
              replace(WHEEL, device=14, stall_torque_nm=0.7, free_speed_rad_s=1000.0))


def with_launcher(config: Config, launcher: str) -> Config:
    """`config` with the axes of "odrive", "spark" (also with a feed as long as the shipped one's) or "advisory"."""
    match launcher:
        case "spark":
            return replace(config, axes=SPARKS)
        case "spark, long feed":
            return replace(config, axes=SPARKS, feeder=replace(config.feeder, feed_s=0.25, clear_s=0.35))
        case "advisory":
            theirs = Axes(tuple(_heard(axis) for axis in (WHEEL, SPARKS.flywheels[1])), _heard(SPARKS.hood),
                          _heard(SPARKS.feeder))
            return replace(config, axes=theirs, hood_encoder=replace(config.hood_encoder, period_ms=0))
    return config


def _heard(axis: SparkConfig) -> AdvisoryConfig:
    return AdvisoryConfig("spark", axis.device, axis.direction, axis.has_endstop)


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


def hurry() -> None:
    """Before others of this machine, threads that are started from now on too; not where that is refused."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))


@contextlib.contextmanager
def in_a_hurry() -> Iterator[None]:
    """The same for a while, in a process that has other things to do afterwards and should not keep others from it."""
    if sys.platform != "linux":
        yield
        return
    before, param = os.sched_getscheduler(0), os.sched_getparam(0)
    hurry()
    try:
        yield
    finally:
        os.sched_setscheduler(0, before, param)
