"""The fault matrix: every fault is injected on every bus, and the robot's reaction is judged.

    python -m benchmarks.fault_matrix [--bus virtual,slcan,socketcan] [--only PATTERN] [--out FILE] [--folder DIR]
    python -m benchmarks.fault_matrix --table FILE

Each row of benchmarks/matrix/rows.py is run on each available bus (socketcan: if vcan0 exists), by the robot's own code
with emulated devices: the robot fires, the fault begins, and then it is repaired. In rows whose names begin with
"motion" the robot fires nothing; they move the launcher of sim/world, and are judged by its torques, speeds and angles.
FILE has one line per row and bus; those that it already contains, and that were as stated, are not run again.
"""

import re
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.matrix.fault import Row
from benchmarks.matrix.judge import Result, judge
from benchmarks.matrix.play import play
from benchmarks.matrix.rows import ROWS
from benchmarks.options import read_options
from truearc_proof.parallel import append_line, lines_of
from truearc_proof.table import make_markdown

BUSES = ("virtual", "slcan", "socketcan")
VCAN = Path("/sys/class/net/vcan0")
TRIES = 3                             # in real time: a machine that stalls tells little of the robot


def run_row(row: Row, bus: str, folder: Path) -> Result:
    """Play and judge; in real time again where it went wrong, and the result says how often."""
    stepped = bus == "virtual" and not row.real
    for tries in range(1, TRIES + 1):
        place = folder / f"{ROWS.index(row)}-{bus}-{tries}"
        shutil.rmtree(place, ignore_errors=True)  # of a run that was cut short
        play(row, bus, place, stepped)
        result = judge(row, bus, stepped, place)
        result.tries = tries
        if not result.wrong:
            shutil.rmtree(place)
            break
        if stepped:
            break
    return result


def main() -> int:
    args = read_options(__doc__, bus=(",".join(BUSES), "comma-separated (default: all that there are)"),
        only=("", "a pattern: faults whose names match"), out=(Path, "a line a cell; goes on where it ended"),
        folder=(Path, "keep what went wrong here"), table=(Path, "print what is there, play nothing"))
    if args.table:
        results = load(args.table)
    else:
        if args.folder is not None:
            args.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=args.folder) as folder:
            results = _run_all(args, Path(args.folder or folder))
    print(make_table(results))
    return int(any(result.wrong for result in results))


def make_table(results: Sequence[Result]) -> str:
    """What went wrong, how many were played, and in Markdown how soon the slowest fault of each kind is a HOLD."""
    kinds: dict[str, list[Result]] = {}
    for result in results:
        kinds.setdefault(result.family, []).append(result)
    rows = []
    for kind, mine in kinds.items():
        held = [one.hold_s for one in mine if one.outcome == "HOLD" and one.hold_s is not None]
        rows.append((kind, str(len({one.fault for one in mine})), f"{max(held):.2f}" if held else "-"))
    wrong = [f"WRONG on {one.bus}: {one.fault}: {'; '.join(one.wrong)}" for one in results if one.wrong]
    fires, stale = (sum(getattr(one, name) for one in results) for name in ("fires", "stale"))
    told = (f"{len({one.fault for one in results})} faults, {len(results)} runs; {len(wrong)} runs deviated from the "
            f"stated reaction. {fires} ticks fired, {stale} of them on a stale reading.")
    return "\n".join([*wrong, told, "", make_markdown(("kind", "faults", "slowest HOLD, s"), rows)])


def load(path: Path) -> list[Result]:
    return [msgspec.convert(line, Result) for line in lines_of(path)]


def _run_all(args: Any, folder: Path) -> list[Result]:
    there = [result for result in load(args.out) if not result.wrong] if args.out and args.out.exists() else []
    if args.out:
        args.out.write_bytes(b"".join(msgspec.json.encode(result) + b"\n" for result in there))
    done = {(result.fault, result.bus) for result in there}
    buses = [bus for bus in args.bus.split(",") if bus != "socketcan" or VCAN.exists()]
    for row in (row for row in ROWS if re.search(args.only, row.name)):
        for bus in (bus for bus in buses if bus in row.buses and (row.name, bus) not in done):
            result = run_row(row, bus, folder)
            there.append(result)
            print(f"{bus:9} {row.name}: {'WRONG: ' + '; '.join(result.wrong) if result.wrong else result.outcome}",
                  file=sys.stderr, flush=True)
            if args.out:
                append_line(args.out, result)
    return there


if __name__ == "__main__":
    sys.exit(main())
