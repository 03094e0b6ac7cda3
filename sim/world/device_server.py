"""The emulated devices alone, in real time, for a robot that runs in another process."""

import shlex
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from truearc.errors import InputError
from truearc.hw.devices.button_box import open_button_box
from truearc.hw.emulated.camera import EmulatedCamera, PictureServer, Stage
from truearc.hw.emulated.nodes import Twin, View
from truearc.hw.emulated.serial_link import SlcanAdapter, SocketCable, open_cable
from truearc.hw.protocols import Clock, Frame, LinkLost
from truearc.hw.real.can_bus import CanBus, open_can
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.overrides import split_bus
from truearc.robot.config.schema import CameraConfig, Config, Tape
from truearc.robot.recording.files import TappedBus
from truearc.sim.world.driver import make_driver
from truearc.sim.world.emulated_robot import Pace, check_emulated, make_nodes
from truearc.sim.world.emulated_vision import make_lens, make_tape
from truearc.sim.world.options import Options
from truearc.sim.world.parts.target import BallResult
from truearc.sim.world.world import World

STEP_NS = 2_000_000                   # the devices hear what came in, and the world goes on, this often


def serve(config: Config, config_path: Path, bus_name: str, watchdog_ms: int, trials: int, seed: int,
          options: Options | None, say: Callable[[str], None]) -> list[BallResult]:
    """Let a robot in another process shoot `trials` balls; returns the world's record of each. `say` gets its command.

    The driver begins when the robot is first heard on the bus. `watchdog_ms`: of the motor drivers.
    """
    check_emulated(config)
    world = World(seed, options)
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
        camera = CameraServer(config.camera, config.tape, seed, world.view)
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
    """The devices' end of the bus called `name`, and what the robot is to open; InputError when there is none.

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
    """Bring a world from 0 on with the clock, in steps, until `over`."""
    pace, t_ns = Pace(clock), 0
    while not over():
        t_ns += STEP_NS
        pace.wait_until(t_ns)
        advance(t_ns)


class CameraServer:
    """A camera whose pictures are drawn by a thread of its own, when one is due, and seen at `url`."""

    def __init__(self, camera: CameraConfig, tape: Tape, seed: int, look: Callable[[], View]) -> None:
        self._server = PictureServer()
        self.url = self._server.url
        self._look, self._stage = look, Stage(look())
        self._camera = EmulatedCamera(self._stage, make_lens(camera), make_tape(tape), seed)
        self._period_ns, self._due_ns = round(1e9 / camera.fps), 0
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
