"""Count lines of Python code per folder, without docstrings, comments and blank lines.

A line counts if a token of code is on it; a string that is a whole statement counts as documentation. Density is the
number of such lines per function, nested functions counted within the outer one and by themselves.

Usage: python tools/count_lines.py [FOLDER_OR_FILE ...]     (default: what the wheel of truearc holds)
"""

import ast
import io
import statistics
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

WHEEL = ("hw", "robot", "sim", "model_export", "truearc")
SILENT = frozenset({tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
                    tokenize.ENCODING, tokenize.ENDMARKER})
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class Count(NamedTuple):
    """Lines of code, and those of each function."""

    lines: int
    functions: tuple[int, ...]


def count_source(source: str) -> Count:
    """Count one file's text.

    Raises:
        SyntaxError: the text is not Python.
    """
    tree = ast.parse(source)
    lines = _lines_of_code(source) - _lines_of_documentation(tree)
    functions = [node for node in ast.walk(tree) if isinstance(node, FUNCTIONS)]
    return Count(len(lines), tuple(sum(node.lineno <= line <= (node.end_lineno or 0) for line in lines)
                                   for node in functions))


def count_files(paths: list[Path]) -> Count:
    """Count files together."""
    counts = [count_source(path.read_text(encoding="utf-8")) for path in paths]
    return Count(sum(count.lines for count in counts), tuple(n for count in counts for n in count.functions))


def python_files(place: Path) -> list[Path]:
    """Return the Python files of a folder and those below it, or the file itself."""
    return [place] if place.is_file() else sorted(place.rglob("*.py"))


def _lines_of_code(source: str) -> set[int]:
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {line for token in tokens if token.type not in SILENT for line in range(token.start[0], token.end[0] + 1)}


def _lines_of_documentation(tree: ast.Module) -> set[int]:
    strings = (node for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
               and isinstance(node.value.value, str))
    return {line for node in strings for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)}


def _rows(places: list[Path]) -> Iterator[tuple[str, int, Count]]:
    """One row per folder that holds Python files itself, then all together."""
    everything = [path for place in places for path in python_files(place)]
    for folder in sorted({path.parent for path in everything}):
        files = [path for path in everything if path.parent == folder]
        yield str(folder), len(files), count_files(files)
    yield "together", len(everything), count_files(everything)


def main(arguments: list[str]) -> int:
    """Print the table; returns 0."""
    print(f"{'folder':32s} {'files':>6s} {'lines':>7s} {'functions':>10s} {'mean':>6s} {'median':>7s}")
    for folder, files, count in _rows([Path(name) for name in arguments or WHEEL]):
        sizes = count.functions or (0,)
        print(f"{folder:32s} {files:6d} {count.lines:7d} {len(count.functions):10d} "
              f"{statistics.mean(sizes):6.2f} {statistics.median(sizes):7.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
