"""Words and images between two who never wait for each other: newest first, whole or not at all."""

import multiprocessing
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.real.processes import Capacity, Slots, make_shared

ROOM = Capacity(3, 100, 4 * 5 * 3)


def pair():
    memory = bytearray(ROOM.bytes)
    return Slots(memory, ROOM), Slots(memory, ROOM), memory


def image(value):
    return np.full((4, 5, 3), value, np.uint8)


def test_only_the_newest_is_read_and_once():
    writer, reader, _ = pair()
    assert reader.read() is None and reader.image() is None
    for number in range(10):
        writer.put(b"%d" % number, image(number))
    assert reader.read() == b"9" and (reader.image() == 9).all()
    assert reader.read() is None and (reader.image() == 9).all()          # still there to be asked for


def test_an_image_that_was_written_over_is_none_and_never_another():
    writer, reader, _ = pair()
    writer.put(b"first", image(1))
    assert reader.read() == b"first"
    for number in range(2, 5):
        assert (reader.image() == 1).all()
        writer.put(b"later", image(number))
    assert reader.image() is None
    assert reader.read() == b"later" and (reader.image() == 4).all()
    writer.put(b"no image")
    assert reader.read() == b"no image" and reader.image() is None


def test_who_takes_over_goes_on_counting():
    writer, reader, memory = pair()
    writer.put(b"one")
    assert reader.read() == b"one"
    Slots(memory, ROOM).put(b"two")
    assert reader.read() == b"two"


@pytest.mark.parametrize(("text", "picture"), [(b"x" * 101, None), (b"", np.zeros((5, 5, 3), np.uint8))])
def test_what_has_no_room_is_refused_and_leaves_what_was_there(text, picture):
    writer, reader, _ = pair()
    writer.put(b"small")
    with pytest.raises(ValueError, match="there is room for"):
        writer.put(text, picture)
    assert reader.read() == b"small"


@given(at=st.integers(16, ROOM.bytes - 1), to=st.integers(0, 255))
def test_a_byte_that_is_not_there_yet_is_noticed(at, to):
    writer, reader, memory = pair()
    writer.put(b"all of it", image(7))
    before, memory[at] = memory[at], to
    text, picture = reader.read(), reader.image()
    assert text in (None, b"all of it") and (picture is None or (picture == 7).all())
    if text is None:
        memory[at] = before
        assert reader.read() == b"all of it"


BIG = Capacity(2, 64, 200 * 300 * 3)


def hammer(memory, count):
    slots = Slots(memory, BIG)
    for number in range(count):
        slots.put(struct.pack("<q", number) * 8, np.full((200, 300, 3), number % 251, np.uint8))


def test_what_another_process_writes_meanwhile_is_never_torn():
    memory = make_shared(BIG.bytes)
    reader = Slots(memory, BIG)
    writer = multiprocessing.get_context("spawn").Process(target=hammer, args=(memory, 20_000))
    writer.start()
    texts = images = 0
    while writer.is_alive():
        text = reader.read()
        if text is not None:
            number = struct.unpack("<q", text[:8])[0]
            assert text == struct.pack("<q", number) * 8
            texts += 1
            picture = reader.image()
            if picture is not None:
                assert (picture == number % 251).all()
                images += 1
    writer.join()
    assert writer.exitcode == 0 and texts > 10 and images > 0


def test_a_beat_is_heard():
    writer, reader, _ = pair()
    assert reader.beaten_ns() == 0
    writer.beat(123)
    assert reader.beaten_ns() == 123
