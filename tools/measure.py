"""The project's size compared with its targets: `python -m tools.measure`.

It counts the files that git tracks. A line of code is a line with a token; comments, blank lines and docstrings do not
count. The import chain is the longest path of imports among truearc's own modules below truearc.api.discovery,
including imports inside functions.
"""

import ast
import io
import subprocess
import tokenize
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WHEEL = {"hw": 40, "robot": 55, "sim": 115, "truearc": 42, "model_export": 4}           # and the most files of each
CODE = (*WHEEL, "frc", "proof", "benchmarks", "tools", "examples")      # all Python but tests and docs
LONGEST_FILE, LOWEST = 600, "truearc.api.discovery"
SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING,
          tokenize.ENDMARKER}


@cache
def tracked() -> tuple[Path, ...]:
    """Files of the repository, relative to its root; those that are deleted here are left out."""
    said = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return tuple(path for path in map(Path, said.split("\0")[:-1]) if (ROOT / path).is_file())


def python_files(*folders: str) -> list[Path]:
    """Tracked Python files below these folders of the root."""
    return [path for path in tracked() if path.suffix == ".py" and path.parts[0] in folders]


def read(path: Path) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def lines_of_code(source: str) -> set[int]:
    """Numbers of the lines with code on them; SyntaxError where the text is not Python."""
    documented = {line for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Expr)
                  and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
                  for line in range(node.lineno, (node.end_lineno or 0) + 1)}
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {line for token in tokens if token.type not in SILENT
            for line in range(token.start[0], token.end[0] + 1)} - documented


def code(paths: list[Path]) -> int:
    """Lines of code of files together."""
    return sum(len(lines_of_code(read(path))) for path in paths)


def import_lines(paths: list[Path]) -> int:
    """Lines that import statements take."""
    return sum((node.end_lineno or 0) - node.lineno + 1 for path in paths for node in ast.walk(ast.parse(read(path)))
               if isinstance(node, ast.Import | ast.ImportFrom))


def module_of(path: Path) -> str:
    """Name by which a file of the wheel is imported."""
    parts = path.with_suffix("").parts
    parts = parts if parts[0] == "truearc" else ("truearc", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def longest_chain(start: str = LOWEST) -> list[str]:
    """Modules of the longest path of imports from one module, which comes first; RecursionError for a cycle."""
    files = {module_of(path): path for path in python_files(*WHEEL)}

    @cache
    def below(module: str) -> tuple[str, ...]:
        names: set[str] = set()
        for node in ast.walk(ast.parse(read(files[module]))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                names |= (inner & set(files)) or {node.module}
        chains = [below(name) for name in sorted(names & set(files)) if name not in (module, "truearc")]
        return (module, *max(chains, key=len, default=()))

    return list(below(start))


def table() -> list[tuple[str, str, str]]:
    """(what, here, target) of each measure."""
    wheel, everything, chain = python_files(*WHEEL), python_files(*CODE), longest_chain()
    wheel_code = code(wheel)
    longest = max((path for path in tracked() if path.suffix == ".py"), key=lambda path: read(path).count("\n"))
    rows = [("files in the wheel", f"{len(wheel)}", "260")]
    rows += [(f"  {folder}", f"{len(python_files(folder))}", f"{most}") for folder, most in WHEEL.items()]
    rows += [("share of imports in the wheel's code", f"{import_lines(wheel) / wheel_code:.1%}", "8 %"),
             ("lines of code, wheel", f"{wheel_code}", "30000"),
             ("lines of code, all but tests and docs", f"{code(everything)}", "45500"),
             ("files in the repository", f"{len(tracked())}", "900")]
    rows += [(f"all lines of {folder}", f"{sum(read(path).count(chr(10)) for path in python_files(folder))}", most)
             for folder, most in (("benchmarks", "7000"), ("tests", "38000"))]
    devices = sum(".hw.devices" in name for name in chain)
    return [*rows, ("chain of imports below api/discovery", f"{len(chain) - 1}, {devices} of hw/devices", "28, 0"),
            ("longest file", f"{read(longest).count(chr(10))} ({longest})", f"{LONGEST_FILE}")]


if __name__ == "__main__":
    for what, here, target in (("", "here", "at most"), *table()):
        print(f"{what:42}{here:>32}{target:>10}")
