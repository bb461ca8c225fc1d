"""Figures of any run: convergence, error by marker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from swim2real.calibration.convergence import best_losses
from swim2real.report.marker_errors import MarkerErrors
from swim2real.report.palette import LIGHT, Figure, framed, label
from swim2real.report.rounds import accepted_steps
from swim2real.report.run import ReportedRun
from swim2real.report.units import mm, to_mm


def convergence(run: ReportedRun, loss: str) -> Figure:
    """Loss of each evaluation, the best so far, accepted rounds, and diverged simulations at the top.

    Args:
        run: As reported.
        loss: What is minimized, in words.
    """
    proper = [(i + 1, entry) for i, entry in enumerate(run.entries) if not entry["failed"]]
    losses = [1e3 * entry["loss"] for _, entry in proper]
    top = 1.12 * max(losses, default=1e3)
    begun = proper[0][0] if proper else len(run.entries) + 1
    best_x = list(range(begun, len(run.entries) + 1))
    best_y = [to_mm(loss) for loss in best_losses(run.entries)[begun - 1 :]]
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "markers", "name": "evaluation",
            "x": [n for n, _ in proper], "y": [to_mm(entry["loss"]) for _, entry in proper],
            "marker": {"color": LIGHT["faint"], "size": 7},
            "text": ["over " if entry.get("lower_bound") else "" for _, entry in proper],
            "hovertemplate": "evaluation %{x}: %{text}%{y:.1f} mm<extra></extra>",
        },
        {
            "type": "scatter", "mode": "lines", "name": "best so far", "x": best_x, "y": best_y,
            "line": {"color": LIGHT["simulated"], "width": 2.5, "shape": "hv"}, "hoverinfo": "skip",
        },
    ]  # fmt: skip
    accepted = accepted_steps(run)
    if accepted:
        data.append({
            "type": "scatter", "mode": "markers", "name": "accepted round",
            "x": [i + 1 for i, _ in accepted], "y": [to_mm(run.entries[i]["loss"]) for i, _ in accepted],
            "text": [f"round {number} accepted" for _, number in accepted],
            "marker": {"color": LIGHT["good"], "size": 12, "symbol": "star"},
            "hovertemplate": "%{text}: %{y:.1f} mm<extra></extra>",
        })  # fmt: skip
    failed = [(i + 1, entry) for i, entry in enumerate(run.entries) if entry["failed"]]
    if failed:
        data.append({
            "type": "scatter", "mode": "markers", "name": "diverged (no loss)", "x": [n for n, _ in failed],
            "y": [round(0.97 * top, 1)] * len(failed),
            "text": [label(str(entry.get("reason") or "diverged")) for _, entry in failed],
            "marker": {"color": LIGHT["warning"], "size": 10, "symbol": "triangle-up"},
            "hovertemplate": "evaluation %{x}: %{text}<extra></extra>",
        })  # fmt: skip
    return framed(
        data, "evaluation", f"loss: {loss} (mm)", 360,
        xaxis={"range": [0.4, len(run.entries) + 0.6], **({"dtick": 1} if len(run.entries) <= 20 else {})},
        yaxis={"range": [0, round(top, 1)]},
    )  # fmt: skip


def by_marker(errors: MarkerErrors, markers: Sequence[str], order: str) -> Figure:
    """One kind of error over the markers: every trial thin, the mean of the fitted ones bold.

    Args:
        errors: Of that kind.
        markers: Their names.
        order: What the axis of the markers is, in words.
    """
    names = [label(marker) for marker in markers]
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "lines", "x": names, "y": [to_mm(value) for value in row], "showlegend": False,
            "line": {"color": LIGHT["faint"], "width": 1.5, **({"dash": "dash"} if held_out else {})},
            "hovertemplate": f"{label(trial)}{' (held out)' if held_out else ''}, %{{x}}: %{{y:.1f}} mm<extra></extra>",
        }
        for trial, held_out, row in zip(errors.trials, errors.held_out, errors.values.tolist(), strict=True)
    ]  # fmt: skip
    data.append({
        "type": "scatter", "mode": "lines+markers", "x": names, "y": [to_mm(value) for value in errors.mean.tolist()],
        "line": {"color": LIGHT["text"], "width": 3}, "marker": {"color": LIGHT["text"], "size": 7},
        "showlegend": False,
        "text": [mm(value) for value in errors.mean.tolist()], "hovertemplate": "mean, %{x}: %{text} mm<extra></extra>",
    })  # fmt: skip
    return framed(
        data, order, "error (mm)", 300,
        xaxis={"type": "category", "categoryorder": "array", "categoryarray": names}, yaxis={"rangemode": "tozero"},
    )  # fmt: skip
