"""Strip plot: the best loss of every seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swim2real.comparison.statistics import MethodStatistics
from swim2real.comparison.statistics_cells import spread_cell
from swim2real.report.comparison_palette import MethodStyle
from swim2real.report.paper_figures.style import COLUMN, FAINT, REAL, log_axis, new_figure


def draw_strip(methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle]) -> Any:
    """One row a method, the best first: a dot a seed, a bar at the mean, mean ± standard deviation at the side."""
    ordered = sorted(methods, key=lambda one: one.final.mean)
    figure = new_figure(COLUMN, 0.75 + 0.24 * len(ordered))
    axes = figure.subplots()
    axes.grid(visible=True, axis="x")
    axes.grid(visible=False, axis="y")
    for row, one in enumerate(ordered):
        style = styles[one.method]
        values = 1e3 * one.final.values
        offsets = 0.26 * (np.arange(len(values)) - (len(values) - 1) / 2) / max(len(values) - 1, 1) * 1.6
        axes.plot(
            values, row + offsets, style.mark, color=style.light, markersize=4, markeredgecolor="white",
            markeredgewidth=0.3, zorder=3, clip_on=False,
        )  # fmt: skip
        axes.plot([1e3 * one.final.mean] * 2, [row - 0.34, row + 0.34], color=REAL, linewidth=1.1, zorder=2)
        axes.annotate(
            spread_cell(one.final).text, (1.0, row), xycoords=("axes fraction", "data"), xytext=(4, 0),
            textcoords="offset points", va="center", ha="left", fontsize=7.5, annotation_clip=False,
        )  # fmt: skip
    axes.annotate(
        "mean ± std", (1.0, -0.62), xycoords=("axes fraction", "data"), xytext=(4, 0), textcoords="offset points",
        va="bottom", ha="left", fontsize=6.5, color=FAINT, annotation_clip=False,
    )  # fmt: skip
    values = 1e3 * np.concatenate([one.final.values for one in methods])
    log_axis(axes.xaxis, 0.88 * float(values.min()), 1.12 * float(values.max()))
    axes.set_ylim(len(ordered) - 0.4, -0.6)
    axes.set_yticks(range(len(ordered)), [one.method for one in ordered])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(f"best {methods[0].words.loss} (mm)")
    return figure
