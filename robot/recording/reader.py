"""Reads a session's ticks, whole or cut short."""

import struct
from collections.abc import Iterator
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from truearc.robot.config.schema import InputError, naming
from truearc.robot.config.whole_file import check_file
from truearc.robot.recording.session import TELEMETRY, TICK_TOPIC, load_row_format
from truearc.robot.types import Tick

LARGEST = 1 << 28                     # bytes of a record; a damaged length must not ask for all memory


class TickReader:
    """Iterates over (Tick, its recorded bytes); afterwards `cut_short` says what was wrong with the tail, if anything.

    `share` is how much of the file has been read, 0 to 1.

    A file that ends early (power loss, kill) gives every tick of its complete chunks. InputError when there is no
    telemetry at all or a whole row cannot be read. `rows`: how this session's ticks are written.
    """

    def __init__(self, session: Path) -> None:
        self.path = session / TELEMETRY
        self.rows = load_row_format(session)
        self.cut_short: str | None = None
        self.share = 0.0

    def __iter__(self) -> Iterator[tuple[Tick, bytes]]:
        decode = self.rows.decode_tick
        for number, data in enumerate(self._rows(), 1):
            with naming(f"{self.path}: row {number}"):
                tick = decode(data)
            yield tick, data

    def _rows(self) -> Iterator[bytes]:
        if not self.path.exists():
            raise InputError(f"{self.path}: is not there; [recording] of launcher.toml may have had it deleted; marked "
                             "shots are in trials.jsonl all the same")
        check_file(self.path)
        with naming(self.path):
            file = self.path.open("rb")
        size, ticks = max(self.path.stat().st_size, 1), 0
        with file:
            try:
                for record in StreamReader(file, validate_crcs=True, record_size_limit=LARGEST).records:
                    if isinstance(record, Channel) and record.topic == TICK_TOPIC:
                        ticks = record.id
                    if isinstance(record, Message) and record.channel_id == ticks:
                        self.share = file.tell() / size
                        yield record.data
            except (McapError, EOFError, ValueError, struct.error, zstandard.ZstdError, MemoryError) as error:
                self.cut_short = f"{self.path}: cut short or damaged ({type(error).__name__}: {error})"
