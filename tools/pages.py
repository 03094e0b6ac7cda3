"""Generator of pages that restate code or results: `python -m tools.pages [NAME ...]`; all pages without a name.

    python -m tools.pages reasons --drivers samplemotor     also prints the reasons of other motor drivers
    python -m tools.pages --run NAME COMMAND                runs `python -m ...` or `truearc ...` and stores its output

Generated text stands between `<!-- made: NAME -->` or `<!-- result: NAME -->` and `<!-- end -->`. The names on pages of
docs/reference are: reference (commands and Python API); formats (files, from the structs and the comments beside their
fields, and truearc/schemas); reasons (codes and messages); terms. `measured` updates each page with results, which are
tables of MADE or entries of docs/measured/results/printed.txt. --run writes an entry: the command, commit and date,
then the output. `<!-- result: NAME: PATTERN -->` shows only the lines that match.
"""

import argparse
import inspect
import itertools
import json
import re
import shlex
import subprocess
import sys
from argparse import SUPPRESS, Action
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any

import truearc
from benchmarks import demo_seeds, fault_matrix
from benchmarks.proof import Packed, load, tell_posteriors
from tools import formats
from truearc.cli.main import COMMANDS, GROUPS, Command, load_plugins, make_parser
from truearc.errors import INSTALL_HINTS
from truearc.hw import fault_codes
from truearc.hw.devices.registry import find_family
from truearc.hw.reason import NESTED, OPTIONAL, Code, Message
from truearc.robot import reasons
from truearc.robot.operator_ui.view import MESSAGES
from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.physics.term import STAGES, Parameter, Term
from truearc_proof.parallel import lines_of
from truearc_proof.rounds.tables import make_tables, posterior_rows
from truearc_proof.table import make_markdown

ROOT = Path(__file__).resolve().parents[1]
REFERENCE, SCHEMAS = ROOT / "docs" / "reference", ROOT / "truearc" / "schemas"


# --- commands and Python API

UNLISTED = ("help", "quiet", "force")


def commands() -> str:
    """A table for each group of commands."""
    every = sorted((*COMMANDS, *(one for one in load_plugins() if one.distribution in INSTALL_HINTS)),
                   key=lambda one: [*GROUPS, one.group].index(one.group))
    lines = []
    for group, members in itertools.groupby(every, key=lambda one: one.group):
        about = f": {GROUPS[group]}" if group in GROUPS else ""
        lines += [f"\n## {group.capitalize()}{about}\n",
                  make_markdown(("command", "does", "arguments and options"), map(_command_row, members))]
    return "\n".join(lines)


def _command_row(command: Command) -> tuple[str, ...]:
    actions = [one for one in make_parser(command)._actions if one.help != SUPPRESS and one.dest not in UNLISTED]
    return f"`{command.name}`", command.summary, " ".join(map(_argument, actions))


def _argument(action: Action) -> str:
    metavar = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
    return f"`{action.option_strings[-1] if action.option_strings else metavar}`".replace("|", "\\|")


def public(is_call: bool) -> list[tuple[str, Any]]:
    """(name, value) of the Python API's functions, or of its classes and modules."""
    every = [(name, getattr(truearc, name)) for name in sorted(truearc.__all__, key=str.lower)]
    return [(name, value) for name, value in every if inspect.isroutine(value) == is_call]


def functions() -> str:
    return make_markdown(("call", "does"), [(f"`{name}({', '.join(inspect.signature(value).parameters)})`",
                                             _summary(value)) for name, value in public(True)])


def classes() -> str:
    return make_markdown(("name", "purpose", "members"), [
        (f"`{name}`", _summary(value), " ".join(f"`{member}`" for member in _members(value)))
        for name, value in public(False)])


def _summary(value: Any) -> str:
    return " ".join((inspect.getdoc(value) or "").partition("\n\n")[0].split()).replace("|", "\\|")


def _members(value: Any) -> Iterator[str]:
    """Public methods, properties and functions that a class or module defines itself, in their order."""
    if not inspect.isclass(value):
        yield from getattr(value, "__all__", ())
        return
    yield from (name for name, member in vars(value).items()
                if not name.startswith("_") and (inspect.isroutine(member) or isinstance(member, property)))


# --- reasons

def own_messages(drivers: Iterable[str]) -> list[Message]:
    """Reasons of motor drivers of other distributions."""
    return [message for driver in drivers for message in find_family(driver).messages]


def messages(drivers: Iterable[str] = ()) -> str:
    """What the operator's page says."""
    alike = itertools.groupby((*own_messages(drivers), *MESSAGES),
                              key=lambda one: (one.code.name, one.kind, one.means, one.do))
    return make_markdown(("code", "in case of", "kind", "the page says", "what to do"),
                         [_message_row(list(group)) for _, group in alike])


def codes(drivers: Iterable[str] = ()) -> str:
    every = (*reasons.CODES, *fault_codes.CODES, *(message.code for message in own_messages(drivers)))
    return make_markdown(("code", "log text", "more"), map(_code_row, every))


def reasons_page(drivers: Iterable[str] = ()) -> str:
    """Both tables, with the own reasons of these motor drivers."""
    return f"{messages(drivers)}\n\n{codes(drivers)}\n"


def _message_row(alike: list[Message]) -> tuple[str, ...]:
    """A row for messages of one code that differ in their case alone."""
    first = alike[0]
    means = _shown(first.means)
    cases = ", ".join(f"`{message.case}`" for message in alike if message.case)
    return f"`{first.code.name}`", cases, first.kind, means[:1].upper() + means[1:], _shown(first.do)


def _code_row(code: Code) -> tuple[str, ...]:
    text = _shown(code.text)
    more = ", ".join(f"`{name}{OPTIONAL if unit.endswith(OPTIONAL) else ''}`" for name, unit in code.params.items()
                     if unit.endswith(OPTIONAL) or f"‹{name}›" not in text)
    return f"`{code.name}`", text, more


def _shown(template: str) -> str:
    """A template for people: each field as its name in angle brackets, and what stands around it."""
    return "".join(literal + ("" if name is None else (spec if spec and NESTED in spec else NESTED).replace(
        NESTED, f"‹{name}›")) for literal, name, spec, _ in Formatter().parse(template))


# --- terms

TERMS_HEAD = ("term", "law", "parameter", "unit", "meaning", "believed before any data", "moves a shot",
              "needs in the data", "measured with")


def term_tables(terms: Iterable[Term] = BUILT_IN) -> str:
    """A table for each stage, terms in the order in which they act, a row for each parameter."""
    return "\n\n".join(f"### {stage.capitalize()}\n\n" + make_markdown(TERMS_HEAD, (
        [" ".join(cell.split()).replace("|", "\\|") for cell in row]
        for term in terms if term.stage == stage for row in _rows(term))) for stage in STAGES)


def _rows(term: Term) -> Iterator[list[str]]:
    law = (type(term).__doc__ or "").partition("\n\n")[0]
    about = [term.direction, term.record, term.instrument.what if term.instrument else ""]
    for number, one in enumerate(term.parameters):
        first = number == 0
        yield [f"`{term.name}`" if first else "", law if first else "", f"`{one.name}`", one.unit, one.meaning,
               _prior(one), *(about if first else ("", "", ""))]


def _prior(one: Parameter) -> str:
    if one.prior is None:
        return f"{one.default:g}, known"
    return f"{one.prior.centre:g} ± {one.prior.sd:g} ({one.prior.scale}): {one.prior.reason}"


# --- measured results

DOCS = ROOT / "docs"
MEASURED = DOCS / "measured"
KEPT = MEASURED / "results"
PRINTED = KEPT / "printed.txt"
MARKS = re.compile(r"(<!-- (?:made|result): (\w+)(?:: (.+?))? -->\n).*?(<!-- end -->)", re.DOTALL)


def demo() -> str:
    """Threes before and after adoption, over the seeds of the demo."""
    said = demo_seeds.make_table(list(lines_of(MEASURED / "demo_seeds-6000.jsonl.xz")))
    return f"```text\n{said.partition(chr(10) + 'threes before -> after')[0]}\n```"


@cache
def load_sealed() -> list[Packed]:
    """All sealed rounds, by level."""
    return sorted(map(load, sorted((MEASURED / "sealed").glob("*.tar.xz"))), key=lambda one: one.setting)


def sealed() -> str:
    """Targets of the posterior at each level of data, side by side; bold where a target is missed."""
    rounds = load_sealed()
    levels = {setting[0]: posterior_rows([one.first for packed in group for one in packed.graded])
              for setting, group in itertools.groupby(rounds, key=lambda one: one.setting)}
    rows: dict[str, list[str]] = {}
    for cells in levels.values():
        for figure, here, wanted, reached in cells:
            here = re.sub(r" \([^)]*-[^)]*\)", "", here)
            here = f"**{here}**" if reached.startswith("NOT") else here
            rows.setdefault(figure, []).append(f"{here} ({wanted})" if wanted != "-" else here)
    return make_markdown(("figure (target)", *levels), [[figure, *here] for figure, here in rows.items()])


def rivals() -> str:
    """What other methods say of the round that they were put to."""
    marks = [one.first for one in load(MEASURED / "sealed" / "L2d.tar.xz").graded]
    table = next(one for one in make_tables(marks) if one.title.startswith("Rivals in"))
    return make_markdown(table.header[:-1], [row[:-1] for row in table.rows])


def fault_kinds() -> str:
    """Faults by kind: how soon the slowest of each kind is a HOLD."""
    told = fault_matrix.make_table(fault_matrix.load(KEPT / "fault_matrix.jsonl.xz"))
    command = "python -m benchmarks.fault_matrix --bus virtual,slcan --out FILE"
    return f"`{command}`, commit 051c5e6f, 2026-11-29:\n\n{told}"


MADE: dict[str, Callable[[], str]] = {
    "commands": commands, "functions": functions, "classes": classes, "launcher": formats.launcher,
    "limits": formats.limits, "documents": formats.documents, "messages": messages, "codes": codes,
    "terms": term_tables, "demo": demo, "faults": fault_kinds, "rivals": rivals, "sealed": sealed,
    "rounds": lambda: tell_posteriors(load_sealed())}


def fill(path: Path) -> str:
    """A page with all between its marks brought up to date."""
    def make(found: re.Match[str]) -> str:
        made = MADE[found[2]]() if found[2] in MADE else show(load_printed()[found[2]], found[3])
        return f"{found[1]}\n{made.strip(chr(10))}\n{found[4]}"

    return MARKS.sub(make, path.read_text(encoding="utf-8"))


def load_printed() -> dict[str, str]:
    """Return {name: command, commit and date, and what was printed} of every kept run."""
    entries = re.split(r"^== ", PRINTED.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return dict(entry.rstrip("\n").split("\n", 1) for entry in entries)


def show(kept: str, pattern: str | None = None) -> str:
    """Markdown of one kept run: the command, commit and date, and what was printed, or its lines that match."""
    head, _, printed = kept.partition("\n\n")
    command, made = head.split("\n")
    lines = [line for line in printed.splitlines() if pattern is None or not line or re.search(pattern, line)]
    body = re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip("\n")
    markdown = re.search(r"^\|---", body, re.MULTILINE)
    return f"`{command}`, {made}:\n\n" + (body if markdown else f"```text\n{body}\n```")


def keep(name: str, command: str) -> None:
    """Run a command in the root of the repository; keep what it prints. CalledProcessError where it fails.

    FILE in the command is where it keeps rows: build/NAME.jsonl.
    """
    rows = ROOT / "build" / f"{name}.jsonl"
    program, *words = (str(rows) if word == "FILE" else word for word in shlex.split(command))
    words = [sys.executable, *(["-m", "truearc"] if program == "truearc" else []), *words]
    printed = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    commit = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE, text=True,
                            check=True).stdout.strip()
    changed = subprocess.run(["git", "diff", "--quiet", "HEAD", "--", "*.py"], cwd=ROOT, check=False).returncode
    made = f"commit {commit}{' with changes' * changed}, {datetime.now(UTC):%Y-%m-%d}"
    lines = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines())
    kept = load_printed() | {name: f"{command}\n{made}\n\n{lines}"}
    PRINTED.write_text("\n".join(f"== {one}\n{text}\n" for one, text in sorted(kept.items())), encoding="utf-8")

# --- all of them: what a name stands for, as {path: text}

def _reference(*names: str) -> dict[Path, str]:
    return {path: fill(path) for path in (REFERENCE / f"{name}.md" for name in names)}


PAGES: dict[str, Callable[[], dict[Path, str]]] = {
    "reference": lambda: _reference("commands", "python-api"),
    "formats": lambda: {**_reference("formats"), **{
        SCHEMAS / f"{one}.json": json.dumps(formats.make_schema(one), indent=1) + "\n" for one in formats.DOCUMENTS}},
    "reasons": lambda: _reference("reasons"), "terms": lambda: _reference("terms"),
    "measured": lambda: {path: fill(path) for path in DOCS.rglob("*.md")
                         if "<!-- result: " in path.read_text(encoding="utf-8")},
}


def main() -> None:
    """Write the pages, after a run if one is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PAGES)} (all)")
    parser.add_argument("--drivers", nargs="+", default=(), metavar="DRIVER", help="print reasons with theirs")
    parser.add_argument("--run", nargs=2, metavar=("NAME", "COMMAND"))
    args = parser.parse_args()
    if unknown := set(args.names) - set(PAGES):
        parser.error(f"there is no {', '.join(sorted(unknown))}; there are {', '.join(PAGES)}")
    if args.drivers:
        print(reasons_page(args.drivers), end="")
        return
    if args.run:
        keep(*args.run)
    for name in args.names or PAGES:
        for path, text in PAGES[name]().items():
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
