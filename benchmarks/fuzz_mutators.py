"""The mutators of `fuzz`, which damage bytes of any file, records of WPILOG and MCAP, and lines and words of texts."""

import re
import struct
import zlib
from collections.abc import Callable
from random import Random

import lz4.frame
import zstandard

from truearc.robot.gate import KEY_SEAL, UNSEALED, seal

Mutator = Callable[[bytes, Random], bytes]

LENGTHS = (0, 1, 0x7F, 0xFF, 0xFFFF, 1 << 28, 0x7FFFFFFF, 0x80000000, 2_600_000_000, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF,
           0xFFFFFFFFFFFFFFFF)
WORDS = ("", "nan", "inf", "-inf", "1e308", "-1e308", "1e999", "-1", "0", "1" * 5000, "1e-320", "99999999999999999999",
         "true", "null", "\"", "'", "\"\"", ",", ";", "\t", "\x00", "\ufeff", "\u2028", "\r", "é", "[", "{", "}", "]",
         "1,5", "1.5,2", "0x10", "١", "²", "_", "--", "#", "=", "\\", "\\u0000", "\ud7ff", "x" * 30_000)
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
BOMB = 300_000_000                    # bytes of zeros, beyond what any case may hold


def _at(data: bytes, random: Random) -> int:
    return random.randrange(len(data)) if data else 0


def flip(data: bytes, random: Random) -> bytes:
    made = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 8, 64))):
        if made:
            made[_at(data, random)] ^= 1 << random.randrange(8)
    return bytes(made)


def scribble(data: bytes, random: Random) -> bytes:
    at, long = _at(data, random), random.choice((1, 4, 16, 512))
    return data[:at] + random.choice((random.randbytes(long), bytes(long), b"\xff" * long)) + data[at + long:]


def truncate(data: bytes, random: Random) -> bytes:
    return data[:random.choice((_at(data, random), max(len(data) - random.randrange(1, 200), 0)))]


def splice(data: bytes, random: Random) -> bytes:
    """A block of the file somewhere else: over what is there, between it, or out."""
    first, at, long = _at(data, random), _at(data, random), random.choice((4, 64, 1024, 20_000))
    block = data[first:first + long]
    return random.choice((data[:at] + block + data[at + long:], data[:at] + block + data[at:],
                          data[:at] + data[at + long:]))


def length(data: bytes, random: Random) -> bytes:
    at, form = _at(data, random), random.choice(("<I", "<Q", "<H", "<B"))
    return data[:at] + struct.pack(form, random.choice(LENGTHS) % (1 << 8 * struct.calcsize(form))) + data[
        at + struct.calcsize(form):]


def zero_tail(data: bytes, random: Random) -> bytes:
    """As a file system leaves a file whose end it had not written before the power went."""
    at = _at(data, random)
    return data[:at] + bytes(len(data) - at)


BYTES: tuple[Mutator, ...] = (flip, flip, scribble, truncate, splice, length, zero_tail)


def _shuffled(records: list[bytes], random: Random) -> list[bytes]:
    """Records doubled, dropped, in another order, or cut after one of them."""
    made, at, long = list(records), _at(bytes(len(records)), random), random.choice((1, 1, 10, 100))
    what = random.randrange(5)
    if what == 0:
        made[at:at] = records[at:at + long]
    elif what == 1:
        del made[at:at + long]
    elif what == 2:
        block = made[at:at + long]
        random.shuffle(block)
        made[at:at + long] = block
    elif what == 3:
        del made[at:]
    else:
        other = _at(bytes(len(records)), random)
        made[other:other] = records[at:at + long]
    return made


# --- WPILOG


def _wpilog_parts(data: bytes) -> tuple[bytes, list[tuple[int, bytes, int]]]:
    """Head, and (signal, payload, time) of each record."""
    place = 12 + struct.unpack_from("<I", data, 8)[0]
    head, records = data[:place], []
    while place < len(data):
        sizes, at, fields = data[place], place + 1, []
        for long in ((sizes & 3) + 1, (sizes >> 2 & 3) + 1, (sizes >> 4 & 7) + 1):
            fields.append(int.from_bytes(data[at:at + long], "little"))
            at += long
        records.append((fields[0], data[at:at + fields[1]], fields[2]))
        place = at + fields[1]
    return head, records


def _wpilog_record(signal: int, payload: bytes, t_us: int, said: int | None = None) -> bytes:
    fields = [number.to_bytes(max(1, (number.bit_length() + 7) // 8), "little")
              for number in (signal, len(payload) if said is None else said, t_us)]
    return bytes([len(fields[0]) - 1 | (len(fields[1]) - 1) << 2 | (len(fields[2]) - 1) << 4]) + b"".join(
        fields) + payload


def wpilog_records(data: bytes, random: Random) -> bytes:
    head, records = _wpilog_parts(data)
    return head + b"".join(_shuffled([_wpilog_record(*record) for record in records], random))


def wpilog_field(data: bytes, random: Random) -> bytes:
    """One record's signal, payload, time or size is another's, or wild."""
    head, records = _wpilog_parts(data)
    made = [_wpilog_record(*record) for record in records]
    controls = [k for k, record in enumerate(records) if record[0] == 0]
    for _ in range(random.choice((1, 1, 5, 50))):
        at = random.choice(controls) if random.random() < 0.2 else random.randrange(len(records))
        signal, payload, t_us = records[at]
        odd = random.choice((b"", b"\xff" * 8, bytes(8), payload[:-1], payload + b"x",
                             struct.pack("<d", random.choice((1e300, -1e9, 5e3, 1e-300))),
                             random.randbytes(random.choice((1, 8, 40)))))
        late = random.choice((0, 1, (1 << 63) - 1, (1 << 64) - 1, t_us + 10**7, t_us // 2, random.randrange(1 << 40)))
        made[at] = random.choice((
            _wpilog_record(random.randrange(200), payload, t_us), _wpilog_record(signal, odd, t_us),
            _wpilog_record(signal, payload, late),
            _wpilog_record(signal, payload, t_us, random.choice(LENGTHS) % (1 << 32)),
            _wpilog_record(signal, random.choice(BYTES)(payload, random), t_us)))
    return head + b"".join(made)


# --- MCAP: magic, then records of an opcode (1 byte), a length (8) and that many bytes


MAGIC, CHUNK = 8, 0x06


def _mcap_parts(data: bytes, around: int = MAGIC) -> list[bytes]:
    place, records = around, []
    while place + 9 <= len(data) - around:
        long = 9 + struct.unpack_from("<Q", data, place + 1)[0]
        records.append(data[place:place + long])
        place += long
    return records


def _joined(data: bytes, records: list[bytes]) -> bytes:
    return data[:MAGIC] + b"".join(records) + data[-MAGIC:]


def mcap_records(data: bytes, random: Random) -> bytes:
    return _joined(data, _shuffled(_mcap_parts(data), random))


def mcap_field(data: bytes, random: Random) -> bytes:
    """Bytes of one record's opcode, length or first fields."""
    records = _mcap_parts(data)
    at = random.randrange(len(records))
    head = random.choice((1, 9, 48))
    records[at] = random.choice((flip, scribble, length))(records[at][:head], random) + records[at][head:]
    return _joined(data, records)


def _chunk(content: bytes, packed: bytes, name: bytes, said: int, start: bytes) -> bytes:
    body = start + struct.pack("<QII", said, zlib.crc32(content), len(name)) + name + struct.pack(
        "<Q", len(packed)) + packed
    return bytes([CHUNK]) + struct.pack("<Q", len(body)) + body


def mcap_chunk(data: bytes, random: Random) -> bytes:
    """A chunk that is whole by its checksum: its content damaged, packed otherwise, or far larger than it says."""
    records = _mcap_parts(data)
    at = random.choice([k for k, record in enumerate(records) if record[0] == CHUNK])
    start, (size, named) = records[at][9:25], struct.unpack_from("<Q4xI", records[at], 9 + 16)
    content = zstandard.decompress(records[at][9 + 32 + named + 8:], size)
    what = random.randrange(8)
    if what == 0:
        bomb = bytes(BOMB)
        said = random.choice((BOMB, len(content), 0))
        packed, name = random.choice(((zstandard.compress(bomb), b"zstd"), (lz4.frame.compress(bomb), b"lz4"),
                                      (zstandard.ZstdCompressor(write_content_size=False).compress(bomb), b"zstd")))
        records[at] = _chunk(b"", packed, name, said, start)
    elif what == 1:
        name, pack = random.choice(((b"", bytes), (b"lz4", lz4.frame.compress), (b"none", bytes)))
        records[at] = _chunk(content, pack(content), name, len(content), start)
    elif what == 2:
        content = b"".join(_shuffled(_mcap_parts(content, 0), random))
    else:
        content = random.choice((*BYTES, *LINES))(content, random)
    if what > 1:
        records[at] = _chunk(content, zstandard.compress(content), b"zstd", len(content), start)
    return _joined(data, records)


# --- texts


def word(data: bytes, random: Random) -> bytes:
    """A number, or what stands at one place, becomes an odd word."""
    said = random.choice(WORDS).encode("utf-8", "surrogatepass")
    found = [match.span() for match in NUMBER.finditer(data[:2_000_000])]
    first, last = random.choice(found) if found and random.random() < 0.7 else (at := _at(data, random), at)
    return data[:first] + said + data[last:]


def lines(data: bytes, random: Random) -> bytes:
    ends = data.splitlines(keepends=True)
    return b"".join(_shuffled(ends, random)) if ends else data


def join_lines(data: bytes, random: Random) -> bytes:
    """A line end lost, or another kind of it."""
    ends = [match.start() for match in re.finditer(rb"\n", data)]
    if not ends:
        return data
    at = random.choice(ends)
    return data[:at] + random.choice((b"", b"\r", b"\r\n", b"\n\n", b"\x0b")) + data[at + 1:]


def nest(data: bytes, random: Random) -> bytes:
    at, mark = _at(data, random), random.choice((b"[", b"{\"a\":", b"a.", b"("))
    return data[:at] + mark * random.choice((100, 9_000, 100_000)) + data[at:]


def encode_otherwise(data: bytes, random: Random) -> bytes:
    other = random.choice(("utf-16", "utf-8-sig", "latin-1", "utf-32"))
    return data.decode("utf-8", "replace").encode(other, "replace")


LINES: tuple[Mutator, ...] = (word, word, lines, join_lines, nest)
TEXT: tuple[Mutator, ...] = (*LINES, encode_otherwise)


def reseal(data: bytes, random: Random) -> bytes:
    """A damaged model whose seal fits again, so that all of it is read."""
    stamped = re.search(KEY_SEAL.encode() + rb".{2,4}?([0-9a-f]{64})", data, re.DOTALL)
    unsealed = data if stamped is None else data.replace(stamped[1], UNSEALED.encode())
    made = random.choice((*BYTES, word))(unsealed, random)
    return seal(made) if made.count(UNSEALED.encode()) == 1 else made


KINDS: dict[str, tuple[Mutator, ...]] = {
    "bytes": BYTES,
    "wpilog": (*BYTES, wpilog_records, wpilog_records, wpilog_field, wpilog_field, wpilog_field),
    "mcap": (*BYTES, mcap_records, mcap_field, mcap_field, mcap_chunk, mcap_chunk, mcap_chunk),
    "lines": (*BYTES, *TEXT),
    "json": (*BYTES, *TEXT),
    "toml": (*BYTES, *TEXT, word, word, word),
    "onnx": (reseal,),
}


def damage(data: bytes, kind: str, random: Random) -> tuple[str, bytes]:
    """(how, a damaged file); once, or twice over."""
    names = []
    for _ in range(random.choice((1, 1, 1, 2))):
        chosen = random.choice(KINDS[kind] if not names else BYTES)
        data = chosen(data, random)
        names.append(chosen.__name__)
    return " then ".join(names), data
