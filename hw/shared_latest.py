"""The newest word and image of one process for another, in memory that both have: neither ever waits for the other."""

import struct
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import numpy.typing as npt

HEAD = 16                             # bytes: number of the newest, when its writer was last seen alive
SLOT = struct.Struct("<IqIIII")       # checksum of header and text, number, bytes of text; height, width, checksum
COLOURS = 3


class Capacity(NamedTuple):
    """How much there is room for. `places`: this number of words later an image is overwritten."""

    places: int
    text_bytes: int
    image_bytes: int = 0

    @property
    def slot_bytes(self) -> int:
        return SLOT.size + self.text_bytes + self.image_bytes

    @property
    def bytes(self) -> int:
        return HEAD + self.places * self.slot_bytes


class Slots:
    """A ring of slots with one writer and one reader, each with a Slots of its own on the same memory (whatever has a
    writable buffer).

    Checksums tell the reader what is not whole yet, or no longer: not every machine promises in what order another core
    sees writes. Memory is all zeros at first; a writer that takes another's place goes on where that one ended.
    """

    def __init__(self, memory: Any, room: Capacity) -> None:
        self._room = room
        self._memory = memoryview(memory).cast("B")
        self._head = self._memory[:HEAD].cast("q")
        self._read = 0

    def put(self, text: bytes, image: npt.NDArray[np.uint8] | None = None) -> None:
        """Say something, with an image of (height, width, 3) or none; ValueError when there is no room for it."""
        pixels = b"" if image is None else np.ascontiguousarray(image).reshape(-1).data
        if len(text) > self._room.text_bytes or len(pixels) > self._room.image_bytes:
            raise ValueError(f"{len(text)} and {len(pixels)} bytes where there is room for {self._room[1:]}")
        number = self._head[0] + 1
        height, width = (0, 0) if image is None else image.shape[:2]
        rest = SLOT.pack(0, number, len(text), height, width, crc32(pixels))[4:] + text
        at, images = self._places(number)
        self._memory[at:at + 4 + len(rest)] = struct.pack("<I", crc32(rest)) + rest
        self._memory[images:images + len(pixels)] = pixels
        self._head[0] = number

    def read(self) -> bytes | None:
        """The newest word, once; None when there is nothing new."""
        number = self._head[0]
        if number == self._read:
            return None
        text = self._text(number)
        if text is not None:
            self._read = number
        return text

    def image(self) -> npt.NDArray[np.uint8] | None:
        """A copy of the image that came with the word read last; None when it had none, or has been overwritten."""
        at, images = self._places(self._read)
        _, _, _, height, width, checksum = SLOT.unpack_from(self._memory, at)
        size = height * width * COLOURS
        if not size or size > self._room.image_bytes:
            return None
        pixels = np.frombuffer(self._memory[images:images + size], dtype=np.uint8).copy()
        if self._text(self._read) is None or crc32(pixels.data) != checksum:
            return None
        return pixels.reshape(height, width, COLOURS)

    def beat(self, t_ns: int) -> None:
        """The writer is alive."""
        self._head[1] = t_ns

    def beaten_ns(self) -> int:
        """When the writer last said that it is alive; 0 = never."""
        return int(self._head[1])

    def _places(self, number: int) -> tuple[int, int]:
        """Where a slot and its image begin."""
        at = HEAD + number % self._room.places * self._room.slot_bytes
        return at, at + SLOT.size + self._room.text_bytes

    def _text(self, number: int) -> bytes | None:
        """The text of slot `number`; None when that is not there, or not whole."""
        at, images = self._places(number)
        slot = bytes(self._memory[at:images])
        checksum, found, length, *_ = SLOT.unpack_from(slot)
        whole = slot[4:SLOT.size + length]
        return whole[SLOT.size - 4:] if found == number and crc32(whole) == checksum else None
