"""Forward speed of swims against the frequency of their beat."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from swim2real.report.palette import LIGHT, Figure, framed, label
from swim2real.report.run import ReportedRun, ReportedTrial
from swim2real.report.units import to_mm

_FILLED, _OPEN = {"real": "circle", "simulated": "square"}, {"real": "circle-open", "simulated": "square-open"}


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
