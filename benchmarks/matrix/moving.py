"""The emulated robot's world and devices with something wrong in them, and what is true meanwhile, step by step."""

import math
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.matrix.ages import frame_id, is_odrive
from truearc.hw.codec import load_codec
from truearc.hw.devices.canandmag.frames import frame_id as encoder_id
from truearc.hw.emulated.nodes import MotorTruth, Node
from truearc.hw.protocols import Frame
from truearc.robot.config.schema import Config
from truearc.sim.world.emulated_robot import make_nodes
from truearc.sim.world.options import Options
from truearc.sim.world.parts.belt import Belt
from truearc.sim.world.parts.hood import COULOMB_NM, Hood
from truearc.sim.world.world import World

STEP_NS = 1_000_000                   # the plant is looked at this often
START_DEG = 22.0                      # where the hood is found, unless a row says otherwise
STIFF_NM = 0.03                       # beside its own 0.02: twice and a half of what the configuration knows
NAMES = ("flywheel_a", "flywheel_b", "hood")
COLUMNS = ("t_s", "asked_a_nm", "asked_b_nm", "asked_hood_nm", "wheel_rad_s", "hood_deg", "screw_rad_s")
PAIR = struct.Struct("<ff")
COUNTS = 16384                        # of the hood encoder, per turn
PATTERN = (1, 0, 0, 1)                # 1: lost. Half of all frames, never more than two of one kind after each other
GAP_S, GAP_EVERY_S = 0.07, 0.5
LOSSES = ("half the frames lost", "gaps of 70 ms")
STICTION_NM = {"wheels": 0.1, "hood": 0.03}   # to break away, one and a half to two and a half times the friction
SLIP = 0.1
STUTTER_S, STUTTER_GAP_S = 1.2, 0.25  # readings stop this often, for so long
NO_WATCHDOG = 0                       # a release is a command; a watchdog would hide that none came


class SickHood(Hood):
    """`trouble`: "" or one of "hood jams", "hood is stiff", "hood backwards", "hood comes loose", "stiction"."""

    trouble = ""

    def step(self, torque_nm: float, dt_s: float) -> None:
        if self.trouble == "hood jams" or (self.trouble == "stiction" and self.speed_rad_s == 0.0
                                           and abs(torque_nm) <= STICTION_NM["hood"]):
            self.speed_rad_s = 0.0
        elif self.trouble == "hood comes loose":      # the motor turns, the screw does not
            before_rad, elevation_deg = self._screw_rad, self.elevation_deg
            super().step(torque_nm, dt_s)
            self._start_rad -= self._screw_rad - before_rad
            self._screw_rad, self.elevation_deg = before_rad, elevation_deg
        else:
            super().step(self._felt_nm(torque_nm), dt_s)

    def _felt_nm(self, torque_nm: float) -> float:
        if self.trouble == "hood backwards":
            return -torque_nm
        if self.trouble != "hood is stiff":
            return torque_nm
        if self.speed_rad_s:
            return torque_nm - math.copysign(STIFF_NM, self.speed_rad_s)
        return 0.0 if abs(torque_nm) <= STIFF_NM + COULOMB_NM else torque_nm - math.copysign(STIFF_NM, torque_nm)


class SickBelt(Belt):
    """`trouble`: "" or one of "wheels jam", "wheels backwards", "wheels have no power", "stiction"."""

    trouble = ""

    def step(self, torque_nm: float, dt_s: float) -> None:
        if self.trouble == "wheels jam" or (self.trouble == "stiction" and self.speed_rad_s == 0.0
                                            and abs(torque_nm) <= STICTION_NM["wheels"]):
            self.speed_rad_s = 0.0
            return
        super().step(torque_nm * {"wheels backwards": -1.0, "wheels have no power": 0.0}.get(self.trouble, 1.0), dt_s)


class MovingWorld(World):
    """The world, in steps of at most a millisecond, each of which leaves a line of COLUMNS."""

    def __init__(self, seed: int, options: Options | None = None, start_deg: float = START_DEG) -> None:
        super().__init__(seed, options)
        options = options or Options()
        self.belt: SickBelt = SickBelt(options)
        self.hood: SickHood = SickHood(start_deg, options)
        self.lines: list[tuple[float, ...]] = []
        self.trouble = ""

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        while self._t_ns < t_ns:
            super().advance(min(t_ns, self._t_ns + STEP_NS), self._felt_nm(torque_nm))
            self.lines.append((self._t_ns * 1e-9, *(torque_nm.get(name, 0.0) for name in self.motors[:3]),
                               self.belt.speed_rad_s, self.hood.elevation_deg, self.hood.speed_rad_s))

    def motor(self, name: str) -> MotorTruth:
        truth = super().motor(name)
        if self.trouble != "motor 2 slips" or name != "flywheel_b":
            return truth
        return truth._replace(position_rad=(1.0 - SLIP) * truth.position_rad,
                              velocity_rad_s=(1.0 - SLIP) * truth.velocity_rad_s)

    def _felt_nm(self, torque_nm: Mapping[str, float]) -> Mapping[str, float]:
        if self.trouble != "motor 2 backwards":
            return torque_nm
        return {**torque_nm, "flywheel_b": -torque_nm.get("flywheel_b", 0.0)}

    def hood_at_limit(self) -> bool:
        return self.trouble != "switch dead" and super().hood_at_limit()

    def suffer(self, trouble: str) -> None:
        """From now on something of SickHood or SickBelt is wrong, "switch dead", "motor 2 backwards" or
        "motor 2 slips"; "" ends it."""
        self.trouble = self.hood.trouble = self.belt.trouble = trouble

    def log(self) -> npt.NDArray[np.float64]:
        return np.array(self.lines, dtype=np.float64).reshape(-1, len(COLUMNS))


class SickNode:
    """A node whose frames may say something else or get lost, and that may be deaf to commands of its torque."""

    def __init__(self, node: Node, reading_id: int, velocity_first: bool) -> None:
        """`reading_id`: of the frame with its reading. `velocity_first`: the order of that one's two floats."""
        self.node, self.motor = node, node.motor
        self.true_ns = 0                          # when a true reading last left it
        self.deaf_to = -1                         # an id
        self._reading_id, self._velocity_first = reading_id, velocity_first
        self._what, self._since_ns = "", 0
        self._first: Frame | None = None          # reading since something has been wrong
        self._counts: dict[int, int] = {}

    def suffer(self, what: str, t_ns: int) -> None:
        """From now on this is wrong with its frames: one of LOSSES, "stutters", or of change_reading; "" ends it."""
        self._what, self._since_ns, self._first = what, t_ns, None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self.node.ids()

    def due_ns(self) -> int:
        return self.node.due_ns()

    def torque_nm(self) -> float:
        return self.node.torque_nm()

    def restart(self, t_ns: int) -> None:
        self.node.restart(t_ns)

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        return [] if frame.arbitration_id == self.deaf_to else self._spoil(self.node.receive(frame, t_ns), t_ns)

    def step(self, t_ns: int) -> list[Frame]:
        return self._spoil(self.node.step(t_ns), t_ns)

    def _spoil(self, frames: list[Frame], t_ns: int) -> list[Frame]:
        said = []
        for frame in frames:
            spoiled = self._spoil_one(frame, (t_ns - self._since_ns) * 1e-9) if self._what else frame
            if frame.arbitration_id == self._reading_id and spoiled is frame:
                self.true_ns = t_ns
            if spoiled is not None:
                said.append(spoiled)
        return said

    def _spoil_one(self, frame: Frame, since_s: float) -> Frame | None:
        if self._what == "half the frames lost":
            count = self._counts[frame.arbitration_id] = self._counts.get(frame.arbitration_id, 0) + 1
            return None if PATTERN[count % len(PATTERN)] else frame
        if self._what == "gaps of 70 ms":
            return None if since_s % GAP_EVERY_S < GAP_S else frame
        if frame.arbitration_id != self._reading_id:
            return frame
        if self._what == "stutters":
            return None if since_s % STUTTER_S < STUTTER_GAP_S else frame
        self._first = self._first or frame
        return change_reading(self._what, frame, self._first, self._velocity_first)


def change_reading(what: str, frame: Frame, first: Frame, velocity_first: bool) -> Frame | None:
    """What becomes of a reading; `first` is the first one since this has been wrong. ValueError: no such trouble."""
    match what:
        case "silent":
            return None
        case "frozen":
            return first._replace(t_ns=frame.t_ns)
        case "big-endian":
            return frame._replace(data=frame.data[3::-1] + frame.data[:3:-1])
        case "10 degrees off":
            codec = load_codec("canandmag")
            values = codec.parse("POSITION_OUTPUT", frame.data)
            values["absolute_rev"] = round((values["absolute_rev"] + 10.0 / 360.0) * COUNTS) % COUNTS / COUNTS
            return frame._replace(data=codec.make("POSITION_OUTPUT", values))
        case "angle reversed":
            codec = load_codec("canandmag")
            began, values = codec.parse("POSITION_OUTPUT", first.data), codec.parse("POSITION_OUTPUT", frame.data)
            turned_rev = 2.0 * began["absolute_rev"] - values["absolute_rev"]
            values["absolute_rev"] = round(turned_rev * COUNTS) % COUNTS / COUNTS
            return frame._replace(data=codec.make("POSITION_OUTPUT", values))
    start, (velocity, position) = (
        PAIR.unpack(data)[::1 if velocity_first else -1] for data in (first.data, frame.data))
    velocity, position = {
        "zero": (0.0, 0.0), "speed zero": (0.0, position), "reversed": (-velocity, 2.0 * start[1] - position),
        "not a number": (math.nan, position), "speed x 0.6": (0.6 * velocity, position),
        "half": (0.5 * velocity, position),
        "position x 0.6": (velocity, start[1] + 0.6 * (position - start[1]))}[what]
    return frame._replace(data=PAIR.pack(*(velocity, position)[::1 if velocity_first else -1]))


def make_sick_nodes(config: Config, world: MovingWorld) -> dict[str, Any]:
    """Every device of the configuration as a SickNode, with nothing wrong; watchdogs of motor drivers are off."""
    axes = (*config.axes.flywheels, config.axes.hood, config.axes.feeder)
    readings = [(frame_id(axis, "Get_Encoder_Estimates" if is_odrive(axis) else "STATUS_2"), not is_odrive(axis))
                for axis in axes]
    if config.hood_encoder.is_heard:
        readings.append((encoder_id(config.hood_encoder.device, "POSITION_OUTPUT"), False))
    nodes = make_nodes(config, world, NO_WATCHDOG)
    return {name: SickNode(node, *reading) for (name, node), reading in zip(nodes.items(), readings, strict=True)}


def torque_frame_id(config: Config, name: str) -> int:
    """Arbitration id of the frame that asks a motor for torque."""
    axis = (*config.axes.flywheels, config.axes.hood)[NAMES.index(name)]
    return frame_id(axis, "Set_Input_Torque" if is_odrive(axis) else "DUTY_CYCLE_SETPOINT")
