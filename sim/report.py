"""Self-contained HTML pages and their pictures, without external resources."""

import base64
import html
import io
import re
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from truearc.robot.gate import OUTPUTS
from truearc.sim.statistics import reliability, wilson

STYLE = (files("truearc.sim") / "report.css").read_text(encoding="utf-8")
DPI = 130
PHONE_IN = 4.4                        # width of a picture whose letters are legible on a phone
LEAST_SCALE = 0.6                     # of a picture; a wider one scrolls in its own box
SHOWN = 16                            # digits of a hash
FIRST_SENTENCE = re.compile(r"(.+?[.!?])\s+(?=[A-Z])(.*)", re.DOTALL)
COLOURS = {"three": "#1b7f3b", "two": "#d99000", "miss": "#b3261e"}


class Origin(NamedTuple):
    """The origin of a page, as its first line states it; "" is omitted.

    made_at: Date and time, ISO 8601. command: As typed. sha256: Of the data.
    """

    made_at: str = ""
    command: str = ""
    sha256: str = ""


NO_ORIGIN = Origin()


def make_page(title: str, verdict: str, sections: Iterable[tuple[str, str]], origin: Origin = NO_ORIGIN) -> str:
    """Return the page: title, origin, the verdict's first sentence in a box, its other sentences, the sections.

    Args:
        title: Plain text, as is `verdict`.
        sections: (heading, HTML body); a heading of "" continues the section before.
        origin: Date, command and data; the version is added.
    """
    parts = [f"<h2>{html.escape(heading)}</h2>\n{body}" if heading else body for heading, body in sections]
    found = FIRST_SENTENCE.fullmatch(verdict)
    first, rest = found.groups() if found else (verdict, "")
    return ("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">"
            f"<title>{html.escape(title)}</title><style>\n{STYLE}</style></head><body>\n<h1>{html.escape(title)}</h1>\n"
            f"{_origin_line(origin)}\n<p class=\"verdict\">{html.escape(first)}</p>\n"
            + "\n".join([*([paragraph(rest)] if rest else []), *parts]) + "\n</body></html>\n")


def _origin_line(origin: Origin) -> str:
    items = [origin.made_at.replace("T", " "), f"truearc {version('truearc')}",
             f"data SHA-256 {origin.sha256[:SHOWN]}" if origin.sha256 else ""]
    said = " · ".join(html.escape(one) for one in items if one)
    return f"<p class=\"origin\">{said}" + (f"<br><code>{html.escape(origin.command)}</code>" if origin.command else
                                            "") + "</p>"


def new_figure(width_in: float = 8.0, height_in: float = 3.6) -> Figure:
    """Return an empty figure without a display."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_panels(width_in: float, height_in: float, rows: int = 1, **layout: Any) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with axes one below the other, framed on the left and below only; layout: as in
    Figure.subplots."""
    figure = new_figure(width_in, height_in)
    panels = figure.subplots(rows, 1, squeeze=False, **layout)[:, 0]
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels


def make_png(figure: Figure) -> bytes:
    """Return the figure as PNG; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def picture(png: bytes | None, alt: str, caption: str = "") -> str:
    """Return an inline image; nothing without one."""
    if png is None:
        return ""
    data = base64.b64encode(png).decode("ascii")
    below = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    least_px = LEAST_SCALE * int.from_bytes(png[16:20])       # the header's width
    return (f"<figure><div class=\"scroll\"><img alt=\"{html.escape(alt)}\" style=\"min-width:{least_px:.0f}px\" "
            f"src=\"data:image/png;base64,{data}\"></div>{below}</figure>")


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table; numbers are right-aligned, None is a dash."""
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


def draw_reliability(p: np.ndarray, level: np.ndarray) -> Figure:
    """Draw reliability of both outputs: p [n, 2] (two, three) against level [n] (0 miss, 1 two, 2 three), 95 %
    intervals."""
    figure = new_figure(7.5, 3.8)
    for k, axes in enumerate(figure.subplots(1, 2, sharey=True)):
        table = reliability(p[:, k], level >= k + 1)
        hits = np.rint(table.came_true * table.count).astype(int)
        low, high = np.array([wilson(int(one), int(tries)) for one, tries in zip(hits, table.count, strict=True)]).T
        axes.plot([0, 1], [0, 1], color="#999999", linewidth=1)
        axes.errorbar(table.stated, table.came_true, yerr=np.abs([table.came_true - low, high - table.came_true]),
                      fmt="o", color="#1b5e9b", capsize=2)
        for x, y, count in zip(table.stated, table.came_true, table.count, strict=True):
            axes.annotate(str(int(count)), (x, y), xytext=(5, -10), textcoords="offset points", fontsize=7)
        axes.set(xlabel=f"stated {OUTPUTS[k]}", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    figure.axes[0].set_ylabel("share that came true")
    return figure
