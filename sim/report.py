"""A self-contained HTML page: verdict first, then pictures, then the fine print. Nothing is fetched from anywhere."""

import base64
import html
import io
from collections.abc import Iterable, Sequence
from importlib.resources import files
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

STYLE = (files("truearc.sim") / "report.css").read_text(encoding="utf-8")
DPI = 130


def make_page(title: str, verdict: str, sections: Iterable[tuple[str, str]]) -> str:
    """HTML text; `sections` are (heading, HTML body), a heading of "" continues the one before."""
    parts = [f"<h2>{html.escape(heading)}</h2>\n{body}" if heading else body for heading, body in sections]
    return ("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">"
            f"<title>{html.escape(title)}</title><style>\n{STYLE}</style></head><body>\n<h1>{html.escape(title)}</h1>\n"
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


def picture(png: bytes | None, alt: str, caption: str = "") -> str:
    """An image, inline; nothing where there is none."""
    if png is None:
        return ""
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
