"""Every whole tick of a damaged telemetry.mcap, those behind the damage included."""

import struct
from collections.abc import Iterator
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord, Message
from mcap.stream_reader import breakup_chunk

LARGEST = 1 << 26                     # bytes of an unpacked chunk; a damaged length must not ask for all memory
UNKNOWN = -1                          # content size of a frame that does not state it
NAME_AT = 37                          # where in a chunk the name of the compression stands ...
NAME = b"\x04\x00\x00\x00zstd"        # ... which is how a chunk is found again
TICKS = 1                             # TickFile's first channel; the record that names it may be lost


def salvage(data: bytes) -> Iterator[bytes]:
    """The ticks of each chunk whose checksum holds, wherever in `data` it lies, in the file's order."""
    file, at = BytesIO(data), data.find(NAME)
    while at >= 0:
        records = _read_chunk(file, at - NAME_AT)
        yield from (one.data for one in records if isinstance(one, Message) and one.channel_id == TICKS)
        at = data.find(NAME, file.tell() if records else at + 1)


def _read_chunk(file: BytesIO, start: int) -> list[McapRecord]:
    """Return the records of the chunk that begins at `start`, none when it is not whole. `file` is then at its end."""
    file.seek(max(start, 0))
    stream = ReadDataStream(file)
    try:
        if stream.read1() != Opcode.CHUNK:
            return []
        stream.read8()
        chunk = Chunk.read(stream)
        stated = zstandard.frame_content_size(chunk.data)   # a damaged one may ask for all memory
        if chunk.uncompressed_size > LARGEST or stated not in (chunk.uncompressed_size, UNKNOWN):
            return []
        return breakup_chunk(chunk, validate_crc=True) if chunk.uncompressed_crc else []
    except (McapError, ValueError, struct.error, zstandard.ZstdError):
        return []
