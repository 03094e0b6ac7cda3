"""Pages say what the code says: columns, keys, names, schemas; and their links and paths lead somewhere."""

import json
import math
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import jsonschema
import msgspec

import truearc
from tests.golden.make import REFERENCE
from tools.formats import DOCUMENTS, launcher_keys
from tools.pages import SCHEMAS
from truearc.hw.devices.canandmag import CanandmagConfig
from truearc.hw.devices.family import HoodEncoder
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config
from truearc.sim.data.table import NO_RANGE, RANGES, TEXTS, WORDS

ROOT = Path(__file__).parents[2]
DATASET = (ROOT / "docs" / "reference" / "dataset.md").read_text(encoding="utf-8")
GOLDEN = sorted([*REFERENCE.glob("finding-*/finding.json"), *REFERENCE.glob("identifiability/*.json"),
                 *REFERENCE.glob("design/*.json"), *REFERENCE.glob("gated-*/session.json"),
                 ROOT / "tests" / "robot" / "aim.json", REFERENCE.parent / "inputs" / "proposal.json"])
# docs/how-to/motors.md, docs/reference/dataset.md, `--plan`, docs/how-to/advise.md
ELSEWHERE = ("axes.", "rig.", "collect.prescribed.", "readings.")


def rows_of(text: str, heading: str) -> dict[str, list[str]]:
    """Rows of the first table below a heading of the second level: first cell without backticks -> other cells."""
    part = text.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip()[1:-1].split("|")] for line in part.splitlines()
            if line.startswith("| `")]
    return {row[0].strip("`"): row[1:] for row in rows}


def values_of(name: str) -> str:
    if name in WORDS:
        return ", ".join(WORDS[name])
    if name in (*TEXTS, "shot_id", "config_id"):
        return "text"
    low, high = RANGES.get(name, NO_RANGE)
    if math.isinf(high):
        return "any" if math.isinf(low) else f"from {low:g}"
    return f"{low:g} to {high:g}"


def leaves(kind: type[msgspec.Struct], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted key, default) of every key of a file."""
    for field in msgspec.structs.fields(kind):
        parts = (field.type, *getattr(field.type, "__args__", ()))
        inner = [part for part in parts if isinstance(part, type) and issubclass(part, msgspec.Struct)]
        if field.type is HoodEncoder:             # the shipped one
            inner = [CanandmagConfig]
            yield f"{prefix}{field.encode_name}.driver", field.default
        if inner:
            yield from leaves(inner[0], f"{prefix}{field.encode_name}.")
        else:
            yield prefix + field.encode_name, field.default


def default_text(default: Any) -> str:
    if isinstance(default, tuple):
        return ", ".join(default)
    if isinstance(default, bool):
        return str(default).lower()
    absent = default is None or default is msgspec.UNSET
    return "required" if default is msgspec.NODEFAULT else "none" if absent else f"{default:g}"


def test_every_column_is_on_the_page_of_datasets() -> None:
    read = re.compile(r'shots\.(?:number|text)\("(\w+)"\)')
    columns = {name for path in (ROOT / "sim").rglob("*.py") for name in read.findall(path.read_text(encoding="utf-8"))}
    rows = rows_of(DATASET, "shots.csv")
    assert {*RANGES, *WORDS, *TEXTS, "shot_id", *columns} - set(rows) == set()
    assert {name: cells[1] for name, cells in rows.items()} == {name: values_of(name) for name in rows}


def test_every_key_of_the_rig_and_of_the_configuration_is_on_its_page() -> None:
    keys = {name: default_text(default) for name, default in leaves(Rig)}
    assert {name: cells[1] for name, cells in rows_of(DATASET, "rig.toml").items()} == keys
    described = [key for key, _, _ in launcher_keys()]
    wanted = {key for key, _ in leaves(Config) if not f"{key}.".startswith(ELSEWHERE)}
    assert len(described) == len(set(described)) and set(described) == wanted


def test_architecture_lists_every_public_name_and_its_file() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").split("\n## Python API\n")[1].split("\n## ")[0]
    listed = {name: row[1] for row in re.findall(r"^\| (`.*`) \| `(.*)` \|$", text, re.MULTILINE)
              for name in re.findall(r"`(\w+)`", row[0])}
    assert set(listed) == set(truearc.__all__)
    for name, path in listed.items():
        module = import_module("truearc." + path.removeprefix("truearc/").removesuffix(".py").replace("/", "."))
        value = getattr(truearc, name)
        assert value is module or (value.__module__, getattr(module, name)) == (module.__name__, value), name


def test_documents_pass_their_schema_and_have_no_key_beside_it() -> None:
    assert GOLDEN
    for path in GOLDEN:
        document, schema = (json.loads(one.read_text("utf-8")) for one in (path, SCHEMAS / f"{path.stem}.json"))
        jsonschema.Draft202012Validator(schema).validate(document)
        kind = DOCUMENTS[path.stem][0]
        assert set(document) <= {field.encode_name for field in msgspec.structs.fields(kind)}, path


# --- links and paths

PAGES = sorted([*ROOT.glob("*.md"), *(page for folder in ("docs", "benchmarks", "examples", ".github")
                                      for page in (ROOT / folder).rglob("*.md"))])

TOPS = ("hw", "robot", "sim", "model_export", "truearc", "proof", "frc", "benchmarks", "tests", "tools", "docs",
        "examples")
CODE_PATH = re.compile(rf"(?<![\w./<{{*-])(?:{'|'.join(TOPS)})/[\w./*<>{{}}-]*")
HISTORY = ("CHANGELOG.md", "docs/measured/proof.md")           # they name files as they were


def anchors(page: Path) -> set[str]:
    """As they are made of headings where such pages are usually read, and those that a page sets itself."""
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    made = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return made | set(re.findall(r'<a id="([^"]+)">', text))


def test_links_lead_somewhere() -> None:
    lost = []
    for page in PAGES:
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            path, _, anchor = link.partition("#")
            there = page.parent / path if path else page
            if "://" not in link and not (there.exists() and (not anchor or anchor in anchors(there))):
                lost.append((page.relative_to(ROOT).as_posix(), link))
    assert lost == []


def code_of(page: Path) -> str:
    """Fenced blocks and code spans of a page, a line each."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^ *```[^\n]*\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^ *```.*?^ *```", "", text, flags=re.DOTALL | re.MULTILINE))
    return "\n".join([*blocks, *spans])


def lost_paths(code: str) -> list[str]:
    """Python files, TOML files and folders that code names from the root and that do not exist."""
    names = [name.rstrip(".-") for name in CODE_PATH.findall(code) if not set("*<>{}") & set(name)]
    return [name for name in names if Path(name).suffix in ("", ".py", ".toml") and not (ROOT / name).exists()]


def test_paths_in_pages_exist() -> None:
    lost = {page.relative_to(ROOT).as_posix(): lost_paths(code_of(page)) for page in PAGES
            if page.relative_to(ROOT).as_posix() not in HISTORY}
    assert {name: names for name, names in lost.items() if names} == {}
