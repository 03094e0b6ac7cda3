"""Every whole tick of a damaged telemetry.mcap, those behind the damage included."""

from collections.abc import Iterator
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk

from truearc.robot.recording.chunks import BROKEN, MESSAGE, TooLarge, split, unpack

NAME_AT = 37                          # where in a chunk the name of the compression stands ...
NAME = b"\x04\x00\x00\x00zstd"        # ... which is how a chunk is found again
TICKS = 1                             # TickFile's first channel; the record that names it may be lost


def salvage(data: bytes) -> Iterator[bytes]:
    """The ticks of each chunk whose checksum holds, wherever in `data` it lies, in the file's order."""
    file, at = BytesIO(data), data.find(NAME)
    while at >= 0:
        rows = _read_chunk(file, at - NAME_AT)
        yield from rows
        at = data.find(NAME, file.tell() if rows else at + 1)


def _read_chunk(file: BytesIO, start: int) -> list[bytes]:
    """Return the ticks of the chunk that begins at `start`, none when it is not whole. `file` is then at its end."""
    file.seek(max(start, 0))
    stream = ReadDataStream(file)
    try:
        if stream.read1() != Opcode.CHUNK:
            return []
        stream.read8()
        chunk = Chunk.read(stream)
        records = split(unpack(chunk, "")) if chunk.uncompressed_crc else ()
        return [content[MESSAGE.size:] for opcode, content in records
                if opcode == Opcode.MESSAGE and MESSAGE.unpack_from(content)[0] == TICKS]
    except (*BROKEN, TooLarge):
        return []
