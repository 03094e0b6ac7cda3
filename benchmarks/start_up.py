"""How long `truearc COMMAND --help` and `import truearc` take: medians, and ratios to `python -c pass`.

    python -m benchmarks.start_up [--repeats N] [--command NAME ...]

The ratio is what to compare between machines and between loads; each round times every entry once, in turn, so that a
load that comes and goes falls on all of them. CPU time counts user and system time of the process.
"""

import argparse
import os
import subprocess
import sys
import time
from statistics import median

from truearc.cli.main import list_commands

EMPTY = "python -c pass"


def measure(argv: list[str]) -> tuple[float, float]:
    """Wall and CPU time of one process, s."""
    before, began = os.times(), time.perf_counter()
    subprocess.run(argv, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - began, cpu_s


def plan(names: list[str]) -> dict[str, list[str]]:
    """What to run, by the name it has in the table."""
    commands = {f"truearc {name} --help": [sys.executable, "-m", "truearc", *name.split(), "--help"] for name in names}
    return {EMPTY: [sys.executable, "-c", "pass"], "import truearc": [sys.executable, "-c", "import truearc"],
            "truearc --help": [sys.executable, "-m", "truearc", "--help"], **commands}


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the help of every command.")
    parser.add_argument("--repeats", type=int, default=9, help="processes per entry (default %(default)s)")
    parser.add_argument("--command", action="append", help="only this command; may be given several times")
    args = parser.parse_args()
    runs = plan(args.command or [command.name for command in list_commands()])
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    for _ in range(args.repeats):
        for name, argv in runs.items():
            times[name].append(measure(argv))
    empty_s = median(wall_s for wall_s, _ in times[EMPTY])
    print(f"| {args.repeats} processes each | wall, median [s] | CPU, median [s] | wall / `{EMPTY}` |")
    print("|---|---|---|---|")
    for name, measured in times.items():
        wall_s, cpu_s = (median(column) for column in zip(*measured, strict=True))
        print(f"| `{name}` | {wall_s:.3f} | {cpu_s:.3f} | {wall_s / empty_s:.1f} |")


if __name__ == "__main__":
    main()
