"""Figures of the whole run: convergence, speed against frequency, error from head to tail."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from swim2real.report.marker_errors import MarkerErrors
from swim2real.report.palette import LIGHT, Figure, framed, label
from swim2real.report.rounds import accepted_steps
from swim2real.report.run import ReportedRun, ReportedTrial, best_losses
from swim2real.report.units import mm, to_mm

_FILLED, _OPEN = {"real": "circle", "simulated": "square"}, {"real": "circle-open", "simulated": "square-open"}


def convergence(run: ReportedRun) -> Figure:
    """Loss of each evaluation, the best so far, accepted rounds, and diverged simulations at the top."""
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
    name = "marker error" if run.paper_protocol else "aligned marker error"
    return framed(
        data, "evaluation", f"loss: {name} (mm)", 360,
        xaxis={"range": [0.4, len(run.entries) + 0.6], **({"dtick": 1} if len(run.entries) <= 20 else {})},
        yaxis={"range": [0, round(top, 1)]},
    )  # fmt: skip


def speeds(run: ReportedRun) -> Figure:
    """Forward speed against frequency, real and simulated; held-out trials are open."""
    trials = run.trials
    moving = [trial for trial in trials if not trial.diverged]
    data = [
        _speed_trace("real", "real", trials, "velocity_real"),
        _speed_trace("simulated", "simulated, best", moving, "velocity_simulated"),
    ]
    first = [t for t in _first_trials(run) if not t.diverged]
    if first and run.best["index"] != run.first["index"]:
        trace = _speed_trace("simulated", "simulated, first evaluation", first, "velocity_simulated")
        trace.update(mode="lines", line={"color": LIGHT["faint"], "width": 1.5, "dash": "dot"})
        data.append(trace)
    if any(trial.held_out for trial in trials):
        data.append({
            "type": "scatter", "mode": "markers", "name": "open: held out", "x": [None], "y": [None],
            "marker": {"symbol": "circle-open", "size": 11, "color": LIGHT["muted"], "line": {"width": 2}},
        })  # fmt: skip
    return framed(data, "frequency of the tail beat (Hz)", "forward speed (mm/s)", 380)


def _first_trials(run: ReportedRun) -> list[ReportedTrial]:
    found = [
        ReportedTrial(name, False, figures, {}) for name, figures in run.first["evidence"].get("trials", {}).items()
    ]
    return sorted(found, key=lambda trial: trial.figures["frequency"] or 0.0)


def _speed_trace(kind: str, name: str, trials: Sequence[ReportedTrial], figure: str) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "lines+markers", "name": name,
        "x": [round(t.figures["frequency"], 4) for t in trials], "y": [to_mm(t.figures[figure]) for t in trials],
        "text": [label(t.name) + (" (held out)" if t.held_out else "") for t in trials],
        "line": {"color": LIGHT[kind], "width": 2},
        "marker": {
            "symbol": [(_OPEN if t.held_out else _FILLED)[kind] for t in trials], "size": 11, "color": LIGHT[kind],
            "line": {"width": 2, "color": LIGHT[kind]},
        },
        "hovertemplate": f"%{{text}}<br>{name}: %{{y:.1f}} mm/s at %{{x:.3f}} Hz<extra></extra>",
    }  # fmt: skip


def head_to_tail(errors: MarkerErrors, markers: Sequence[str]) -> Figure:
    """One kind of error over the markers: every trial thin, the mean of the fitted ones bold."""
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
        data, "marker, head to tail", "error (mm)", 300,
        xaxis={"type": "category", "categoryorder": "array", "categoryarray": names}, yaxis={"rangemode": "tozero"},
    )  # fmt: skip
