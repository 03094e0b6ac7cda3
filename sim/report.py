"""A self-contained HTML page: verdict first, then pictures, then the fine print. Nothing is fetched from anywhere."""

import base64
import html
import io
from collections.abc import Iterable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

STYLE = """
:root { color-scheme: light dark; --ink: #1a1c20; --dim: #5c6470; --line: #d9dde3; --paper: #fff; --accent: #1f5fa8; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8eb; --dim: #9aa3af; --line: #333a44; --paper: #14171b; --accent: #7db3ee; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 62rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.1rem; color: var(--dim); font-weight: 500; margin: 0 0 .5rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem; }
.verdict { font-size: 1.35rem; line-height: 1.4; margin: 0 0 1rem; border-left: .3rem solid var(--accent);
           padding-left: 1rem; }
figure { margin: 1rem 0; } figure img { max-width: 100%; background: #fff; border-radius: .3rem; }
figcaption, .dim { color: var(--dim); font-size: .9rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .25rem .8rem .25rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { color: var(--dim); font-weight: 500; } td.number { text-align: right; }
"""
DPI = 130


def make_page(title: str, verdict: str, sections: Iterable[tuple[str, str]]) -> str:
    """HTML text; `sections` are (heading, HTML body), a heading of "" continues the one before."""
    parts = [f"<h2>{html.escape(heading)}</h2>\n{body}" if heading else body for heading, body in sections]
    return ("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">"
            f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>\n<h1>{html.escape(title)}</h1>\n"
            f"<p class=\"verdict\">{html.escape(verdict)}</p>\n" + "\n".join(parts) + "\n</body></html>\n")


def new_figure(width_in: float = 8.0, height_in: float = 3.6) -> Figure:
    """An empty figure that no display knows of."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_panels(width_in: float, height_in: float, rows: int = 1, **layout: Any) -> tuple[Figure, Sequence[Axes]]:
    """A figure with axes one below the other, framed on the left and below only; layout: as of Figure.subplots."""
    figure = new_figure(width_in, height_in)
    panels = figure.subplots(rows, 1, squeeze=False, **layout)[:, 0]
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels


def make_png(figure: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def picture(png: bytes, alt: str, caption: str = "") -> str:
    """An image, inline."""
    data = base64.b64encode(png).decode("ascii")
    below = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    return f"<figure><img alt=\"{html.escape(alt)}\" src=\"data:image/png;base64,{data}\">{below}</figure>"


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table; numbers are right-aligned, None is a dash."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in rows)
    return f"<div class=\"scroll\"><table><tr>{head}</tr>{body}</table></div>"


def paragraph(text: str, dim: bool = False) -> str:
    return f"<p class=\"dim\">{html.escape(text)}</p>" if dim else f"<p>{html.escape(text)}</p>"


def _cell(cell: Any) -> str:
    if isinstance(cell, float):
        return f"<td class=\"number\">{cell:.4g}</td>"
    if isinstance(cell, int):
        return f"<td class=\"number\">{cell}</td>"
    return f"<td>{'–' if cell is None else html.escape(str(cell))}</td>"
