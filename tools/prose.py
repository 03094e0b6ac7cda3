"""Phrases that the project's text avoids, and where they are.

    python tools/prose.py [PATH...]      list every hit (of these files)

Text is docstrings (D), comments (C) and messages (M, string literals with a space) of Python files, TOML files and the
scripts of HTML pages, and Markdown outside code, notebooks' cells of it, text files and the text of HTML pages (T). A
line with `prose: allow` is an exception; in a string of several lines, any of its lines.
"""

import ast
import io
import json
import re
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PHRASES = ROOT / "tests" / "house" / "phrases.toml"
CODE = ("hw", "robot", "sim", "model_export", "truearc", "proof", "benchmarks", "tools", "examples")
PAGES = ("docs", "benchmarks", "examples", "paper", ".github")
ALLOW = "prose: allow"
QUOTED = r""""(\\.|[^"\\\n])*"|'(\\.|[^'\\\n])*'"""
TOML = re.compile(rf"(?P<comment>#[^\n]*(\n[ \t]*#[^\n]*)*)|(?P<string>{QUOTED})")
SCRIPT = re.compile(rf"(?P<comment>//[^\n]*(\n[ \t]*//[^\n]*)*)|(?P<string>{QUOTED}|`[^`]*`)")
HTML = re.compile(r"<style.*?</style>|<!--.*?-->|<script[^>]*>(?P<script>.*?)</script>|<[^>]*>|(?P<text>[^<]+)",
                  re.DOTALL)


class Phrase(NamedTuple):
    """One pattern, what to write instead, and the kinds of text (of "DCMT") that it applies to."""

    pattern: re.Pattern[str]
    use: str
    scope: str


class Piece(NamedTuple):
    """A piece of text: its kind (D, C, M or T), its first line in the file, and the text with single blanks."""

    kind: str
    line: int
    text: str


class Hit(NamedTuple):
    """A phrase that was found, with the line at which its piece of text begins."""

    line: int
    found: str
    use: str


def load_phrases(path: Path = PHRASES) -> list[Phrase]:
    """Return the phrases of a TOML file."""
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["phrase"]
    return [Phrase(re.compile(entry["pattern"]), entry["use"], entry["scope"]) for entry in entries]


def find_files(root: Path = ROOT) -> list[Path]:
    """Return the files of code and the pages that the phrases apply to."""
    code = [path for folder in CODE for suffix in SPLIT for path in (root / folder).rglob(f"*{suffix}")]
    pages = [*root.glob("*.md"), *(path for folder in PAGES for path in (root / folder).rglob("*.md"))]
    return sorted(path for path in {*code, *pages}
                  if not {"build", "__pycache__"} & {*path.parts} and ".egg-info" not in str(path))


def find_hits(path: Path, phrases: list[Phrase]) -> list[Hit]:
    """Return every hit in a file, in the order of its text."""
    pieces = SPLIT[path.suffix](path.read_text(encoding="utf-8"))
    return [Hit(piece.line, found.group(), phrase.use) for piece in pieces for phrase in phrases
            if piece.kind in phrase.scope for found in phrase.pattern.finditer(piece.text)]


def split_markdown(source: str) -> Iterator[Piece]:
    """Yield paragraphs and table rows, without fenced and inline code."""
    source = re.sub(r"^( *)```.*?^ *```", lambda code: "\n" * code.group().count("\n"), source,
                    flags=re.DOTALL | re.MULTILINE)
    line = 1
    for part in re.split(r"(\n(?=\n|\||[-*] |#))", source):
        if part.strip() and ALLOW not in part:
            yield Piece("T", line + len(part) - len(part.lstrip("\n")), " ".join(re.sub(r"`[^`]*`", "`", part).split()))
        line += part.count("\n")


def split_notebook(source: str) -> Iterator[Piece]:
    """Yield the paragraphs of cells of text and the comments of cells of code, at the lines where these begin."""
    for cell in json.loads(source)["cells"]:
        text = "".join(cell["source"])
        start = json.dumps(cell["source"][0] if cell["source"] else "", ensure_ascii=False)
        line = source[:max(source.find(start), 0)].count("\n")
        found = split_markdown(text) if cell["cell_type"] == "markdown" else (
            one for one in _split(text, TOML) if one.kind == "C")
        yield from (Piece(one.kind, one.line + line, one.text) for one in found)


def split_python(source: str) -> Iterator[Piece]:
    """Yield docstrings, messages and comments; comments on lines that follow each other are one piece."""
    yield from split_literals(source)
    yield from _comments(source, source.splitlines())


def split_literals(source: str) -> Iterator[Piece]:
    """Yield docstrings and messages."""
    nodes, lines = list(ast.walk(ast.parse(source))), source.splitlines()
    docstrings = {id(node.body[0].value) for node in nodes if _has_docstring(node)}
    inside = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in ast.walk(node)
              if part is not node}
    for node in nodes:
        text = _text_of(node) if id(node) not in inside else None
        if text and " " in text.strip() and not _is_allowed(lines, node.lineno, node.end_lineno):
            yield Piece("D" if id(node) in docstrings else "M", node.lineno, " ".join(text.split()))


def split_toml(source: str) -> Iterator[Piece]:
    """Yield strings with a space, and comments; comments on lines that follow each other are one piece."""
    yield from _split(source, TOML)


def split_html(source: str) -> Iterator[Piece]:
    """Yield the text between tags, and strings and comments of scripts."""
    for found in HTML.finditer(source):
        line = source.count("\n", 0, found.start()) + 1
        if found["script"]:
            yield from (Piece(one.kind, one.line + line - 1, one.text) for one in _split(found["script"], SCRIPT))
        elif found["text"] and " " in found["text"].strip():
            yield Piece("T", line, " ".join(found["text"].split()))


def _split(source: str, pattern: re.Pattern[str]) -> Iterator[Piece]:
    """Yield what a pattern of strings (M) and comments (C) finds, from lines without an exception."""
    lines = source.splitlines()
    for found in pattern.finditer(source):
        kind, text = ("C", found["comment"]) if found["comment"] else ("M", found["string"] or "")
        first, last = (source.count("\n", 0, place) + 1 for place in found.span())
        if " " in text.strip() and not _is_allowed(lines, first, last):
            yield Piece(kind, first, " ".join(re.sub(r"^[ \t]*(#|//)", "", text, flags=re.MULTILINE).split()))


def _has_docstring(node: ast.AST) -> bool:
    documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    return documented and ast.get_docstring(node) is not None


def _text_of(node: ast.AST) -> str | None:
    """The text of a string literal; of an f-string, with {} in the place of each value."""
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _is_allowed(lines: list[str], first: int, last: int | None) -> bool:
    return any(ALLOW in line for line in lines[first - 1:last or first])


def _comments(source: str, lines: list[str]) -> Iterator[Piece]:
    first, last, texts = 0, -1, []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT or ALLOW in token.string:
            continue
        line, alone = token.start[0], lines[token.start[0] - 1].lstrip().startswith("#")
        if not (alone and line == last + 1):
            if texts:
                yield Piece("C", first, " ".join(texts))
            first, texts = line, []
        last = line if alone else -1
        texts.append(token.string.lstrip("# ").strip())
    if texts:
        yield Piece("C", first, " ".join(texts))


SPLIT: dict[str, Callable[[str], Iterator[Piece]]] = {
    ".py": split_python, ".md": split_markdown, ".txt": split_markdown, ".toml": split_toml, ".html": split_html,
    ".ipynb": split_notebook}


def main(words: list[str]) -> int:
    """List hits."""
    phrases = load_phrases()
    paths = [Path(word).resolve() for word in words] or find_files()
    tally: Counter[str] = Counter()
    for path in paths:
        for hit in find_hits(path, phrases):
            tally[hit.use] += 1
            print(f"{path.relative_to(ROOT)}:{hit.line}: {hit.found!r}; write: {hit.use}")
    print(f"{sum(tally.values())} hits", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
