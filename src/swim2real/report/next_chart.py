"""The chart of the trials that could be filmed next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from swim2real.report.style import COLUMN, LIGHT, chart_name, new_figure, paper_style
from swimbase import store
from swimbase.errors import RunError

CHART = "next.png"
_ROW = 0.17  # inches


def _volumes(trials: Sequence[Mapping[str, Any]]) -> Figure:
    """Expected volume of the sets' region by trial, the first one highlighted.

    Args:
        trials: With `label` and `volume`, in the order in which they are drawn from the top.
    """
    figure = new_figure(1.4 * COLUMN, 0.6 + _ROW * len(trials))
    axes = figure.add_subplot()
    colors = [LIGHT["good"], *[LIGHT["faint"]] * (len(trials) - 1)]
    axes.barh([chart_name(one["label"]) for one in trials], [100 * one["volume"] for one in trials], color=colors)
    axes.invert_yaxis()
    axes.set(xlabel="expected volume of the sets' region (% of now)", xlim=(0, 100))
    return figure


def write_chart(folder: Path, trials: Sequence[Mapping[str, Any]]) -> None:
    """Writes next.png.

    Raises:
        RunError: It can't be written.
    """
    with paper_style(), store.writing(folder / CHART, RunError), store.whole_file(folder / CHART) as part:
        _volumes(trials).savefig(part, format="png", dpi=200, metadata={"Software": None})
