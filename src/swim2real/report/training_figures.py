"""Figures of a training run: learning curves, paths from above, motor commands, speeds against constant frequencies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.report.palette import LIGHT, Figure, framed

Array = NDArray[np.float64]

_MOST_POINTS = 400  # of a learning curve
_MOST_PATHS = 40
_WINDOW = 50  # episodes of a running mean


def learning_curve(
    episodes: Sequence[Mapping[str, Any]], evaluations: Sequence[Mapping[str, Any]], key: str, title: str,
    factor: float = 1.0, baseline: float | None = None, exploration: int | None = None,
) -> Figure:  # fmt: skip
    """A figure of every episode over the environment steps: their running mean, and the evaluations.

    Args:
        episodes: Lines with `step` and the figure.
        evaluations: Likewise.
        key: The figure.
        title: Of the y axis, with unit.
        factor: By which values are multiplied.
        baseline: What constant-frequency swimming reaches, in the same unit before the factor.
        exploration: Steps of random actions at the start.
    """
    known = [(one["step"], one[key]) for one in episodes if one.get(key) is not None]
    steps, values = np.array([k[0] for k in known], float), factor * np.array([k[1] for k in known], float)
    data: list[dict[str, Any]] = []
    if len(steps):
        window = min(_WINDOW, len(values))
        mean = np.convolve(values, np.ones(window) / window, mode="valid")
        places = np.unique(np.linspace(0, len(mean) - 1, _MOST_POINTS).astype(int))
        data.append({
            "type": "scatter", "mode": "lines", "name": f"while learning, mean of {window} episodes",
            "x": steps[window - 1 :][places].tolist(), "y": np.round(mean[places], 4).tolist(),
            "line": {"color": LIGHT["faint"], "width": 2}, "hovertemplate": "%{x:,} steps: %{y:.3g}<extra></extra>",
        })  # fmt: skip
    shown = [(one["step"], one[key]) for one in evaluations if one.get(key) is not None]
    if shown:
        data.append({
            "type": "scatter", "mode": "lines+markers", "name": "evaluated, without exploration",
            "x": [s for s, _ in shown], "y": [round(factor * v, 4) for _, v in shown],
            "line": {"color": LIGHT["simulated"], "width": 2.5}, "marker": {"size": 7, "color": LIGHT["simulated"]},
            "hovertemplate": "%{x:,} steps: %{y:.3g}<extra></extra>",
        })  # fmt: skip
    last = max([*steps.tolist(), *(s for s, _ in shown), 1.0])
    if baseline is not None:
        data.append({
            "type": "scatter", "mode": "lines", "name": "best constant frequency", "x": [0, last],
            "y": [round(factor * baseline, 4)] * 2, "line": {"color": LIGHT["real"], "width": 2, "dash": "dash"},
            "hovertemplate": "best constant frequency: %{y:.3g}<extra></extra>",
        })  # fmt: skip
    shapes: list[dict[str, Any]] = []
    if exploration:
        shapes.append({
            "type": "rect", "xref": "x", "yref": "paper", "x0": 0, "x1": exploration, "y0": 0, "y1": 1,
            "fillcolor": LIGHT["grid"], "opacity": 0.5, "line": {"width": 0}, "layer": "below",
        })  # fmt: skip
    return framed(data, "environment steps", title, 360, shapes=shapes)


def paths(heads: Sequence[Array], goals: Sequence[Array | None], reached: Sequence[bool]) -> Figure:
    """Ways of the head from above; goals that were reached are green, the others hollow [m]."""
    data: list[dict[str, Any]] = []
    for i, (way, ok) in enumerate(zip(heads[:_MOST_PATHS], reached, strict=False)):
        way = way[:: max(1, len(way) // 150)]
        data.append({
            "type": "scatter", "mode": "lines", "x": np.round(way[:, 0], 4).tolist(),
            "y": np.round(way[:, 1], 4).tolist(), "showlegend": False, "opacity": 0.7,
            "line": {"color": LIGHT["simulated"] if ok or goals[i] is None else LIGHT["faint"], "width": 1.5},
            "hovertemplate": f"episode {i}: %{{x:.2f}} m, %{{y:.2f}} m<extra></extra>",
        })  # fmt: skip
    for name, wanted, symbol, color in (
        ("reached", True, "circle", "good"), ("not reached", False, "circle-open", "real")
    ):  # fmt: skip
        places = [g for g, ok in zip(goals[:_MOST_PATHS], reached, strict=False) if g is not None and ok == wanted]
        if places:
            data.append({
                "type": "scatter", "mode": "markers", "name": name,
                "x": [round(float(g[0]), 3) for g in places], "y": [round(float(g[1]), 3) for g in places],
                "marker": {"symbol": symbol, "size": 9, "color": LIGHT[color], "line": {"width": 2}},
                "hovertemplate": f"{name}: %{{x:.2f}} m, %{{y:.2f}} m<extra></extra>",
            })  # fmt: skip
    return framed(
        data, "x (m), the fish starts toward the left", "y (m)", 460,
        yaxis={"scaleanchor": "x", "scaleratio": 1},
    )  # fmt: skip


def commands(series: Mapping[str, tuple[Array, Array]]) -> Figure:
    """Motor commands over time: name to times [s] and speeds [rad/s]."""
    colors = ("simulated", "real", "good", "warning")
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "lines", "name": name, "x": np.round(times, 3).tolist(),
            "y": np.round(speeds, 3).tolist(),
            "line": {"color": LIGHT[color], "width": 2, "shape": "hv", **({} if i == 0 else {"dash": "dash"})},
            "hovertemplate": f"{name}: %{{y:.2f}} rad/s at %{{x:.2f}} s<extra></extra>",
        }
        for i, ((name, (times, speeds)), color) in enumerate(zip(series.items(), colors, strict=False))
    ]  # fmt: skip
    return framed(data, "time (s)", "motor command (rad/s)", 300)


def scan(frequencies: Array, distances: Array, policy: float) -> Figure:
    """Distance of constant-frequency swimming over its frequency, and that of the policy [mm]."""
    order = np.argsort(frequencies)
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "lines+markers", "name": "constant frequency",
            "x": np.round(frequencies[order], 4).tolist(), "y": np.round(1e3 * distances[order], 2).tolist(),
            "line": {"color": LIGHT["real"], "width": 2}, "marker": {"size": 5, "color": LIGHT["real"]},
            "hovertemplate": "%{x:.2f} Hz: %{y:.0f} mm<extra></extra>",
        },
        {
            "type": "scatter", "mode": "lines", "name": "policy",
            "x": [float(frequencies.min()), float(frequencies.max())], "y": [round(1e3 * policy, 2)] * 2,
            "line": {"color": LIGHT["simulated"], "width": 2.5}, "hovertemplate": "policy: %{y:.0f} mm<extra></extra>",
        },
    ]  # fmt: skip
    return framed(data, "constant frequency of the motor (Hz)", "distance (mm)", 320)
