"""Upkeep of recorded sessions: recovery of truncated ones, and deletion of old data beyond the limits in [recording].

Recovery loses no complete record, and replaced files are kept in damaged/. When a limit is exceeded, the telemetry and
images of the oldest sessions are deleted first; `session.json`, `config.json`, `trials.jsonl`, models and aim files are
always kept, as are files that are not part of a recording. A folder beside that of the running session counts as a
session if it has a valid session.json, or a damaged one together with telemetry. Links are not followed.
"""

import contextlib
import os
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from io import BytesIO
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from msgspec import Struct

from truearc.errors import NO_JSON, InputError, check_file, in_words
from truearc.robot.config.schema import RecordingConfig
from truearc.robot.recording import session as layout
from truearc.robot.recording.files import Appender, TickFile, load_image, lock_trouble, parse_candump, save_synced
from truearc.robot.recording.reader import BROKEN, MESSAGE, TickReader, TooLarge, Total, split, unpack
from truearc.robot.recording.writer import BATCH_NS
from truearc.robot.types import Tick

# --- recovery

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
        for row in salvage(damaged.read_bytes() if damaged.exists() else b"", damaged):
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


def salvage(data: bytes, path: Path) -> Iterator[bytes]:
    """Return the ticks of each chunk with a valid checksum, wherever in the `data` of a file it lies, in its order."""
    file, at, total = BytesIO(data), data.find(NAME), Total(path, len(data))
    while at >= 0:
        rows = _read_chunk(file, at - NAME_AT, total)
        yield from rows
        at = data.find(NAME, file.tell() if rows else at + 1)


def _read_chunk(file: BytesIO, start: int, total: Total) -> list[bytes]:
    """Return the ticks of the chunk that begins at `start`, none when it is not whole. `file` is then at its end."""
    file.seek(max(start, 0))
    stream = ReadDataStream(file)
    try:
        if stream.read1() != Opcode.CHUNK:
            return []
        stream.read8()
        chunk = Chunk.read(stream)
        records = split(total.add(unpack(chunk, ""))) if chunk.uncompressed_crc else ()
        return [content[MESSAGE.size:] for opcode, content in records
                if opcode == Opcode.MESSAGE and MESSAGE.unpack_from(content)[0] == TICKS]
    except (*BROKEN, TooLarge):
        return []


# --- retention

BULK = (layout.TELEMETRY, layout.CAN, layout.FRAMES, layout.LATENESS, layout.DAMAGED)
BYTES_PER_GB, S_PER_DAY = 1_000_000_000, 86_400.0
LOOK_S = 600.0                        # between looks: a session grows by some 70 MB meanwhile


class _Session(NamedTuple):
    """An earlier session."""

    ended_s: float                    # when its telemetry was written last, Unix
    folder: Path
    bulk_bytes: int                   # of what may go
    rest_bytes: int


def prune(running: Path, limits: RecordingConfig, now_s: float) -> list[Path]:
    """Delete bulk data of earlier sessions beyond the limits, oldest first; return the affected sessions.

    A session that another process is recording counts, but keeps everything. What cannot be deleted also stays.
    """
    total = sum(_bytes(running, name) for name in _names(running))
    sessions = sorted(filter(None, map(_look, _folders(running))))
    total += sum(one.bulk_bytes + one.rest_bytes for one in sessions)
    pruned = []
    for one in sessions:
        is_old = limits.keep_days is not None and now_s - one.ended_s > limits.keep_days * S_PER_DAY
        is_much = limits.keep_gb is not None and total > limits.keep_gb * BYTES_PER_GB
        if one.bulk_bytes and (is_old or is_much) and isinstance(       # unless another process may be writing it
                lock_trouble(one.folder / layout.TELEMETRY), FileNotFoundError | None):
            _delete_bulk(one.folder)
            total -= one.bulk_bytes - sum(_bytes(one.folder, name) for name in BULK)
            pruned.append(one.folder)
    return pruned


def start_pruning(limits: RecordingConfig | None, unix_s: Callable[[], float], running: Path) -> None:
    """Prune now and every ten minutes, in a thread of this process, as long as that lives; nothing without limits.

    `unix_s`: the time of day.
    """
    if limits is not None and limits != RecordingConfig():
        threading.Thread(target=_keep_pruning, args=(limits, unix_s, running), name="retention", daemon=True).start()


def _keep_pruning(limits: RecordingConfig, unix_s: Callable[[], float], running: Path) -> None:
    pause = threading.Event()
    while True:
        try:
            if pruned := prune(running, limits, unix_s()):
                print(f"truearc run: [recording]: telemetry and images of {len(pruned)} earlier sessions deleted, up "
                      f"to {pruned[-1].name}", file=sys.stderr, flush=True)
        except OSError as error:      # recording goes on; the next look may succeed
            print(f"truearc run: [recording]: earlier sessions were not deleted: {error}", file=sys.stderr, flush=True)
        pause.wait(LOOK_S)


def _folders(running: Path) -> list[Path]:
    try:
        with os.scandir(running.parent) as entries:
            return [Path(entry.path) for entry in entries
                    if entry.name != running.name and entry.is_dir(follow_symlinks=False)]
    except FileNotFoundError:
        return []


def _look(folder: Path) -> _Session | None:
    """The session in a folder; None when the folder holds none, or may not be looked into."""
    telemetry = folder / layout.TELEMETRY
    try:
        try:
            layout.load_header(folder)
        except InputError:            # of another program, or damaged as when the power fails
            known = ((layout.HEADER, layout.TELEMETRY), (layout.HEADER, layout.CONFIG, layout.CAN))
            if not any(all((folder / name).is_file() for name in names) for names in known):
                return None
        ended_s = (telemetry if telemetry.exists() else folder / layout.HEADER).stat().st_mtime
    except OSError:
        return None
    bulk = sum(_bytes(folder, name) for name in BULK)
    return _Session(ended_s, folder, bulk, sum(_bytes(folder, name) for name in _names(folder)) - bulk)


def _names(folder: Path) -> list[str]:
    return os.listdir(folder) if folder.is_dir() else []


def _bytes(folder: Path, name: str) -> int:
    """Of a file, or of all in a folder; 0 when it is not there or has gone meanwhile."""
    total = 0
    for at, _, files in [(str(folder), (), (name,)), *os.walk(folder / name)]:
        for file in files:
            try:
                stat = os.lstat(os.path.join(at, file))
            except FileNotFoundError:
                continue
            total += stat.st_size
    return total


def _delete_bulk(folder: Path) -> None:
    for name in BULK:
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif path.exists() or path.is_symlink():
            with contextlib.suppress(OSError):
                path.unlink()
