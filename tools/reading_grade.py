"""Reading grade of pages, reports, messages and docstrings: Flesch and Kincaid's, the school year that a text asks for.

    python -m tools.reading_grade [CHECKOUT]

0.39 words per sentence + 11.8 syllables per word - 15.59 (Kincaid et al. 1975, Research Branch Report 8-75). Reports
are the sentences of the golden findings and the fine print; messages have at least five words; pages are README.md and
docs/ without tables, headings and code. Syllables are groups of vowels, without a silent e, so that only grades by this
tool compare. A checkout that has no text of a kind gets no line for it.
"""

import json
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from tools.prose import CODE, ROOT, Piece, split_literals, split_markdown

FEWEST_WORDS = 5                      # of a message; shorter ones are labels
WORD = re.compile(r"[A-Za-z]+(?:'[a-z]+)?")


def count_syllables(word: str) -> int:
    """Return the number of groups of vowels, without an e that ends the word; at least one."""
    word = word.lower()
    groups = len(re.findall(r"[aeiouy]+", word))
    silent = word.endswith("e") and not word.endswith(("le", "ee", "ye"))
    return max(groups - silent, 1)


def grade(texts: Iterable[str]) -> tuple[int, float, float, float]:
    """Return (sentences, words per sentence, syllables per word, grade) of texts, each at least one sentence."""
    sentences = [WORD.findall(one) for text in texts for one in re.split(r"[.!?](?=\s|$)", text)]
    sentences = [words for words in sentences if words]
    words = [word for sentence in sentences for word in sentence]
    length, weight = len(words) / len(sentences), sum(map(count_syllables, words)) / len(words)
    return len(sentences), length, weight, 0.39 * length + 11.8 * weight - 15.59


def reports(root: Path) -> Iterator[str]:
    """Yield the sentences of the golden findings, and the paragraphs of the fine print."""
    for path in sorted((root / "tests" / "golden" / "reference").rglob("finding*.json")):
        yield json.loads(path.read_text(encoding="utf-8"))["sentence"]
    for path in (root / "sim" / "discover").rglob("fine_print.txt"):
        yield from path.read_text(encoding="utf-8").split("\n\n")


def pages(root: Path) -> Iterator[str]:
    """Yield the paragraphs of README.md and docs/."""
    for path in [root / "README.md", *sorted((root / "docs").rglob("*.md"))]:
        for piece in split_markdown(path.read_text(encoding="utf-8")):
            if not piece.text.startswith(("|", "#", "<")) and len(WORD.findall(piece.text)) >= FEWEST_WORDS:
                yield re.sub(r"\]\([^)]*\)", "]", piece.text)


def literals(root: Path) -> Iterator[Piece]:
    """Yield the messages (M) and docstrings (D) of all code."""
    for path in sorted(path for folder in CODE for path in (root / folder).rglob("*.py")):
        if "build" not in path.relative_to(root).parts:
            for piece in split_literals(path.read_text(encoding="utf-8")):
                if piece.kind == "D" or len(WORD.findall(piece.text)) >= FEWEST_WORDS:
                    yield piece


def main(words: list[str]) -> int:
    """Print a line for each kind of text."""
    root = Path(words[0]).resolve() if words else ROOT
    pieces = list(literals(root))
    messages, docstrings = ([piece.text for piece in pieces if piece.kind == kind] for kind in "MD")
    for name, texts in (("pages", list(pages(root))), ("reports", list(reports(root))), ("messages", messages),
                        ("docstrings", docstrings)):
        if not texts:
            continue
        count, length, weight, found = grade(texts)
        print(f"{name:10s} grade {found:4.1f}   {count:5d} sentences, {length:4.1f} words each, {weight:.2f} syllables "
              "per word")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
