"""What all figures for papers share: widths, letters, and files that are the same to the last byte each time."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swim2real.errors import MissingExtraError, RunError
from swim2real.report.comparison_palette import MethodStyle

COLUMN, DOUBLE = 3.4, 7.0  # inches, of a column and of both
REAL = "#111111"
MANY = 5  # methods, beyond which ranges and single seeds would cover everything
FAINT, GRID = "#8a929c", "#e3e6ea"

_SETTINGS: Any = {
    "font.family": ["STIXGeneral", "DejaVu Sans"],  # both come with matplotlib, so every machine has them
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "legend.columnspacing": 1.2,
    "legend.labelspacing": 0.35,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#4a525c",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.6,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "axes.unicode_minus": True,
    "pdf.fonttype": 42,  # letters stay letters, embedded
    "ps.fonttype": 42,
    "savefig.facecolor": "white",
    "text.usetex": False,
}


@contextmanager
def paper_style() -> Generator[None]:
    """Settings for drawing and for saving; those of the caller come back after.

    Raises:
        MissingExtraError: matplotlib isn't installed.
    """
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise MissingExtraError(
            "figures for papers need matplotlib; install it with: pip install 'swim2real[compare]'"
        ) from error
    with mpl.rc_context(_SETTINGS):
        yield


def new_figure(width: float, height: float) -> Any:
    """A figure of its own, unknown to pyplot. Sizes in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Any, folder: Path, name: str) -> list[Path]:
    """Writes a figure as PDF and as PNG with 300 dots an inch, without dates.

    Raises:
        RunError: It can't be written.
    """
    paths = [folder / f"{name}.pdf", folder / f"{name}.png"]
    try:
        figure.savefig(paths[0], metadata={"CreationDate": None, "Producer": None, "Creator": None})
        figure.savefig(paths[1], dpi=300, metadata={"Software": None})
    except OSError as error:
        raise RunError(f"can't write figure '{name}' to '{folder}': {error.strerror or error}") from error
    return paths


def log_axis(axis: Any, low: float, high: float) -> None:
    """A logarithmic axis with plain numbers on it, between two values that its data lie within."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter, NullLocator

    few, more, many = (1, 2, 5), (1, 1.5, 2, 3, 5, 7), (1, 1.2, 1.5, 2, 3, 4, 5, 6, 7, 8)
    steps = few if high / low > 12 else more if high / low > 3 else many
    ticks = [s * 10.0**e for e in range(-3, 6) for s in steps if low <= s * 10.0**e <= high]
    axis.axes.set(**{f"{axis.axis_name}scale": "log", f"{axis.axis_name}lim": (low, high)})
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def handle(**options: Any) -> Any:
    """A line of a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **options)


def look(style: MethodStyle) -> dict[str, Any]:
    """Color, mark and pattern of a method's line."""
    return {"color": style.light, "marker": style.mark} | dashed(style)


def dashed(style: MethodStyle) -> dict[str, Any]:
    """Its pattern alone."""
    return {"dashes": style.dashes} if style.dashes else {}


def legend_columns(labels: Sequence[str], width: float) -> int:
    """How many columns a legend may have within a width [inches]."""
    widest = 0.46 + 0.056 * max(map(len, labels))
    columns = max(1, min(len(labels), int(width / widest)))
    rows = -(-len(labels) // columns)
    return -(-len(labels) // rows)


def legend_rows(labels: Sequence[str], width: float) -> int:
    """How many rows it then has."""
    return -(-len(labels) // legend_columns(labels, width))


def legend_above(figure: Any, handles: Sequence[Any], width: float) -> None:
    """One legend over all axes, which make room for it."""
    columns = legend_columns([one.get_label() for one in handles], width)
    figure.legend(handles=list(handles), loc="outside upper center", ncols=columns, borderaxespad=0.1)


def letter(axes: Any, text: str) -> None:
    """The letter of a panel, such as `(a)`, with what it shows."""
    axes.set_title(text, loc="left", pad=4)
