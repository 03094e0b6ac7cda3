"""The robot side of a run: the robot's code, and the faults injected on its side of the wires.

The faults concern the bus, clocks, disks and the gate's model, and vision and the recorder as separate processes.
"""

import errno
import os
import resource
import shutil
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import can
import cv2
import msgspec

from benchmarks.matrix.camera import Scenery, SteppedCamera, open_camera
from benchmarks.matrix.fault import Breaking, Camera, Disk, Model, Motion, Process, Time, Wire
from benchmarks.matrix.motion import ToldEyes
from benchmarks.matrix.run import Span
from truearc.cli.run_processes import CLOSE_S, RecorderProcess, make_see
from truearc.hw.fault_codes import CAN_ADAPTER_ERROR
from truearc.hw.protocols import NS_PER_S, Bus, Clock, LinkLost, Stream
from truearc.hw.protocols import Camera as CameraLink
from truearc.hw.real.can_bus import ROOM, WAIT_S, CanBus, SupervisedBus, open_can
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.processes import Capacity, Child, Line, Slots, make_shared
from truearc.hw.real.wires import MendedCamera, MendedStream, open_serial
from truearc.robot.config.schema import Config
from truearc.robot.eyes import Eyes, FarEyes, InlineEyes, make_room, watch
from truearc.robot.gate import Gate, Rating
from truearc.robot.motors import guard
from truearc.robot.recording.files import TappedBus
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import Keeper, SessionWriter
from truearc.robot.rig import HardwareRig, RecordingRig
from truearc.robot.runtime import Lateness, RobotIo, TimedRig, WatchedRig, run
from truearc.robot.types import Command, Sent

SMALL_ROOM = 64                       # frames that may wait for the tick, where an overrun is wanted


class AdvisedRig:
    """Passes everything through, and lets another controller know what is asked."""

    def __init__(self, rig: RobotIo, span: Span) -> None:
        self._rig, self._span = rig, span

    def __getattr__(self, name: str) -> Any:
        return getattr(self._rig, name)

    def write(self, command: Command) -> Sent:
        self._span.advise(command.flywheel_torque_nm, command.hood_torque_nm, command.feeder_torque_nm)
        return self._rig.write(command)


class RobotSide(msgspec.Struct):
    """Facts of a run that the robot's side reports beside its recording."""

    tally: dict[str, int]
    answers: list[Rating | None] | None           # what the gate said, if there was one
    failed: str = ""                              # why the recording is not whole


def run_robot(config: Config, breaking: Breaking, bus: tuple[str, str], box_port: str, folder: Path, span: Span,
              clock: Clock, stepped: bool, hurry: Callable[[], None] = lambda: None) -> None:
    """Run until the span is over, and leave `folder`/session and robot.json.

    On a stepped clock nothing needs threads of its own: the bus is read by the tick, and is not supervised.
    """
    tally: Counter[str] = Counter()
    clock = StallingClock(clock, span, breaking in (Time("late ticks"), Wire("overrun")))
    gate = BrokenGate(breaking.what, span.stands, clock) if isinstance(breaking, Model) else None
    with ExitStack() as wires, standing_wall(breaking, span):
        beside = Beside(config, folder, wires) if isinstance(breaking, Process) and breaking.who in (
            "vision", "recorder") else None
        hurry()                                   # as on the robot: vision and recorder have no real time
        wire, box = _open(config, breaking, bus, box_port, span, clock, stepped, tally, wires)
        eyes = beside.open_eyes(clock) if beside else _open_eyes(config, breaking, span, clock, stepped, wires)
        recorder = SessionWriter(folder / "session", make_header(config, None, None), config, None, lossless=stepped,
                                 open_keeper=beside.open_keeper if beside else None)
        wires.callback(recorder.close)
        if isinstance(breaking, Disk):
            wires.callback(break_disk(recorder, breaking.what, span))

        lateness = Lateness(recorder.keep_lateness, NS_PER_S // config.tick_hz)
        rig = HardwareRig(config, TappedBus(wire, recorder.tap), box, eyes, clock,
                          lambda: span.over_ns > 0 or recorder.is_over())
        wires.callback(rig.release)
        kept = RecordingRig(TimedRig(rig, lateness), recorder.trouble)
        run(WatchedRig(AdvisedRig(kept, span), config, lambda words: None), config, gate, recorder)
    side = RobotSide(dict(tally), None if gate is None else gate.answers, str(recorder.failed or ""))
    (folder / "robot.json").write_bytes(msgspec.json.encode(side))


def _open(config: Config, breaking: Breaking, bus: tuple[str, str], box_port: str, span: Span, clock: Clock,
          stepped: bool, tally: Counter[str], wires: ExitStack) -> tuple[Bus, Stream]:
    what = breaking.what if isinstance(breaking, Wire) else ""

    def open_flaky() -> CanBus:
        if what == "adapter out" and span.stands():
            raise LinkLost(CAN_ADAPTER_ERROR(bus="CAN", detail="no such device"))
        return FlakyBus.over(open_can(*bus, config.can.bitrate, clock, WAIT_S, tally), what, span)

    wire: CanBus | SupervisedBus = open_can(*bus, config.can.bitrate, clock, 0.0, tally) if stepped else SupervisedBus(
        open_flaky, clock, tally, SMALL_ROOM if what == "overrun" else ROOM)
    if stepped:
        FlakyBus.over(wire, what, span)
    wires.callback(wire.close)
    box = MendedStream(lambda: open_serial(box_port, config.buttons.baud))
    wires.callback(box.close)
    return guard(wire, config, clock, tally), box


def _open_eyes(config: Config, breaking: Breaking, span: Span, clock: Clock, stepped: bool, wires: ExitStack) -> Eyes:
    if isinstance(breaking, Motion):
        return ToldEyes(clock, lambda: breaking.what == "no target" and span.stands())
    scenery = Scenery(config, breaking.what if isinstance(breaking, Camera) else "", span.stands)
    fps = config.camera.fps
    camera: CameraLink = SteppedCamera(scenery, fps, clock) if stepped else MendedCamera(
        lambda: open_camera(scenery, fps, clock))
    wires.callback(camera.close)
    return InlineEyes(camera, make_see(config))


class Beside:
    """Both processes; their numbers are in `folder`/vision.pid and recorder.pid, for who wants to stop or kill them."""

    def __init__(self, config: Config, folder: Path, wires: ExitStack) -> None:
        room = make_room(config.camera.width_px, config.camera.height_px)
        memory = make_shared(room.bytes)
        self._folder, self._sightings = folder, Slots(memory, room)
        self._vision = Child("vision", look, (config, memory, room), restarts=True, mortal=True)
        wires.callback(self._vision.close, CLOSE_S)
        self._recorder = RecorderProcess(wires)

    def open_eyes(self, clock: Clock) -> FarEyes:
        self._vision.wait()
        self._tell("vision", self._vision)
        return FarEyes(self._sightings, lambda: self._vision.trouble, clock)

    def open_keeper(self, folder: Path, contents: Mapping[str, bytes]) -> Keeper:
        keeper = self._recorder.open_keeper(folder, contents)
        self._tell("recorder", self._recorder.child)
        return keeper

    def _tell(self, name: str, child: Child) -> None:
        (self._folder / f"{name}.pid").write_text(str(child.pid))


def look(line: Line, is_first: bool, config: Config, memory: object, room: Capacity) -> None:
    """The vision process."""
    cv2.setNumThreads(1)
    clock = MonotonicClock()
    camera = open_camera(Scenery(config, "", lambda: False), config.camera.fps, clock)
    line.say(None)
    watch(camera, make_see(config), Slots(memory, room), clock, line.is_over)
    camera.close()


HOUR_S = 3600.0


class FlakyBus:
    """A python-can bus whose transmit queue is full, or that is gone, while the span stands."""

    def __init__(self, bus: Any, what: str, span: Span) -> None:
        self._bus, self._what, self._span = bus, what, span

    @staticmethod
    def over(bus: CanBus, what: str, span: Span) -> CanBus:
        """`bus`, with a flaky one underneath where one is wanted."""
        if what in ("queue full", "adapter out"):
            bus._bus = FlakyBus(bus._bus, what, span)
        return bus

    def recv(self, wait_s: float) -> can.Message | None:
        self._look()
        return self._bus.recv(wait_s)

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self._look()
        if self._what == "queue full" and self._span.stands():
            raise can.CanOperationError("Transmit buffer full", errno.ENOBUFS)
        self._bus.send(message, timeout)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def _look(self) -> None:
        if self._what == "adapter out" and self._span.stands():
            raise can.CanOperationError("no such device", errno.ENODEV)


class StallingClock:
    """A clock on which one sleep takes until the span is over: nothing else of the process stands still."""

    def __init__(self, clock: Clock, span: Span, stalls: bool) -> None:
        self._clock, self._span, self._stalls = clock, span, stalls

    def now_ns(self) -> int:
        return self._clock.now_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        self._clock.sleep_until_ns(t_ns)
        while self._stalls and self._span.stands():
            self._clock.sleep_until_ns(self._clock.now_ns() + 2_000_000)


@contextmanager
def standing_wall(breaking: Breaking, span: Span) -> Iterator[None]:
    """The process reads another time of day while the span stands; the machine's own clock is left alone."""
    jump_s = {"clock +1 h": HOUR_S, "clock -1 h": -HOUR_S}.get(breaking.what if isinstance(breaking, Time) else "", 0.0)
    true = time.time
    if jump_s:
        time.time = lambda: true() + (jump_s if span.stands() else 0.0)
    try:
        yield
    finally:
        time.time = true


DISK_MB, LOOK_S = 48, 0.005


def mount_small_disk(folder: Path) -> bool:
    """A disk of its own at `folder`, where this user may have one; ENOSPC is real there."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "truearc-small-disk", str(folder)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def unmount(folder: Path) -> None:
    """Files on the small disk stay."""
    kept = folder.with_name(folder.name + "-kept")
    shutil.copytree(folder, kept, symlinks=True)
    subprocess.run(["umount", "-l", str(folder)], capture_output=True, check=False)
    shutil.copytree(kept, folder, symlinks=True, dirs_exist_ok=True)
    shutil.rmtree(kept)


def break_disk(recorder: SessionWriter, what: str, span: Span) -> Callable[[], None]:
    """Break it as long as the span stands; what ends that for good is returned."""
    if what in ("hangs", "turns read-only"):
        files = recorder._keeper._files
        for appender in (files._telemetry, files._can, files._trials, files._index):
            appender._file = _BadFile(appender._file, what, span)
        return lambda: None
    over = threading.Event()
    work = {"full": _fill, "loses a folder": _lose}[what]
    thread = threading.Thread(target=_wait_and, args=(work, recorder.folder, span, over), daemon=True)
    thread.start()

    def end() -> None:
        over.set()
        thread.join()
    return end


class _BadFile:
    """An open file that hangs or refuses."""

    def __init__(self, file: Any, what: str, span: Span) -> None:
        self._file, self._what, self._span = file, what, span
        self._wait = threading.Event()

    def write(self, data: bytes) -> int:
        while self._what == "hangs" and self._span.stands():
            self._wait.wait(LOOK_S)
        if self._what == "turns read-only" and self._span.stands():
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return int(self._file.write(data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def _wait_and(work: Callable[[Path, bool], None], folder: Path, span: Span, over: threading.Event) -> None:
    while not span.stands():
        if over.wait(LOOK_S):
            return
    work(folder, True)
    while span.stands() and not over.wait(LOOK_S):
        pass
    work(folder, False)


def _fill(folder: Path, begins: bool) -> None:
    """A real ENOSPC where the disk is small; else no file of this process may grow (EFBIG)."""
    ballast = folder.parent / "ballast"
    if os.path.ismount(folder.parent):
        if not begins:
            ballast.unlink()
            return
        with ballast.open("wb", buffering=0) as file:
            for size in (1 << 20, 1 << 12, 1):
                try:
                    while True:
                        file.write(bytes(size))
                except OSError:
                    continue
        return
    largest = max(path.stat().st_size for path in folder.iterdir()) if begins else resource.RLIM_INFINITY
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 if begins else largest, resource.RLIM_INFINITY))


def _lose(folder: Path, begins: bool) -> None:
    here, there = folder / "frames", folder / "frames-away"
    (here if begins else there).rename(there if begins else here)


SLOW_NS = 300_000_000
GOOD = Rating(0.9, 0.8, True, 0.2)
RATINGS = {"no number": Rating(None, None, False), "not a number": Rating(0.9, float("nan"), True, 0.2), "outside":
           Rating(0.9, 0.8, False, 0.2), "novel": Rating(0.9, 0.8, False, 3.0), "doubts": Rating(0.9, 0.1, True, 0.2)}


class BrokenGate(Gate):
    """A gate that agrees until the fault begins. `answers` keeps what it said: None where it raised."""

    def __init__(self, what: str, stands: Callable[[], bool], clock: Clock) -> None:
        self.answers: list[Rating | None] = []
        self.sha256 = "0" * 64
        self._what, self._stands, self._clock = what, stands, clock

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        if not self._stands():
            self.answers.append(GOOD)
        elif self._what == "raises":
            self.answers.append(None)
            raise RuntimeError("the model has broken")
        else:
            if self._what == "slow":
                self._clock.sleep_until_ns(self._clock.now_ns() + SLOW_NS)
            self.answers.append(RATINGS.get(self._what, GOOD))
        return self.answers[-1] or GOOD


class AnswersAgain(Gate):
    """For replay: what the gate of a run had said, in order."""

    def __init__(self, answers: list[Rating | None]) -> None:
        self._answers = iter(answers)

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        answer = next(self._answers)
        if answer is None:
            raise RuntimeError("the model had broken")
        return answer
