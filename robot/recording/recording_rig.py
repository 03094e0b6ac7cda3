"""No shot is fired unless it is recorded."""

from collections.abc import Callable

from msgspec.structs import replace

from truearc.hw.readings import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot.reasons import NOT_RECORDING
from truearc.robot.runtime import RobotIo
from truearc.robot.types import Command, Inputs, Sent


class RecordingRig:
    """A rig whose inputs also say when the recording is in trouble; a fault like any other, so it is a HOLD.

    `trouble`: why what is recorded is not reaching the disk; None while it is.
    """

    def __init__(self, rig: RobotIo, trouble: Callable[[], Reason | None]) -> None:
        self._rig, self._trouble = rig, trouble

    def read(self) -> Inputs | None:
        inputs = self._rig.read()
        trouble = self._trouble()
        if inputs is None or trouble is None:
            return inputs
        return replace(inputs, faults=(*inputs.faults, NOT_RECORDING(cause=trouble)))

    def write(self, command: Command) -> Sent:
        return self._rig.write(command)

    def picture(self) -> CameraFrame | None:
        return self._rig.picture()
