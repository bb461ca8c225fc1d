"""Figures of one recording and its playback: marker paths, errors, the way and sensors over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.objective import PlaybackComparison, SensorComparison
from swim2real.report.palette import LIGHT, Figure, framed, label
from swim2real.report.traces import Range, points_mm, ranges_mm
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Links = Sequence[tuple[int, int]]

_MAX_POINTS = 600  # of a line
_OPACITIES = (0.25, 0.4, 0.6, 0.9)  # of the links at these instants, the first to the last
_MARGIN = 0.1  # of the largest extent, on each side
_AXES = "xyz"


def view(trials: Sequence[PlaybackComparison]) -> tuple[Range, Range]:
    """Ranges along both axes that hold all that is drawn of all trials, for the same scale everywhere [mm]."""
    points = [np.zeros((0, 2))]
    for trial in trials:
        points += [trial.real[seen(trial)], trial.simulated[np.isfinite(trial.simulated).all(axis=2)]]
    everything = np.concatenate(points)
    extent = np.ptp(everything, axis=0).max() if len(everything) else 0.0
    return ranges_mm(everything, _MARGIN * float(extent))


def seen(trial: PlaybackComparison) -> Mask:
    """Marker-frames that count. Shape (T, M)."""
    return np.asarray(trial.weights > 0)


def axis_titles(robot: Robot) -> tuple[str, str]:
    """What the frame of comparison is, in words."""
    frame = robot.recordings.frame
    if frame is None:
        return f"{_AXES[robot.plane[0]]} (mm)", f"{_AXES[robot.plane[1]]} (mm)"
    first, second = (label(robot.marker_names[marker]) for marker in frame)
    return f"from {first} toward {second} (mm)", "to the left of it (mm)"


def paths(
    trial: PlaybackComparison, markers: Sequence[str], links: Links, ranges: tuple[Range, Range],
    titles: tuple[str, str],
) -> Figure:  # fmt: skip
    """Paths of the markers in the frame of comparison, and the links at some instants, the later the stronger."""
    drawn, good = _thinned(trial.times), seen(trial)
    simulated = np.asarray(np.isfinite(trial.simulated).all(axis=2))
    data: list[dict[str, Any]] = []
    for kind, positions, where, width in (
        ("real", trial.real, good, 1.1), ("simulated", trial.simulated, simulated, 1.7)
    ):  # fmt: skip
        data += [
            {
                "type": "scatter", "mode": "lines", **points_mm(positions[drawn, m], where[drawn, m]),
                "line": {"color": LIGHT[kind], "width": width}, "connectgaps": False,
                "hovertemplate": f"{label(name)} {kind}<br>%{{x:.0f}} mm, %{{y:.0f}} mm<extra></extra>",
            }
            for m, name in enumerate(markers)
        ]  # fmt: skip
        for instant, opacity in zip(_instants(good, len(_OPACITIES)), _OPACITIES, strict=True):
            data.append(_body(kind, positions[instant], where[instant], links, opacity))
    data.append(_names(trial, good, markers))
    return framed(
        data, titles[0], titles[1], 380, showlegend=False, xaxis={"range": list(ranges[0])},
        yaxis={"range": list(ranges[1]), "scaleanchor": "x", "scaleratio": 1},
    )  # fmt: skip


def errors(trial: PlaybackComparison, markers: Sequence[str]) -> Figure:
    """How far each marker is off over time, and their mean."""
    lengths = np.where(seen(trial), np.linalg.norm(trial.residual, axis=2), np.nan)
    known = np.isfinite(lengths)
    mean = np.where(known, lengths, 0.0).sum(axis=1) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    data = [
        _over_time(trial.times, 1e3 * lengths[:, m], LIGHT["faint"], 1, label(name), "mm")
        for m, name in enumerate(markers)
    ]
    data.append(_over_time(trial.times, 1e3 * mean, LIGHT["text"], 2.5, "mean", "mm"))
    return framed(data, "time (s)", "error (mm)", 260, showlegend=False, yaxis={"rangemode": "tozero"})


def way(trial: PlaybackComparison) -> Figure:
    """How far it has come along the line of travel, over time; of a trial that travels."""
    data = [
        _over_time(trial.times, 1e3 * progress, LIGHT[kind], 2, kind, "mm")
        for kind, progress in (("simulated", trial.progress_simulated), ("real", trial.progress_real))
        if progress is not None
    ]
    return framed(data, "time (s)", "way (mm)", 260, showlegend=False)


def readings(sensor: SensorComparison, unit: str) -> Figure:
    """A sensor's readings over time."""
    data = [
        _over_time(sensor.times, values, LIGHT[kind], 1.5, kind, label(unit))
        for kind, values in (("real", sensor.real), ("simulated", sensor.simulated))
    ]
    return framed(data, "time (s)", f"{label(sensor.name)} ({label(unit)})", 260, showlegend=False)


def _over_time(times: Array, values: Array, color: str, width: float, name: str, unit: str) -> dict[str, Any]:
    drawn = _thinned(times)
    shown = [float(f"{value:.4g}") if np.isfinite(value) else None for value in values[drawn].tolist()]
    return {
        "type": "scatter", "mode": "lines", "x": np.round(times[drawn], 4).tolist(), "y": shown,
        "line": {"color": color, "width": width}, "connectgaps": False,
        "hovertemplate": f"{name}: %{{y:.4~g}} {unit} at %{{x:.2f}} s<extra></extra>",
    }  # fmt: skip


def _thinned(times: Array) -> slice:
    return slice(None, None, max(1, -(-len(times) // _MAX_POINTS)))


def _instants(good: Mask, count: int) -> list[int]:
    """Frames from the first to the last in which tracking has every marker that it has in most, or near by."""
    seen = good.sum(axis=1)
    whole = np.flatnonzero(seen >= np.median(seen))
    return [int(whole[np.abs(whole - wanted).argmin()]) for wanted in np.linspace(0, len(good) - 1, count)]


def _body(kind: str, positions: Array, where: Mask, links: Links, opacity: float) -> dict[str, Any]:
    """The links at an instant, or the markers where there are none. Positions of shape (M, 2) [m]."""
    parts = links or [(m,) for m in range(len(where))]
    ends = [end for part in parts if where[list(part)].all() for end in (*part, None)]
    rows = [(None, None) if end is None else (1e3 * positions[end, 0], 1e3 * positions[end, 1]) for end in ends]
    return {
        "type": "scatter", "mode": "lines+markers", "opacity": opacity, "hoverinfo": "skip",
        "x": [None if x is None else round(float(x), 1) for x, _ in rows],
        "y": [None if y is None else round(float(y), 1) for _, y in rows],
        "line": {"color": LIGHT[kind], "width": 2.5}, "marker": {"color": LIGHT[kind], "size": 5},
    }  # fmt: skip


def _names(trial: PlaybackComparison, good: Mask, markers: Sequence[str]) -> dict[str, Any]:
    """Names of the markers where each is seen last."""
    last = {m: trial.real[np.flatnonzero(good[:, m])[-1], m] for m in range(len(markers)) if good[:, m].any()}
    return {
        "type": "scatter", "mode": "text", "hoverinfo": "skip",
        "x": [round(1e3 * float(place[0]), 1) for place in last.values()],
        "y": [round(1e3 * float(place[1]), 1) for place in last.values()],
        "text": [label(markers[m]) for m in last], "textposition": "top right",
        "textfont": {"size": 11, "color": LIGHT["muted"]},
    }  # fmt: skip
