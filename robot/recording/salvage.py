"""Every whole tick of a damaged telemetry.mcap, those behind the damage included."""

import struct
import zlib
from collections.abc import Iterator

import zstandard

CHUNK, MESSAGE = 0x06, 0x05
LARGEST = 1 << 26                     # bytes of an unpacked chunk; a damaged length must not ask for all memory
UNKNOWN = -1                          # content size of a frame that does not state it
# A chunk: opcode, length of the rest; start, end, unpacked size, CRC of what is unpacked, "zstd", packed size, data
HEAD = struct.Struct("<BQQQQI8sQ")
NAME_AT = 37                          # where in it the name of the compression stands ...
NAME = b"\x04\x00\x00\x00zstd"        # ... which is how a chunk is found again
TICKS = b"\x01\x00"                   # TickFile's first channel; the record that names it may be lost
MESSAGE_HEAD = 22                     # bytes of channel, sequence and two times before the data


def salvage(data: bytes) -> Iterator[bytes]:
    """The ticks of each chunk whose checksum holds, wherever in `data` it lies, in the file's order."""
    at = data.find(NAME)
    while at >= 0:
        unpacked, end = _unpack(data, at - NAME_AT)
        if unpacked is not None:
            yield from _ticks(unpacked)
        at = data.find(NAME, end if unpacked is not None else at + 1)


def _unpack(data: bytes, start: int) -> tuple[bytes | None, int]:
    """The content of the chunk that begins at `start` and where it ends; None when there is no whole one."""
    if start < 0 or start + HEAD.size > len(data):
        return None, 0
    opcode, _, _, _, size, crc, _, packed = HEAD.unpack_from(data, start)
    begin = start + HEAD.size
    if opcode != CHUNK or size > LARGEST or packed > len(data) - begin:
        return None, 0
    frame = data[begin:begin + packed]
    try:
        if zstandard.frame_content_size(frame) not in (size, UNKNOWN):     # a damaged one may ask for all memory
            return None, 0
        content = zstandard.decompress(frame, max_output_size=size)
    except zstandard.ZstdError:
        return None, 0
    return (content, begin + packed) if zlib.crc32(content) == crc else (None, 0)


def _ticks(content: bytes) -> Iterator[bytes]:
    at = 0
    while at + 9 <= len(content):
        opcode, length = struct.unpack_from("<BQ", content, at)
        at += 9
        if opcode == MESSAGE and content[at:at + len(TICKS)] == TICKS:
            yield content[at + MESSAGE_HEAD:at + length]
        at += length
