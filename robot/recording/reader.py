"""Reads a session's ticks, whole or cut short."""

from collections.abc import Iterator
from pathlib import Path

from truearc.errors import InputError, check_file, naming
from truearc.robot.recording.chunks import Damaged, rows_in
from truearc.robot.recording.session import TELEMETRY, TICK_TOPIC, load_row_format
from truearc.robot.types import Tick


class TickReader:
    """Iterates over (Tick, its recorded bytes); afterwards `cut_short` says what was wrong with the tail, if anything.

    `share` is how much of the file has been read, 0 to 1.

    A file that ends early (power loss, kill) gives every tick of its complete chunks. InputError when there is no
    telemetry at all, a whole row cannot be read, or a chunk would fill the memory. `rows`: how this session's ticks are
    written.
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
        size = self.path.stat().st_size
        with file:
            try:
                for data in rows_in(file, size, self.path, TICK_TOPIC):
                    self.share = file.tell() / size
                    yield data
            except Damaged as error:
                self.cut_short = f"{self.path}: cut short or damaged: {error}"
