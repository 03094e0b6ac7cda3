"""Reading of a session's ticks from the records of an MCAP file, whether complete or truncated.

The sizes stated in a file are not trusted: a record cannot be longer than the rest of the file, a chunk is unpacked to
at most LARGEST bytes, and all chunks together to little more than MOST_TIMES the size of the file. Missing rows are
always detected, because the rows of a topic are numbered from 0 without gaps and a file that was closed states how many
there are (robot/recording/files.py).
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Statistics

from truearc.errors import InputError, check_file, naming
from truearc.robot.recording.session import TELEMETRY, TICK_TOPIC, decode_tick, load_header
from truearc.robot.types import Tick

# Bytes of a record, and of an unpacked chunk. Ours end each 0.1 s, at some 80 kB unpacked; programs that rewrite MCAP
# make them of 4 MB.
LARGEST = 1 << 26
# Times the file's size. Recordings were measured to unpack to 11 to 40 times theirs; that of a robot that stands still,
# rewritten in chunks of 4 MB, to 260 times.
MOST_TIMES = 500
MAGIC = b"\x89MCAP0\r\n"
WANTED = (Opcode.CHUNK, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.STATISTICS)
IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
HEAD = struct.Struct("<BQ")           # opcode, length
MESSAGE = struct.Struct("<HIQQ")      # channel, number in it, two times; then the row
BROKEN = (McapError, EOFError, ValueError, OverflowError, RuntimeError, MemoryError, struct.error, zstandard.ZstdError)


class TickReader:
    """Iterates over (Tick, its recorded bytes); afterwards `cut_short` says what was wrong with the tail, if anything.

    `share` is how much of the file has been read, 0 to 1.

    A file that ends early (power loss, kill) gives every tick of its complete chunks. InputError when there is no
    telemetry at all, a whole row cannot be read, or a chunk would fill the memory.
    """

    def __init__(self, session: Path) -> None:
        self.path = session / TELEMETRY
        load_header(session)
        self.cut_short: str | None = None
        self.share = 0.0

    def __iter__(self) -> Iterator[tuple[Tick, bytes]]:
        for number, data in enumerate(self._rows(), 1):
            with naming(f"{self.path}: row {number}"):
                tick = decode_tick(data)
            yield tick, data

    def _rows(self) -> Iterator[bytes]:
        if not self.path.exists():
            raise InputError(f"{self.path}: missing; it may have been deleted by [recording] of launcher.toml; marked "
                             "shots are still in trials.jsonl")
        check_file(self.path)
        with naming(self.path):
            file = self.path.open("rb")
        size = self.path.stat().st_size
        with file:
            try:
                for data in rows_in(file, size, self.path, TICK_TOPIC):
                    self.share = file.tell() / size
                    yield data
            except Damaged as error:
                self.cut_short = f"{self.path}: cut short or damaged: {error}"


class Damaged(ValueError):
    """A damaged file; the text says what is wrong and where."""


class TooLarge(InputError):
    """A record or chunk that would fill the memory."""


def rows_in(file: IO[bytes], size: int, path: Path, topic: str) -> Iterator[bytes]:
    """Yield the messages of a topic in an open file of `size` bytes, in the file's order.

    Raises:
        Damaged: the file ends early, or is not what was written; all that was given before is.
        TooLarge: a record or an unpacked chunk is larger than LARGEST.
        InputError: the chunks unpack to too much in all.
    """
    channel, count, total = -1, 0, Total(path, size)
    stated: int | None = None
    for at, opcode, body in _records(file, size, path):
        try:
            is_chunk = opcode == Opcode.CHUNK
            inside = (split(total.add(unpack(Chunk.read(_stream(body)), f"{path}: byte {at}"))) if is_chunk
                      else iter(((opcode, body),)))
            for kind, content in inside:
                if kind == Opcode.CHANNEL and (said := Channel.read(_stream(content))).topic == topic:
                    channel = said.id
                elif kind == Opcode.STATISTICS:
                    stated = Statistics.read(_stream(content)).channel_message_counts.get(channel, 0)
                elif kind == Opcode.MESSAGE:
                    of, number, *_ = MESSAGE.unpack_from(content)
                    if of != channel:
                        continue
                    if number != count:
                        raise Damaged(f"row {count + 1} is missing; found row {number + 1} instead")
                    count += 1
                    yield content[MESSAGE.size:]
        except BROKEN as error:
            raise Damaged(f"byte {at}: {error}") from error
    if stated != count:
        raise Damaged(f"has {count} rows; its end states {'nothing' if stated is None else stated}")


class Total:
    """Counts what a file of `size` bytes unpacks to; InputError once that is too much."""

    def __init__(self, path: Path, size: int) -> None:
        self._path, self._most = path, LARGEST + MOST_TIMES * size
        self._bytes = 0

    def add(self, data: bytes) -> bytes:
        """Count an unpacked chunk, and return it."""
        self._bytes += len(data)
        if self._bytes > self._most:
            raise InputError(f"{self._path}: unpacks to more than {self._most} bytes, the most that is read of a "
                             "recording of its size")
        return data


def unpack(chunk: Chunk, name: str) -> bytes:
    """Return the content of a chunk whose checksum is valid; otherwise Damaged or TooLarge. name: location for
    errors."""
    if chunk.uncompressed_size > LARGEST:
        raise TooLarge(f"{name}: a chunk that unpacks to {chunk.uncompressed_size} bytes; at most {LARGEST} are read")
    data: bytes
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor(max_window_size=LARGEST).stream_reader(chunk.data) as packed:
            data = packed.read(LARGEST + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=LARGEST + 1)
    elif chunk.compression:
        raise Damaged(f"compressed with {chunk.compression[:20]!r}; expected zstd")
    else:
        data = chunk.data
    if len(data) > LARGEST:
        raise TooLarge(f"{name}: a chunk that states {chunk.uncompressed_size} bytes unpacks to more than {LARGEST}")
    if len(data) != chunk.uncompressed_size:
        raise Damaged(f"a chunk unpacks to {len(data)} bytes; expected {chunk.uncompressed_size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise Damaged("the checksum of a chunk does not match")
    return data


def split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of the records in an unpacked chunk; Damaged if they are not records."""
    place = 0
    while place < len(data):
        opcode, length = HEAD.unpack_from(data, place)
        first, place = place + HEAD.size, place + HEAD.size + length
        if opcode not in IN_CHUNKS or place > len(data):
            raise Damaged("a chunk contains something other than rows")
        yield opcode, data[first:place]


def _records(file: IO[bytes], size: int, path: Path) -> Iterator[tuple[int, int, bytes]]:
    """(place, opcode, content) of those that matter, up to the end mark."""
    if file.read(len(MAGIC)) != MAGIC:
        raise Damaged("is not MCAP: wrong first bytes")
    while True:
        at = file.tell()
        head = file.read(HEAD.size)
        if len(head) < HEAD.size:
            raise Damaged(f"ends at byte {size} without an end mark")
        opcode, length = HEAD.unpack(head)
        if not opcode or length > size - at - HEAD.size:
            raise Damaged(f"byte {at}: not a whole record")
        if opcode == Opcode.FOOTER:
            file.seek(length, 1)
            if file.read(len(MAGIC)) != MAGIC:
                raise Damaged(f"ends at byte {size} without an end mark")
            return
        if opcode not in WANTED:
            file.seek(length, 1)
        elif length > LARGEST:
            raise TooLarge(f"{path}: byte {at}: a record of {length} bytes; at most {LARGEST} are read")
        else:
            yield at, opcode, file.read(length)


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))
