"""Recognition of file kinds, so that a command given the wrong kind of file can name the command to use instead."""

import argparse
import re
import shlex
import tomllib
from pathlib import Path

_TABLE = tomllib.loads(Path(__file__).with_name("files.toml").read_text(encoding="utf-8"))
KINDS: dict[str, dict[str, str]] = _TABLE["kind"]
ARGUMENTS: dict[str, list[str]] = _TABLE["argument"]
HEAD_BYTES = 65_536
MARKS = ((b"WPILOG", "wpilog"), (b"\x89MCAP", "mcap"), (b"PAR1", "table"), (b"\xff\xd8\xff", "picture"),
         (b"\x89PNG", "picture"))
SCHEMA = re.compile(r'schema"?\s*[=:]\s*"truearc\.([a-z-]+)/')
ENDS = {".onnx": "gate", ".csv": "table", ".xlsx": "table", ".txt": "table", ".parquet": "table",
        ".xls": "workbook", ".ods": "workbook", ".py": "python"}
FOLDERS = (("session.json", "session"), ("shots.csv", "dataset"), ("shots.parquet", "dataset"),
           ("physics.json", "weights"), ("weights.npz", "weights"))


def kind_of(path: Path) -> str:
    """The kind of a file or folder, by its content before its name: "file" for another one, "" where there is none."""
    try:
        return _kind_of(path)
    except OSError:                   # the command says why it cannot be read
        return ""


def _kind_of(path: Path) -> str:
    if path.is_dir():
        return next((kind for name, kind in FOLDERS if (path / name).is_file()), "folder")
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head.strip():
        return "empty"
    for mark, kind in MARKS:
        if head.startswith(mark):
            return kind
    if path.suffix.lower() in ENDS:
        return ENDS[path.suffix.lower()]
    text = head.decode("utf-8", errors="replace")
    if (found := SCHEMA.search(text)) and found[1] in KINDS:
        return found[1]
    tables = re.findall(r"(?m)^\s*\[(gate|rig|ball)\b", text) if path.suffix.lower() == ".toml" else []
    return "launcher" if {"gate", "rig"} & {*tables} else "rig" if tables else "file"


def misplaced(command: str, args: argparse.Namespace, error: str = "") -> str:
    """What is wrong with the first argument that names another kind of file than the command takes, and the command to
    use; "" where there is none. error: a message; then of the missing file that it begins with."""
    if getattr(args, "system", None) is not None:        # a table of runs, of which no kind is known
        return ""
    source = f"{command} {getattr(args, 'source', '')}"
    for name, value in vars(args).items():
        keys = (f"{source}.{name}", f"{command}.{name}", name)
        wanted = next((ARGUMENTS[key] for key in keys if key in ARGUMENTS), [])
        paths = [one for one in (value if isinstance(value, list | tuple) else [value]) if isinstance(one, str | Path)]
        for path in map(Path, paths if wanted else []):
            concerned = error.startswith((f"{path}:", f"{path}/")) if error else path.exists()
            if concerned and path.exists() != bool(error) and (message := _objection(command, path, wanted)):
                return as_typed(message, args) if command == "import" and name != "rig" else message
    return ""


def _objection(command: str, path: Path, wanted: list[str]) -> str:
    kind, expected = kind_of(path), KINDS[wanted[0]]
    is_folder = "folder" in expected["noun"]
    if kind in wanted or (kind == "file" and not is_folder) or (not kind and "make" not in expected):
        return ""
    if "dataset" in wanted and kind and kind_of(path.resolve().parent) == "dataset":
        return f"{path}: is {KINDS[kind]['noun']}; name the folder that it is in: truearc {command} {path.parent}"
    if kind and "use" in KINDS[kind] and (kind, wanted[0]) != ("table", "rig"):       # which is imported, not the rig
        return f"{path}: is {KINDS[kind]['noun']}, not {expected['noun']}; use: {_line(KINDS[kind]['use'], path)}"
    what = f"is {KINDS[kind]['noun']}" if kind else f"there is no such {'folder' if is_folder else 'file'}"
    if "make" not in expected:
        return f"{path}: {what}; {expected['noun']} is expected"
    return f"{path}: {what}; {expected['noun']} is made by: {_line(expected['make'], Path('NEW') if kind else path)}"


def as_typed(message: str, args: argparse.Namespace) -> str:
    """A message that ends in an import, with the rig and the folder that were given."""
    for name, placeholder in (("rig", "--rig rig.toml"), ("out", "-o DIR")):
        if (given := getattr(args, name, None)) is not None:
            message = message.replace(placeholder, f"{placeholder.split()[0]} {shlex.quote(str(given))}")
    return message


def _line(command: str, path: Path) -> str:
    return command.format(path=shlex.quote(str(path)))
