"""Charts of any run: convergence, error by marker, speed against frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from swim2real.calibration.convergence import best_losses
from swim2real.report.marker_errors import MarkerErrors
from swim2real.report.rounds import accepted_steps
from swim2real.report.run import ReportedRun, ReportedTrial
from swim2real.report.style import (
    LIGHT,
    THIRD,
    WIDE,
    chart_name,
    handle,
    legend_over,
    log_axis,
    new_chart,
    titled,
    titled_points,
)
from swim2real.report.units import mm, text

SMALLEST = 1e-3  # mm, of a loss on the logarithmic axis
_MOST_NUMBERS = 20  # evaluations that each have a number on the axis


def convergence(run: ReportedRun) -> Figure:
    """Loss of each evaluation, the best so far, accepted rounds, and diverged simulations at the top."""
    figure, axes = new_chart(WIDE, 2.9, "evaluation", f"loss: {run.loss} (mm)", legend_rows=1)
    proper = [(i + 1, entry) for i, entry in enumerate(run.entries) if not entry["failed"]]
    losses = [max(1e3 * entry["loss"], SMALLEST) for _, entry in proper] or [1e2, 1e3]
    top = max(losses) * (max(losses) / min(losses)) ** 0.1 * 1.12
    titled_points(
        axes.scatter(
            [n for n, _ in proper], losses[: len(proper)], s=12, color=LIGHT["faint"],
            linewidths=0, label="evaluation", zorder=2,
        ),
        [f"evaluation {n}: {mm(e['loss'])} mm" for n, e in proper],
    )  # fmt: skip
    begun = proper[0][0] if proper else len(run.entries) + 1
    highest = top / (top / min(losses)) ** 0.03
    best = np.maximum(1e3 * np.array(best_losses(run.entries)[begun - 1 :]), SMALLEST)
    axes.step(
        range(begun, len(run.entries) + 1), best, where="post", color=LIGHT["simulated"], linewidth=1.5,
        label="best so far", zorder=3,
    )  # fmt: skip
    accepted = accepted_steps(run)
    if accepted:
        found = [max(1e3 * run.entries[i]["loss"], SMALLEST) for i, _ in accepted]
        titled_points(
            axes.scatter(
                [i + 1 for i, _ in accepted], found, s=42, marker="*", color=LIGHT["good"],
                linewidths=0, label="accepted round", zorder=4,
            ),
            [f"round {n} accepted: {mm(1e-3 * loss)} mm" for (_, n), loss in zip(accepted, found, strict=True)],
        )  # fmt: skip
    failed = [(i + 1, entry) for i, entry in enumerate(run.entries) if entry["failed"]]
    if failed:
        titled_points(
            axes.scatter(
                [n for n, _ in failed], [highest] * len(failed), s=22, marker="^", color=LIGHT["warning"],
                linewidths=0, label="diverged (no loss)", zorder=4,
            ),
            [f"evaluation {n}: {entry.get('reason') or 'diverged'}" for n, entry in failed],
        )  # fmt: skip
    axes.set_xlim(0.4, len(run.entries) + 0.6)
    log_axis(axes.yaxis, min(losses) / 1.25, top)
    if len(run.entries) <= _MOST_NUMBERS:
        axes.set_xticks(range(1, len(run.entries) + 1))
    legend_over(axes)
    return figure


def by_marker(errors: MarkerErrors, markers: Sequence[str], order: str) -> Figure:
    """One kind of error over the markers: every trial thin, the mean of the fitted ones bold.

    Args:
        errors: Errors of that kind.
        markers: Their names.
        order: What the axis of the markers is, in words.
    """
    figure, axes = new_chart(THIRD, 2.5, order, "error (mm)")
    places = range(len(markers))
    for trial, held_out, row in zip(errors.trials, errors.held_out, errors.values, strict=True):
        style = "--" if held_out else "-"
        (line,) = axes.plot(places, 1e3 * row, style, color=LIGHT["faint"], linewidth=0.9)
        titled(line, f"{trial}{' (held out)' * held_out}")
    (line,) = axes.plot(places, 1e3 * errors.mean, "-o", color=LIGHT["text"], linewidth=1.8, markersize=3.6)
    titled(line, "mean of the fitted trials")
    axes.set_ylim(bottom=0)
    names_on_axis(axes, markers, THIRD)
    return figure


def names_on_axis(axes: Any, names: Sequence[str], width: float) -> None:
    """Names of markers along the x axis, every other one or fewer where they would overlap; width in inches."""
    longest = max((len(name) for name in names), default=1)
    step = max(1, -(-len(names) * (0.07 * longest + 0.06) // width))
    places = list(range(0, len(names), int(step)))
    axes.set_xticks(places, [chart_name(names[i]) for i in places])


def speeds(run: ReportedRun) -> Figure:
    """Forward speed against the frequency of the beat, real and simulated; held-out trials are open."""
    figure, axes = new_chart(WIDE, 3.1, "frequency of the tail beat (Hz)", "forward speed (mm/s)", legend_rows=1)
    moving = [trial for trial in run.trials if not trial.diverged]
    first = sorted(
        (
            ReportedTrial(name, False, figures, {})
            for name, figures in run.first["evidence"].get("trials", {}).items()
            if not figures.get("divergence")
        ),
        key=lambda trial: trial.figures["frequency"] or 0.0,
    )
    if first and run.best["index"] != run.first["index"]:
        x, y = _speeds(first, "velocity_simulated")
        axes.plot(x, y, ":", color=LIGHT["faint"], linewidth=1.2, label="simulated, first evaluation")
    for color, mark, label, trials, figures in (
        ("real", "o", "real", run.trials, "velocity_real"),
        ("simulated", "s", "simulated, best", moving, "velocity_simulated"),
    ):
        x, y = _speeds(trials, figures)
        axes.plot(x, y, color=LIGHT[color], linewidth=1.2, zorder=3)
        titled_points(
            axes.scatter(
                x, y, s=26, marker=mark, edgecolors=LIGHT[color], linewidths=1.1, zorder=4,
                facecolors=[LIGHT["surface"] if trial.held_out else LIGHT[color] for trial in trials],
            ),
            [
                f"{t.name}{' (held out)' * t.held_out}, {label}: {text(v, 1)} mm/s at {text(f, 3)} Hz"
                for t, f, v in zip(trials, x, y, strict=True)
            ],
        )  # fmt: skip
        axes.plot([], [], f"-{mark}", color=LIGHT[color], label=label)
    if any(trial.held_out for trial in run.trials):
        open_mark = handle(
            color=LIGHT["muted"], linestyle="none", marker="o", markerfacecolor="none", label="open: held out"
        )
        axes.add_line(open_mark)
    legend_over(axes)
    return figure


def _speeds(trials: Sequence[ReportedTrial], figure: str) -> tuple[list[float], list[float]]:
    """Frequencies [Hz] and speeds [mm/s] of trials, NaN where a speed isn't known."""
    values = [trial.figures[figure] for trial in trials]
    return [t.figures["frequency"] for t in trials], [float("nan") if v is None else 1e3 * v for v in values]
