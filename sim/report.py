"""Self-contained HTML pages and their pictures, without external resources."""

import html
import io
import re
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, FunctionLoader
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from truearc.robot.gate import OUTPUTS
from truearc.sim.statistics import reliability, wilson

HERE = files("truearc.sim") / "templates"
STYLE = (HERE / "page.css").read_text(encoding="utf-8").rstrip()
DPI = 130
PHONE_IN = 4.4                        # width of a picture whose letters are legible on a phone
# Colours of pictures that a page's style decides, by day and by night
INK, BEFORE, AFTER, GREY = "#30343b", "#1f5fa8", "#c2571a", "#9aa3af"
THEME = {"#000000": "ink", INK: "ink", BEFORE: "blue", AFTER: "orange", GREY: "grey",
         "#1b7f3b": "good", "#d99000": "fair", "#b3261e": "bad"}
SHOWN = 16                            # digits of a hash
BEFORE_PERCENT = re.compile(r"(?<=\d) (?=%)")
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


def render(template: str, **values: Any) -> str:
    """Return the text of a template of sim/templates; what is not marked as safe there is escaped."""
    return ENVIRONMENT.get_template(template).render(**values)


def make_page(title: str, verdict: str, sections: Iterable[tuple[str, str]], origin: Origin = NO_ORIGIN,
              template: str = "page.html", **values: Any) -> str:
    """Return the page: title, origin, the verdict's first sentence in a box, its other sentences, the sections.

    Args:
        title: Plain text, as is `verdict`.
        sections: (heading, HTML body); a heading of "" continues the section before.
        origin: Date, command and data; the version is added.
        template: Template of the page, which takes `values`.
    """
    found = FIRST_SENTENCE.fullmatch(verdict)
    first, rest = found.groups() if found else (verdict, "")
    items = [origin.made_at.replace("T", " "), f"truearc {version('truearc')}",
             f"data SHA-256 {origin.sha256[:SHOWN]}" if origin.sha256 else ""]
    return render(template, title=title, style=STYLE, first=first, rest=rest, sections=list(sections), origin=origin,
                  origin_line=" · ".join(filter(None, items)), **values) + "\n"


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


def make_svg(figure: Figure, alt: str) -> str:
    """Return the figure as SVG for a page: text as text, colours of THEME by the page's style, no ids but references.
    """
    buffer = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "truearc"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>| xmlns(:\w+)?=\"[^\"]*\"| id=\"[A-Za-z.]+[\w.]*_\d+\"", "",
                  text[text.index("<svg"):], flags=re.DOTALL)
    for colour, variable in THEME.items():
        text = text.replace(colour, f"var(--{variable})")
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px system-ui, sans-serif", text)
    return re.sub(r'^<svg[^>]*(viewBox="[^"]*")[^>]*>', rf'<svg role="img" aria-label="{html.escape(alt)}" \1>', text)


def picture(figure: Figure | None, alt: str, caption: str = "") -> str:
    """Return an inline image; nothing without one."""
    return "" if figure is None else str(_part("picture")(make_svg(figure, alt), caption))


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table; numbers are right-aligned, None is a dash."""
    return str(_part("table")(header, list(rows)))


def paragraph(text: str, dim: bool = False) -> str:
    return str(_part("paragraph")(text, dim))


def _part(name: str) -> Any:
    return getattr(ENVIRONMENT.get_template("parts.html").module, name)


def _cell(cell: Any) -> str:
    return "–" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)


ENVIRONMENT = Environment(autoescape=True, loader=FunctionLoader(
    lambda name: (HERE / name).read_text(encoding="utf-8")))
ENVIRONMENT.filters["cell"] = _cell
ENVIRONMENT.filters["whole"] = lambda text: BEFORE_PERCENT.sub("\N{NO-BREAK SPACE}", text)


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
