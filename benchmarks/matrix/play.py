"""One run of one fault on one bus: in stepped time in this process, or in real time in separate processes."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

from msgspec.structs import replace

from benchmarks.matrix.broken import BrokenBox, FarWire
from benchmarks.matrix.devices import FarSide
from benchmarks.matrix.fault import DISARMS, REARM, Breaking, Disk, Key, Model, Motion, Process, Row, Time
from benchmarks.matrix.keys import play_keys
from benchmarks.matrix.motion import MotionSide, make_motion_config
from benchmarks.matrix.robot_side import mount_small_disk, run_robot, unmount
from benchmarks.matrix.run import Span, hurry, in_a_hurry, with_launcher
from truearc.cli.common import SHIPPED
from truearc.hw.emulated.nodes import StepClock
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import Config, Prescribed, load_config
from truearc.sim.world.emulated_robot import keep_time

AIM = Prescribed(distance_m=4.0, motor_ratio=0.3, hood_deg=20.0)
WATCHDOG_MS = 200                     # in real time: a machine that is shared may stall for longer than a robot's
SPARE_NS = 100_000_000                # a process goes on this much after the fault is said to be over
LIMIT_S = 90.0
MS = 1_000_000


class Place(NamedTuple):
    """Where one run happens, for each of its processes; all of it can be handed to a new one."""

    row: Row
    bus: tuple[str, str]              # interface, channel: as the robot opens it
    folder: Path
    stepped: bool

    @property
    def config(self) -> Config:
        return make_config(self.row)

    @property
    def arms(self) -> int:
        if self.row.after not in (REARM, DISARMS):
            return 0
        # a robot that starts again is not armed
        return 1 if self.row.after == DISARMS or ends_robot(self.row.breaking) else 2


def ends_robot(breaking: Breaking) -> bool:
    """Whether the robot has to be started again: with its recorder nothing is left to record."""
    return breaking in (Process("control", "kill"), Process("recorder", "kill"))


def make_config(row: Row) -> Config:
    """The row's launcher at one set point, with a ball every 0.2 s, so that whoever wrongly fires is seen to."""
    if isinstance(row.breaking, Motion):
        return make_motion_config(row, row.breaking)
    config = load_config(SHIPPED)
    config = replace(config, collect=replace(config.collect, repeats=1 << 30, prescribed=(AIM,)),
                     feeder=replace(config.feeder, feed_s=0.05, clear_s=0.1), camera=replace(config.camera, fps=10.0),
                     gate=replace(config.gate, policy="model" if isinstance(row.breaking, Model) else "collect"))
    return with_launcher(config, row.launcher)


def play(row: Row, bus: str, folder: Path, stepped: bool) -> None:
    """Leave in `folder` what the judge wants.

    stepped: in stepped time, at which a host of any speed keeps up; on a virtual bus or SocketCAN's."""
    folder.mkdir(parents=True)
    channel = {"virtual": f"matrix-{folder.name}", "slcan": str(folder / "adapter"), "socketcan": "vcan0"}[bus]
    place = Place(row, (bus, channel), folder, stepped)
    if isinstance(row.breaking, Key):
        play_keys(row, row.breaking, folder)
    elif stepped:
        _play_stepped(place)
    else:
        small = row.breaking == Disk("full") and mount_small_disk(folder)
        try:
            _play_real(place)
        finally:
            if small:
                unmount(folder)


# --- in stepped time

def _play_stepped(place: Place) -> None:
    row, span = place.row, Span(place.folder / "span")
    clock = StepClock(lambda t_ns: world.advance(t_ns))
    world = _SteppedWorld(place, span, clock.now_ns)
    breaking = Time("late ticks") if row.breaking == Process("control", "stop") else row.breaking
    try:
        run_robot(place.config, breaking, place.bus, world.box.port, place.folder, span, clock, True)
    finally:
        world.close()


class _SteppedWorld:
    """The devices, which may stand still or be replaced where in real time their process would."""

    def __init__(self, place: Place, span: Span, now_ns: Callable[[], int]) -> None:
        self.box = BrokenBox(place.folder / "box", prompt=True)
        self._place, self._span, self._now_ns = place, span, now_ns
        self._wire = FarWire(*place.bus, SimpleNamespace(now_ns=now_ns))
        self._make = partial(_make_far_side, place, self._wire, self.box, span, now_ns)
        self._far = self._make()
        self._stood_ns = 0                        # how long it has stood still in all
        self._at_ns = 0

    def advance(self, t_ns: int) -> None:
        breaking, lasts_ns = self._place.row.breaking, round(self._place.row.lasts_s * 1e9)
        if isinstance(breaking, Process) and breaking.who == "devices" and self._span.stands():
            if t_ns - self._span.begin_ns < lasts_ns:
                return
            self._stood_ns = t_ns - self._at_ns
            self._span.end(t_ns)
            if breaking.signal == "kill":
                self._far.save(self._place.folder / "devices-killed.json")
                self.box.restart()
                self._far = self._make()
                self._stood_ns = t_ns
        self._at_ns = t_ns
        self._far.advance(t_ns - self._stood_ns)

    def close(self) -> None:
        self._far.save(self._place.folder / "devices.json")
        self._wire.close()
        self.box.close()


def _make_far_side(place: Place, wire: FarWire, box: BrokenBox, span: Span,
                   now_ns: Callable[[], int]) -> FarSide | MotionSide:
    if isinstance(place.row.breaking, Motion):
        return MotionSide(place.config, place.row, wire, box, span, now_ns)
    parts = place.config, place.row, place.arms, wire, box, span, now_ns
    return FarSide(*parts) if place.stepped else FarSide(*parts, WATCHDOG_MS)


# --- in real time

def _play_real(place: Place) -> None:
    span = Span(place.folder / "span")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["benchmarks.matrix.play"])
    if place.bus[0] == "virtual":
        both = context.Process(target=_be_both, args=(place,))
        both.start()
        if isinstance(place.row.breaking, Process):
            _signal(place, place.row.breaking, span, both, both, context)
        _wait_for(both)
        return
    far = context.Process(target=_be_devices, args=(place,))
    far.start()
    _wait_until(lambda: (place.folder / "ready").exists())
    near = context.Process(target=_be_robot, args=(place, place.folder))
    near.start()
    if isinstance(place.row.breaking, Process):
        far, near = _signal(place, place.row.breaking, span, far, near, context)
    _wait_for(near)
    _wait_for(far)


def _signal(place: Place, breaking: Process, span: Span, far: BaseProcess, near: BaseProcess,
            context: multiprocessing.context.ForkServerContext) -> tuple[BaseProcess, BaseProcess]:
    """Stop or kill one of the two when it is time, and put that right; the processes there are then."""
    clock = MonotonicClock()
    victim = far if breaking.who == "devices" else near
    with in_a_hurry():                           # not to come too late, where both others do
        _wait_until(lambda: span.begin_ns > 0 or span.over_ns > 0)
        pid_file = place.folder / f"{breaking.who}.pid"
        pid = int(pid_file.read_text()) if pid_file.exists() else victim.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP if breaking.signal == "stop" else signal.SIGKILL)
        clock.sleep_until_ns(clock.now_ns() + round(place.row.lasts_s * 1e9) + SPARE_NS)
        if breaking.signal == "stop":
            os.kill(pid, signal.SIGCONT)
        elif breaking.who != "vision":
            victim.join()                         # a robot without its recorder ends by itself
        if breaking.who == "devices":
            span.end(clock.now_ns())
    if breaking.signal == "kill" and breaking.who == "devices":
        far = context.Process(target=_be_devices, args=(place,))
        far.start()
    elif breaking.signal == "kill" and breaking.who != "vision":
        again = place.folder / "again"
        again.mkdir()
        near = context.Process(target=_be_robot, args=(place, again))
        near.start()
    return far, near


def _be_both(place: Place) -> None:
    devices = threading.Thread(target=_be_devices, args=(place,), daemon=True)
    devices.start()
    _wait_until(lambda: (place.folder / "ready").exists())
    _be_robot(place, place.folder)
    devices.join()


def _be_devices(place: Place) -> None:
    """Until the span is over."""
    hurry()
    span, clock = Span(place.folder / "span"), MonotonicClock()
    box = BrokenBox(place.folder / "box", prompt=False)
    wire = FarWire(*place.bus, clock)
    far = _make_far_side(place, wire, box, span, clock.now_ns)
    (place.folder / "ready").touch()
    keep_time(clock, far.advance, lambda: far.over)
    far.save(place.folder / "devices.json")
    wire.close()
    box.close()


def _be_robot(place: Place, folder: Path) -> None:
    span = Span(place.folder / "span")
    try:
        run_robot(place.config, place.row.breaking, place.bus, str(place.folder / "box"), folder, span,
                  MonotonicClock(), False, hurry)
    finally:
        if not ends_robot(place.row.breaking) or folder != place.folder:
            span.finish(span.over_ns or MonotonicClock().now_ns())      # whatever it was, the devices need not go on


def _wait_until(true: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(int(LIMIT_S / 0.002)):
        if true():
            return
        pause.wait(0.002)
    raise TimeoutError("it never came")


def _wait_for(process: BaseProcess) -> None:
    process.join(LIMIT_S)
    if process.is_alive():
        process.kill()
        process.join()
