"""Charts of a comparison: convergence, every seed, speeds, errors by marker, and what becomes of proposals.

The same functions draw the page's charts and the figures for papers; only widths differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from swim2real.comparison.statistics import MethodStatistics, Speeds, marker_errors, speeds, step_statistics
from swim2real.comparison.tables import THEORY, spread_cell
from swim2real.report.style import (
    COLUMN,
    DOUBLE,
    LIGHT,
    MANY,
    MethodStyle,
    chart_name,
    handle,
    legend_above,
    legend_rows,
    log_axis,
    new_figure,
    panel_title,
    titled,
)

if TYPE_CHECKING:
    import pandas as pd

Styles = Mapping[str, MethodStyle]

_ACCEPTED = ("#00416a", "#2f7fb8", "#85bce0", "#c3dff1", "#e0eff8")  # dark to light with the step getting smaller
_REJECTED = "#eceef0"
_LEAST_SHARE = 3.5  # %, of a bar with room for its number
_BESIDE = 16  # characters of a name that stands beside others on an axis


def convergence(methods: Sequence[MethodStatistics], styles: Styles, width: float = COLUMN) -> Figure:
    """Mean of the best loss so far of each method, and every seed thin. Width in inches."""
    height = 2.4 + 0.24 * (width - COLUMN)
    figure = new_figure(width, height + 0.14 * legend_rows([stats.method for stats in methods], width))
    axes: Any = figure.subplots()
    budget = methods[0].curves.shape[1]
    evaluations = np.append(np.arange(1, budget + 1), 1.04 * budget)  # so that the last step is seen
    handles: list[Any] = []
    for stats in sorted(methods, key=lambda stats: stats.mean("final")):
        style = styles[stats.method]
        thin = {"color": style.light, "linewidth": 0.4, "alpha": 0.4 if len(methods) <= MANY else 0.18}
        for seed, curve in zip(stats.seeds, stats.curves, strict=True):
            (line,) = axes.step(evaluations, 1e3 * np.append(curve, curve[-1]), where="post", **thin)
            titled(line, f"{stats.method}, seed {seed}")
        mean, bold = 1e3 * stats.curves.mean(axis=0), {"color": style.light, "linewidth": 1.5, "zorder": 3}
        (line,) = axes.step(evaluations, np.append(mean, mean[-1]), where="post", **bold, **style.pattern)
        titled(line, f"{stats.method}, mean of {len(stats.seeds)}")
        handles.append(handle(label=stats.method, linewidth=1.5, **style.line))
    curves = 1e3 * np.concatenate([stats.curves for stats in methods])
    log_axis(axes.yaxis, 0.85 * float(curves.min()), 1.12 * float(curves.max()))
    axes.set_xlim(1, evaluations[-1])
    step = next(n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 10**4) if budget <= 10 * n)
    axes.set_xticks([1, *range(step, budget + 1, step)] if step > 1 else range(1, budget + 1))
    axes.set_xlabel("evaluations")
    axes.set_ylabel(f"best {methods[0].description.loss} so far (mm)")
    legend_above(figure, handles, width)
    return figure


def strip(methods: Sequence[MethodStatistics], styles: Styles, width: float = COLUMN) -> Figure:
    """One row per method, the best first: a dot per seed, a bar at the mean, mean ± standard deviation at the side."""
    ordered = sorted(methods, key=lambda stats: stats.mean("final"))
    figure = new_figure(width, 0.75 + 0.24 * len(ordered))
    axes: Any = figure.subplots()
    axes.grid(visible=True, axis="x")
    axes.grid(visible=False, axis="y")
    for row, stats in enumerate(ordered):
        style = styles[stats.method]
        values = 1e3 * stats.final.to_numpy()
        offsets = 0.26 * (np.arange(len(values)) - (len(values) - 1) / 2) / max(len(values) - 1, 1) * 1.6
        for seed, value, offset in zip(stats.seeds, values, offsets, strict=True):
            (point,) = axes.plot(
                value, row + offset, style.mark, color=style.light, markersize=4, markeredgecolor=LIGHT["surface"],
                markeredgewidth=0.3, zorder=3, clip_on=False,
            )  # fmt: skip
            titled(point, f"{stats.method}, seed {seed}: {value:.1f} mm")
        axes.plot(
            [1e3 * stats.mean("final")] * 2, [row - 0.34, row + 0.34], color=LIGHT["text"], linewidth=1.1, zorder=2
        )
        axes.annotate(
            spread_cell(stats.final).text, (1.0, row), xycoords=("axes fraction", "data"), xytext=(4, 0),
            textcoords="offset points", va="center", ha="left", fontsize=7.5, annotation_clip=False,
        )  # fmt: skip
    axes.annotate(
        "mean ± std", (1.0, -0.62), xycoords=("axes fraction", "data"), xytext=(4, 0), textcoords="offset points",
        va="bottom", ha="left", fontsize=6.5, color=LIGHT["muted"], annotation_clip=False,
    )  # fmt: skip
    values = 1e3 * np.concatenate([stats.final.to_numpy() for stats in methods])
    log_axis(axes.xaxis, 0.88 * float(values.min()), 1.12 * float(values.max()))
    axes.set_ylim(len(ordered) - 0.4, -0.6)
    axes.set_yticks(range(len(ordered)), [chart_name(stats.method) for stats in ordered])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(f"best {methods[0].description.loss} (mm)")
    return figure


def velocity(
    methods: Sequence[MethodStatistics], styles: Styles, theory: Mapping[str, float] | None = None,
    width: float = DOUBLE,
) -> Figure:  # fmt: skip
    """Speeds on the left, their errors on the right, over frequencies; mean over seeds with their range.

    Args:
        methods: Under one protocol.
        styles: Look of each method, by name.
        theory: Speeds that elongated body theory predicts, by trial [m/s].
        width: [inches].
    """
    ordered = sorted(methods, key=lambda stats: stats.figures["velocity_error"].mean())
    by_method = {stats.method: own for stats in ordered if (own := speeds(stats.runs)) is not None}
    first = next(iter(by_method.values()))
    labels = [f"{method} (00.0 mm/s)" for method in (*by_method, THEORY)]
    figure = new_figure(width, 0.31 * width + 0.14 * legend_rows(labels, width))
    layout: Any = figure.get_layout_engine()
    layout.set(wspace=0.07)
    left, right = figure.subplots(1, 2)
    handles: list[Any] = []
    gap = float(np.min(np.diff(first.frequencies))) if len(first.frequencies) > 1 else 0.2
    for i, (method, own) in enumerate(by_method.items()):
        style = styles[method]
        shift = min(0.07, 0.36 / len(by_method)) * gap * (i - (len(by_method) - 1) / 2)
        _draw_range(left, own, own.simulated, style, shift, method, bars=len(by_method) <= MANY)
        _draw_range(right, own, own.errors, style, shift, method, bars=True)
        handles.append(handle(label=f"{method} ({1e3 * own.mean_error.mean():.1f} mm/s)", **style.line))
    if theory is not None:
        predicted = np.array([theory.get(name, np.nan) for name in first.trials])
        line: dict[str, Any] = {"color": LIGHT["muted"], "linestyle": (0, (1, 1.3)), "marker": "+"}
        left.plot(first.frequencies, 1e3 * predicted, **line)
        errors = 1e3 * np.abs(predicted - first.real)
        right.plot(first.frequencies, errors, **line)
        handles.append(handle(label=f"{THEORY} ({np.nanmean(errors):.1f} mm/s)", **line))
    real: dict[str, Any] = {
        "color": LIGHT["text"], "linestyle": "none", "marker": "o", "markersize": 6.5, "markerfacecolor": "none",
    }  # fmt: skip
    left.plot(first.frequencies, 1e3 * first.real, zorder=5, **real)
    handles.insert(0, handle(label="real", **real))
    panel_title(left, "(a) forward speed")
    panel_title(right, "(b) velocity error")
    left.set_ylabel("forward speed (mm/s)")
    right.set_ylabel("|simulated − real| (mm/s)")
    right.set_ylim(bottom=0)
    for axes in (left, right):
        axes.set_xlabel("frequency of the tail beat (Hz)")
    legend_above(figure, handles, width)
    return figure


def _draw_range(
    axes: Any, own: Speeds, values: pd.DataFrame, style: MethodStyle, shift: float, method: str, bars: bool
) -> None:  # fmt: skip
    """The mean over seeds as a line and the range as bars; the values have a column for each trial [m/s]."""
    x = own.frequencies.to_numpy() + shift
    (line,) = axes.plot(x, 1e3 * values.mean().to_numpy(), linewidth=1, zorder=3, **style.line)
    titled(line, method)
    if bars:
        low, high = 1e3 * values.min().to_numpy(), 1e3 * values.max().to_numpy()
        axes.vlines(x, low, high, color=style.light, linewidth=0.7, alpha=0.5, zorder=2)


def markers(
    methods: Sequence[MethodStatistics], styles: Styles, names: Sequence[str], width: float = DOUBLE
) -> Figure:  # fmt: skip
    """Error of each marker, one panel a kind: the mean as a line, and for few methods the range over seeds as a band.

    Args:
        methods: Under one protocol.
        styles: Look of each method, by name.
        names: Names of the markers.
        width: [inches].
    """
    protocol = methods[0].description
    figure = new_figure(width, 0.29 * width + 0.14 * legend_rows([stats.method for stats in methods], width))
    panels = figure.subplots(1, len(protocol.markers), squeeze=False)[0]
    places = list(range(len(names)))
    for axes, (kind, description), name in zip(panels, protocol.markers, "abc", strict=False):
        for stats in methods:
            style = styles[stats.method]
            errors = 1e3 * marker_errors(stats.runs, kind, len(names))
            (line,) = axes.plot(places, errors.mean(), markersize=3.2, zorder=3, clip_on=False, **style.line)
            titled(line, stats.method)
            if len(methods) > MANY:
                continue
            axes.fill_between(places, errors.min(), errors.max(), color=style.light, alpha=0.13, linewidth=0, zorder=1)
        axes.set_ylim(bottom=0)
        axes.set_xticks(places, [chart_name(name, _BESIDE) for name in names])
        axes.set_xlabel(protocol.markers_order)
        panel_title(axes, f"({name}) {description}")
    panels[0].set_ylabel("error (mm)")
    legend_above(figure, [handle(label=stats.method, **styles[stats.method].line) for stats in methods], width)
    return figure


def line_search(methods: Sequence[MethodStatistics], styles: Styles) -> Figure | None:
    """At which step proposals are accepted: shares of the step sizes and of rejected rounds. None without rounds."""
    counted = {stats.method: steps for stats in methods if (steps := step_statistics(stats.runs)) and steps.rounds}
    if not counted:
        return None
    figure = new_figure(COLUMN, 1.3 + 0.4 * len(counted))
    axes: Any = figure.subplots()
    sizes = sorted({size for steps in counted.values() for size in steps.by_size}, reverse=True)
    shades = [_ACCEPTED[min(i, len(_ACCEPTED) - 1)] for i in range(len(sizes))]
    axes.grid(visible=False)
    for row, steps in enumerate(counted.values()):
        shares = np.array([100 * steps.by_size.get(size, 0) / steps.rounds for size in sizes])
        ends = np.cumsum(shares)
        bars = zip([*shares, 100 - ends[-1]], [*(ends - shares), ends[-1]], [*shades, _REJECTED], strict=True)
        for i, (share, start, shade) in enumerate(bars):
            axes.barh(row, share, left=start, height=0.56, color=shade, edgecolor="white", linewidth=0.6)
            if share >= _LEAST_SHARE and shade != _REJECTED:
                look = {"ha": "center", "va": "center", "fontsize": 7, "color": "white" if i < 2 else LIGHT["text"]}
                axes.text(start + share / 2, row, f"{share:.0f}", **look)
        accepted = f"{steps.accepted} of {steps.rounds} accepted ({100 * steps.accept_rate:.0f} %)"
        axes.text(100, row - 0.33, accepted, ha="right", va="bottom", fontsize=7)
    axes.set_yticks(range(len(counted)), [chart_name(method) for method in counted])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set(ylim=(len(counted) - 0.45, -0.85), xlim=(0, 100), xlabel="share of the rounds (%)")
    patches = [Patch(facecolor=shade, label=f"step {size:g}") for shade, size in zip(shades, sizes, strict=True)]
    patches.append(Patch(facecolor=_REJECTED, label="rejected"))
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), handlelength=1.0, columnspacing=0.9)
    return figure
