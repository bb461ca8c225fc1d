"""Figures of the comparison's page: convergence, every seed, speeds and their errors, error by marker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swim2real.comparison.protocols import MarkerKind
from swim2real.comparison.statistics import MethodStatistics
from swim2real.comparison.statistics_detail import marker_errors, nan_mean, speeds
from swim2real.comparison.statistics_tables import THEORY
from swim2real.report.comparison_palette import MethodStyle
from swim2real.report.palette import LIGHT, Figure, framed, label
from swim2real.report.units import mm, to_mm

Styles = Mapping[str, MethodStyle]
Theory = Mapping[str, float]

_LEGEND = {"itemclick": "toggle", "itemdoubleclick": "toggleothers"}


def convergence(methods: Sequence[MethodStatistics], styles: Styles) -> Figure:
    """Best loss so far: the mean of each method bold, every seed thin, a point at each seed's end."""
    budget = methods[0].curves.shape[1]
    count = list(range(1, budget + 1))
    step = next(n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 10**4) if budget <= 10 * n)
    data: list[dict[str, Any]] = []
    for i, one in enumerate(methods):
        style, name = styles[one.method], label(one.method)
        shared = {"type": "scatter", "legendgroup": str(i)}
        data.append({
            **shared, "mode": "lines", "name": name, "x": count, "y": _millimeters(one.curves.mean(axis=0)),
            "line": {"color": style.light, "width": 3, "dash": style.pattern, "shape": "hv"},
            "hovertemplate": f"{name}, mean of {len(one.runs)} after %{{x}}: %{{y:.1f}} mm<extra></extra>",
        })  # fmt: skip
        data += [
            {
                **shared, "mode": "lines", "showlegend": False, "x": count, "y": _millimeters(curve),
                "line": {"color": style.light, "width": 1, "shape": "hv"}, "opacity": 0.4,
                "hovertemplate": f"{name}, seed {seed}, after %{{x}}: %{{y:.1f}} mm<extra></extra>",
            }
            for seed, curve in zip(one.seeds, one.curves, strict=True)
        ]  # fmt: skip
        data.append({
            **shared, "mode": "markers", "showlegend": False, "x": [budget + 0.02 * budget * (i + 1)] * len(one.runs),
            "y": _millimeters(one.final.values), "text": [f"seed {seed}" for seed in one.seeds], "cliponaxis": False,
            "marker": {"color": style.light, "symbol": style.symbol, "size": 8},
            "hovertemplate": f"{name}, %{{text}} ends at %{{y:.1f}} mm<extra></extra>",
        })  # fmt: skip
    return framed(
        data, "evaluations", f"best {methods[0].words.loss} so far (mm)", 460, legend=_legend(),
        xaxis={
            "range": [1, budget * (1 + 0.02 * (len(methods) + 1))],
            "tickvals": [1, *range(step, budget + 1, step)] if step > 1 else count,
        },
        yaxis=_log_axis(),
    )  # fmt: skip


def strip(methods: Sequence[MethodStatistics], styles: Styles) -> Figure:
    """Best loss of every seed, a row a method, the best at the top; a bar at the mean."""
    ordered = sorted(methods, key=lambda one: one.final.mean, reverse=True)  # plotly's axis goes up
    data: list[dict[str, Any]] = []
    for row, one in enumerate(ordered):
        style, name = styles[one.method], label(one.method)
        spread = 0.18 * np.linspace(-1, 1, len(one.runs)) if len(one.runs) > 1 else np.zeros(1)
        data.append({
            "type": "scatter", "mode": "lines", "x": [to_mm(one.final.mean)] * 2, "y": [row - 0.3, row + 0.3],
            "line": {"color": LIGHT["text"], "width": 2.5}, "showlegend": False,
            "hovertemplate": f"{name}, mean: %{{x:.1f}} mm<extra></extra>",
        })  # fmt: skip
        data.append({
            "type": "scatter", "mode": "markers", "x": _millimeters(one.final.values),
            "y": [round(row + offset, 3) for offset in spread.tolist()], "text": [str(seed) for seed in one.seeds],
            "marker": {"color": style.light, "symbol": style.symbol, "size": 10}, "showlegend": False,
            "hovertemplate": f"{name}, seed %{{text}}: %{{x:.1f}} mm<extra></extra>",
        })  # fmt: skip
    return framed(
        data, f"best {methods[0].words.loss} (mm)", "", 90 + 44 * len(ordered), xaxis=_log_axis(),
        yaxis={
            "tickvals": list(range(len(ordered))), "ticktext": [label(one.method) for one in ordered],
            "range": [-0.6, len(ordered) - 0.4], "showgrid": False, "ticks": "", "fixedrange": True,
        },
    )  # fmt: skip


def velocities(
    methods: Sequence[MethodStatistics], styles: Styles, errors: bool, theory: Theory | None = None
) -> Figure:  # fmt: skip
    """Forward speed against frequency, or how far off it is: mean over seeds, bars from the lowest to the highest."""
    data: list[dict[str, Any]] = []
    words = "velocity error" if errors else "forward speed"
    first = None
    for one in methods:
        own = speeds(one.runs)
        if own is None:
            continue
        first = first or own
        style, name = styles[one.method], label(one.method)
        values = own.errors if errors else own.simulated
        mean = nan_mean(values, axis=0)
        known = np.isfinite(values)
        above = np.where(known, values, -np.inf).max(axis=0) - mean
        below = mean - np.where(known, values, np.inf).min(axis=0)
        data.append({
            "type": "scatter", "mode": "lines+markers", "name": name,
            "x": [round(f, 4) for f in own.frequencies.tolist()], "y": _millimeters(mean),
            "text": [label(trial) for trial in own.trials],
            "line": {"color": style.light, "width": 2, "dash": style.pattern},
            "marker": {"color": style.light, "symbol": style.symbol, "size": 9},
            "error_y": {
                "type": "data", "symmetric": False, "array": _millimeters(above), "arrayminus": _millimeters(below),
                "color": style.light, "thickness": 1, "width": 3,
            },
            "hovertemplate": f"%{{text}}, {name}: %{{y:.1f}} mm/s at %{{x:.2f}} Hz<extra></extra>",
        })  # fmt: skip
    if first is not None:
        x = [round(f, 4) for f in first.frequencies.tolist()]
        if theory is not None:
            predicted = np.array([theory.get(name, np.nan) for name in first.trials])
            data.append({
                "type": "scatter", "mode": "lines+markers", "name": THEORY, "x": x,
                "y": _millimeters(np.abs(predicted - first.real) if errors else predicted),
                "line": {"color": LIGHT["muted"], "width": 1.5, "dash": "dot"},
                "marker": {"color": LIGHT["muted"], "symbol": "cross-thin-open", "size": 9},
                "hovertemplate": f"{THEORY}: %{{y:.1f}} mm/s at %{{x:.2f}} Hz<extra></extra>",
            })  # fmt: skip
        if not errors:
            data.append({
                "type": "scatter", "mode": "markers", "name": "real", "x": x, "y": _millimeters(first.real),
                "marker": {"color": LIGHT["real"], "symbol": "circle-open", "size": 15, "line": {"width": 2.5}},
                "hovertemplate": "real: %{y:.1f} mm/s at %{x:.2f} Hz<extra></extra>",
            })  # fmt: skip
    return framed(
        data, "frequency of the tail beat (Hz)", f"{words} (mm/s)", 400, legend=_legend(),
        yaxis={"rangemode": "tozero"} if errors else {},
    )  # fmt: skip


def by_marker(
    methods: Sequence[MethodStatistics], styles: Styles, kind: MarkerKind, markers: Sequence[str]
) -> Figure:  # fmt: skip
    """One kind of error over the markers, mean over trials and seeds."""
    names = [label(marker) for marker in markers]
    data = [
        {
            "type": "scatter", "mode": "lines+markers", "x": names, "y": _millimeters(mean), "showlegend": False,
            "line": {"color": style.light, "width": 2, "dash": style.pattern},
            "marker": {"color": style.light, "symbol": style.symbol, "size": 8},
            "text": [mm(value) for value in mean.tolist()],
            "hovertemplate": f"{label(one.method)}, %{{x}}: %{{text}} mm<extra></extra>",
        }
        for one in methods
        for style, mean in [(styles[one.method], nan_mean(marker_errors(one.runs, kind), axis=0))]
    ]  # fmt: skip
    return framed(
        data, methods[0].words.markers_order, "error (mm)", 320,
        xaxis={"type": "category", "categoryorder": "array", "categoryarray": names}, yaxis={"rangemode": "tozero"},
    )  # fmt: skip


def _millimeters(values: Any) -> list[float | None]:
    return [to_mm(value) for value in np.asarray(values, dtype=float).tolist()]


def _log_axis() -> dict[str, Any]:
    return {"type": "log", "dtick": "D2", "tickformat": "~g", "minor": {"showgrid": False}}


def _legend() -> dict[str, Any]:
    return {
        "orientation": "h", "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)",
        **_LEGEND,
    }  # fmt: skip
