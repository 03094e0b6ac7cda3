"""Damaged files into every reader: is each one refused with a sentence, or read without losing rows in silence?

    python -m benchmarks.fuzz --minutes N --seed S [--only WORD] [--case NAME:NUMBER] [--out FILE]

Each case damages one file (fuzz_mutators.py) and reads it (fuzz_readers.py) in a process of its own, forked from one
that has imported the readers and neither JAX nor MuJoCo. A case is bad when that process ends by an exception other
than the readers' own (`traceback`), by a signal (`crash`), not within LONGEST_S of a core (`hang`), with more than
MOST_BYTES resident (`memory`); when a refusal does not name the file (`nameless`); and when the file is accepted with
fewer rows than the original and no line of warning that the original does not have (`lost`). FILE has one JSON line for
each bad case; `--case` runs one again and prints what it gives. Exit 1 when there is a bad one.
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
from pathlib import Path
from random import Random

import msgspec

from benchmarks import fuzz_mutators
from benchmarks.fuzz_readers import READERS, Reader, make_originals
from benchmarks.options import read_options
from truearc.errors import InputError
from truearc.sim.printed import make_text

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
