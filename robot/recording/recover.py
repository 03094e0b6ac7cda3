"""Recovery of a session that was cut short: nothing whole is lost, and replaced files are kept in damaged/."""

import contextlib
import shutil
from collections.abc import Callable, Iterator
from io import BytesIO
from itertools import chain, count
from pathlib import Path

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from msgspec import Struct

from truearc.errors import NO_JSON, InputError, check_file, in_words
from truearc.robot.recording import session as layout
from truearc.robot.recording.files import Appender, TickFile, load_image, lock_trouble, parse_candump, save_synced
from truearc.robot.recording.reader import BROKEN, MESSAGE, TickReader, TooLarge, split, unpack
from truearc.robot.recording.writer import BATCH_NS
from truearc.robot.types import Tick

NAME_AT = 37                          # where in a chunk the name of the compression stands ...
NAME = b"\x04\x00\x00\x00zstd"        # ... which is how a chunk is found again
TICKS = 1                             # TickFile's first channel; the record that names it may be lost


class Recovered(Struct):
    """Contents of a session, and the repairs as text (none for one that was whole)."""

    ticks: int
    trials: int
    repairs: list[str]


class _Told:
    """What ticks say of their session, without keeping them: an hour of them would fill the memory."""

    def __init__(self) -> None:
        self.ticks = self.last_cycle = 0
        self.trials: list[layout.Trial] = []

    def hear(self, tick: Tick) -> None:
        self.ticks += 1
        self.last_cycle = tick.inputs.cycle
        self.trials += layout.make_trials(tick)


def recover(session: Path) -> Recovered:
    """Repair a session's files in place; InputError for no session and for one being recorded.

    Ticks: a readable MCAP file with a summary, of no tick if none is whole. Trials: no torn line, and those that only
    the ticks know. CAN: whole lines. Images: an index of those that are there. Running it again changes nothing.
    """
    layout.load_session_config(session)
    for name in (layout.TELEMETRY, layout.TRIALS, layout.CAN, layout.INDEX):
        check_file(session / name)
    if isinstance(trouble := lock_trouble(session / layout.TELEMETRY), BlockingIOError):
        raise InputError(f"{session / layout.TELEMETRY}: is being recorded") from trouble
    repairs: list[str] = []
    told = _recover_ticks(session, repairs)
    trials = _recover_trials(session, told, repairs)
    _recover_lines(session, layout.CAN, "CAN frames",
                   lambda line: parse_candump(line.decode("ascii", "replace") + "\n") is not None, repairs)
    _recover_lines(session, layout.INDEX, "images", lambda line: _has_image(session, line), repairs)
    return Recovered(told.ticks, trials, repairs)


def _recover_ticks(session: Path, repairs: list[str]) -> _Told:
    """Read the ticks; their file is rewritten when it is not whole."""
    path = session / layout.TELEMETRY
    reader, told = TickReader(session), _Told()
    if path.exists():
        with contextlib.suppress(TooLarge):           # what is whole around it is kept
            for tick, _ in reader:
                told.hear(tick)
            if not reader.cut_short:
                return told
    told = _Told()
    _replace(path, session, lambda new: _write_ticks(new, path, told))
    missing = told.last_cycle - told.ticks
    repairs.append(f"{layout.TELEMETRY}: {told.ticks} ticks kept"
                   + (f", {missing} before the last of them were damaged or never written" if missing else ""))
    return told


def _write_ticks(new: Path, damaged: Path, told: _Told) -> None:
    file, flushed_ns = Appender(new), 0
    ticks = TickFile(file)
    try:
        for row in salvage(damaged.read_bytes() if damaged.exists() else b""):
            tick = layout.decode_tick(row)
            if told.ticks and tick.inputs.cycle <= told.last_cycle:
                continue              # a chunk that stands there twice
            told.hear(tick)
            ticks.write(tick.inputs.t_ns, row, list(map(layout.encode_row, layout.make_trials(tick))))
            if tick.inputs.t_ns - flushed_ns >= BATCH_NS:
                flushed_ns = tick.inputs.t_ns
                ticks.flush()
        ticks.finish()
        file.sync()
    except NO_JSON as error:
        raise InputError(f"{damaged}: row {told.ticks + 1}: {in_words(error)}") from error
    finally:
        file.close()


def _recover_trials(session: Path, told: _Told, repairs: list[str]) -> int:
    path = session / layout.TRIALS
    lines = path.read_bytes().split(b"\n") if path.exists() else []
    trials: list[layout.Trial] = []
    torn = 0
    for line in filter(None, lines):
        try:
            trials.append(layout.decode_trial(line))
        except NO_JSON:
            torn += 1
    known = [trial for trial in told.trials if trial not in trials]
    if torn or known or (lines and lines[-1]):
        trials = sorted(trials + known, key=lambda trial: trial.outcome.t_ns)
        text = b"".join(layout.encode_row(trial) + b"\n" for trial in trials)
        _replace(path, session, lambda new: save_synced(new, text))
        repairs.append(f"{layout.TRIALS}: {len(trials)} rows kept, {torn} torn, {len(known)} restored from the ticks")
    return len({trial.outcome.trial for trial in trials})


def _recover_lines(session: Path, name: str, what: str, is_whole: Callable[[bytes], bool], repairs: list[str]) -> None:
    """Leave only the whole lines of a text file."""
    path = session / name
    if not path.exists():
        return
    data = path.read_bytes()
    lines = data.split(b"\n")
    kept = [line for line in lines if line and is_whole(line)]
    text = b"".join(line + b"\n" for line in kept)
    if text != data:
        _replace(path, session, lambda new: save_synced(new, text))
        repairs.append(f"{name}: {len(kept)} {what} kept, {len(list(filter(None, lines))) - len(kept)} torn or missing")


def _has_image(session: Path, line: bytes) -> bool:
    try:
        return load_image(session, msgspec.json.decode(line, type=layout.Picture)) is not None
    except NO_JSON:
        return False


def _replace(path: Path, session: Path, write: Callable[[Path], None]) -> None:
    """Put what `write` makes in a file's place, at one stroke, with the old one kept aside."""
    new = path.with_name(path.name + ".part")
    new.unlink(missing_ok=True)       # of a recovery that was cut short itself
    try:
        write(new)
        if path.exists():
            _keep_aside(path, session / layout.DAMAGED)
        new.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be repaired: {in_words(error)}") from error
    finally:
        new.unlink(missing_ok=True)


def _keep_aside(path: Path, damaged: Path) -> None:
    damaged.mkdir(exist_ok=True)
    names = chain((path.name,), (f"{path.stem}-{number}{path.suffix}" for number in count(2)))
    shutil.copy2(path, next(damaged / name for name in names if not (damaged / name).exists()))


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
