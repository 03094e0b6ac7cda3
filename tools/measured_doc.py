"""Results of benchmarks on the site, put between marks.

    python -m tools.measured_doc                        brings every page up to date with its result files
    python -m tools.measured_doc --run NAME COMMAND     runs `python -m ...` or `truearc ...`, keeps what it prints

`<!-- result: NAME -->` stands for a table of RESULTS or for docs/measured/results/NAME.txt, which --run writes: the
command, the commit and the date, then what was printed. `<!-- result: NAME: PATTERN -->` shows the lines alone that
match. What has a table of Markdown is shown as such, all else as it was printed. FILE in a command is where it keeps
rows: results/NAME.jsonl, of which results/NAME.jsonl.xz is committed. `benchmarks.proof --posterior --write` fills
docs/measured/sealed.md in the same way.
"""

import argparse
import lzma
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path

from benchmarks import demo_seeds, fault_matrix, scale
from benchmarks.matrix.judge import Result
from benchmarks.proof import load
from truearc_proof.report.tables import make_tables
from truearc_proof.report.targets import posterior_rows
from truearc_proof.rounds.jsonl_store import lines_of
from truearc_proof.table import make_markdown

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
MEASURED = DOCS / "measured"
KEPT = MEASURED / "results"
MARKS = re.compile(r"(<!-- result: (\w+)(?:: (.+?))? -->\n).*?(<!-- end -->)", re.DOTALL)

def demo() -> str:
    """Threes before and after adoption, over the seeds of the demo."""
    said = demo_seeds.make_table(list(lines_of(MEASURED / "demo_seeds-6000.jsonl.xz")))
    return f"\n```text\n{said.partition(chr(10) + 'threes before -> after')[0]}\n```\n"

def screen() -> str:
    """Shares that the screen of thousands of worlds finds."""
    return f"\n```text\n{scale.make_table(list(lines_of(MEASURED / 'scale-900.jsonl.xz')))}\n```\n"

def sealed() -> str:
    """Targets of the posterior at each level of data, side by side; bold where a target is missed."""
    rounds = sorted(map(load, sorted((MEASURED / "sealed").glob("*.tar.xz"))), key=lambda one: one.setting)
    levels = {setting[0]: posterior_rows([one.first for packed in group for one in packed.graded])
              for setting, group in groupby(rounds, key=lambda one: one.setting)}
    rows: dict[str, list[str]] = {}
    for cells in levels.values():
        for figure, here, wanted, reached in cells:
            here = re.sub(r" \([^)]*-[^)]*\)", "", here)
            here = f"**{here}**" if reached.startswith("NOT") else here
            rows.setdefault(figure, []).append(f"{here} ({wanted})" if wanted != "-" else here)
    return "\n" + make_markdown(("figure (wanted)", *levels), [[figure, *here] for figure, here in rows.items()]) + "\n"

def rivals() -> str:
    """What other methods say of the round that they were put to."""
    marks = [one.first for one in load(MEASURED / "sealed" / "L2d.tar.xz").graded]
    table = next(one for one in make_tables(marks) if one.title.startswith("Beside others"))
    return f"\n{make_markdown(table.header[:-1], [row[:-1] for row in table.rows])}\n"

def fault_kinds() -> str:
    """Faults by kind: how soon the slowest of each kind is a HOLD."""
    kinds: dict[str, list[Result]] = {}
    for result in fault_matrix.load(KEPT / "fault_matrix.jsonl.xz"):
        kinds.setdefault(result.family, []).append(result)
    rows = []
    for kind, mine in kinds.items():
        held = [one.hold_s for one in mine if one.outcome == "HOLD" and one.hold_s is not None]
        rows.append((kind, str(len({one.fault for one in mine})), f"{max(held):.2f}" if held else "-"))
    every = [one for mine in kinds.values() for one in mine]
    wrong = sum(bool(one.wrong) for one in every)
    fires, stale = (sum(getattr(one, name) for one in every) for name in ("fires", "stale"))
    return ("\n`python -m benchmarks.fault_matrix --bus virtual,slcan --out FILE`, commit 2b58f989, 2026-11-28:\n\n"
            f"{len({one.fault for one in every})} faults, {len(every)} runs, {wrong} of them not as stated; "
            f"{fires} ticks fired, {stale} of these on a reading that was too old.\n\n"
            + make_markdown(("kind", "faults", "slowest HOLD, s"), rows) + "\n")

RESULTS: dict[str, Callable[[], str]] = {"demo": demo, "faults": fault_kinds, "rivals": rivals,
                                         "screen": screen, "sealed": sealed}

def fill(page: str) -> str:
    """Return a page with every result between its marks brought up to date."""
    return MARKS.sub(lambda found: f"{found[1]}{_result(found[2], found[3])}{found[4]}", page)

def _result(name: str, pattern: str | None) -> str:
    return RESULTS[name]() if name in RESULTS else show((KEPT / f"{name}.txt").read_text(encoding="utf-8"), pattern)

def show(kept: str, pattern: str | None = None) -> str:
    """Markdown of one result file: the command, commit and date, and what was printed, or its lines that match."""
    head, _, printed = kept.partition("\n\n")
    command, made = head.split("\n")
    lines = [line for line in printed.splitlines() if pattern is None or not line or re.search(pattern, line)]
    body = re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip("\n")
    markdown = re.search(r"^\|---", body, re.MULTILINE)
    return f"\n`{command}`, {made}:\n\n" + (f"{body}\n" if markdown else f"```text\n{body}\n```\n")

def keep(name: str, command: str) -> None:
    """Run a command in the root of the repository; write its result file. CalledProcessError where it fails."""
    rows = KEPT / f"{name}.jsonl"
    program, *words = (str(rows) if word == "FILE" else word for word in shlex.split(command))
    words = [sys.executable, *(["-m", "truearc"] if program == "truearc" else []), *words]
    printed = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    commit = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE, text=True,
                            check=True).stdout.strip()
    changed = subprocess.run(["git", "diff", "--quiet", "HEAD", "--", "*.py"], cwd=ROOT, check=False).returncode
    write_kept(name, command, f"commit {commit}{' with changes' * changed}, {datetime.now(UTC):%Y-%m-%d}", printed)
    if rows.exists():
        rows.with_suffix(".jsonl.xz").write_bytes(lzma.compress(rows.read_bytes(), preset=9))
        rows.unlink()

def write_kept(name: str, command: str, made: str, printed: str) -> None:
    """The result file of a command."""
    KEPT.mkdir(exist_ok=True)
    lines = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines())
    (KEPT / f"{name}.txt").write_text(f"{command}\n{made}\n\n{lines}\n", encoding="utf-8")

def main() -> None:
    """Bring the pages of the site up to date, after a run if one is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", nargs=2, metavar=("NAME", "COMMAND"))
    args = parser.parse_args()
    if args.run:
        keep(*args.run)
    for path in DOCS.rglob("*.md"):
        page = path.read_text(encoding="utf-8")
        if MARKS.search(page):
            path.write_text(fill(page), encoding="utf-8")

if __name__ == "__main__":
    main()
