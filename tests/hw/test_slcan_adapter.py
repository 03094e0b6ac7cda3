"""The emulated serial CAN adapter: its lines to the letter, and python-can's own slcan, in a process of its own."""

import json
import os
import subprocess
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.emulated import serial_link as slcan
from truearc.hw.protocols import Frame

frames = st.builds(
    lambda frame_id, data, is_extended, is_remote: Frame(0, frame_id if is_extended else frame_id & 0x7FF,
                                                         b"" if is_remote else data, is_extended, is_remote),
    st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.booleans(), st.booleans())


class Line:
    """A cable whose robot's end is two lists."""

    port = "line"

    def __init__(self) -> None:
        self.coming, self.said, self.broken = b"", b"", False

    def read(self) -> bytes:
        coming, self.coming = self.coming, b""
        return coming

    def write(self, data: bytes) -> bool:
        self.said += b"" if self.broken else data
        return not self.broken

    def close(self) -> None: ...


class Host:
    """Somebody at the robot's end."""

    def __init__(self) -> None:
        self.line = Line()
        self.adapter = slcan.SlcanAdapter(self.line)

    def ask(self, data: bytes) -> tuple[bytes, list[Frame]]:
        """What the adapter answers, and the frames that reach the bus."""
        self.line.coming, self.line.said = data, b""
        reached = self.adapter.read()
        return self.line.said, reached


@pytest.fixture
def host() -> Host:
    return Host()


@given(frames)
def test_every_frame_has_one_line(frame: Frame) -> None:
    line = slcan.make_line(frame)
    assert line.endswith(b"\r") and slcan.parse_line(line[:-1]) == frame == slcan.parse_line(line[:-1].lower().replace(
        line[:1].lower(), line[:1], 1))


@given(st.one_of(st.binary(max_size=40), st.from_regex(rb"[tTrR][0-9A-Fa-f]{0,30}", fullmatch=True)))
def test_a_line_that_is_none_is_refused_and_nothing_raises(line: bytes) -> None:
    frame = slcan.parse_line(line)
    assert frame is None or slcan.make_line(frame)[1:-1].upper() == line[1:].upper() or frame.is_remote


def test_known_lines() -> None:
    assert slcan.parse_line(b"t02E40000803F") == Frame(0, 0x2E, b"\x00\x00\x80\x3f")
    assert slcan.parse_line(b"T070E00C5101") == Frame(0, 0x070E00C5, b"\x01", True)
    assert slcan.parse_line(b"r0208") == Frame(0, 0x20, b"", is_remote=True)
    assert slcan.make_line(Frame(0, 0x020, b"", is_remote=True)) == b"r0200\r"


def test_a_session_of_commands_and_answers(host) -> None:
    assert host.ask(b"\r\r\r") == (b"\r\r\r", [])
    assert host.ask(b"V\rN\rF\r") == (slcan.VERSION + slcan.SERIAL + b"\a", [])        # no status while closed
    assert host.ask(b"C\r") == (b"\a", [])                                 # not open
    assert host.ask(b"t0210\r") == (b"\a", [])                             # nor is anything sent
    assert host.ask(b"S9\rS8\rO\r") == (b"\a\r\r", []) and host.adapter.bitrate == 1_000_000
    assert host.ask(b"O\rS6\rF\r") == (b"\a\aF00\r", [])                   # open already
    assert host.ask(b"t0210\rT0000002111") == (b"z\r", [Frame(0, 0x21, b"")])
    assert host.ask(b"0\r") == (b"Z\r", [Frame(0, 0x21, b"\x10", True)])   # a line in two halves
    assert host.ask(b"C\rL\rt0210\rq\r") == (b"\r\r\a\a", [])              # listens only
    assert host.ask(b"C\rs0014\r") == (b"\r\r", []) and host.adapter.bitrate is None


def test_a_line_without_end_is_thrown_away_with_a_bell(host) -> None:
    host.ask(b"O\r")
    assert host.ask(b"t" * (slcan.LONGEST + 1)) == (b"\a", [])
    assert host.ask(b"t0210\r") == (b"z\r", [Frame(0, 0x21, b"")])


def test_devices_are_heard_only_while_the_channel_is_open(host) -> None:
    frame = Frame(0, 0x29, b"\x01")
    assert host.adapter.write(frame) and host.line.said == b""
    host.ask(b"O\r")
    host.line.said = b""
    assert host.adapter.write(frame) and host.line.said == b"t029101\r"
    host.line.broken = True
    assert not host.adapter.write(frame)       # the host does not fetch: the twin counts it


HOST = """
import json, sys, can
bus = can.Bus(interface="slcan", channel=sys.argv[1], bitrate=500_000, sleep_after_open=0.0, timeout=0.05,
              ignore_config=True)
said = {"version": bus.get_version(20.0), "serial": bus.get_serial_number(20.0), "echoes": []}
for number in range(50):
    extended = number % 2 == 1
    bus.send(can.Message(arbitration_id=0x700 + number, is_extended_id=extended, data=[number] * (number % 9)))
    message = bus.recv(20.0)
    said["echoes"].append([message.arbitration_id, message.is_extended_id, bytes(message.data).hex()])
bus.send(can.Message(arbitration_id=0x20, is_extended_id=False, is_remote_frame=True, dlc=8))
said["remote"] = bus.recv(20.0).is_remote_frame
bus.shutdown()
print(json.dumps(said))
"""


@pytest.mark.parametrize("make_cable", [lambda: slcan.PtyCable(prompt=False), slcan.SocketCable], ids=["pty", "socket"])
def test_python_cans_own_slcan_in_another_process(make_cable) -> None:
    adapter = slcan.SlcanAdapter(make_cable())
    host = subprocess.Popen([sys.executable, "-c", HOST, adapter.port], stdout=subprocess.PIPE, text=True,
                            env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"})
    nap = threading.Event()
    was_open = False
    while host.poll() is None:                             # the devices: each frame comes back as it is
        for frame in adapter.read():
            adapter.write(frame)
        was_open |= adapter.is_open
        nap.wait(0.001)
    adapter.read()
    assert host.returncode == 0 and host.stdout is not None
    said = json.loads(host.stdout.read())
    host.stdout.close()
    assert said["version"] == [10, 13] and said["serial"] == "T254" and said["remote"]
    assert said["echoes"] == [[0x700 + n, n % 2 == 1, bytes([n] * (n % 9)).hex()] for n in range(50)]
    assert was_open and adapter.bitrate == 500_000
    adapter.close()
