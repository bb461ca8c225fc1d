"""Figures of a comparison for papers: vector and pixels, without LaTeX, the same look for a method in all of them.

One is drawn here: chronophotography, three moments of a swim over one another, real and as methods have it.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from swim2real.calibration import RunFolder, load_trials
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import MethodStatistics, method_statistics
from swim2real.objective import ComparedTrial
from swim2real.report.comparison_charts import convergence, line_search, markers, strip, velocity
from swim2real.report.style import DOUBLE, LIGHT, MethodStyle, method_styles, new_figure, paper_style
from swimbase import store
from swimbase.arrays import Array
from swimbase.errors import RunError
from swimbase.escaping import visible

FIGURES = "figures"
_INK = LIGHT["text"]
_OPACITIES = (0.25, 0.5, 1.0)
_WIDTH, _NOSE, _TAIL_WIDTH = 0.13, 0.12, 0.016  # of the length of the body, for looks
_SCALE_ROOM = 22.0  # mm, below the last lane
_log = logging.getLogger(__name__)


def write_figures(
    results: ComparisonResults, folder: str | Path, theory: Mapping[str, float] | None = None
) -> list[Path]:  # fmt: skip
    """Writes each figure as PDF, SVG and PNG into the folder `figures` of a comparison.

    The same results give the same files, to the last byte, with the same matplotlib. Figures of what the trials have
    none of, as frequencies, are left out, and so is one whose data are not there, with a warning in the log.

    Args:
        results: The results of the comparison.
        folder: The folder of the comparison; its run folders hold the swims.
        theory: Speeds that elongated body theory predicts, by trial [m/s].

    Returns:
        The files, by protocol.

    Raises:
        RunError: They can't be written.
    """
    place = Path(folder) / FIGURES
    styles = method_styles(results.methods)
    paths: list[Path] = []
    with store.writing(place, RunError):
        place.mkdir(parents=True, exist_ok=True)
    with paper_style():
        for protocol in results.protocols:
            methods = method_statistics(results, protocol)
            if not methods:
                _log.warning("no figures for protocol %s: it has no finished runs", protocol)
                continue
            drawn = {
                "convergence": convergence(methods, styles),
                "strip": strip(methods, styles),
                "velocity": velocity(methods, styles, theory) if methods[0].description.has_frequencies else None,
                "line-search": line_search(methods, styles),
                "markers": markers(methods, styles, results.markers),
            }
            if methods[0].description.has_frequencies:
                try:
                    drawn["chronophotography"] = chronophotography(methods, styles, Path(folder))
                except RunError as error:
                    _log.warning("no chronophotography for protocol %s: %s", protocol, error)
            for name, figure in drawn.items():
                if figure is not None:
                    paths += _save(figure, place, f"{name}-{protocol}")
    return paths


def _save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Writes a figure as PDF, SVG and PNG (300 dots an inch), without dates."""
    metadata = {
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
        "svg": {"Date": None, "Creator": None},
        "png": {"Software": None},
    }
    paths = [folder / f"{name}.{kind}" for kind in metadata]
    figure.draw_without_rendering()  # arranges the axes once for all files
    figure.set_layout_engine("none")
    for path, (kind, said) in zip(paths, metadata.items(), strict=True):
        with store.writing(path, RunError), store.whole_file(path) as part:
            figure.savefig(part, format=kind, dpi=300, metadata=said)
    return paths


@dataclass(frozen=True)
class _Lane:
    """A row: what swims there, its color, and its body at each moment, NaN where not seen [m]. Shape (3, M, 2)."""

    label: str
    color: str
    bodies: Array


def chronophotography(methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle], folder: Path) -> Figure:
    """A swim with the middle frequency at its first, middle and last moment: real, by the best and by the worst method.

    Of each method it is the run with the median loss. Bodies are drawn in the body frame, moved on by the progress, so
    headings are not seen. Nothing is registered.

    Args:
        methods: Under one protocol.
        styles: Looks by method.
        folder: Folder of the comparison.

    Raises:
        RunError: A run has no swims.
    """
    ordered = sorted(methods, key=lambda one: one.mean("final"))
    chosen = {"best": ordered[0], "worst": ordered[-1]} if len(ordered) > 1 else {"best": ordered[0]}
    swims = [_swim(folder / one.typical_run().folder) for one in chosen.values()]
    real = swims[0]
    frames = _frames(real)
    lanes = [_Lane("real", _INK, moments(real, "real", frames))]
    for (words, one), swim in zip(chosen.items(), swims, strict=True):
        run = one.typical_run()
        error = 1e3 * (getattr(run.fit.trials[swim.name], one.description.trial_loss) or 0.0)
        label = f"{words}: {one.method} (seed {run.seed}), {error:.0f} mm"
        lanes.append(_Lane(label, styles[one.method].light, moments(swim, "simulated", frames)))
    words = f"{real.name}, {real.frequency:.2f} Hz;  mm: {methods[0].description.loss} of this swim"
    return _draw(lanes, real.times[frames], words)


def _swim(folder: Path) -> ComparedTrial:
    fitted = [saved.compared for saved in load_trials(RunFolder(folder)) if not saved.held_out]
    return sorted(fitted, key=lambda trial: trial.frequency or 0.0)[len(fitted) // 2]


def _frames(swim: ComparedTrial) -> list[int]:
    """The first, the middle and the last frame, or ones near by in which tracking has more of the markers."""
    seen = ((swim.weights > 0) & np.isfinite(swim.real).all(axis=2)).sum(axis=1)
    last, window = len(swim.times) - 1, max(1, len(swim.times) // 20)
    frames: list[int] = []
    for wanted in (0, last // 2, last):
        near = np.arange(max(0, wanted - window), min(last, wanted + window) + 1)
        frames.append(int(min(near, key=lambda i: (-seen[i], abs(i - wanted)))))
    return frames


def moments(swim: ComparedTrial, side: str, frames: Sequence[int]) -> Array:
    """The body at some frames, swimming to the right from where it was at the first of them [m]. Shape (n, M, 2).

    Args:
        swim: A trial that is scored by how far the robot has come.
        side: `real`, without the markers that tracking lost, or `simulated`.
        frames: Indices, n of them.
    """
    if swim.progress is None:
        raise RunError(f"trial '{swim.name}' isn't scored by how far the robot has come")
    picked = list(frames)
    bodies, progress = getattr(swim, side)[picked].copy(), getattr(swim.progress, side)[picked]
    if side == "real":
        bodies[swim.weights[picked] <= 0] = np.nan
    # the swimmer moves toward -x of its body frame: turn the picture by half a turn
    return -(bodies - np.stack([progress - progress[0], np.zeros(len(picked))], axis=1)[:, None])


def outline(body: Array) -> Array | None:
    """A fish's outline around a smooth curve through its markers, for looks. Shape (n, 2).

    None without the two markers of the head, or without any of the tail.
    """
    known = body[np.isfinite(body).all(axis=1)]
    if not np.isfinite(body[:2]).all() or len(known) < 3:
        return None
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(known, axis=0), axis=1))])
    spine, s = CubicSpline(along / along[-1], known), np.linspace(0, 1, 160) ** 1.5  # dense at the nose
    middle, tangent = spine(s), spine(s, 1)
    nose = np.minimum(s / _NOSE, 1)
    width = along[-1] / 2 * (_TAIL_WIDTH + (_WIDTH - _TAIL_WIDTH) * (1 - s) ** 0.8) * np.sqrt(nose * (2 - nose))
    side = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) * (width / np.linalg.norm(tangent, axis=1))[:, None]
    return np.concatenate([middle + side, (middle - side)[::-1]])


def _draw(lanes: Sequence[_Lane], times: Array, words: str) -> Figure:
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


def _range(lane: _Lane) -> tuple[Array, Array]:
    """Lower and upper corner of what a lane shows, with room around [mm]."""
    points = 1e3 * lane.bodies.reshape(-1, 2)
    known = points[np.isfinite(points).all(axis=1)]
    margin = np.array([12.0, 42.0])
    return known.min(axis=0) - margin, known.max(axis=0) + margin


def _draw_lane(axes: Any, lane: _Lane) -> None:
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
