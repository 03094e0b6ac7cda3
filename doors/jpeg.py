"""Whether a JPEG's coded data are whole: read code by code, as a decoder does, without making an image of them.

A JPEG has no checksum, and decoders fill in what they cannot read. But damage seldom leaves as many blocks as the
header says, each within the range that pixels can give it, ending where the data end. What passes all of this is not
known to be as it was written: a changed bit that leaves the codes as long as they were is just another picture.
"""

import struct
from typing import NamedTuple

START, END, SCAN, TABLES, STEPS, RESTARTS = 0xD8, 0xD9, 0xDA, 0xC4, 0xDB, 0xDD
BASELINE = (0xC0, 0xC1)
FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
LARGEST = 1024                        # of a coefficient times its step, for 8-bit pixels
BLOCK = 64
NO_CODE = (0, 0, 0)
Codes = list[tuple[int, int, int]]


class _Part(NamedTuple):
    """A component of the frame: its blocks across and down in a unit, and its table of steps."""

    across: int
    down: int
    steps: int


class _Damaged(Exception):
    """The data cannot be read as JPEG; says why."""


class _Walk:
    """One pass over a file's segments, which keeps the tables that scans are read with."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 2
        self._codes: dict[int, Codes] = {}
        self._steps: dict[int, list[int]] = {}
        self._parts: dict[int, _Part] = {}
        self._size, self._restart, self._plain = (0, 0), 0, False

    def check(self) -> None:
        """Raises _Damaged, struct.error or LookupError where the file is not whole."""
        while True:
            marker = self._next_marker()
            if marker == END:
                return
            (length,) = struct.unpack_from(">H", self._data, self._at)
            body = self._data[self._at + 2:self._at + length]
            if length < 2 or len(body) != length - 2:
                raise _Damaged("a segment is longer than the file")
            self._at += length
            self._take(marker, body)

    def _next_marker(self) -> int:
        if self._data[self._at] != 0xFF:
            raise _Damaged("data between its segments")
        while self._data[self._at] == 0xFF:
            self._at += 1
        self._at += 1
        return self._data[self._at - 1]

    def _take(self, marker: int, body: bytes) -> None:
        if marker in FRAMES:
            self._plain = marker in BASELINE and body[0] == 8
            self._size = struct.unpack_from(">HH", body, 1)
            self._parts = {body[at]: _Part(body[at + 1] >> 4, body[at + 1] & 15, body[at + 2])
                           for at in range(6, 6 + 3 * body[5], 3)}
        elif marker == TABLES:
            self._take_codes(body)
        elif marker == STEPS:
            self._take_steps(body)
        elif marker == RESTARTS:
            (self._restart,) = struct.unpack(">H", body)
        elif marker == SCAN:
            coded = self._coded()
            if self._plain:
                self._check_scan(body, coded)

    def _take_codes(self, body: bytes) -> None:
        while body:
            counts, used = body[1:17], 17 + sum(body[1:17])
            self._codes[body[0]] = _lookup(counts, body[17:used], body[0] < 16)
            body = body[used:]

    def _take_steps(self, body: bytes) -> None:
        while body:
            form = ">64H" if body[0] >> 4 else ">64B"
            self._steps[body[0] & 15] = list(struct.unpack_from(form, body, 1))
            body = body[1 + struct.calcsize(form):]

    def _coded(self) -> list[bytes]:
        """The scan's data between restarts, with the bytes that mask markers taken out."""
        pieces: list[bytes] = []
        begin = self._at
        while True:
            self._at = self._data.index(b"\xff", self._at)
            after = self._data[self._at + 1]
            if after == 0:
                self._at += 2
            elif 0xD0 <= after <= 0xD7:
                if after - 0xD0 != len(pieces) % 8:
                    raise _Damaged("its restarts are out of order")
                pieces.append(self._data[begin:self._at])
                self._at += 2
                begin = self._at
            else:
                pieces.append(self._data[begin:self._at])
                return [piece.replace(b"\xff\x00", b"\xff") for piece in pieces]

    def _check_scan(self, body: bytes, coded: list[bytes]) -> None:
        """A scan of one component has blocks alone; of several, units with each one's blocks."""
        chosen = [(self._parts[body[at]], body[at + 1]) for at in range(1, 1 + 2 * body[0], 2)]
        widest = max(part.across for part in self._parts.values()), max(part.down for part in self._parts.values())
        alone = len(chosen) == 1
        plan = []
        for number, (part, tables) in enumerate(chosen):
            block = number, self._codes[tables >> 4], self._codes[16 + (tables & 15)], self._steps[part.steps]
            plan += [block] * (1 if alone else part.across * part.down)
        share = (chosen[0][0].across, chosen[0][0].down) if alone else (1, 1)
        (height, width), (most_across, most_down) = self._size, widest
        units = -(-width * share[0] // (8 * most_across)) * -(-height * share[1] // (8 * most_down))
        each = self._restart or units
        if len(coded) != -(-units // each):
            raise _Damaged("a part of its data is missing")
        for k, piece in enumerate(coded):
            left = 8 * len(piece) - _read(piece, plan, min(each, units - k * each))
            if not 0 <= left < 8:
                raise _Damaged("its data end too early" if left < 0 else "more data than the image has room for")


def what_is_damaged(data: bytes) -> str:
    """"" for a JPEG file whose coded data can be read to their end; else what is wrong. Of a progressive one only the
    segments are looked at."""
    try:
        _Walk(data).check()
    except _Damaged as error:
        return str(error)
    except (struct.error, LookupError, ValueError, ZeroDivisionError):
        return "its tables contradict each other, or are cut short"
    return ""


def _lookup(counts: bytes, symbols: bytes, first: bool) -> list[tuple[int, int, int]]:
    """For the next 16 bits: bits of code and value together, bits of the value, and how many coefficients it ends
    (BLOCK: all that are left); NO_CODE where no code begins so. `first`: of a block's first coefficient."""
    table: list[tuple[int, int, int]] = []
    taken = 0
    for length, count in enumerate(counts, 1):
        for symbol in symbols[taken:taken + count]:
            size = symbol if first else symbol & 15
            ends = 1 if first else BLOCK if symbol == 0 else (symbol >> 4) + 1
            table += [(length + size, size, ends)] * (1 << 16 - length)
        taken += count
    if len(table) > 1 << 16 or len(symbols) != taken:
        raise _Damaged("its tables of codes are impossible")
    return table + [NO_CODE] * ((1 << 16) - len(table))


def _read(piece: bytes, plan: list[tuple[int, Codes, Codes, list[int]]], units: int) -> int:
    """How many bits of a piece this many units take; _Damaged where they cannot be read."""
    padded, last, at = piece + b"\xff" * 8, 8 * len(piece), 0
    before = [0] * (plan[-1][0] + 1)
    for _ in range(units):
        for number, first, rest, steps in plan:
            window = int.from_bytes(padded[at >> 3:(at >> 3) + 6], "big") << (at & 7) & 0xFFFFFFFFFFFF
            bits, size, _ends = first[window >> 32]
            if not bits or size > 11:
                raise _Damaged("data that are no code")
            value = window >> 48 - bits & (1 << size) - 1
            before[number] += value if not size or value >> size - 1 else value - (1 << size) + 1
            if abs(before[number]) * steps[0] > LARGEST + steps[0]:
                raise _Damaged("brightness that no pixel has")
            at += bits
            at = _read_rest(padded, at, rest, steps)
        if at > last:
            raise _Damaged("its data end too early")
    return at


def _read_rest(padded: bytes, at: int, codes: list[tuple[int, int, int]], steps: list[int]) -> int:
    """Where the block ends whose first coefficient ended at bit `at`."""
    done = 1
    while done < BLOCK:
        byte = at >> 3
        bits, size, ends = codes[int.from_bytes(padded[byte:byte + 3], "big") >> 8 - (at & 7) & 0xFFFF]
        at += bits
        done += ends
        if ends == BLOCK:
            return at
        if not bits or done > BLOCK or (1 << size >> 1) * steps[done - 1] > LARGEST + steps[done - 1]:
            raise _Damaged("data that are no code" if not bits else "a block that no pixels give")
    return at
