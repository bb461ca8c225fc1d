"""Figures of one swim: marker paths, envelope of the midline, motion of the tail tip. Real is red, simulated blue."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import SwimPair
from swim2real.report.palette import LIGHT, Figure, framed, label
from swim2real.report.traces import Range, points_mm, ranges_mm

Array = NDArray[np.float64]

_MAX_FRAMES = 480  # drawn of a swim
_FRAMES_A_BEAT = 60
_MAX_LOST = 250  # marker-frames drawn
_MARGIN = 0.02  # m
_FRAME_MARKERS = 2  # the first ones span the body frame and hardly move in it
_NAME_SPACING = 45.0  # mm, between marker names that are drawn
_NAME_ROOM = 26.0  # mm, above the paths


def counted(swim: SwimPair) -> NDArray[np.bool_]:
    """Marker-frames that count: tracked and seen. Shape (T, M)."""
    return (swim.weights > 0) & np.isfinite(swim.real).all(axis=2)


def drawn_frames(swim: SwimPair) -> slice:
    """Frames to draw: all of a short swim, else about 60 a beat from the first frame on, at most 480."""
    if len(swim.times) <= _MAX_FRAMES:
        return slice(None)
    steps = np.diff(swim.times)
    spacing = float(np.median(steps)) if steps.size else 1.0
    stride = max(1, int(1 / (max(swim.frequency, 1e-3) * _FRAMES_A_BEAT * max(spacing, 1e-6))))
    return slice(0, _MAX_FRAMES * stride, stride)


def view(swims: Sequence[SwimPair], first: int = 0) -> tuple[Range, Range]:
    """Ranges of x and y that hold what counts of all swims [mm], from a marker on, for the same scale everywhere."""
    points: list[Array] = []
    for swim in swims:
        good = counted(swim)[:, first:]
        points += [swim.real[:, first:][good], (swim.simulated + swim.registration)[:, first:][good]]
    return ranges_mm(np.concatenate(points) if points else np.zeros((0, 2)), _MARGIN)


def path_markers(markers: Sequence[str]) -> range:
    """Indices of the markers whose paths are drawn: all but those that span the body frame."""
    return range(_FRAME_MARKERS if len(markers) > _FRAME_MARKERS else 0, len(markers))


def paths(swim: SwimPair, markers: Sequence[str], ranges: tuple[Range, Range]) -> Figure:
    """Paths of the markers in the body frame, the simulated ones registered; lost marker-frames faint and hollow."""
    frames = drawn_frames(swim)
    good = counted(swim)
    simulated = swim.simulated + swim.registration
    data: list[dict[str, Any]] = [_lost(swim, frames, good, path_markers(markers).start)]
    everywhere = np.ones_like(good)
    for kind, positions, where, width in (("real", swim.real, good, 1.1), ("simulated", simulated, everywhere, 1.7)):
        data += [
            {
                "type": "scatter", "mode": "lines", **points_mm(positions[frames, m], where[frames, m]),
                "line": {"color": LIGHT[kind], "width": width}, "connectgaps": False,
                "hovertemplate": f"{label(markers[m])} {kind}<br>%{{x:.0f}} mm, %{{y:.0f}} mm<extra></extra>",
            }
            for m in path_markers(markers)
        ]  # fmt: skip
    (left, right), (low, high) = ranges
    data.append(_names(swim, good, markers, high))
    return framed(
        data, "along the body, head to tail (mm)", "sideways (mm)", 370, showlegend=False,
        xaxis={"range": [left, right]}, yaxis={"range": [low, high + _NAME_ROOM], "scaleanchor": "x", "scaleratio": 1},
    )  # fmt: skip


def envelope(swim: SwimPair, ranges: tuple[Range, Range]) -> Figure:
    """Smallest and largest sideways position of every marker along the body, over the frames that count."""
    good = counted(swim)
    seen = np.flatnonzero(good.any(axis=0))
    data: list[dict[str, Any]] = []
    for kind, positions in (("simulated", swim.simulated + swim.registration), ("real", swim.real)):
        if not np.isfinite(positions[good]).all():
            continue  # diverged
        x = [round(1e3 * float(positions[good[:, m], m, 0].mean()), 1) for m in seen]
        for name, bound, fill in (
            ("smallest", np.min, {}),
            ("largest", np.max, {"fill": "tonexty", "fillcolor": LIGHT[f"{kind}-fill"]}),
        ):
            data.append({
                "type": "scatter", "mode": "lines+markers", "x": x,
                "y": [round(1e3 * float(bound(positions[good[:, m], m, 1])), 1) for m in seen],
                "line": {"color": LIGHT[kind], "width": 2}, "marker": {"color": LIGHT[kind], "size": 5}, **fill,
                "hovertemplate": f"{kind}, {name}: %{{y:.0f}} mm<extra></extra>",
            })  # fmt: skip
    (left, right), (low, high) = ranges
    return framed(
        data, "along the body, head to tail (mm)", "sideways (mm)", 280, showlegend=False,
        xaxis={"range": [left, right]}, yaxis={"range": [low, high]},
    )  # fmt: skip


def tail_tip(swim: SwimPair, markers: Sequence[str], ranges: tuple[Range, Range]) -> Figure:
    """Sideways position of the rearmost marker that was tracked, over time."""
    frames = drawn_frames(swim)
    good = counted(swim)
    seen = np.flatnonzero(good.any(axis=0))
    m = int(seen[-1]) if seen.size else len(markers) - 1
    times = np.round(swim.times[frames], 3).tolist()
    data: list[dict[str, Any]] = []
    for kind, positions, where in (
        ("simulated", swim.simulated + swim.registration, np.ones_like(good)), ("real", swim.real, good)
    ):  # fmt: skip
        data.append({
            "type": "scatter", "mode": "lines", "x": times, "y": points_mm(positions[frames, m], where[frames, m])["y"],
            "line": {"color": LIGHT[kind], "width": 2}, "connectgaps": False,
            "hovertemplate": f"{kind}: %{{y:.0f}} mm at %{{x:.2f}} s<extra></extra>",
        })  # fmt: skip
    return framed(
        data, "time (s)", f"{label(markers[m])} sideways (mm)", 280, showlegend=False, yaxis={"range": list(ranges[1])}
    )


def _lost(swim: SwimPair, frames: slice, good: NDArray[np.bool_], first: int) -> dict[str, Any]:
    real = swim.real[frames, first:]
    points = real[~good[frames, first:] & np.isfinite(real).all(axis=2)]
    points = points[:: max(1, -(-len(points) // _MAX_LOST))]
    return {
        "type": "scatter", "mode": "markers", **points_mm(points, np.ones(len(points), dtype=bool)),
        "marker": {"symbol": "circle-open", "size": 5, "color": LIGHT["lost"], "line": {"width": 1}},
        "hovertemplate": "lost by tracking, not counted<extra></extra>",
    }  # fmt: skip


def _names(swim: SwimPair, good: NDArray[np.bool_], markers: Sequence[str], high: float) -> dict[str, Any]:
    """Names of markers above their paths, left out where they would overlap; the rearmost one is always there."""
    placed: list[tuple[float, int]] = []
    for m in reversed(path_markers(markers)):
        seen = swim.real[good[:, m], m, 0] if good[:, m].any() else (swim.simulated + swim.registration)[:, m, 0]
        x = round(1e3 * float(seen.mean()), 1)
        if np.isfinite(x) and all(abs(x - other) >= _NAME_SPACING for other, _ in placed):
            placed.append((x, m))
    return {
        "type": "scatter", "mode": "text", "x": [x for x, _ in placed], "y": [high + _NAME_ROOM / 2] * len(placed),
        "text": [label(markers[m]) for _, m in placed], "textfont": {"color": LIGHT["muted"], "size": 12},
        "hoverinfo": "skip",
    }  # fmt: skip
