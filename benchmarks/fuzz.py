"""Damaged files into every reader: is each one refused with a sentence, or read without losing rows in silence?

    python -m benchmarks.fuzz --minutes N --seed S [--only WORD] [--case NAME:NUMBER] [--out FILE]

Each case damages one file (fuzz_mutators.py) and reads it (fuzz_readers.py) in a process of its own, forked from one
that has imported the readers and neither JAX nor MuJoCo. A case is bad when that process ends by an exception other
than the readers' own (`traceback`), by a signal (`crash`), not within LONGEST_S of a core (`hang`), with more than
MOST_BYTES resident (`memory`); when a refusal does not name the file (`nameless`); and when the file is accepted with
fewer rows than the original and no line of warning that the original does not have (`lost`). FILE has one JSON line for
each bad case; `--case` runs one again and prints what it gives. Exit 1 when there is a bad one.
"""

import argparse
import contextlib
import faulthandler
import io
import json
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
from pathlib import Path
from random import Random
from typing import NamedTuple

import msgspec

from benchmarks import fuzz_mutators, fuzz_readers
from benchmarks.fuzz_readers import READERS, Reader
from truearc.errors import InputError

LONGEST_S, PATIENCE_S = 15, 300.0     # of a core, where a case takes 0.1 s; and of the clock, for a busy computer
MOST_BYTES = 500_000_000              # resident; the imports alone are 110 MB
SPACE_BYTES = 4_000_000_000           # of addresses beyond those in use: asking for more fails
BAD = ("traceback", "crash", "hang", "memory", "nameless", "lost")


class Read(msgspec.Struct):
    """What reading one file gave: `said` is the refusal, or the exception's own text."""

    how: str                          # accepted | refused | one of BAD
    rows: int = 0
    notes: list[str] = []
    said: str = ""
    peak_mb: float = 0.0
    seconds: float = 0.0


class Case(NamedTuple):
    """One damaged file: which reader, which number; `how` it was damaged."""

    reader: str
    number: int
    how: str
    data: bytes


def make_case(reader: Reader, data: bytes, seed: int, number: int) -> Case:
    """The same for the same seed and number."""
    random = Random(f"{seed} {reader.name} {number}")
    how, damaged = fuzz_mutators.damage(data, reader.kind, random)
    return Case(reader.name, number, how, damaged)


def judge(case: Case, reader: Reader, got: Read, original: Read) -> Read:
    """`got`, with what is bad about it as `how`."""
    least = min(original.rows, original.rows if reader.count is None else reader.count(case.data))
    if got.how == "accepted" and got.rows < least and not set(got.notes) - set(original.notes):
        return msgspec.structs.replace(got, how="lost", said=f"{got.rows} rows of {least}")
    return got


def run_case(reader: Reader, originals: Path, data: bytes) -> Read:
    """Read `data` in place of the reader's file, in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="fuzz") as folder:
        home = Path(folder) / "made"
        shutil.copytree(originals / reader.folder, home)
        (home / reader.file).write_bytes(data)
        return _in_child(reader, home)


def _in_child(reader: Reader, home: Path) -> Read:
    ours, theirs = os.pipe()
    began = time.monotonic()
    child = os.fork()
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
    seconds, peak_mb = used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        return Read("hang", peak_mb=peak_mb, seconds=seconds)
    if not said or os.WIFSIGNALED(status):
        return Read("crash", said=f"status {status}", peak_mb=peak_mb, seconds=seconds)
    got = msgspec.json.decode(said, type=Read)
    got.peak_mb, got.seconds = peak_mb, seconds
    if peak_mb * 1e6 > MOST_BYTES:
        got.how, got.said = "memory", f"{peak_mb:.0f} MB, {got.how}: {got.said}"
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
    """Cases of every reader, as much time for each of them, and what was bad."""

    def __init__(self, originals: Path, seed: int, only: str = "") -> None:
        self.seed, self.originals = seed, originals
        self.readers = [reader for reader in READERS if only in reader.name]
        self.data = {reader.name: (originals / reader.folder / reader.file).read_bytes() for reader in self.readers}
        self.first = {reader.name: run_case(reader, originals, self.data[reader.name]) for reader in self.readers}
        for name, read in self.first.items():
            if read.how != "accepted":
                raise SystemExit(f"{name}: the original itself: {read.how}: {read.said}")
        self.counts: dict[str, Counter[str]] = {reader.name: Counter() for reader in self.readers}
        self.peak_mb: dict[str, float] = dict.fromkeys(self.counts, 0.0)
        self.longest_s: dict[str, float] = dict.fromkeys(self.counts, 0.0)
        self.spent_s: dict[str, float] = dict.fromkeys(self.counts, 0.0)

    def next(self) -> tuple[Case, Read]:
        """The next case of the reader that has had the least time."""
        reader = min(self.readers, key=lambda one: self.spent_s[one.name])
        case, got = self.run(reader, self.counts[reader.name].total())
        self.spent_s[reader.name] += got.seconds
        return case, got

    def run(self, reader: Reader, number: int) -> tuple[Case, Read]:
        case = make_case(reader, self.data[reader.name], self.seed, number)
        got = judge(case, reader, run_case(reader, self.originals, case.data), self.first[reader.name])
        self.counts[reader.name][got.how] += 1
        self.peak_mb[reader.name] = max(self.peak_mb[reader.name], got.peak_mb)
        self.longest_s[reader.name] = max(self.longest_s[reader.name], got.seconds)
        return case, got

    def table(self) -> str:
        lines = [f"{'reader':18}{'cases':>8}{'refused':>9}{'accepted':>10}{'bad':>6}{'peak MB':>9}{'longest s':>16}"]
        for name, counts in self.counts.items():
            bad = sum(counts[how] for how in BAD)
            lines.append(f"{name:18}{counts.total():8}{counts['refused']:9}{counts['accepted']:10}{bad:6}"
                         f"{self.peak_mb[name]:9.0f}{self.longest_s[name]:16.2f}")
        return "\n".join(lines)


def main() -> int:
    args = _arguments()
    with tempfile.TemporaryDirectory(prefix="originals") as folder:
        fuzz_readers.make_originals(Path(folder))
        fuzz = Fuzz(Path(folder), args.seed, args.case.partition(":")[0] if args.case else args.only)
        if args.case:
            case, got = fuzz.run(fuzz.readers[0], int(args.case.partition(":")[2]))
            if args.out:
                args.out.write_bytes(case.data)
            print(case.how, json.dumps(msgspec.to_builtins(fuzz.first[case.reader]), indent=1),
                  json.dumps(msgspec.to_builtins(got), indent=1).replace("\\n", "\n"), sep="\n")
            return int(got.how in BAD)
        return _run_all(fuzz, args)


def _run_all(fuzz: Fuzz, args: argparse.Namespace) -> int:
    until, bad = time.monotonic() + 60.0 * args.minutes, 0
    with contextlib.ExitStack() as stack:
        out = stack.enter_context(args.out.open("a", encoding="utf-8")) if args.out else None
        while time.monotonic() < until or not all(fuzz.spent_s.values()):
            case, got = fuzz.next()
            if got.how not in BAD:
                continue
            bad += 1
            line = {"seed": fuzz.seed, "case": f"{case.reader}:{case.number}", "damage": case.how,
                    **msgspec.to_builtins(got)}
            print(f"{line['case']}: {got.how}: {case.how}: {got.said.strip().splitlines()[-1:]}", file=sys.stderr)
            if out is not None:
                print(json.dumps(line), file=out, flush=True)
    print(fuzz.table())
    print(f"seed {fuzz.seed}: {sum(counts.total() for counts in fuzz.counts.values())} cases, {bad} bad, "
          f"{sum(fuzz.spent_s.values()) / 60.0:.1f} minutes of a core in their processes")
    return int(bad > 0)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="readers whose name has this word in it")
    parser.add_argument("--case", default="", metavar="NAME:NUMBER", help="one case; --out takes the damaged file")
    parser.add_argument("--out", type=Path, metavar="FILE")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
