"""Fuzz test of every file reader: a damaged file must be refused with a message, or read without silent loss of rows.

    python -m benchmarks.fuzz --minutes N --seed S [--only WORD] [--case NAME:NUMBER] [--out FILE]

Each case damages one file (fuzz_mutators.py) and reads it (READERS) in a separate process, which is forked from one
that has imported the readers but neither JAX nor MuJoCo. A case fails if that process

- raises an exception other than the readers' own (`traceback`), or is ended by a signal (`crash`);
- uses more than LONGEST_S of processor time (`hang`) or more than MOST_BYTES of resident memory (`memory`);
- refuses the file without naming it (`nameless`);
- accepts the file with fewer rows than the original, without an additional warning (`lost`).

FILE has one JSON line per failed case; `--case` repeats one case and prints its output. The exit code is 1 if any case
fails.
"""

import contextlib
import faulthandler
import io
import json
import multiprocessing
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import NamedTuple

import msgspec

from benchmarks import fuzz_mutators
from benchmarks.options import read_options
from truearc.cli.common import SHIPPED
from truearc.errors import InputError
from truearc.robot.aim_file import load_aim
from truearc.robot.config.schema import CameraFile, load_config, load_toml
from truearc.robot.config.shot_map import load_map
from truearc.robot.gate import load_gate
from truearc.robot.recording.export import ExportRows
from truearc.robot.recording.files import parse_candump
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import Difference, replay_frames
from truearc.robot.recording.session import load_session_aims, load_session_config, load_trials
from truearc.robot.recording.upkeep import recover
from truearc.sim.data.files import load_dataset, load_rig
from truearc.sim.data.import_shots import import_shots
from truearc.sim.data.recordings import shots_from_sessions
from truearc.sim.printed import make_text
from truearc.sim.sysid.session import load_steps
from truearc.sim.video.frames import open_clip
from truearc.sim.video.track import watch
from truearc_frc import maps
from truearc_frc.wpilog import write_wpilog

LONGEST_S, PATIENCE_S = 15, 300.0     # of a core, where a case takes 0.1 s; and of the clock, for a busy computer
MOST_BYTES = 500_000_000              # resident; the imports alone are 110 MB
SPACE_BYTES = 4_000_000_000           # of addresses beyond those in use: asking for more fails
BAD = ("traceback", "crash", "hang", "memory", "nameless", "lost")
ROOT = Path(__file__).parents[1]
GATE = ROOT / "tests" / "golden" / "reference" / "export-physics" / "gate.onnx"
AIM = ROOT / "tests" / "robot" / "aim.json"
CLIPS = {"clip.mp4": "libx264", "clip.mov": "libx265", "clip.mkv": "libx264"}        # and codecs
Result = tuple[int, list[str]]        # rows, warnings


class Reader(NamedTuple):
    """`folder`: of the originals; `file`: in it, the one that is damaged; `kind`: how (fuzz_mutators.KINDS).

    count: rows that a damaged file could give, for a format that cannot say that a whole line is gone."""

    name: str
    folder: str
    file: str
    kind: str
    read: Callable[[Path], Result]
    count: Callable[[bytes], int] | None = None


def _lines(header: int) -> Callable[[bytes], int]:
    return lambda data: sum(bool(line.strip()) for line in data.split(b"\n")) - header


def _logs(home: Path, name: str) -> Result:
    dataset = import_shots([home / name], rig=home / "rig.toml")
    return len(dataset.shots), list(dataset.left_out)


def _shots(home: Path) -> Result:
    dataset = shots_from_sessions([home], "fuzz")
    return len(dataset.shots), list(dataset.left_out)


def _traces(home: Path) -> Result:
    dataset = shots_from_sessions([home], "fuzz")
    return 0 if dataset.traces is None else len(dataset.traces.t_s), list(dataset.left_out)


def _ticks(home: Path) -> Result:
    reader = TickReader(home)
    return sum(1 for _ in reader), [reader.cut_short] if reader.cut_short else []


def _convert(home: Path) -> Result:
    rows = ExportRows(home, lambda done, note: None)
    write_wpilog(rows, io.BytesIO())
    return rows.count, [rows.reader.cut_short] if rows.reader.cut_short else []


def _recover(home: Path) -> Result:
    """Recovered twice: a second time must change nothing, and every tick must be readable."""
    first = recover(home)
    again = recover(home)
    if again.repairs:
        raise AssertionError(f"recovered twice: {again.repairs}")
    rows, notes = _ticks(home)
    if notes or rows != first.ticks:
        raise AssertionError(f"recovered {first.ticks} ticks, read {rows}: {notes}")
    return first.ticks + len(load_trials(home)), first.repairs


def _can(home: Path) -> Result:
    repairs = recover(home).repairs
    lines = (home / "can0.log").read_text(encoding="ascii").splitlines(keepends=True)
    return sum(parse_candump(line) is not None for line in lines), repairs


def _replay(home: Path) -> Result:
    try:
        replayed, again = replay_frames(home)
    except Difference as error:
        raise InputError(f"{home}/can0.log: {error}") from error
    return replayed.ticks, [*([replayed.cut_short] if replayed.cut_short else []), str(again)]


def _header(home: Path) -> Result:
    load_session_config(home)
    load_session_aims(home)
    return _shots(home)


def _dataset(home: Path) -> Result:
    dataset = load_dataset(home)
    return len(dataset.shots) + (0 if dataset.tracks is None else len(dataset.tracks.t_s)), list(dataset.left_out)


def _none(load: Callable[[Path], object], name: str) -> Callable[[Path], Result]:
    def read(home: Path) -> Result:
        load(home / name)
        return 0, []
    return read


def _clip(home: Path, name: str) -> Result:
    """Rows are none: frames that a damaged stream lacks are gaps in time, not lost rows."""
    watch(open_clip(home / name))
    return 0, []


READERS = (
    Reader("wpilog", "logs", "log.wpilog", "wpilog", lambda home: _logs(home, "log.wpilog")),
    Reader("wpilog stranger", "logs", "stranger.wpilog", "wpilog", lambda home: _logs(home, "stranger.wpilog")),
    Reader("wpilog no feeder", "logs", "plain.wpilog", "wpilog", lambda home: _logs(home, "plain.wpilog")),
    Reader("mcap ticks", "session", "telemetry.mcap", "mcap", _ticks),
    Reader("mcap import", "session", "telemetry.mcap", "mcap", _traces),
    Reader("mcap convert", "session", "telemetry.mcap", "mcap", _convert),
    Reader("mcap recover", "session", "telemetry.mcap", "mcap", _recover),
    Reader("csv log", "logs", "log.csv", "lines", lambda home: _logs(home, "log.csv")),
    Reader("csv list", "logs", "list.csv", "lines", lambda home: _logs(home, "list.csv")),
    Reader("csv table", "tables", "table.csv", "lines", lambda home: _logs(home, "table.csv"), _lines(1)),
    Reader("csv dataset", "dataset", "shots.csv", "lines", _dataset),
    Reader("csv tracks", "dataset", "tracks.csv", "lines", _dataset, lambda data: 30 + _lines(1)(data)),
    Reader("csv steps", "tables", "steps.csv", "lines", lambda home: (len(load_steps(home / "steps.csv").effort), []),
           _lines(1)),
    Reader("parquet", "parquet", "shots.parquet", "bytes", _dataset),
    Reader("toml launcher", "toml", "launcher.toml", "toml", _none(load_config, "launcher.toml")),
    Reader("toml rig", "toml", "rig.toml", "toml", _none(load_rig, "rig.toml")),
    Reader("toml map", "toml", "shots.toml", "toml", _none(load_map, "shots.toml")),
    Reader("toml camera", "toml", "camera.toml", "toml", _none(partial(load_toml, kind=CameraFile), "camera.toml")),
    Reader("candump recover", "session", "can0.log", "lines", _can, _lines(0)),
    Reader("candump replay", "session", "can0.log", "lines", _replay),
    Reader("trials", "session", "trials.jsonl", "lines", _shots),
    Reader("trials recover", "session", "trials.jsonl", "lines", _recover),
    Reader("session header", "session", "session.json", "json", _header),
    Reader("session config", "session", "config.json", "json", _header),
    Reader("session index", "session", "frames/frames.jsonl", "lines", _recover),
    Reader("session aim", "toml", "aim.json", "json", _none(load_aim, "aim.json")),
    Reader("onnx", "toml", "gate.onnx", "bytes", _none(load_gate, "gate.onnx")),
    Reader("onnx resealed", "toml", "gate.onnx", "onnx", _none(load_gate, "gate.onnx")),
    Reader("json film", "dataset", "film.json", "json", _dataset),
    *(Reader(f"clip {name}", "clips", name, "bytes", partial(_clip, name=name)) for name in CLIPS),
)


def make_originals(home: Path) -> None:
    """Small files of each kind, the same on every run; for a process of its own, as it imports what the fuzzer may not.
    """
    from tests.sim.data.stranger_log import write_stranger_log
    from tests.sim.video.film import Scene, Throw, film
    from truearc.sim.data.dataset import Film
    from truearc.sim.data.files import save_rig
    from truearc.sim.world.emulated_robot import emulate

    config = load_config(SHIPPED)
    emulate(config, home / "session", trials=3, seed=3)
    logs, tables, dataset, parquet, toml = (home / name for name in ("logs", "tables", "dataset", "parquet", "toml"))
    for folder in (logs, tables, dataset, parquet, toml):
        folder.mkdir()
        save_rig(folder / "rig.toml", config.rig)
    with (logs / "log.wpilog").open("wb") as file:
        write_wpilog(ExportRows(home / "session", lambda done, note: None), file)
    write_stranger_log(home / "session", logs / "stranger.wpilog", every=2)
    write_stranger_log(home / "session", logs / "plain.wpilog", feeder=False, every=2)
    _write_csv_logs(logs)
    _write_tables(tables, dataset, parquet)
    shutil.copy(SHIPPED, toml / "launcher.toml")
    text = SHIPPED.read_text(encoding="utf-8")
    parts = {part.partition("]")[0]: f"[{part}" for part in text.split("\n[")}
    (toml / "camera.toml").write_text("\n".join(part for name, part in parts.items()
                                                if name in ("camera", "tape", "vision")), encoding="utf-8")
    shutil.copy(Path(maps.__file__).parent / "truearc.toml", toml / "shots.toml")
    shutil.copy(GATE, toml / "gate.onnx")
    shutil.copy(AIM, toml / "aim.json")
    places = {f"s{k}": ((100.0, 0.0), (0.0, -100.0), (50.0, 300.0)) for k in range(9)}
    picture = Film(b"no picture is decoded here", places)
    (dataset / "film.json").write_bytes(msgspec.json.encode(picture))
    clips = home / "clips"
    clips.mkdir()
    for name, codec in CLIPS.items():
        film(clips / name, [Throw(0.1, 0.5, 20.0, 60.0, 180.0, -110.0, 540.0)], 0.6, Scene(160, 96, 30.0), codec=codec)


def _write_csv_logs(logs: Path) -> None:
    """What AdvantageScope exports of the stranger's log: a list, and a table."""
    from truearc_frc.wpilog import read_wpilog
    log = read_wpilog(logs / "stranger.wpilog")
    rows = sorted((t_s, name, value) for name, series in log.items()
                  for t_s, value in zip(series.t_s.tolist(), series.values, strict=True))
    (logs / "list.csv").write_text("Timestamp,Key,Value\n" + "".join(f"{t_s},{name},{value}\n"
                                                                     for t_s, name, value in rows), encoding="utf-8")
    table, newest = ["Timestamp," + ",".join(log)], dict.fromkeys(log, "")
    for number, (t_s, name, value) in enumerate(rows):
        newest[name] = str(value)
        if number + 1 == len(rows) or rows[number + 1][0] != t_s:
            table.append(f"{t_s}," + ",".join(newest.values()))
    (logs / "log.csv").write_text("\n".join(table) + "\n", encoding="utf-8")


def _write_tables(tables: Path, dataset: Path, parquet: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq
    shots = ["shot_id,distance_m,hood_deg,motor_ratio,outcome,side,session"]
    tracks = ["shot_id,t_s,x_m,y_m,z_m"]
    table = ["Shot,Distance (m),Hood angle (deg),Flywheel RPM,Result"]
    for k in range(30):
        distance_m, hood_deg, ratio = 2.0 + 0.1 * k, 60.0 - k, 0.4 + 0.01 * k
        shots.append(f"s{k},{distance_m:.1f},{hood_deg:.1f},{ratio:.2f},{('two', 'three', 'miss')[k % 3]},"
                     f"{'low' if k % 3 == 2 else ''},day{k // 10}")
        table.append(f"{k + 1},{distance_m:.1f},{hood_deg:.1f},{5700 * ratio:.0f},{('two', 'miss')[k % 2]}")
        tracks += [f"s{k},{0.05 * n:.2f},{0.3 * n:.2f},0.0,{0.6 + 0.2 * n - 0.01 * n * n:.3f}" for n in range(1, 6)]
    (dataset / "shots.csv").write_text("\n".join(shots) + "\n", encoding="utf-8")
    (dataset / "tracks.csv").write_text("\n".join(tracks) + "\n", encoding="utf-8")
    (tables / "table.csv").write_text("\n".join(table) + "\n", encoding="utf-8")
    (tables / "steps.csv").write_text("t_s,applied_V,speed_rad_s\n" + "".join(
        f"{0.01 * k:.2f},{6.0 if k < 80 else 0.0},{2.0 * k:.1f}\n" for k in range(100)), encoding="utf-8")
    cells = [row.split(",") for row in shots]
    columns = {name: [row[k] for row in cells[1:]] for k, name in enumerate(cells[0])}
    pq.write_table(pa.table({name: [float(cell) for cell in column] if name in (
        "distance_m", "hood_deg", "motor_ratio") else column for name, column in columns.items()}),
        parquet / "shots.parquet")


class Read(msgspec.Struct):
    """What reading one file gave: `said` is the refusal, or the exception's own text."""

    how: str                          # accepted | refused | one of BAD
    rows: int = 0
    notes: list[str] = []
    said: str = ""


def run_case(reader: Reader, originals: Path, data: bytes) -> Read:
    """Read `data` in place of the reader's file, in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="fuzz") as folder:
        home = Path(folder) / "made"
        shutil.copytree(originals / reader.folder, home)
        (home / reader.file).write_bytes(data)
        return _in_child(reader, home)


def _in_child(reader: Reader, home: Path) -> Read:
    ours, theirs = os.pipe()
    began, child = time.monotonic(), os.fork()
    if child == 0:
        os.close(ours)
        _child(reader, home, theirs)
    os.close(theirs)
    said = b""
    while (left := began + PATIENCE_S - time.monotonic()) > 0 and select.select([ours], [], [], left)[0]:
        more = os.read(ours, 1 << 16)
        if not more:
            break
        said += more
    else:
        os.kill(child, signal.SIGKILL)
    os.close(ours)
    _, status, used = os.wait4(child, 0)
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        return Read("hang")
    if not said or os.WIFSIGNALED(status):
        return Read("crash", said=f"status {status}")
    got = msgspec.json.decode(said, type=Read)
    if (peak := used.ru_maxrss * 1e3) > MOST_BYTES:
        got.how, got.said = "memory", f"{peak / 1e6:.0f} MB, {got.how}: {got.said}"
    return got


def _child(reader: Reader, home: Path, pipe: int) -> None:
    """Never returns. Printed lines are warnings, too."""
    faulthandler.disable()
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S + 5))
    resource.setrlimit(resource.RLIMIT_AS, (now + SPACE_BYTES, now + SPACE_BYTES))
    printed = io.StringIO()
    with contextlib.redirect_stderr(printed), contextlib.redirect_stdout(io.StringIO()):
        try:
            rows, notes = reader.read(home)
            got = Read("accepted", rows, [*notes, *printed.getvalue().splitlines()])
        except InputError as error:
            got = Read("refused" if str(home) in str(error) else "nameless", said=str(error))
        except OSError as error:      # the command line says these, too
            got = Read("refused" if error.filename else "traceback", said=f"{error.filename}: {error}")
        except BaseException:
            got = Read("traceback", said=traceback.format_exc())
    with os.fdopen(pipe, "wb") as file:
        got.said = got.said.replace(str(home), "")[-4000:].encode("utf-8", "replace").decode()
        got.notes = [note.replace(str(home), "").encode("utf-8", "replace").decode()[:500] for note in got.notes[:50]]
        file.write(msgspec.json.encode(got))
    os._exit(0)


class Fuzz:
    """The originals, what reading them gives, and damaged ones."""

    def __init__(self, originals: Path, seed: int, only: str) -> None:
        self.seed, self.originals = seed, originals
        self.readers = [reader for reader in READERS if only in reader.name]
        self.data = {reader.name: (originals / reader.folder / reader.file).read_bytes() for reader in self.readers}
        self.first = {reader.name: run_case(reader, originals, self.data[reader.name]) for reader in self.readers}
        for name, read in self.first.items():
            if read.how != "accepted":
                raise SystemExit(f"{name}: the original itself: {read.how}: {read.said}")

    def run(self, reader: Reader, number: int) -> tuple[str, bytes, Read]:
        """How a file is damaged, the same for the same seed and number; the file; and what reading it gives."""
        random, original = Random(f"{self.seed} {reader.name} {number}"), self.first[reader.name]
        how, data = fuzz_mutators.damage(self.data[reader.name], reader.kind, random)
        got = run_case(reader, self.originals, data)
        least = min(original.rows, original.rows if reader.count is None else reader.count(data))
        if got.how == "accepted" and got.rows < least and not set(got.notes) - set(original.notes):
            got.how, got.said = "lost", f"{got.rows} rows of {least}"
        return how, data, got


def main() -> int:
    args = read_options(__doc__, minutes=1.0, seed=1, only=("", "readers whose name has this word in it"),
                        case=("", "NAME:NUMBER, one case; --out takes the damaged file"), out=Path)
    name, _, number = args.case.partition(":")
    with tempfile.TemporaryDirectory(prefix="originals") as folder:
        maker = multiprocessing.get_context("spawn").Process(target=make_originals, args=(Path(folder),))
        maker.start()
        maker.join()
        fuzz = Fuzz(Path(folder), args.seed, name or args.only)
        if not args.case:
            return _run_all(fuzz, args.minutes, args.out or Path(os.devnull))
        how, data, got = fuzz.run(fuzz.readers[0], int(number))
        if args.out:
            args.out.write_bytes(data)
        print(how, *(json.dumps(msgspec.to_builtins(read), indent=1).replace("\\n", "\n")
                     for read in (fuzz.first[fuzz.readers[0].name], got)), sep="\n")
        return int(got.how in BAD)


def _run_all(fuzz: Fuzz, minutes: float, path: Path) -> int:
    """A case of each reader in turn, until the time is up."""
    until, counts, number = time.monotonic() + 60.0 * minutes, Counter[tuple[str, str]](), 0
    with path.open("a", encoding="utf-8") as out:
        while not number or time.monotonic() < until:
            for reader in fuzz.readers:
                how, _, got = fuzz.run(reader, number)
                counts[reader.name, got.how] += 1
                if got.how in BAD:
                    line = {"seed": fuzz.seed, "case": f"{reader.name}:{number}", "damage": how,
                            **msgspec.to_builtins(got)}
                    print(f"{line['case']}: {got.how}: {how}: {got.said.strip().splitlines()[-1:]}", file=sys.stderr)
                    print(json.dumps(line), file=out, flush=True)
            number += 1
    bad = sum(count for (_, how), count in counts.items() if how in BAD)
    rows = [(reader.name, *(str(counts[reader.name, how]) for how in ("refused", "accepted", *BAD)))
            for reader in fuzz.readers]
    print(*make_text(("reader", "refused", "accepted", *BAD), rows, right=range(1, 3 + len(BAD))),
          f"seed {fuzz.seed}: {counts.total()} cases, {bad} bad", sep="\n")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
