"""Faults injected at the device end: in the button box and its cable, on the wire, and inside a SPARK."""

import fcntl
import os
import random
import socket
import struct
from pathlib import Path
from typing import Any

import can

from truearc.hw.devices.button_box import ButtonBox
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkSettings
from truearc.hw.devices.spark.frames import CONTROLLER_HEARTBEAT
from truearc.hw.emulated.serial_link import Cable, PtyCable, SlcanAdapter, open_cable
from truearc.hw.protocols import Clock, Frame, LinkLost
from truearc.hw.real.can_bus import open_can

NOISE_NS = 20_000_000                 # between two lines of garbage, or two presses of a stuck button
NOISE = b"\x00\xffq$B,7,fi\xfe*3\n$B,8,fire*00\r\n"
MUTE = ("unplugged", "silent", "no power")
LOST = 3                              # presses


class CrookedCable:
    """A cable that may carry less than it is given, or more."""

    def __init__(self, cable: Cable) -> None:
        self.what = ""
        self._cable = cable

    def write(self, data: bytes) -> bool:
        if self.what in MUTE:
            return True
        lines = {"all twice": data + data, "half lines": data[:7]}
        return self._cable.write(lines.get(self.what, data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cable, name)


class BrokenBox:
    """A ButtonBox behind `port`, a link that leads to its cable. `prompt` as
    truearc.hw.emulated.serial_link.open_cable has it."""

    def __init__(self, link: Path, prompt: bool) -> None:
        self.port = str(link)
        self._link, self._prompt = link, prompt
        self._due_ns = self._stuck = 0
        self._plug_in()

    def press(self, button: str) -> None:
        self._box.press(button)
        if self._cable.what == "bounces":
            self._box.press(button)

    def step(self, t_ns: int) -> None:
        if self._cable.what == "unplugged":
            return
        self._box.step(t_ns)
        if t_ns >= self._due_ns:
            self._due_ns = t_ns + NOISE_NS
            if self._cable.what == "garbage":
                self._cable.write(NOISE)
            elif self._cable.what.startswith("stuck "):
                self._box.press(self._cable.what.removeprefix("stuck "))
                self._stuck += 1

    def begin(self, what: str) -> None:
        self._cable.what = "silent" if what == "loses presses" else what
        if what == "unplugged":
            self._link.unlink()
            self._box.unplug()
        elif what == "loses presses":
            for _ in range(LOST):
                self._box.press("two")
            self._cable.what = ""

    def end(self) -> None:
        what, self._cable.what = self._cable.what, ""
        if what == "unplugged":
            self._plug_in()
        elif what == "stuck arm" and self._stuck % 2:
            self._box.press("arm")                # the driver sees that the robot is disarmed
        elif what == "no power":
            self.restart()

    def restart(self) -> None:
        """Count from the start again."""
        self._box = ButtonBox(self._cable)

    def close(self) -> None:
        self._box.unplug()

    def _plug_in(self) -> None:
        self._cable = CrookedCable(open_cable(self._prompt))
        self._link.unlink(missing_ok=True)
        os.symlink(self._cable.port, self._link)
        self._box = ButtonBox(self._cable)


MS = 1_000_000
BITRATE = 1_000_000
BUS_OFF_ID = 0x40                     # of linux/can/error.h
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
DEAD = ("adapter out", "bus off", "silent")
OURS = OdriveAxis(1, 1)
TWIN = spark.SparkAxis(11, 1)             # of flywheel motor 1
STRAYS = {                            # what other hosts say every 20 ms; each of two SPARKs sends a STATUS_0 every 10
    "another host commands": (odrive.make_torque(OURS, 0.0),), "another host stops": (odrive.make_estop(OURS),),
    "two sparks with one id": tuple(Frame(0, spark.frame_id(TWIN, message), bytes(8), is_extended=True)
                                    for message in ("STATUS_0", "STATUS_0", "STATUS_2")),
    "another host's heartbeat": (spark.make_heartbeat(()),),
    "competition controller": (Frame(0, CONTROLLER_HEARTBEAT, bytes(8), is_extended=True),)}


class FarWire:
    """truearc.hw.protocols.Bus at the devices' end; `channel` is what the robot opens."""

    def __init__(self, bus: str, channel: str, clock: Clock) -> None:
        self.bus, self.channel = bus, channel
        self._what = ""
        self._due_ns = 0
        self._heard: list[Frame] = []             # of other hosts, which the devices hear, too
        self._random = random.Random(5)
        self._clock = clock
        self._open()

    def read(self) -> list[Frame]:
        """Frames that the robot and other hosts have sent."""
        heard, self._heard = self._heard, []
        if self._what == "adapter out":
            return []
        try:
            frames = self._wire.read()
        except LinkLost:                          # it hears of the bus-off, too
            frames = []
        return [] if self._what in DEAD else [*frames, *heard]

    def write(self, frame: Frame) -> bool:
        return True if self._what in DEAD else self._wire.write(frame)

    def faults(self) -> list[str]:
        return []

    def close(self) -> None:
        self._wire.close()

    def begin(self, what: str) -> None:
        self._what = what
        if what == "adapter out":
            self._pull_out()
        elif what == "bus off" and self.bus != "slcan":       # a serial adapter does not say
            self._say_bus_off()

    def end(self) -> None:
        what, self._what = self._what, ""
        if what == "adapter out":
            self._put_in()

    def chatter(self, t_ns: int) -> None:
        """What others say while the fault stands."""
        if t_ns < self._due_ns:
            return
        self._due_ns = t_ns + 20 * MS
        for frame in STRAYS.get(self._what, ()):
            self._say(frame)
        match self._what:
            case "two with one id":
                for command in (0x01, 0x09):
                    self._wire.write(Frame(0, OURS.node << 5 | command, bytes(8)))
            case "strangers":
                for _ in range(5):
                    self._wire.write(Frame(0, self._random.randrange(0x700, 0x7FF), self._random.randbytes(8)))
            case "questions":
                self._wire.write(Frame(0, 0x7A1, b"", is_remote=True))
            case "garbled":
                self._garble()

    def _say(self, frame: Frame) -> None:
        self._heard.append(frame)
        self._wire.write(frame)

    def _garble(self) -> None:
        if isinstance(self._wire, SlcanAdapter):
            self._cable.write(b"t0298zz11\rT07\r\xff\xfe\r")
        else:
            self._wire.write(Frame(0, self._random.randrange(0x800), self._random.randbytes(3)))

    def _open(self) -> None:
        if self.bus == "slcan":
            self._cable = PtyCable(prompt=False)
            link = Path(self.channel)
            link.unlink(missing_ok=True)
            os.symlink(self._cable.port, link)
            self._wire: SlcanAdapter | object = SlcanAdapter(self._cable)
        else:
            self._wire = open_can(self.bus, self.channel, BITRATE, self._clock)

    def _pull_out(self) -> None:
        if self.bus == "slcan":
            Path(self.channel).unlink()
            self._wire.close()
        elif self.bus == "socketcan":
            set_up(self.channel, False)

    def _put_in(self) -> None:
        if self.bus == "socketcan":
            set_up(self.channel, True)
            self._wire.close()
        if self.bus != "virtual":
            self._open()

    def _say_bus_off(self) -> None:
        with can.Bus(interface=self.bus, channel=self.channel, ignore_config=True) as controller:
            controller.send(can.Message(arbitration_id=BUS_OFF_ID, is_error_frame=True, is_extended_id=False,
                                        data=bytes(8)))


def set_up(interface: str, up: bool) -> None:
    """Bring a network interface up or down, as a plug does."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        name = interface.encode().ljust(16, b"\0")
        request = fcntl.ioctl(asker, SIOCGIFFLAGS, name + bytes(16))
        (flags,) = struct.unpack_from("<H", request, 16)
        flags = flags | IFF_UP if up else flags & ~IFF_UP
        fcntl.ioctl(asker, SIOCSIFFLAGS, name + struct.pack("<H", flags) + bytes(14))


FAULTS = {"sensor": 0x04, "too hot": 0x10, "gate driver": 0x20}
FIRMWARE = {"old firmware": (24, 0, 1), "new firmware": (27, 0, 0)}


def begin_trouble(node: Any, what: str, t_ns: int) -> None:
    """One of FAULTS or FIRMWARE, or "came and went", "settings lost", "locked", "switch closed", "switch open"."""
    if what in FAULTS:
        node.fail(FAULTS[what])
    elif what in FIRMWARE:
        node.settings = SparkSettings(node.settings.kt_nm_a, node.settings.resistance_ohm, FIRMWARE[what])
        node.restart(t_ns)
    elif what == "came and went":
        node.fail(FAULTS["gate driver"])
        node.fail(0)
    elif what == "settings lost":
        node.restart(t_ns)
    elif what == "locked":
        node.receive(Frame(0, CONTROLLER_HEARTBEAT, bytes(8), is_extended=True), t_ns)
    elif what in ("switch closed", "switch open"):
        said, node.endstop = node.endstop, lambda: what == "switch closed"
        node.endstop.switch = said


def end_trouble(node: Any, what: str, t_ns: int) -> None:
    """A lock wants its power cycled, other firmware is exchanged; what was lost in a reset is the robot's to set."""
    if what in FAULTS:
        node.fail(0)
    elif what in FIRMWARE:
        node.settings = SparkSettings(node.settings.kt_nm_a, node.settings.resistance_ohm)
        node.restart(t_ns)
    elif what == "locked":
        node.restart(t_ns)
    elif what in ("switch closed", "switch open"):
        node.endstop = node.endstop.switch
