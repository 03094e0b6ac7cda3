"""Hooks of mkdocs.yml: a link from docs/ to a file outside it, which the site lacks, becomes the name of that file."""

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s:#]+)(?:#[^)\s]*)?\)")


def unlink_outside(markdown: str, folder: Path) -> str:
    """Return a page of `folder` with each link that leaves docs/ as its text and the file's path in parentheses."""
    def plain(found: re.Match[str]) -> str:
        target = (folder / found[2]).resolve()
        inside = target.is_relative_to(DOCS) and target.suffix in (".md", ".png")
        return found[0] if inside else f"{found[1]} (`{target.relative_to(ROOT)}`)"
    return LINK.sub(plain, markdown)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Called by MkDocs with each page's text before it is rendered."""
    return unlink_outside(markdown, (DOCS / page.file.src_uri).parent)
