"""Tables of docs/measured that follow from result files, put between marks: `python -m tools.measured_doc`.

`benchmarks.proof --posterior --write` fills docs/measured/sealed.md in the same way.
"""

import re
from collections.abc import Callable
from itertools import groupby
from pathlib import Path

from benchmarks import demo_seeds, naming_rules, scale
from benchmarks.proof import load
from truearc_proof.report.posterior_targets import posterior_rows
from truearc_proof.rounds.jsonl_store import lines_of
from truearc_proof.table import make_markdown

MEASURED = Path(__file__).resolve().parents[1] / "docs" / "measured"
MARKS = re.compile(r"(<!-- result: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

def demo() -> str:
    """Threes before and after adoption, over the seeds of the demo."""
    said = demo_seeds.make_table(list(lines_of(MEASURED / "demo_seeds-6000.jsonl.xz")))
    return f"\n```text\n{said.partition(chr(10) + 'threes before -> after')[0]}\n```\n"

def screen() -> str:
    """Shares that the screen of thousands of worlds finds."""
    return f"\n```text\n{scale.make_table(list(lines_of(MEASURED / 'scale-900.jsonl.xz')))}\n```\n"

def rules() -> str:
    """What each rule of naming beside the posterior earns in development worlds."""
    return f"\n```text\n{naming_rules.make_table(list(lines_of(MEASURED / 'naming_rules.jsonl.xz')))}\n```\n"

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

RESULTS: dict[str, Callable[[], str]] = {"demo": demo, "rules": rules, "screen": screen, "sealed": sealed}

def fill(page: str) -> str:
    """Return a page with every result between its marks brought up to date."""
    return MARKS.sub(lambda found: f"{found[1]}{RESULTS[found[2]]()}{found[3]}", page)

def main() -> None:
    """Bring the pages of docs/measured up to date."""
    for path in MEASURED.glob("*.md"):
        page = path.read_text(encoding="utf-8")
        if MARKS.search(page):
            path.write_text(fill(page), encoding="utf-8")

if __name__ == "__main__":
    main()
