"""The button box's far end and pyserial's near end, over a real pseudo-terminal and a real socket."""

import os

import pytest

from truearc.hw.devices.button_box import BUTTONS, BoxHeartbeat, ButtonBox, make_press, open_button_box, parse_lines
from truearc.hw.emulated.serial_link import PtyCable, SocketCable
from truearc.hw.protocols import ButtonEvent, LinkLost
from truearc.hw.real.wires import open_serial

S = 1_000_000_000


def hear(stream, t_ns: int = 0):
    events, rest, faults = parse_lines(b"", stream.read(), t_ns)
    assert not rest and not faults
    return events


@pytest.fixture
def box():
    box = open_button_box()
    yield box
    box.unplug()


def test_presses_are_there_at_the_very_next_read(box) -> None:
    stream = open_serial(box.port, 115200)
    for seq in range(1, 501):                              # kernel delivery is asynchronous: once is no proof
        button = BUTTONS[seq % len(BUTTONS)]
        box.press(button)
        assert hear(stream) == [ButtonEvent(0, seq, button)]
    assert stream.read() == b""
    stream.close()


def test_heartbeats_keep_time_and_tell_the_newest_press(box) -> None:
    stream = open_serial(box.port, 115200)
    heard = []
    for tick in range(401):                                # 0 to 2 s in steps of 5 ms
        box.step(tick * S // 200)
        if tick == 150:
            box.press("fire")
        heard += hear(stream, tick * S // 200)
    assert [event for event in heard if isinstance(event, BoxHeartbeat)] == [
        BoxHeartbeat(0, 0),
        BoxHeartbeat(S // 2, 0),
        BoxHeartbeat(S, 1),
        BoxHeartbeat(3 * S // 2, 1),
        BoxHeartbeat(2 * S, 1),
    ]
    stream.close()


def test_missed_heartbeats_are_skipped_not_burst(box) -> None:
    stream = open_serial(box.port, 115200)
    box.step(0)
    box.step(10 * S)
    box.step(10 * S + 1)
    assert hear(stream) == [BoxHeartbeat(0, 0), BoxHeartbeat(0, 0)]
    stream.close()


def test_the_line_carries_every_byte_and_blocks_nobody(box) -> None:
    cable = PtyCable()
    stream = open_serial(cable.port, 115200)
    cable.write(bytes(range(256)))
    assert stream.read() == bytes(range(256))
    stream.close()
    cable.close()
    cable = PtyCable()
    box = ButtonBox(cable)
    for _ in range(1000):
        box.press("three")
    box.unplug()


def test_a_second_reader_is_refused_and_an_unplugged_box_a_lost_link(box) -> None:
    stream = open_serial(box.port, 115200)
    with pytest.raises(LinkLost, match=box.port):
        open_serial(box.port, 115200)
    stream.close()
    stream = open_serial(box.port, 115200)
    box.press("arm")
    box.unplug()
    box.press("fire")                                      # into the air
    for _ in range(2):
        with pytest.raises(LinkLost, match=box.port):
            stream.read()
    stream.close()


@pytest.mark.parametrize("port", ["/dev/nosuchport", "socket://127.0.0.1:1", "nosuchscheme://x"])
def test_what_cannot_be_opened_is_named(port: str) -> None:
    with pytest.raises(LinkLost, match=port):
        open_serial(port, 115200)


def test_the_same_box_on_a_socket() -> None:
    box = ButtonBox(SocketCable())
    stream = open_serial(box.port, 115200)
    assert stream.read() == b""
    box.press("two")
    received = b""
    while not received.endswith(b"\n"):
        received += stream.read()
    assert received == make_press(1, "two")
    box.unplug()
    with pytest.raises(LinkLost, match="socket://"):
        while True:
            stream.read()
    stream.close()


def test_a_system_without_pseudo_terminals_gets_a_socket(monkeypatch) -> None:
    def refuse() -> tuple[int, int]:
        raise OSError("out of pty devices")

    monkeypatch.setattr(os, "openpty", refuse)
    box = open_button_box()
    assert box.port.startswith("socket://127.0.0.1:")
    box.unplug()
