"""Line search: what becomes of the proposals, and the course of one run, step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.comparison.results import RunResult
from swim2real.comparison.statistics import MethodStatistics
from swim2real.comparison.statistics_detail import step_statistics
from swim2real.report.comparison_palette import MethodStyle
from swim2real.report.paper_figures.style import DOUBLE, FAINT, REAL, handle, letter, log_axis, new_figure

_ACCEPTED = ("#00416a", "#2f7fb8", "#85bce0", "#c3dff1", "#e0eff8")  # dark to light with the step getting smaller
_REJECTED = "#eceef0"


def draw_line_search(methods: Sequence[MethodStatistics], styles: Mapping[str, MethodStyle]) -> Any | None:
    """Shares of the step sizes and of rejected rounds on the left, the losses of a typical run on the right.

    The run is that with the median loss of the first method that tries more than one step. None without rounds.
    """
    counted = [(one, steps) for one in methods if (steps := step_statistics(one.runs)) is not None and steps.rounds]
    if not counted:
        return None
    figure = new_figure(DOUBLE, 2.5)
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.35])
    sizes = sorted({size for _, steps in counted for size in steps.by_size}, reverse=True)
    left.grid(visible=False)
    for row, (_, steps) in enumerate(counted):
        start = 0.0
        for i, size in enumerate(sizes):
            share = 100 * steps.by_size.get(size, 0) / steps.rounds
            shade = min(i, len(_ACCEPTED) - 1)
            left.barh(row, share, left=start, height=0.56, color=_ACCEPTED[shade], edgecolor="white", linewidth=0.6)
            if share >= 3.5:
                ink = "white" if shade < 2 else REAL
                left.text(start + share / 2, row, f"{share:.0f}", ha="center", va="center", color=ink, fontsize=7)
            start += share
        left.barh(row, 100 - start, left=start, height=0.56, color=_REJECTED, edgecolor="white", linewidth=0.6)
        left.text(
            100, row - 0.33, f"{steps.accepted} of {steps.rounds} accepted ({100 * steps.accept_rate:.0f} %)",
            ha="right", va="bottom", fontsize=7,
        )  # fmt: skip
    left.set_yticks(range(len(counted)), [one.method for one, _ in counted])
    left.tick_params(axis="y", length=0)
    left.spines["left"].set_visible(False)
    left.set_ylim(len(counted) - 0.45, -0.85)
    left.set_xlim(0, 100)
    left.set_xlabel("share of the rounds (%)")
    letter(left, "(a) step at which a proposal is accepted")
    _size_legend(left, sizes)
    many = next((one for one, steps in counted if len(steps.by_size) > 1), counted[0][0])
    run = many.typical_run()
    _draw_run(right, run, styles[many.method].light)
    letter(right, f"(b) {many.method}, seed {run.seed}")
    right.set_ylabel(f"{many.words.loss} (mm)")
    return figure


def _size_legend(axes: Any, sizes: Sequence[float]) -> None:
    from matplotlib.patches import Patch

    shades = [_ACCEPTED[min(i, len(_ACCEPTED) - 1)] for i in range(len(sizes))]
    patches = [Patch(facecolor=shade, label=f"step {size:g}") for shade, size in zip(shades, sizes, strict=True)]
    patches.append(Patch(facecolor=_REJECTED, label="rejected"))
    _legend_below(axes, patches, 1.0)


def _legend_below(axes: Any, handles: Sequence[Any], length: float) -> None:
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=len(handles), handlelength=length,
        columnspacing=0.9, handletextpad=0.4, borderaxespad=0.2,
    )  # fmt: skip


def _draw_run(axes: Any, run: RunResult, color: str) -> None:
    """Every step of a run: filled where it was accepted, open where not; rounds on bands; the incumbent as a line."""
    losses = [1e3 * loss for loss in run.losses]
    known = [loss for loss, failed in zip(losses, run.failed, strict=True) if not failed] or losses
    top = 1.15 * max(known)
    for number, one in enumerate(run.rounds):
        first = one.begin + 1
        if number % 2:
            axes.axvspan(first - 0.5, first + len(one.sizes) - 0.5, color="#f1f3f5", linewidth=0, zorder=0)
        steps = range(one.begin, one.begin + len(one.sizes))
        axes.plot([i + 1 for i in steps], [min(losses[i], top) for i in steps], color=FAINT, linewidth=0.6, zorder=2)
    axes.step(
        range(1, len(losses) + 1), 1e3 * run.best, where="post", color=color, linewidth=1.3, zorder=3
    )  # fmt: skip
    accepted = {one.begin + len(one.sizes) - 1 for one in run.rounds if one.accepted} | {0}
    for i, loss in enumerate(losses):
        good, fell = i in accepted, run.failed[i]
        axes.plot(
            i + 1, top * 0.97 if fell else loss, "x" if fell else "o", color=color if good else FAINT,
            markerfacecolor=color if good else "white", markersize=3.8 if good else 3.4, markeredgewidth=0.7, zorder=4,
        )  # fmt: skip
    log_axis(axes.yaxis, 0.85 * min(known), top)
    axes.set_xlim(0.2, len(losses) + 0.8)
    axes.set_xlabel("evaluation (bands: rounds)")
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0.7}
    handles = [
        handle(color=color, label="accepted", **dot),
        handle(color=FAINT, markerfacecolor="white", label="not accepted", **dot),
        handle(color=color, label="best so far"),
    ]
    if any(run.failed):
        handles.append(handle(color=FAINT, linestyle="none", marker="x", label="diverged"))
    _legend_below(axes, handles, 1.6)
