"""The devices' end of the bus in a run, whichever bus it is, and what can be wrong with that."""

import fcntl
import os
import random
import socket
import struct
from pathlib import Path

import can

from benchmarks.matrix.spark_troubles import stray_frames
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.emulated.pty_cable import PtyCable
from truearc.hw.emulated.serial_link import SlcanAdapter
from truearc.hw.protocols import Clock, Frame, LinkLost
from truearc.hw.real.can_bus import open_can

MS = 1_000_000
BITRATE = 1_000_000
BUS_OFF_ID = 0x40                     # of linux/can/error.h
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
DEAD = ("adapter out", "bus off", "silent")
OURS = OdriveAxis(1, 1)


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
        for frame in stray_frames(self._what):
            self._say(frame)
        self._chatter()

    def _chatter(self) -> None:
        match self._what:
            case "another host commands":
                self._say(odrive.make_torque(OURS, 0.0))
            case "another host stops":
                self._say(odrive.make_estop(OURS))
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
