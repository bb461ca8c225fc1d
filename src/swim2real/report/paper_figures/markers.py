"""Error of each marker, of swims from head to tail, with and without registration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.comparison.statistics import MethodStatistics
from swim2real.comparison.statistics_detail import marker_errors, nan_mean
from swim2real.report.comparison_palette import MethodStyle
from swim2real.report.paper_figures.style import (
    DOUBLE,
    MANY,
    handle,
    legend_above,
    legend_rows,
    letter,
    look,
    new_figure,
)


def draw_markers(
    methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle], markers: Sequence[str]
) -> Any:  # fmt: skip
    """One panel a kind of error: the mean as a line, and for few methods the range over seeds as a band."""
    words = methods[0].words
    kinds = words.markers
    figure = new_figure(DOUBLE, 2.05 + 0.14 * legend_rows([one.method for one in methods], DOUBLE))
    panels = figure.subplots(1, len(kinds), squeeze=False)[0]
    places = list(range(len(markers)))
    for axes, (kind, kind_words), name in zip(panels, kinds, "abc", strict=False):
        for one in methods:
            style = styles[one.method]
            errors = 1e3 * marker_errors(one.runs, kind)
            axes.plot(places, nan_mean(errors, axis=0), markersize=3.2, zorder=3, clip_on=False, **look(style))
            if len(methods) > MANY:
                continue
            axes.fill_between(
                places, errors.min(axis=0), errors.max(axis=0), color=style.light, alpha=0.13, linewidth=0, zorder=1
            )
        axes.set_ylim(bottom=0)
        axes.set_xticks(places, list(markers))
        axes.set_xlabel(words.markers_order)
        letter(axes, f"({name}) {kind_words}")
    panels[0].set_ylabel("error (mm)")
    handles = [handle(label=one.method, **look(styles[one.method])) for one in methods]
    legend_above(figure, handles, DOUBLE)
    return figure
