"""Convergence: the best loss so far, and where each seed ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swim2real.comparison.statistics import MethodStatistics
from swim2real.report.comparison_palette import MethodStyle
from swim2real.report.paper_figures.style import (
    COLUMN,
    FAINT,
    MANY,
    dashed,
    handle,
    legend_above,
    legend_rows,
    log_axis,
    look,
    new_figure,
)


def draw_convergence(methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle]) -> Any:
    """Mean of the best loss so far of each method, every seed thin, and a dot where a seed ends.

    The dots of each method stand in a column of their own, right of the last evaluation.
    """
    figure = new_figure(COLUMN, 2.4 + 0.14 * legend_rows([one.method for one in methods], COLUMN))
    axes = figure.subplots()
    ordered = sorted(methods, key=lambda one: one.final.mean)
    budget = methods[0].curves.shape[1]
    evaluations = np.arange(1, budget + 1)
    spacing = 0.028 * budget
    handles: list[Any] = []
    alpha = 0.4 if len(methods) <= MANY else 0.18
    for i, one in enumerate(ordered):
        style = styles[one.method]
        for curve in one.curves:
            axes.step(evaluations, 1e3 * curve, where="post", color=style.light, linewidth=0.4, alpha=alpha)
        mean = 1e3 * one.curves.mean(axis=0)
        axes.step(evaluations, mean, where="post", color=style.light, linewidth=1.5, zorder=3, **dashed(style))
        place = np.full(len(one.runs), budget + (i + 1) * spacing)
        axes.plot(
            place, 1e3 * one.final.values, style.mark, color=style.light, markersize=3, markeredgewidth=0, alpha=0.85,
            clip_on=False, zorder=4,
        )  # fmt: skip
        handles.append(handle(label=one.method, linewidth=1.5, **look(style)))
    curves = 1e3 * np.concatenate([one.curves for one in methods])
    log_axis(axes.yaxis, 0.85 * float(curves.min()), 1.12 * float(curves.max()))
    end = budget + (len(ordered) + 0.8) * spacing
    axes.axvline(budget + 0.45 * spacing, color=FAINT, linewidth=0.5, linestyle=(0, (1, 2)))
    axes.set_xlim(1, end)
    axes.set_xticks([1, *range(10, budget + 1, 10)] if budget >= 10 else list(range(1, budget + 1)))
    axes.set_xlabel("evaluations")
    axes.xaxis.set_label_coords(0.5 * budget / end, -0.11)
    axes.set_ylabel(f"best {methods[0].words.loss} so far (mm)")
    legend_above(figure, handles, COLUMN)
    return figure
