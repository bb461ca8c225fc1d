"""Chronophotography: three moments of a swim over one another, real and as the best and the worst method have it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swim2real.calibration import RunFolder, load_trials
from swim2real.comparison.statistics import MethodStatistics
from swim2real.errors import RunError
from swim2real.escaping import visible
from swim2real.objective import ComparedProgress, ComparedTrial
from swim2real.report.style import DOUBLE, LIGHT, MethodStyle, new_figure

Array = NDArray[np.float64]

_INK = LIGHT["text"]
_OPACITIES = (0.25, 0.5, 1.0)
_WIDTH, _NOSE, _TAIL_WIDTH = 0.13, 0.12, 0.016  # of the length of the body, for looks
_TERMS = 3  # of the polynomial that the tail bends along
_SCALE_ROOM = 22.0  # mm, below the last lane


@dataclass(frozen=True)
class Lane:
    """A row of the figure.

    Attributes:
        label: What swims there.
        color: Color of the body.
        bodies: Positions on the water at each moment, NaN where not seen [m]. Shape (3, M, 2).
    """

    label: str
    color: str
    bodies: Array


def chronophotography(
    methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle], folder: Path, trial: str | None = None
) -> Figure:
    """One swim at its first, middle and last moment: real, by the best method and by the worst.

    Of each method it is the run with the median loss. Bodies are drawn in the body frame, moved on by the progress, so
    headings are not seen. Nothing is registered.

    Args:
        methods: Under one protocol.
        styles: Looks by method.
        folder: Folder of the comparison.
        trial: Name of the trial; None takes the one with the middle frequency.

    Raises:
        RunError: A run has no swims, or none of this name.
    """
    ordered = sorted(methods, key=lambda one: one.mean("final"))
    chosen = [("best", ordered[0])] + ([("worst", ordered[-1])] if len(ordered) > 1 else [])
    swims = [_swim(folder / one.typical_run().folder, trial) for _, one in chosen]
    real = swims[0]
    frames = _frames(real)
    lanes = [Lane("real", _INK, moments(real, real.real, _progress(real).real, frames, seen=True))]
    for (words, one), swim in zip(chosen, swims, strict=True):
        run = one.typical_run()
        figures = run.fit.trials[swim.name]
        error = 1e3 * (getattr(figures, one.description.trial_loss) or 0.0)
        label = f"{words}: {one.method} (seed {run.seed}), {error:.0f} mm"
        bodies = moments(swim, swim.simulated, _progress(swim).simulated, frames, seen=False)
        lanes.append(Lane(label, styles[one.method].light, bodies))
    return _draw(
        lanes,
        real.times[frames],
        f"{real.name}, {real.frequency:.2f} Hz;  mm: {methods[0].description.loss} of this swim",
    )


def _swim(folder: Path, trial: str | None) -> ComparedTrial:
    fitted = sorted(
        (saved.compared for saved in load_trials(RunFolder(folder)) if not saved.held_out),
        key=lambda compared: compared.frequency or 0.0,
    )
    chosen = [one for one in fitted if one.name == trial] if trial is not None else fitted[len(fitted) // 2 :]
    if not chosen:
        raise RunError(f"run '{folder}' has no swim '{trial}'; it has {', '.join(one.name for one in fitted)}")
    return chosen[0]


def _progress(swim: ComparedTrial) -> ComparedProgress:
    if swim.progress is None:
        raise RunError(f"trial '{swim.name}' isn't scored by how far the robot has come")
    return swim.progress


def _frames(swim: ComparedTrial) -> list[int]:
    """The first, the middle and the last frame, or ones near by in which tracking has more of the markers."""
    seen = ((swim.weights > 0) & np.isfinite(swim.real).all(axis=2)).sum(axis=1)
    last, window = len(swim.times) - 1, max(1, len(swim.times) // 20)
    frames: list[int] = []
    for wanted in (0, last // 2, last):
        near = np.arange(max(0, wanted - window), min(last, wanted + window) + 1)
        frames.append(int(min(near, key=lambda i: (-seen[i], abs(i - wanted)))))
    return frames


def moments(swim: ComparedTrial, positions: Array, progress: Array, frames: Sequence[int], seen: bool) -> Array:
    """The body at some frames, swimming to the right from where it was at the first of them [m]. Shape (n, M, 2).

    Args:
        swim: The trial whose weights count.
        positions: Positions in the body frame [m]. Shape (T, M, 2).
        progress: How far the body has come [m]. Shape (T,).
        frames: Indices, n of them.
        seen: Whether markers that tracking lost are left out, as NaN.
    """
    picked = list(frames)
    bodies = positions[picked].copy()
    if seen:
        bodies[swim.weights[picked] <= 0] = np.nan
    # the swimmer moves toward -x of its body frame: turn the picture by half a turn
    return -(bodies - np.stack([progress[picked] - progress[picked[0]], np.zeros(len(picked))], axis=1)[:, None])


def outline(body: Array) -> Array | None:
    """A fish's outline around a smooth curve through its markers, for looks. Shape (n, 2).

    The head is straight between its two markers, the tail bends smoothly from there. None without a head or a tail.
    """
    known = np.isfinite(body[:, 0] + body[:, 1])
    tail = body[2:][known[2:]]
    if not known[:2].all() or not len(tail):
        return None
    head, neck = body[0], body[1]
    axis = (neck - head) / np.linalg.norm(neck - head)
    across = np.array([-axis[1], axis[0]])
    along = np.cumsum(np.linalg.norm(np.diff(tail, axis=0, prepend=neck[None]), axis=1))
    share = along / along[-1]
    powers = np.arange(2, 2 + min(_TERMS, len(tail)))
    weights = np.where(share == 1, 3.0, 1.0)[:, None]
    local = (tail - neck) @ np.stack([axis, across], axis=1) - np.outer(along, [1, 0])
    bend = np.linalg.lstsq(weights * share[:, None] ** powers, weights * local, rcond=None)[0]
    front, length = float(np.linalg.norm(neck - head)), float(along[-1])
    s = (front + length) * np.linspace(0, 1, 160) ** 1.5 - front  # dense at the nose; 0 at the neck
    rest = np.clip(s / length, 0, 1)
    middle = neck + np.outer(s, axis) + (rest[:, None] ** powers @ bend) @ np.stack([axis, across])
    tangent = np.gradient(middle, s, axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    whole = (s + front) / (front + length)
    nose = np.minimum(whole / _NOSE, 1)
    width = (
        (front + length) / 2 * (_TAIL_WIDTH + (_WIDTH - _TAIL_WIDTH) * (1 - whole) ** 0.8) * np.sqrt(nose * (2 - nose))
    )
    return np.concatenate([middle + normal * width[:, None], (middle - normal * width[:, None])[::-1]])


def _draw(lanes: Sequence[Lane], times: Array, words: str) -> Figure:
    ranges = [_range(lane) for lane in lanes]
    left, right = min(low[0] for low, _ in ranges), max(high[0] for _, high in ranges)
    heights = [float(high[1] - low[1]) for low, high in ranges]
    heights[-1] += _SCALE_ROOM
    figure = new_figure(DOUBLE, DOUBLE * sum(heights) / float(right - left) + 0.25)
    layout: Any = figure.get_layout_engine()
    layout.set(hspace=0, h_pad=0.01, w_pad=0.01)
    panels = figure.subplots(len(lanes), 1, squeeze=False, sharex=True, height_ratios=heights)[:, 0]
    heads = 1e3 * lanes[0].bodies[:, 0, 0]
    for axes, lane, (low, high) in zip(panels, lanes, ranges, strict=True):
        _draw_lane(axes, lane)
        axes.set_aspect("equal")
        bottom = low[1] - (_SCALE_ROOM if lane is lanes[-1] else 0)
        axes.set(xlim=(left, right), ylim=(bottom, high[1]))
        axes.axis("off")
        axes.text(left, high[1] - 2, visible(lane.label), va="top", color=_INK)
        for head in heads:
            axes.axvline(head, color=LIGHT["muted"], linewidth=0.4, linestyle=(0, (1, 2)), zorder=0)
    top = float(ranges[0][1][1])
    for head, time in zip(heads, times - times[0], strict=True):
        panels[0].annotate(
            f"{time:.1f} s", (head, top), xytext=(0, 1), textcoords="offset points", ha="center", va="bottom",
            fontsize=7, color=LIGHT["muted"], annotation_clip=False,
        )  # fmt: skip
    bottom = float(ranges[-1][0][1]) - _SCALE_ROOM + 8
    panels[-1].plot([left, left + 100], [bottom, bottom], color=_INK, linewidth=1.4, solid_capstyle="butt")
    panels[-1].text(left + 108, bottom, f"100 mm;  {visible(words)}", va="center", fontsize=7)
    return figure


def _range(lane: Lane) -> tuple[Array, Array]:
    """Lower and upper corner of what a lane shows, with room around [mm]."""
    points = 1e3 * lane.bodies.reshape(-1, 2)
    known = points[np.isfinite(points).all(axis=1)]
    margin = np.array([12.0, 42.0])
    return known.min(axis=0) - margin, known.max(axis=0) + margin


def _draw_lane(axes: Any, lane: Lane) -> None:
    for body, opacity in zip(1e3 * lane.bodies, _OPACITIES, strict=True):
        edge = _mixed(lane.color, opacity)
        around = outline(body)
        if around is not None:
            axes.fill(*around.T, facecolor=_mixed(lane.color, 0.7 * opacity), edgecolor=edge, linewidth=0.6)
        axes.plot(*body.T, "o", color="white", markersize=2.2, markeredgecolor=edge, markeredgewidth=0.5)


def _mixed(color: str, opacity: float) -> tuple[float, ...]:
    """A color thinned with white, so that bodies over one another stay clear. Opacity 1 leaves it."""
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return tuple(1 - opacity * (1 - part) for part in parts)
