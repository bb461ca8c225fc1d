"""Forward speed and its error against the frequency of the tail beat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swim2real.comparison.statistics import MethodStatistics
from swim2real.comparison.statistics_detail import Speeds, nan_mean, speeds
from swim2real.comparison.statistics_tables import THEORY
from swim2real.report.comparison_palette import MethodStyle
from swim2real.report.paper_figures.style import (
    DOUBLE,
    FAINT,
    MANY,
    REAL,
    handle,
    legend_above,
    legend_rows,
    letter,
    look,
    new_figure,
)


def draw_velocity(
    methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle], theory: Mapping[str, float] | None = None
) -> Any | None:
    """Speeds on the left, their errors on the right; mean over seeds with their range. None without frequencies.

    Args:
        methods: Under one protocol.
        styles: By method.
        theory: Speeds that elongated body theory predicts, by trial [m/s].
    """
    ordered = sorted(methods, key=lambda one: one.figures["velocity_error"].mean)
    found = {one.method: own for one in ordered if (own := speeds(one.runs)) is not None}
    if not found:
        return None
    first = next(iter(found.values()))
    figure = new_figure(
        DOUBLE, 2.2 + 0.14 * legend_rows([f"{method} (00.0 mm/s)" for method in (*found, THEORY)], DOUBLE)
    )
    figure.get_layout_engine().set(wspace=0.07)
    left, right = figure.subplots(1, 2)
    handles: list[Any] = []
    gap = float(np.min(np.diff(first.frequencies))) if len(first.frequencies) > 1 else 0.2
    for i, (method, own) in enumerate(found.items()):
        style = styles[method]
        shift = min(0.07, 0.36 / len(found)) * gap * (i - (len(found) - 1) / 2)
        _draw_range(left, own, own.simulated, style, shift, bars=len(found) <= MANY)
        _draw_range(right, own, own.errors, style, shift, bars=True)
        handles.append(handle(label=f"{method} ({1e3 * own.mean_error.mean:.1f} mm/s)", **look(style)))
    if theory is not None:
        predicted = np.array([theory.get(name, np.nan) for name in first.trials])
        line: dict[str, Any] = {"color": FAINT, "linestyle": (0, (1, 1.3)), "marker": "+"}
        left.plot(first.frequencies, 1e3 * predicted, **line)
        errors = 1e3 * np.abs(predicted - first.real)
        right.plot(first.frequencies, errors, **line)
        handles.append(handle(label=f"{THEORY} ({np.nanmean(errors):.1f} mm/s)", **line))
    real: dict[str, Any] = {
        "color": REAL,
        "linestyle": "none",
        "marker": "o",
        "markersize": 6.5,
        "markerfacecolor": "none",
    }
    left.plot(first.frequencies, 1e3 * first.real, zorder=5, **real)
    handles.insert(0, handle(label="real", **real))
    letter(left, "(a) forward speed")
    letter(right, "(b) velocity error")
    left.set_ylabel("forward speed (mm/s)")
    right.set_ylabel("|simulated − real| (mm/s)")
    right.set_ylim(bottom=0)
    for axes in (left, right):
        axes.set_xlabel("frequency of the tail beat (Hz)")
    legend_above(figure, handles, DOUBLE)
    return figure


def _draw_range(axes: Any, own: Speeds, values: Any, style: MethodStyle, shift: float, bars: bool) -> None:
    """The mean over seeds as a line and the range as bars. Values of shape (S, N) [m/s]."""
    known = np.isfinite(values)
    low = np.where(known.any(axis=0), np.where(known, values, np.inf).min(axis=0), np.nan)
    high = np.where(known.any(axis=0), np.where(known, values, -np.inf).max(axis=0), np.nan)
    x = own.frequencies + shift
    axes.plot(x, 1e3 * nan_mean(values, axis=0), linewidth=1, zorder=3, **look(style))
    if bars:
        axes.vlines(x, 1e3 * low, 1e3 * high, color=style.light, linewidth=0.7, alpha=0.5, zorder=2)
