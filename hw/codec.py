"""Conversion between physical values and frame bytes, as defined by the DBC files in `hw/dbc`.

This is the only module that uses cantools. Most of the messages defined here consist of whole little-endian bytes
without scaling. These are packed with the equivalent `struct` format, which is three times faster than cantools and is
tested to give the same bytes.
"""

import functools
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from truearc.hw.fault_codes import FRAME_LENGTH, FRAME_SIGNALS, FRAME_VALUE
from truearc.hw.protocols import BadFrame, Frame

if TYPE_CHECKING:
    from cantools.database.can.message import Message

DBC = Path(__file__).parent / "dbc"

Values = Mapping[str, float]

# bits, float?, signed? -> struct's letter
FORMATS = {(32, True, False): "f", (64, True, False): "d",
           (8, False, False): "B", (16, False, False): "H", (32, False, False): "I", (64, False, False): "Q",
           (8, False, True): "b", (16, False, True): "h", (32, False, True): "i", (64, False, True): "q"}


class _Entry(NamedTuple):
    message: "Message"
    length: int                                   # bytes
    names: frozenset[str]
    limits: tuple[tuple[str, float, float], ...]  # signal, lowest, highest; in the unit of the DBC
    layout: "_Layout | None"                      # None: cantools packs it


class _Layout(NamedTuple):
    """A message as whole bytes: signal names in the order of `packer`'s fields, and whether each is a float."""

    packer: struct.Struct
    names: tuple[str, ...]
    floats: tuple[bool, ...]


class Codec:
    """The frames of one device family.

    Values are physical, in the unit that the DBC file states for each signal. A value that is not finite or lies
    outside the DBC's range is refused in both directions, so the DBC file also defines what is plausible.
    """

    def __init__(self, name: str, messages: Mapping[str, _Entry]) -> None:
        self.name = name
        self._messages = messages

    def sent_by(self, node: str) -> tuple[str, ...]:
        """Return the names of the messages that `node` of the DBC file sends ("Host", or the file's name for the
        device)."""
        return tuple(name for name, entry in self._messages.items() if node in entry.message.senders)

    def base_id(self, message: str) -> int:
        """Return the arbitration id of a message for device 0."""
        return int(self._messages[message].message.frame_id)

    def make(self, message: str, values: Values) -> bytes:
        """Encode `values`, one for each signal; BadFrame for a missing, unknown or impossible one."""
        entry = self._messages[message]
        if values.keys() != entry.names:
            wrong = tuple(sorted(values.keys() ^ entry.names))
            raise BadFrame(FRAME_SIGNALS(message=f"{self.name} {message}", signals=wrong))
        self._check(message, entry, values)
        if entry.layout is None:
            return bytes(entry.message.encode(dict(values), strict=False))
        packer, names, floats = entry.layout
        return packer.pack(*[values[name] if is_float else int(values[name])
                             for name, is_float in zip(names, floats, strict=True)])

    def parse(self, message: str, data: bytes) -> dict[str, float]:
        """Decode the signal values of `data`; BadFrame if it is short, long, not finite or out of range."""
        entry = self._messages[message]
        if len(data) != entry.length:
            raise BadFrame(FRAME_LENGTH(message=f"{self.name} {message}", bytes=len(data), wanted_bytes=entry.length))
        values: dict[str, Any]
        if entry.layout is None:
            values = entry.message.decode_simple(data, decode_choices=False)
        else:
            values = dict(zip(entry.layout.names, entry.layout.packer.unpack(data), strict=True))
        self._check(message, entry, values)
        return values

    def parse_frame(self, message: str, frame: Frame, device: str, data: bytes | None = None) -> dict[str, float]:
        """Parse a frame, or `data` in its place; errors also name the device and the frame."""
        try:
            return self.parse(message, frame.data if data is None else data)
        except BadFrame as error:
            raise BadFrame(error.reason.about(device=device, frame=frame.name)) from error

    def _check(self, message: str, entry: _Entry, values: Values) -> None:
        for name, low, high in entry.limits:
            if not low <= values[name] <= high:                 # a NaN fails this too
                raise BadFrame(FRAME_VALUE(message=f"{self.name} {message}", bytes=entry.length, signal=name,
                                           value=float(values[name]), low=low, high=high))


@functools.cache
def load_codec(name: str) -> Codec:
    """Load `hw/dbc/<name>.dbc`, once; raises ValueError as read_codec does."""
    return read_codec(DBC / f"{name}.dbc")


@functools.cache
def read_codec(path: Path) -> Codec:
    """Read a DBC file, once; ValueError if a signal states no range."""
    import cantools  # slow to import, and most commands make no frame
    database = cantools.database.load_file(path, database_format="dbc", strict=True)
    return Codec(path.stem, {message.name: _entry(path, message) for message in database.messages})


def _entry(path: Path, message: "Message") -> _Entry:
    limits = []
    for signal in message.signals:
        if signal.minimum is None or signal.maximum is None:
            raise ValueError(f"{path}: {message.name} {signal.name} states no range")
        limits.append((signal.name, float(signal.minimum), float(signal.maximum)))
    return _Entry(message, message.length, frozenset(name for name, _, _ in limits), tuple(limits), _layout(message))


def _layout(message: "Message") -> _Layout | None:
    text, at_bit = "<", 0
    signals = sorted(message.signals, key=lambda signal: signal.start)
    for signal in signals:
        code = FORMATS.get((signal.length, bool(signal.is_float), bool(signal.is_signed) and not signal.is_float))
        whole = signal.byte_order == "little_endian" and signal.start % 8 == 0 and signal.start >= at_bit
        if code is None or not whole or (signal.scale, signal.offset) != (1, 0) or signal.is_multiplexer:
            return None
        text += "x" * ((signal.start - at_bit) // 8) + code
        at_bit = signal.start + signal.length
    text += "x" * (message.length - at_bit // 8)
    return _Layout(struct.Struct(text), tuple(signal.name for signal in signals),
                   tuple(bool(signal.is_float) for signal in signals))
