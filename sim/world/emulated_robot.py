"""The emulated robot: the robot's own code at one end of every wire; devices, a world and a driver at the other end.

`emulate` runs both ends in one process on a stepped clock; `serve` runs the devices alone, in real time, for a robot in
another process. Camera and vision run in a process of their own, as on the robot: rendering and evaluating an image
takes longer than a tick and overlaps with the ticks until the image is due. Only the stepped clock determines the rig's
readings and their times, because the rig waits for a reading that is due.
"""

import contextlib
import itertools
import math
import pickle
import shlex
import subprocess
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import cv2
import numpy as np
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.hw.devices.button_box import ButtonBox, open_button_box
from truearc.hw.devices.family import AttachedMotor, Axis
from truearc.hw.devices.registry import family_of
from truearc.hw.emulated.camera import NOTHING, EmulatedCamera, Lens, PictureServer, Stage, TagCamera, TagSize, TapeSize
from truearc.hw.emulated.nodes import Node, Plant, StepClock, Stepper, Twin, View
from truearc.hw.emulated.serial_link import SlcanAdapter, SocketCable, open_cable
from truearc.hw.fault_codes import PROCESS_ENDED
from truearc.hw.protocols import CameraFrame, Clock, Frame, LinkLost
from truearc.hw.real.can_bus import CanBus, open_can
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.wires import open_serial
from truearc.robot.aim_file import NO_AIMS, Aims, load_aim_for, needs_aim
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import AimConfig, CameraConfig, Config, Tape, split_bus
from truearc.robot.eyes import Eyes
from truearc.robot.gate import load_gate_for
from truearc.robot.motors import guard, make_motors, name_axes
from truearc.robot.recording.files import TappedBus
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import HardwareRig, RecordingRig
from truearc.robot.runtime import Screen, run, with_screen
from truearc.robot.tick import step
from truearc.robot.types import Sighting
from truearc.robot.vision import find_target
from truearc.sim.printed import Progress
from truearc.sim.world.drive import FEEDER, FLYWHEEL, HOOD
from truearc.sim.world.field import TAPE_M, BallResult
from truearc.sim.world.options import Options, with_ball
from truearc.sim.world.world import World

if TYPE_CHECKING:
    from truearc.sim.world.filming import Filmer

LATENCY_NS = 45_000_000               # middle of the exposure until the robot can read the sighting
CLOSE_S = 2.0
KEPT = 4                              # pictures the process remembers


class TwinEyes:
    """truearc.robot.eyes.Eyes on an emulated world; the owner of the clock calls `step`."""

    def __init__(self, plant: Plant, config: Config, seed: int) -> None:
        # A new interpreter: forking one in which JAX runs threads may hang; spawning would run its main module again.
        self._process = subprocess.Popen([sys.executable, "-m", __name__], stdin=subprocess.PIPE,
                                         stdout=subprocess.PIPE)
        self._say((config, seed))
        self._plant = plant
        self._period_ns = round(1e9 / config.camera.fps)
        self._due_ns = self._now_ns = 0
        self._asked: deque[int] = deque()         # exposures whose sightings have not been read
        self._early: deque[Sighting] = deque()    # of those, sightings that had to be taken in before they were due
        self._read_ns = 0

    def step(self, t_ns: int) -> None:
        """Expose when an image is due."""
        self._now_ns = t_ns
        if t_ns < self._due_ns:
            return
        self._due_ns += ((t_ns - self._due_ns) // self._period_ns + 1) * self._period_ns
        self.expose(t_ns)

    def expose(self, t_ns: int) -> None:
        """Take an image now."""
        self._say((t_ns, self._plant.view()))
        self._asked.append(t_ns)

    def read(self) -> Sighting | None:
        newest = None
        while self._asked and self._asked[0] + LATENCY_NS <= self._now_ns:
            self._read_ns = self._asked.popleft()
            newest = self._early.popleft() if self._early else self._hear()
        return newest

    def picture(self) -> CameraFrame | None:
        while len(self._early) < len(self._asked):
            self._early.append(self._hear())
        self._say((self._read_ns, None))
        picture: CameraFrame | None = self._hear()
        return picture

    def close(self) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_S)
        self._process.kill()
        self._process.stdout.close()

    def _say(self, what: object) -> None:
        assert self._process.stdin is not None
        pickle.dump(what, self._process.stdin)
        self._process.stdin.flush()

    def _hear(self) -> Any:
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except EOFError as error:
            raise LinkLost(PROCESS_ENDED(process="vision")) from error


def look(ours: IO[bytes], theirs: IO[bytes]) -> None:
    """Run the process until its input ends: (time, view) -> sighting; (time, None) -> the picture of that time."""
    cv2.setNumThreads(1)
    stage = Stage(NOTHING)
    config, seed = pickle.load(ours)
    camera = make_camera(config, stage, seed)
    pictures: deque[CameraFrame] = deque(maxlen=KEPT)
    while True:
        try:
            t_ns, what = pickle.load(ours)
        except (EOFError, KeyboardInterrupt):
            return
        if what is None:
            answer: object = next((picture for picture in pictures if picture.t_ns == t_ns), None)
        else:
            stage.now = what
            pictures.append(camera.expose(t_ns))
            answer = find_target(pictures[-1], config)
        pickle.dump(answer, theirs)
        theirs.flush()


def make_lens(camera: CameraConfig) -> Lens:
    return Lens(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px,
                camera.distortion)


def make_camera(config: Config, stage: Stage, seed: int) -> EmulatedCamera:
    """Return the camera of an emulated world in which the mark that the configuration's camera looks for hangs."""
    if config.camera.target == "apriltag" and config.apriltag is not None:
        tag = TagSize(config.apriltag.ids[0], config.apriltag.side_m)
        return TagCamera(stage, make_lens(config.camera), tag, seed)
    return EmulatedCamera(stage, make_lens(config.camera), make_tape(config.tape), seed)


def make_world(config: Config, seed: int, options: Options | None = None) -> World:
    """Return a world with the configuration's target, if that faces up, and its ball; and with its AprilTag, if any."""
    target, tag, mark_m = config.rig.target, config.apriltag, TAPE_M
    if config.camera.target == "apriltag" and tag is not None:
        mark_m = -tag.behind_m, tag.centre_height_m
    if target is None or not target.faces_up:
        return World(seed, options, mark_m=mark_m)
    return World(seed, with_ball(options or Options(), config.rig), target=target, mark_m=mark_m)


def make_tape(tape: Tape) -> TapeSize:
    return TapeSize(tape.top_width_m, tape.bottom_width_m, tape.height_m, tape.tape_width_m)


if __name__ == "__main__":
    look(sys.stdin.buffer, sys.stdout.buffer)


LONGEST_TRIAL_S = 40.0                # a session that takes longer than this a trial is stuck, and ends
CORRECTION_STEP = 0.005               # of log speed per mark, where the configuration has no [aim]
WATCHDOG_MS = 100                     # of the motor drivers, where it can be set
FLYWHEELS = sum(name.startswith("flywheel") for name in World.motors)
CHANNELS = itertools.count()          # every twin in this process has a wire of its own
MakeNodes = Callable[[Config, World], dict[str, Node]]
MakeEyes = Callable[[World, Config, int], TwinEyes]
LATE_NS = 50_000_000                  # world time stands still where this machine did, rather than catch up
STEP_NS = 2_000_000                   # the devices hear what came in, and the world goes on, this often


def check_emulated(config: Config) -> Config:
    """Return a configuration that can be emulated; InputError names the key that prevents it, before anything is
    made."""
    make_motors(config)               # which refuses two axes that are one device
    if (count := len(config.axes.flywheels)) != FLYWHEELS:
        raise InputError(f"axes.flywheels: {count} motors; the emulated robot has {FLYWHEELS}, so state as many")
    return config


def make_nodes(config: Config, world: Plant, watchdog_ms: int = WATCHDOG_MS) -> dict[str, Node]:
    """Return every emulated device on the configuration's bus, by name ("flywheel_a", ..., "hood_encoder")."""
    nodes: dict[str, Node] = {name: make_axis_node(axis, name, world, watchdog_ms)
                              for name, (_, axis) in zip(World.motors, name_axes(config), strict=True)}
    encoder = config.hood_encoder
    node = encoder_family_of(encoder).make_node(encoder, world, nodes)
    return nodes if node is None else {**nodes, "hood_encoder": node}


def make_axis_node(axis: Axis, name: str, world: Plant, watchdog_ms: int) -> Node:
    """Return the device of one axis, with the world's motor `name` on it; an advisory one receives no commands."""
    motor = {"hood": HOOD, "feeder": FEEDER}.get(name, FLYWHEEL)
    attached = AttachedMotor(name, world, motor.kt_nm_a, motor.resistance_ohm, watchdog_ms,
                             world.hood_at_limit if name == "hood" else None)
    return family_of(axis).make_node(axis, attached)


def emulate(config: Config, folder: Path, trials: int, seed: int, options: Options | None = None,
            gate_path: Path | None = None, progress: Progress = lambda done, note: None,
            page: Screen | None = None, nodes_of: MakeNodes = make_nodes,
            eyes_of: MakeEyes = TwinEyes, aim_path: Path | None = None,
            clips: Path | None = None) -> list[BallResult]:
    """Record trials, as truearc.api.emulation.emulate describes; return the true result of each ball.

    `nodes_of` makes the emulated devices, `eyes_of` the camera. `clips`: folder for clips of the flights.
    """
    check_emulated(config)
    gate = None if gate_path is None else load_gate_for(gate_path, config.rig)
    if gate is not None:
        config = replace(config, gate=replace(config.gate, policy="model"))
    config, aims = _aimed(config, aim_path)
    recorder = SessionWriter(folder, make_header(config, gate, None, aims.get("")), config,
                             gate_path.read_bytes() if gate_path else None, lossless=True,
                             aim=aim_path.read_bytes() if aim_path else None)
    with closing(recorder):
        world, box = make_world(config, seed, options), open_button_box()
        driver = make_driver(config, world, box.press, trials, seed)
        filmer = None if clips is None else _film(world, clips, config, seed)
        pace = None if page is None else Pace(MonotonicClock())
        limit_ns = int(LONGEST_TRIAL_S * trials * 1e9)

        def over(now_ns: int) -> bool:
            if pace is not None:
                pace.wait_until(now_ns)
            progress(min(driver.trial / max(trials, 1), 0.99), f"{driver.trial} of {trials} trials")
            return driver.done or now_ns > limit_ns

        with closing(eyes_of(world, config, seed)) as eyes, emulated_rig(
                config, world, nodes_of(config, world), box, eyes,
                (driver.step, eyes.step, *(() if filmer is None else (filmer.step,))), recorder.tap, over) as (
                rig, clock):
            run(RecordingRig(rig, recorder.trouble), config, gate, with_screen(recorder, page),
                partial(step, aims=aims))
        if filmer is not None:
            filmer.close()
        progress(1.0, f"{len(world.results)} balls in {clock.now_ns() * 1e-9:.0f} s of robot time")
    if recorder.failed is not None:
        raise recorder.failed
    return world.results


def _film(world: World, clips: Path, config: Config, seed: int) -> "Filmer":
    from truearc.sim.world.filming import Filmer  # needs the extra `video`
    target = config.rig.target
    return (Filmer(world, clips, seed) if target is None else
            Filmer(world, clips, seed, goal_height_m=target.centre_height_m))


def _aimed(config: Config, aim_path: Path | None) -> tuple[Config, Aims]:
    if aim_path is None:
        if needs_aim(config):
            raise InputError("aim.policy is 'belief', so an aim file is needed (--aim)")
        return config, NO_AIMS
    aims = {"": load_aim_for(aim_path, config)}
    return (config if needs_aim(config) else replace(config, aim=AimConfig("belief", CORRECTION_STEP))), aims


@contextmanager
def emulated_rig(config: Config, world: World, nodes: Mapping[str, Node], box: ButtonBox, eyes: Eyes,
                 steppers: tuple[Stepper, ...], tap: Callable[[Frame, bool], None],
                 over: Callable[[int], bool]) -> Iterator[tuple[HardwareRig, StepClock]]:
    """Wire the robot's rig to emulated devices on a virtual bus; afterwards close all wires and unplug the button box.

    Args:
        nodes: The emulated devices by name; they see `world` only.
        steppers: Called at the end of each tick's time with the world's time in ns, in order, after the button box.
        tap: Called with every frame, and whether the robot sent it.
        over: Says before each tick, from the time in ns, whether there will be no more.
    """
    clock = StepClock(lambda t_ns: twin.advance(t_ns))
    channel = f"truearc-{next(CHANNELS)}"
    with ExitStack() as wires:
        wires.callback(box.unplug)
        near, far = (wires.enter_context(closing(open_can("virtual", channel, config.can.bitrate, clock)))
                     for _ in range(2))
        twin = Twin(world, far, tuple(nodes.values()), (box.step, *steppers))
        stream = wires.enter_context(closing(open_serial(box.port, config.buttons.baud)))
        bus = TappedBus(guard(near, config, clock, Counter()), tap)
        make = encoder_family_of(config.hood_encoder).make_off_bus
        encoder = None if make is None else make(config.hood_encoder, world)
        yield HardwareRig(config, bus, stream, eyes, clock, lambda: over(clock.now_ns()), encoder), clock


class Pace:
    """Real-time pacing; world time begins at 0 when this is made."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._began_ns = clock, clock.now_ns()

    def wait_until(self, t_ns: int) -> None:
        """Return when the world's time is `t_ns`, at once if that is past."""
        behind_ns = self._clock.now_ns() - (self._began_ns + t_ns)
        if behind_ns > LATE_NS:
            self._began_ns += behind_ns
        self._clock.sleep_until_ns(self._began_ns + t_ns)


def serve(config: Config, config_path: Path, bus_name: str, watchdog_ms: int, trials: int, seed: int,
          options: Options | None, say: Callable[[str], None]) -> list[BallResult]:
    """Let a robot in another process shoot `trials` balls; return the world's record of each. `say` gets its
    command.

    The driver begins when the robot is first heard on the bus. `watchdog_ms`: of the motor drivers.
    """
    check_emulated(config)
    world = make_world(config, seed, options)
    clock = MonotonicClock()
    heard = threading.Event()

    def listen(frame: Frame, sent: bool) -> None:
        if not sent:
            heard.set()

    with ExitStack() as wires:
        bus, channel = open_device_bus(bus_name, config, clock)
        wires.callback(bus.close)
        box = open_button_box(prompt=False)
        wires.callback(box.unplug)
        camera = CameraServer(config, seed, world.view)
        wires.callback(camera.close)
        driver = make_driver(config, world, box.press, trials, seed)

        def drive(t_ns: int) -> None:
            if heard.is_set():
                driver.step(t_ns)

        twin = Twin(world, TappedBus(bus, listen), tuple(make_nodes(config, world, watchdog_ms).values()),
                    (box.step, drive, camera.step))
        say(shlex.join(["truearc", "run", "--config", str(config_path), "--can", channel, "--buttons", box.port,
                        "--camera", camera.url]))
        keep_time(clock, twin.advance, lambda: driver.done)
    return world.results


def open_device_bus(name: str, config: Config, clock: Clock) -> tuple[CanBus | SlcanAdapter, str]:
    """Open the devices' end of the bus called `name`; also return what the robot must open. InputError if there is
    none.

    slcan:auto is an adapter on a pseudo-terminal, or on a socket where the system has none; slcan:socket always that.
    """
    interface, channel = split_bus(name, "--bus")
    if interface == "slcan" and channel in ("auto", "socket"):
        adapter = SlcanAdapter(open_cable(prompt=False) if channel == "auto" else SocketCable())
        return adapter, f"slcan:{adapter.port}"
    if interface != "socketcan":
        raise InputError(f"--bus {name}: one of virtual, slcan:auto, slcan:socket, socketcan:CHANNEL")
    try:
        return open_can(interface, channel, config.can.bitrate, clock), name
    except LinkLost as error:
        raise InputError(f"--bus {name}: {error}") from error


def keep_time(clock: Clock, advance: Callable[[int], None], over: Callable[[], bool]) -> None:
    """Advance a world from 0 with the clock, in steps, until `over`."""
    pace, t_ns = Pace(clock), 0
    while not over():
        t_ns += STEP_NS
        pace.wait_until(t_ns)
        advance(t_ns)


class CameraServer:
    """A camera whose pictures are drawn by a separate thread when due, and served at `url`."""

    def __init__(self, config: Config, seed: int, look: Callable[[], View]) -> None:
        self._server = PictureServer()
        self.url = self._server.url
        self._look, self._stage = look, Stage(look())
        self._camera = make_camera(config, self._stage, seed)
        self._period_ns, self._due_ns = round(1e9 / config.camera.fps), 0
        self._due, self._over = threading.Event(), False
        self._thread = threading.Thread(target=self._draw, name="camera", daemon=True)
        self._thread.start()

    def step(self, t_ns: int) -> None:
        """Expose when an image is due."""
        if t_ns >= self._due_ns:
            self._due_ns += ((t_ns - self._due_ns) // self._period_ns + 1) * self._period_ns
            self._stage.now = self._look()
            self._due.set()

    def close(self) -> None:
        self._over = True
        self._due.set()
        self._thread.join()
        self._server.close()

    def _draw(self) -> None:
        while self._due.wait() and not self._over:
            self._due.clear()
            self._server.show(self._camera.expose(0).image)


GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
SETTLE_S = 0.3                    # from standing still to pressing fire, and before arming
NOTICE_S = 0.4                    # from seeing where the ball went to pressing the button
BETWEEN_S = 0.2                   # from one press to the next
JAM_S = 10.0                      # a ball that has gone in and not come out is given up after this
REJECTED_SHARE = 0.02             # share of trials that the driver knows to be worthless
MAX_TRIALS_AT_A_STOP = 3
PLACES_M, PLACES_UP_M = (2.6, 8.0), (1.8, 4.5)    # from where balls reach an upright opening, and one that faces up


class Driver:
    """An emulated driver, who sees only the world, not the robot's state; call step() once a tick until `done`.

    Distances are a golden-ratio sequence over `distances` (metres, exit point to target plane), one to three trials at
    each stop, times `repeats`, so that a configuration is shot from one place; or, where `places` are given, each of
    them for one configuration. A shot that the robot has not granted after `patience_s` is given up; a ball that went
    in and has not come out is rejected.
    """

    def __init__(self, world: World, press: Callable[[str], None], trials: int, seed: int,
                 distances: tuple[float, float] = PLACES_M, patience_s: float = 8.5, repeats: int = 1,
                 places: Sequence[float] = (), jam_s: float = JAM_S, rejected_share: float = REJECTED_SHARE) -> None:
        self._world, self._press, self._trials = world, press, trials
        self._distances, self._places, self._repeats = distances, places, repeats
        self._patience_s, self._jam_s, self._rejected_share = patience_s, jam_s, rejected_share
        self._rng = np.random.default_rng([seed, 6])
        self._place = float(self._rng.uniform())
        self._left_here = 0
        self._wake_t_ns: int | None = None
        self._fired_t_ns = 0
        self._seen = 0
        self._went_in = False
        self._do: Callable[[int], None] = self._arm
        self.trial = 0                # trials begun
        self.done = trials <= 0

    def step(self, t_ns: int) -> None:
        """Do what a person would do at this moment, if anything."""
        if self.done:
            return
        if self._wake_t_ns is None:
            self._wait(t_ns, SETTLE_S, self._arm)
        if t_ns >= (self._wake_t_ns or 0):
            self._do(t_ns)

    def _wait(self, t_ns: int, seconds: float, then: Callable[[int], None]) -> None:
        self._wake_t_ns = t_ns + round(seconds * 1e9)
        self._do = then

    def _arm(self, t_ns: int) -> None:
        self._press("arm")
        self._wait(t_ns, BETWEEN_S, self._begin)

    def _begin(self, t_ns: int) -> None:
        if self.trial >= self._trials:
            self.done = True
            return
        self.trial += 1
        if self._left_here == 0:
            self._world.chassis.drive_to(self._next_place_m())
        self._left_here -= 1
        self._do = self._stop

    def _next_place_m(self) -> float:
        if self._places:
            self._left_here = self._repeats
            return self._places[(self.trial - 1) // self._repeats]
        self._left_here = self._repeats * int(self._rng.integers(1, MAX_TRIALS_AT_A_STOP + 1))
        self._place = (self._place + GOLDEN) % 1.0
        low_m, high_m = self._distances
        return low_m + (high_m - low_m) * self._place

    def _stop(self, t_ns: int) -> None:
        if not self._world.chassis.moving:
            self._wait(t_ns, SETTLE_S, self._fire)

    def _fire(self, t_ns: int) -> None:
        self._seen = len(self._world.results)
        self._fired_t_ns = t_ns
        self._went_in = False
        self._press("fire")
        self._do = self._watch

    def _watch(self, t_ns: int) -> None:
        if len(self._world.results) > self._seen:
            self._wait(t_ns, NOTICE_S, self._mark)
            return
        self._went_in = self._went_in or self._world.ball_on_its_way
        patience_s = self._patience_s + (self._jam_s if self._world.ball_on_its_way else 0.0)
        if t_ns - self._fired_t_ns > patience_s * 1e9:
            # unrejected, a ball that was thrown back would have the robot wait for its mark for ever
            self._do = self._reject if self._went_in else self._begin

    def _mark(self, t_ns: int) -> None:
        self._press(self._world.results[self._seen].outcome)
        self._wait(t_ns, BETWEEN_S, self._reject if self._rng.uniform() < self._rejected_share else self._begin)

    def _reject(self, t_ns: int) -> None:
        self._press("reject")
        self._wait(t_ns, BETWEEN_S, self._begin)


def make_driver(config: Config, world: World, press: Callable[[str], None], trials: int, seed: int) -> Driver:
    """Return a driver who shoots any prescribed configurations, and waits as long as the robot tries."""
    up = config.rig.target is not None and config.rig.target.faces_up
    return Driver(world, press, trials, seed, PLACES_UP_M if up else PLACES_M, config.gate.request_s + 0.5,
                  config.collect.repeats, [row.distance_m for row in config.collect.prescribed])
