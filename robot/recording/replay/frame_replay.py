"""Replay from the wires: raw CAN frames through the codecs, and kept images through vision, once more into Inputs.

What no frame and no image says is taken as it was recorded: button presses, that a wire was lost, and sightings whose
image was not kept (a session keeps the one behind each shot).
"""

import itertools
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from truearc.errors import InputError, check_file, naming
from truearc.hw.devices.family import Encoder
from truearc.hw.protocols import CameraFrame, Frame, LinkLost
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config
from truearc.robot.hood_encoders import encoder_family_of
from truearc.robot.reasons import BAD_FRAME, CAN_LOST
from truearc.robot.recording.candump import parse_candump
from truearc.robot.recording.files import load_image, load_pictures
from truearc.robot.recording.rows import RowFormat
from truearc.robot.recording.session import CAN, INDEX
from truearc.robot.rig import HardwareRig, ReplayRig
from truearc.robot.types import Command, Inputs, Sent, Sighting
from truearc.robot.vision import find_target
from truearc.robot.vision_source import NoEyes


class Recomputed(Struct):
    """How much of the inputs came from the wires again."""

    frames: int = 0                   # parsed again
    seen: int = 0                     # sightings seen again in their image
    taken: int = 0                    # sightings taken as recorded: their image was not kept
    missing: int = 0                  # images that the session names but that are not there, or broken; or their index
    ended: str = ""                   # why not every tick was recomputed


class LoggedBus:
    """truearc.hw.protocols.Bus that reads can0.log, as many frames a tick as were read then; what is written to it
    goes nowhere."""

    def __init__(self, path: Path, done: Recomputed) -> None:
        self._path, self._done = path, done
        self._frames = self._read()
        self._count = 0
        self._lost: Reason | None = None

    def turn(self, inputs: Inputs) -> None:
        """Go to the tick that had `inputs`."""
        self._count = inputs.frames
        self._lost = next((fault for fault in inputs.faults if fault.code == CAN_LOST.name), None)

    def read(self) -> list[Frame]:
        if self._lost is not None:
            raise LinkLost(self._lost)            # that it was lost is taken as it was recorded
        frames = list(itertools.islice(self._frames, self._count))
        self._done.frames += len(frames)
        if len(frames) < self._count:
            self._done.ended = f"{self._path}: ends before the ticks do"
        return frames

    def write(self, frame: Frame) -> bool:
        return True

    def faults(self) -> list[Reason]:
        return []

    def _read(self) -> Iterator[Frame]:
        check_file(self._path)
        with naming(self._path):
            file = self._path.open(encoding="ascii", errors="replace", newline="\n")
        with file:
            for number, line in enumerate(file, 1):
                parsed = parse_candump(line)
                if parsed is None and line.endswith("\n"):
                    raise InputError(f"{self._path}:{number}: not a line of this log")
                if parsed is not None and not parsed[1]:
                    yield parsed[0]


class FramesRig:
    """A ReplayRig whose inputs are recomputed by HardwareRig from the recorded frames and images."""

    def __init__(self, ticks: ReplayRig, config: Config, session: Path, rows: RowFormat, done: Recomputed) -> None:
        self.done = done
        self.done.missing += not (session / INDEX).exists()
        self._ticks, self._config, self._session, self._rows = ticks, config, session, rows
        self._bus = LoggedBus(session / CAN, self.done)
        self._clock = _RecordedClock()
        self._is_wired = encoder_family_of(config.hood_encoder).make_off_bus is None
        self._rig = HardwareRig(config, self._bus, _NoBox(), NoEyes(), self._clock, lambda: False,
                                None if self._is_wired else Encoder())
        self._pictures = {picture.t_ns: picture for picture in load_pictures(session)}

    def read(self) -> Inputs | None:
        recorded = self._ticks.read()
        if recorded is None:
            return None
        self._clock.t_ns = recorded.t_ns
        self._bus.turn(recorded)
        parsed = self._rig.read()
        if parsed is None or self.done.ended:
            return None
        return replace(recorded, flywheels=parsed.flywheels, hood_motor=parsed.hood_motor, feeder=parsed.feeder,
                       hood_angle=parsed.hood_angle if self._is_wired else recorded.hood_angle,
                       sighting=self._see(recorded.sighting), faults=self._faults(recorded.faults, parsed.faults))

    def write(self, command: Command) -> Sent:
        """Return what was sent then; drivers get the command, since some of their faults depend on it."""
        self._rig.write(command)
        return self._ticks.write(command)

    def picture(self) -> CameraFrame | None:
        return None

    def _see(self, sighting: Sighting | None) -> Sighting | None:
        if sighting is None:
            return None
        picture = self._pictures.get(sighting.t_ns)
        image = None if picture is None else load_image(self._session, picture)
        self.done.seen += image is not None
        self.done.taken += image is None
        self.done.missing += picture is not None and image is None
        return sighting if image is None else find_target(image, self._config)

    def _faults(self, recorded: tuple[Reason, ...], parsed: tuple[Reason, ...]) -> tuple[Reason, ...]:
        """Faults that the frames show now, with the other recorded ones."""
        again, was = (tuple(fault for fault in faults if fault.code == BAD_FRAME.name or "motor" in fault.params)
                      for faults in (parsed, recorded))
        if self._rows.recorded(again) == was:
            return recorded
        return again + tuple(fault for fault in recorded if fault not in was)


class _RecordedClock:
    def __init__(self) -> None:
        self.t_ns = 0

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None: ...


class _NoBox:
    def read(self) -> bytes:
        return b""

    def close(self) -> None: ...
