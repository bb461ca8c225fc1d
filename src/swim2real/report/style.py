"""The look of every chart, on pages and in papers: colors, letters, widths, and the distinction of methods.

A chart is a matplotlib figure of its own, unknown to pyplot. Within `page_style` or `paper_style` the same functions
draw for the screen or for print. Charts are drawn in the light colors; a page names each of them as a variable of its
style sheet, so that they follow the reader's theme. Hence no two roles share a light color.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter, NullLocator

from swim2real.formatting import shortened
from swim2real.methods import ABLATION, METHODS
from swimbase.escaping import visible

COLUMN, DOUBLE = 3.4, 7.0  # inches, of a column of a paper and of both
WIDE, HALF, THIRD = 8.4, 4.2, 2.8  # inches, of charts on a page; a page shows an inch as up to 1.3 cm
LONGEST = 64  # characters of a name in a chart
MANY = 5  # methods, beyond which ranges and single seeds would cover everything

# role: (light, dark)
COLORS: dict[str, tuple[str, str]] = {
    "real": ("#c62828", "#ff7f76"),
    "simulated": ("#1558b0", "#6db3ff"),
    "lost": ("#d08b84", "#a0625c"),
    "text": ("#1b2430", "#e7ebf0"),
    "muted": ("#586474", "#a3aebb"),
    "faint": ("#a2acb9", "#66717f"),
    "grid": ("#e2e6eb", "#2b3440"),
    "page": ("#f5f6f8", "#10151b"),
    "surface": ("#fefefe", "#181f27"),
    "good": ("#1a7a3c", "#56c878"),
    "warning": ("#955800", "#e6b450"),
    "bad": ("#a8002a", "#ff6f86"),
}
LIGHT = {role: light for role, (light, _) in COLORS.items()}

_STYLES = Path(__file__).parent / "styles"


def paper_style() -> AbstractContextManager[None]:
    """Settings for figures of a paper, for drawing and for saving; those of the caller come back after."""
    return mpl.rc_context(_settings("charts") | _settings("paper"))


def page_style() -> AbstractContextManager[None]:
    """Settings for charts of a page, for drawing and for saving; those of the caller come back after."""
    return mpl.rc_context(_settings("charts") | _settings("page"))


@cache
def _settings(name: str) -> Any:
    return dict(mpl.rc_params_from_file(_STYLES / f"{name}.mplstyle", use_default_template=False))


def new_figure(width: float, height: float) -> Figure:
    """A figure that arranges its axes itself. Sizes in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def new_chart(width: float, height: float, x: str, y: str, legend_rows: int = 0) -> tuple[Figure, Any]:
    """A figure with one pair of axes and fixed margins, which is quicker to draw than one that arranges itself.

    Args:
        width: [inches].
        height: [inches].
        x: Title of the x axis, with unit.
        y: Title of the y axis, with unit.
        legend_rows: Lines of text to leave room for above the axes.
    """
    left, right, bottom, top = 0.6, 0.1, 0.42, 0.09 + 0.16 * legend_rows  # inches
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes(
        (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
    )  # fmt: skip
    axes.set(xlabel=x, ylabel=y)
    return figure, axes


def titled(artist: Any, text: str) -> Any:
    """Marks a drawn thing with a text that a page shows where one points at it; returns the artist."""
    artist.set_gid(TITLE + text)
    return artist


def titled_points(points: Any, texts: Sequence[str]) -> Any:
    """The same for every point of a scatter plot."""
    points.set_urls([TITLE + text for text in texts])
    return points


TITLE = "title:"


@dataclass(frozen=True)
class MethodStyle:
    """Look of a method.

    Attributes:
        light: Color on a light ground.
        dark: Color on a dark ground.
        mark: Marker of points, in matplotlib's letters.
        dashes: Pattern of lines in multiples of the width; empty for a solid line.
    """

    light: str
    dark: str
    mark: str
    dashes: tuple[float, ...] = ()

    @property
    def pattern(self) -> dict[str, Any]:
        """The pattern as options of a line."""
        return {"dashes": self.dashes} if self.dashes else {}

    @property
    def line(self) -> dict[str, Any]:
        """Color, mark and pattern as options of a line."""
        return {"color": self.light, "marker": self.mark} | self.pattern


_DASH, _DASHDOT, _DOT, _LONGDASH = (4, 1.6), (4, 1.4, 1, 1.4), (1, 1.3), (7, 1.8)

# of the ablation, of each method, and of advisors and scales beyond those; readers with any of the usual kinds of color
# blindness tell them apart, and patterns and marks do so in gray as well
_LOOKS = (
    MethodStyle("#56b4e9", "#a8dcff", "s", _DASH),
    MethodStyle("#0072b2", "#4da6e8", "o"),
    MethodStyle("#4c10e2", "#e24cc4", "v", _LONGDASH),
    MethodStyle("#636a73", "#7d8794", "X", _DOT),
    MethodStyle("#d55e00", "#ff7d3b", "D", _DASH),
    MethodStyle("#009e73", "#2fc79a", "^"),
    MethodStyle("#332288", "#8f83ff", "p", _DASHDOT),
    MethodStyle("#661100", "#d98a6a", "h", _DASHDOT),
    MethodStyle("#2e6ae2", "#6ac4c4", "H", _DOT),
    MethodStyle("#e69f00", "#ffc44d", "P", _LONGDASH),
    MethodStyle("#882255", "#d0477f", "<", _DASH),
    MethodStyle("#7a6a00", "#b8a43a", ">", _DASHDOT),
    MethodStyle("#117766", "#7fe0d0", "h", _DOT),
    MethodStyle("#882256", "#d04780", "*", _DOT),
    MethodStyle("#7a6a01", "#b8a43b", "d", _LONGDASH),
    MethodStyle("#117767", "#7fe0d1", "8"),
)
_KNOWN = dict(zip((ABLATION, *METHODS), _LOOKS, strict=False))
_OTHERS = _LOOKS[len(_KNOWN) :]

# names in a page's style sheet of all colors that charts are drawn in, and what they are in both themes
VARIABLES = {f"--{role}": pair for role, pair in COLORS.items()} | {
    f"--method-{style.light[1:]}": (style.light, style.dark) for style in _LOOKS
}


def method_styles(methods: Sequence[str]) -> dict[str, MethodStyle]:
    """The look of each method of a comparison; those without a look of their own get one by their order."""
    unknown = [method for method in dict.fromkeys(methods) if method not in _KNOWN]
    others = {method: _OTHERS[i % len(_OTHERS)] for i, method in enumerate(unknown)}
    return {method: _KNOWN.get(method) or others[method] for method in methods}


def log_axis(axis: Any, low: float, high: float) -> None:
    """A logarithmic axis with plain numbers on it, between two values that its data lie within."""
    few, more, many = (1, 2, 5), (1, 1.5, 2, 3, 5, 7), (1, 1.2, 1.5, 2, 3, 4, 5, 6, 7, 8)
    steps = few if high / low > 12 else more if high / low > 3 else many
    ticks = [s * 10.0**e for e in range(-3, 6) for s in steps if low <= s * 10.0**e <= high]
    axis.axes.set(**{f"{axis.axis_name}scale": "log", f"{axis.axis_name}lim": (low, high)})
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def handle(label: str, **options: Any) -> Line2D:
    """A line of a legend."""
    return Line2D([], [], label=chart_name(label), **options)


def _legend_columns(labels: Sequence[str], width: float) -> int:
    """Number of columns that a legend may have within a width [inches]."""
    widest = 0.46 + 0.056 * max(map(len, labels))
    columns = max(1, min(len(labels), int(width / widest)))
    rows = -(-len(labels) // columns)
    return -(-len(labels) // rows)


def legend_rows(labels: Sequence[str], width: float) -> int:
    """Number of rows that it then has."""
    return -(-len(labels) // _legend_columns(labels, width))


def legend_above(figure: Figure, handles: Sequence[Line2D], width: float) -> None:
    """One legend over all axes of a figure that arranges itself; they make room for it."""
    columns = _legend_columns([str(line.get_label()) for line in handles], width)
    figure.legend(handles=list(handles), loc="outside upper center", ncols=columns, borderaxespad=0.1)


def legend_over(axes: Any) -> None:
    """A legend in one row over the axes of a chart, for what has a label."""
    count = len(axes.get_legend_handles_labels()[0])
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=max(1, count), borderaxespad=0.1)


def chart_name(name: str, longest: int = LONGEST) -> str:
    """A name in a chart: in one line, and cut off where it would leave the chart no room.

    A legend leaves out what begins with an underscore, so that gets a space before it.
    """
    line = shortened(" ".join(visible(name).split()), longest)
    return f" {line}" if line.startswith("_") else line


def panel_title(axes: Any, text: str) -> None:
    """The letter of a panel, such as `(a)`, with what it shows."""
    axes.set_title(text, loc="left", pad=4)
