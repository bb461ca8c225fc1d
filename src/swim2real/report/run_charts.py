"""Charts of a run and of its trials: convergence, speeds, errors of markers; paths, errors and sensors of a trial.

Real is red, simulated blue.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from matplotlib.figure import Figure

from swim2real.calibration.convergence import best_losses
from swim2real.formatting import mm, number
from swim2real.objective import ComparedProgress, ComparedSensor, ComparedTrial
from swim2real.report import style
from swim2real.report.errors import MarkerErrors
from swim2real.report.pages import Charts
from swim2real.report.rounds import accepted_steps
from swim2real.report.run import ReportedRun
from swim2real.robots.robot import Robot
from swimbase.arrays import Array, Mask

Range = tuple[float, float]
T = TypeVar("T")

_SMALLEST = 1e-3  # mm, of a loss on the logarithmic axis
_MOST_NUMBERS = 20  # evaluations that each have a number on the axis
_MOST_TRIALS = 24  # drawn, so that the page stays of a size to send
_LEFT, _RIGHT = 3.4, 5.0  # inches, of a wide chart's two columns
_FRAMES_A_BEAT = 60
_MOST_POINTS = 480  # frames of a line
_MOST_LOST = 250  # marker-frames drawn
_SHARE = 0.08  # of the largest extent, around what is drawn
_FRAME_MARKERS = 2  # the first ones span the body frame and hardly move in it
_NAME_SPACING = 45.0  # mm, between marker names that are drawn
_NAME_ROOM = 26.0  # mm, above the paths
_OPACITIES = (0.25, 0.4, 0.6, 0.9)  # of the links at these instants, the first to the last
_AXES = "xyz"


def convergence(run: ReportedRun) -> Figure:
    """Loss of each evaluation, the best so far, accepted rounds, and diverged simulations at the top."""
    figure, axes = style.new_chart(style.WIDE, 2.9, "evaluation", f"loss: {run.loss} (mm)", legend_rows=1)
    proper, failed = ([entry for entry in run.entries if entry.failed == fails] for fails in (False, True))
    losses = [_on_axis(entry.loss) for entry in proper] or [1e2, 1e3]
    top = max(losses) * (max(losses) / min(losses)) ** 0.1 * 1.12
    highest = top / (top / min(losses)) ** 0.03
    accepted = [(s.index + 1, _on_axis(s.loss), f"round {n} accepted: {mm(s.loss)} mm")
                for n, s in accepted_steps(run).items()]  # fmt: skip
    evaluated = [(e.index + 1, _on_axis(e.loss), f"evaluation {e.index + 1}: {mm(e.loss)} mm") for e in proper]
    diverged = [(e.index + 1, highest, f"evaluation {e.index + 1}: {e.reason or 'diverged'}") for e in failed]
    _draw_dots(axes, evaluated, s=12, color=style.LIGHT["faint"], label="evaluation", zorder=2)
    _draw_best(axes, run, color=style.LIGHT["simulated"], linewidth=1.5, label="best so far", zorder=3)
    _draw_dots(axes, accepted, s=42, marker="*", color=style.LIGHT["good"], label="accepted round", zorder=4)
    _draw_dots(axes, diverged, s=22, marker="^", color=style.LIGHT["warning"], label="diverged (no loss)", zorder=4)
    axes.set_xlim(0.4, len(run.entries) + 0.6)
    style.log_axis(axes.yaxis, min(losses) / 1.25, top)
    if len(run.entries) <= _MOST_NUMBERS:
        axes.set_xticks(range(1, len(run.entries) + 1))
    style.legend_over(axes)
    return figure


def _draw_best(axes: Any, run: ReportedRun, **look: Any) -> tuple[Any, Array]:
    """The best loss so far, from the first evaluation that didn't fail; the line, and the losses [mm]."""
    begun = next((i for i, entry in enumerate(run.entries) if not entry.failed), len(run.entries))
    best = np.maximum(1e3 * np.array(best_losses(run.entries)[begun:]), _SMALLEST)
    (line,) = axes.step(range(begun + 1, len(run.entries) + 1), best, where="post", **look)
    return line, best


def _on_axis(loss: float) -> float:
    return max(1e3 * loss, _SMALLEST)


def _draw_dots(axes: Any, dots: Sequence[tuple[float, float, str]], **look: Any) -> None:
    """Dots with a text each."""
    if dots:
        x, y, texts = zip(*dots, strict=True)
        style.titled_points(axes.scatter(x, y, **{"linewidths": 0, **look}), texts)


def by_marker(errors: MarkerErrors, markers: Sequence[str], order: str) -> Figure:
    """One kind of error over the markers: every trial thin, the mean of the fitted ones bold.

    Args:
        errors: Errors of that kind.
        markers: Their names.
        order: What the axis of the markers is, in words.
    """
    figure, axes = style.new_chart(style.THIRD, 2.5, order, "error (mm)")
    for trial, held_out, row in zip(errors.trials, errors.held_out, errors.values, strict=True):
        (line,) = axes.plot(1e3 * row, "--" if held_out else "-", color=style.LIGHT["faint"], linewidth=0.9)
        style.titled(line, f"{trial}{' (held out)' * held_out}")
    (line,) = axes.plot(1e3 * errors.mean, "-o", color=style.LIGHT["text"], linewidth=1.8, markersize=3.6)
    style.titled(line, "mean of the fitted trials")
    axes.set_ylim(bottom=0)
    longest = max((len(name) for name in markers), default=1)  # where names would overlap, some are left out
    places = range(0, len(markers), int(max(1, -(-len(markers) * (0.07 * longest + 0.06) // style.THIRD))))
    axes.set_xticks(places, [style.chart_name(markers[i]) for i in places])
    return figure


def speeds(run: ReportedRun) -> Figure:
    """Forward speed against the frequency of the beat, real and simulated; held-out trials are open."""
    labels = "frequency of the tail beat (Hz)", "forward speed (mm/s)"
    figure, axes = style.new_chart(style.WIDE, 3.1, *labels, legend_rows=1)
    if run.study is not None and run.study.speeds is not None:
        ends = 1e3 * np.array(run.study.speeds.speeds)
        axes.fill_between(
            run.study.speeds.frequencies, ends[0], ends[2], color=style.LIGHT["simulated"], alpha=0.18, linewidth=0,
            label="90 % of the sets that fit",
        )  # fmt: skip
    first = [(one.frequency or 0.0, 1e3 * one.velocity_simulated)
             for one in run.entries[0].evidence.trials.values() if one.velocity_simulated is not None]  # fmt: skip
    if first and run.best is not run.entries[0]:
        line = np.array(sorted(first)).T
        axes.plot(*line, ":", color=style.LIGHT["faint"], linewidth=1.2, label="simulated, first evaluation")
    for color, mark, label in (("real", "o", "real"), ("simulated", "s", "simulated, best")):
        known = [(t, t.figures.frequency or 0.0, 1e3 * speed) for t in run.trials
                 if (speed := getattr(t.figures, f"velocity_{color}")) is not None]  # fmt: skip
        axes.plot([f for _, f, _ in known], [v for _, _, v in known], color=style.LIGHT[color], linewidth=1.2, zorder=3)
        dots = [
            (f, v, f"{t.name}{' (held out)' * t.held_out}, {label}: {number(v)} mm/s at {number(f, 3)} Hz")
            for t, f, v in known
        ]
        _draw_dots(
            axes, dots, s=26, marker=mark, edgecolors=style.LIGHT[color], linewidths=1.1, zorder=4,
            facecolors=[style.LIGHT["surface"] if trial.held_out else style.LIGHT[color] for trial, _, _ in known],
        )  # fmt: skip
        axes.plot([], [], f"-{mark}", color=style.LIGHT[color], label=label)
    if any(trial.held_out for trial in run.trials):
        look = {"color": style.LIGHT["muted"], "linestyle": "none", "marker": "o", "markerfacecolor": "none"}
        axes.add_line(style.handle(label="open: held out", **look))
    style.legend_over(axes)
    return figure


def trial_charts(trials: Sequence[ComparedTrial], run: ReportedRun) -> Charts:
    """Charts that each trial has the data for, as functions that draw them; names begin with what they show."""
    names, units = run.marker_names, {sensor.name: sensor.unit for sensor in run.robot.trials.sensors}
    ranges = _common_ranges(trials)
    charts: Charts = {}
    for i, trial in enumerate(trials):
        if names:
            shown = _common_ranges([trial], _path_markers_of(trial, names))
            charts[f"paths-{i}"] = partial(paths, trial, names, run.robot, shown)
        if trial.frequency is not None:
            charts[f"tail-{i}"] = partial(_tail_tip, trial, names, ranges)
        if trial.divergence is not None:
            continue
        if names:
            charts[f"off-{i}"] = partial(_errors_over_time, trial, names)
        if trial.progress is not None:
            charts[f"progress-{i}"] = partial(_progress_over_time, trial.times, trial.progress)
        for j, sensor in enumerate(trial.sensors):
            charts[f"sensor-{i}-{j}"] = partial(_sensor_readings, sensor, units.get(sensor.name, ""))
    return charts


def drawn_trials(trials: Sequence[T]) -> tuple[T, ...]:
    """The trials that get charts: at most `_MOST_TRIALS`, spread over all."""
    if len(trials) <= _MOST_TRIALS:
        return tuple(trials)
    return tuple(trials[i] for i in (round(k * (len(trials) - 1) / (_MOST_TRIALS - 1)) for k in range(_MOST_TRIALS)))


def _counted(trial: ComparedTrial) -> Mask:
    """Marker-frames that count: tracked and seen. Shape (T, M)."""
    return (trial.weights > 0) & np.isfinite(trial.real).all(axis=2)


def _registered(trial: ComparedTrial) -> Array:
    """Simulated positions, registered; NaN where the simulation diverged [m]. Shape (T, M, 2)."""
    return trial.simulated + trial.registration + (np.nan if trial.divergence else 0.0)


def _drawn_frames(trial: ComparedTrial) -> slice:
    """Frames to draw: all of a short trial; of a long one with a beat the first ones, else every so many."""
    count = len(trial.times)
    if count <= _MOST_POINTS:
        return slice(None)
    if trial.frequency is None:
        return slice(None, None, -(-count // _MOST_POINTS))
    spacing = float(np.median(np.diff(trial.times)))
    stride = max(1, int(1 / (max(trial.frequency, 1e-3) * _FRAMES_A_BEAT * max(spacing, 1e-6))))
    return slice(0, _MOST_POINTS * stride, stride)


def _common_ranges(trials: Sequence[ComparedTrial], shown: range | None = None) -> tuple[Range, Range]:
    """Ranges along both axes that hold what is drawn of all trials [mm], for the same scale everywhere.

    Args:
        trials: The trials.
        shown: Indices of the markers that are drawn; None for all.
    """
    points = [np.zeros((0, 2))]
    for trial in trials:
        markers = slice(None) if shown is None else slice(shown.start, shown.stop)
        good, simulated = _counted(trial)[:, markers], _registered(trial)[:, markers]
        points += [trial.real[:, markers][good], simulated[good if trial.frequency is not None else slice(None)]]
    everything = np.concatenate([part.reshape(-1, 2) for part in points])
    there = everything[np.isfinite(everything).all(axis=1)]
    if not len(there):
        return (0.0, 100.0), (-50.0, 50.0)
    margin = _SHARE * float(np.ptp(there, axis=0).max())
    low, high = (there.min(axis=0) - margin) * 1e3, (there.max(axis=0) + margin) * 1e3
    return (round(float(low[0])), round(float(high[0]))), (round(float(low[1])), round(float(high[1])))


def _path_markers_of(trial: ComparedTrial, names: Sequence[str]) -> range:
    """Indices of the markers whose paths are drawn: with a beat not those that span the body frame, which are still."""
    return range(_FRAME_MARKERS if trial.frequency is not None and len(names) > _FRAME_MARKERS else 0, len(names))


def paths(trial: ComparedTrial, markers: Sequence[str], robot: Robot, ranges: tuple[Range, Range]) -> Figure:
    """Paths of the markers in the frame of comparison, the simulated ones registered.

    Marker-frames that were lost are faint and hollow. Without a beat the links are drawn at some instants, the later
    the stronger.
    """
    beat, shown = trial.frequency is not None, _path_markers_of(trial, markers)
    across, (low, high) = ranges
    figure, axes = _path_chart(_LEFT, across, (low, high + _NAME_ROOM * beat), _axis_titles(trial, robot))
    frames, good, simulated = _drawn_frames(trial), _counted(trial), _registered(trial)
    real = trial.real[frames, shown.start :]
    lost = real[~good[frames, shown.start :] & np.isfinite(real).all(axis=2)]
    if len(lost):
        lost = 1e3 * lost[:: -(-len(lost) // _MOST_LOST)]
        (marks,) = axes.plot(
            *lost.T, "o", color=style.LIGHT["lost"], markersize=2.2, markerfacecolor="none", markeredgewidth=0.6,
            scalex=False, scaley=False,
        )  # fmt: skip
        style.titled(marks, "lost by tracking, not counted")
    known = np.asarray(np.isfinite(simulated).all(axis=2))
    for kind, positions, where, width in (("real", trial.real, good, 0.6), ("simulated", simulated, known, 0.95)):
        _draw_paths(axes, kind, positions[frames], where[frames], markers, shown, width)
        if not beat:
            for instant, opacity in zip(_instants(good, len(_OPACITIES)), _OPACITIES, strict=True):
                _draw_links(axes, kind, positions[instant], where[instant], robot.links, opacity)
    if beat:
        _name_from_the_tail(axes, trial, good, markers, high)
        return figure
    for m, name in enumerate(markers):
        if good[:, m].any():
            last = 1e3 * trial.real[np.flatnonzero(good[:, m])[-1], m]
            look = {"fontsize": 6.5, "color": style.LIGHT["muted"], "zorder": 5}
            axes.annotate(name, last, xytext=(3, 3), textcoords="offset points", **look)
    return figure


def _tail_tip(trial: ComparedTrial, markers: Sequence[str], ranges: tuple[Range, Range]) -> Figure:
    """Sideways position of the rearmost marker that was tracked, over time."""
    frames, good = _drawn_frames(trial), _counted(trial)
    seen = np.flatnonzero(good.any(axis=0))
    m = int(seen[-1]) if seen.size else len(markers) - 1
    figure, axes = style.new_chart(_RIGHT, 2.0, "time (s)", f"{markers[m]} sideways (mm)")
    for kind, positions, where in (
        ("simulated", _registered(trial), np.ones_like(good)), ("real", trial.real, good)
    ):  # fmt: skip
        y = np.where(where[frames, m], 1e3 * positions[frames, m, 1], np.nan)
        _draw_line(axes, trial.times[frames], y, style.LIGHT[kind], 1.1, kind)
    axes.set_ylim(*ranges[1])
    return figure


def _errors_over_time(trial: ComparedTrial, markers: Sequence[str]) -> Figure:
    """Error of each marker over time, and their mean."""
    figure, axes = style.new_chart(_RIGHT, 2.0, "time (s)", "error (mm)")
    lengths = np.where(trial.weights > 0, np.linalg.norm(trial.residual, axis=2), np.nan)
    known = np.isfinite(lengths)
    mean = np.where(known, lengths, 0.0).sum(axis=1) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    thin = _thinned(trial.times)
    for m, name in enumerate(markers):
        _draw_line(axes, trial.times[thin], 1e3 * lengths[thin, m], style.LIGHT["faint"], 0.6, name)
    _draw_line(axes, trial.times[thin], 1e3 * mean[thin], style.LIGHT["text"], 1.4, "mean")
    axes.set_ylim(bottom=0)
    return figure


def _progress_over_time(times: Array, progress: ComparedProgress) -> Figure:
    """Distance come along the line of travel, over time."""
    figure, axes = style.new_chart(_RIGHT, 2.0, "time (s)", "progress (mm)")
    thin = _thinned(times)
    for kind, way in (("simulated", progress.simulated), ("real", progress.real)):
        _draw_line(axes, times[thin], 1e3 * way[thin], style.LIGHT[kind], 1.1, kind)
    return figure


def _sensor_readings(sensor: ComparedSensor, unit: str) -> Figure:
    """A sensor's readings over time."""
    figure, axes = style.new_chart(_RIGHT, 2.0, "time (s)", style.chart_name(f"{sensor.name} ({unit})"))
    thin = _thinned(sensor.times)
    for kind, values in (("real", sensor.real), ("simulated", sensor.simulated)):
        _draw_line(axes, sensor.times[thin], values[thin], style.LIGHT[kind], 0.9, kind)
    return figure


def _axis_titles(trial: ComparedTrial, robot: Robot) -> tuple[str, str]:
    """Axes of the frame of comparison, in words."""
    if trial.frequency is not None:
        return "along the body, head to tail (mm)", "sideways (mm)"
    if trial.frame is None:
        return f"{_AXES[robot.plane[0]]} (mm)", f"{_AXES[robot.plane[1]]} (mm)"
    first, second = (robot.marker_names[marker] for marker in trial.frame)
    return f"from {first} toward {second} (mm)", "to the left of it (mm)"


def _path_chart(width: float, across: Range, up: Range, titles: tuple[str, str]) -> tuple[Figure, Any]:
    """A chart whose axes have one scale, as high as its ranges [mm] need."""
    inner = width - 0.7  # inches between the margins of a chart
    height = float(np.clip(inner * (up[1] - up[0]) / max(across[1] - across[0], 1e-9), 1.2, 1.25 * width))
    figure, axes = style.new_chart(width, height + 0.51, *titles)
    axes.set_xlim(across, auto=True)  # the aspect may widen them
    axes.set_ylim(up, auto=True)
    axes.set_aspect("equal", adjustable="datalim")
    return figure, axes


def _draw_paths(
    axes: Any, kind: str, positions: Array, where: Mask, markers: Sequence[str], shown: range, width: float
) -> None:
    for m in shown:
        points = np.where(where[:, m, None], 1e3 * positions[:, m], np.nan)
        (line,) = axes.plot(*points.T, color=style.LIGHT[kind], linewidth=width, scalex=False, scaley=False)
        style.titled(line, f"{markers[m]}, {kind}")


def _draw_line(axes: Any, times: Array, values: Array, color: str, width: float, title: str) -> None:
    (line,) = axes.plot(times, values, color=color, linewidth=width)
    style.titled(line, title)


def _draw_links(
    axes: Any, kind: str, positions: Array, where: Mask, links: Sequence[tuple[int, int]], opacity: float
) -> None:
    """The links at an instant, or the markers where there are none. Positions of shape (M, 2) [m]."""
    parts = links or [(m,) for m in range(len(where))]
    points = [row for part in parts if where[list(part)].all() for row in (*1e3 * positions[list(part)], [np.nan] * 2)]
    if points:
        axes.plot(
            *np.array(points).T, "-o", color=style.LIGHT[kind], linewidth=1.4, markersize=2.6, alpha=opacity,
            scalex=False, scaley=False,
        )  # fmt: skip


def _name_from_the_tail(axes: Any, trial: ComparedTrial, good: Mask, markers: Sequence[str], high: float) -> None:
    """Names of markers above their paths, left out where they would overlap; the rearmost one is always there."""
    placed: list[float] = []
    for m in reversed(_path_markers_of(trial, markers)):
        seen = trial.real[good[:, m], m, 0] if good[:, m].any() else _registered(trial)[:, m, 0]
        x = 1e3 * float(seen.mean())
        if np.isfinite(x) and all(abs(x - other) >= _NAME_SPACING for other in placed):
            placed.append(x)
            axes.text(
                x,
                high + _NAME_ROOM / 2,
                style.chart_name(markers[m]),
                ha="center",
                va="center",
                fontsize=7,
                color=style.LIGHT["muted"],
            )


def _thinned(times: Array) -> slice:
    return slice(None, None, max(1, -(-len(times) // _MOST_POINTS)))


def _instants(good: Mask, count: int) -> list[int]:
    """Frames from the first to the last in which tracking has every marker that it has in most, or near by."""
    seen = good.sum(axis=1)
    whole = np.flatnonzero(seen >= np.median(seen))
    return [int(whole[np.abs(whole - wanted).argmin()]) for wanted in np.linspace(0, len(good) - 1, count)]
