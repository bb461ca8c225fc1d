"""Tables of a run's page: parameters within their bounds, trials and how well they are met, settings and versions."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast

from swim2real.objective.figures import FIGURES, SENSORS, UNSIMULATED, Figure, figures_for, sensor_figure
from swim2real.report.run import Json, ReportedRun, ReportedTrial
from swim2real.report.units import NOTHING, degrees, mm, significant, spread, text
from swim2real.robots.robot import Sensor
from swim2real.settings import asks_a_vlm

ON_BOUND = 0.01  # of the unit cube
_LABELS = {
    "robot": "Robot",
    "robot_file": "Robot file",
    "robot_fingerprint": "Robot fingerprint (sha256)",
    "method": "Method",
    "advisor": "Advisor",
    "protocol": "Protocol",
    "budget": "Budget (evaluations)",
    "seed": "Seed",
    "scale": "Scale of the search",
    "probes": "Parameters measured first",
    "horizon": "Horizon (s compared of each trial)",
    "hold_out": "Held-out trials",
    "reference": "Reference",
    "reference_fingerprint": "Reference fingerprint (sha256)",
    "commit": "Commit",
    "created": "Begun",
}
_APART = ("engine", "versions")
_UNUSED = {"playback": ("start",)}  # settings that mean nothing under a protocol
_SHOWN_NUMBERS = 3


@dataclass(frozen=True)
class ParameterRow:
    """One parameter, as texts.

    Attributes:
        name: Identifier.
        unit: Empty for a pure number.
        value: At the best parameters.
        lower: Bound.
        upper: Bound.
        published: Value of the prior work.
        meaning: In a sentence or two.
        position: Within the bounds on the run's scale [%].
        published_position: Position of the published value [%].
        bound: `lower` or `upper` when it lies on that bound, else empty.
        down: Change of the loss for a step down [mm], signed; empty when it wasn't determined.
        up: Change of the loss for a step up [mm], signed; empty when it wasn't determined.
        verdict: `identified`, `weak`, `not identified`, or empty.
    """

    name: str
    unit: str
    value: str
    lower: str
    upper: str
    published: str
    meaning: str
    position: float
    published_position: float
    bound: str
    down: str
    up: str
    verdict: str


def parameter_rows(run: ReportedRun) -> tuple[ParameterRow, ...]:
    """One row a parameter, in the order of the space."""
    values: Json = run.best["values"]
    published = {p.name: min(max(p.published, p.lower), p.upper) for p in run.space}
    positions, published_positions = run.space.to_cube(values), run.space.to_cube(published)
    rows: list[ParameterRow] = []
    for i, p in enumerate(run.space):
        position = float(positions[i])
        effects: Json = run.sensitivity.get(p.name) or {}
        rows.append(
            ParameterRow(
                name=p.name,
                unit="" if p.unit == "-" else p.unit,
                value=significant(values[p.name]),
                lower=significant(p.lower),
                upper=significant(p.upper),
                published=significant(p.published),
                meaning=p.meaning,
                position=round(100 * position, 1),
                published_position=round(100 * float(published_positions[i]), 1),
                bound="lower" if position <= ON_BOUND else "upper" if position >= 1 - ON_BOUND else "",
                down=_effect(effects, "lower"),
                up=_effect(effects, "upper"),
                verdict=str(effects.get("verdict") or ""),
            )
        )
    return tuple(rows)


def _effect(effects: Json, side: str) -> str:
    return "" if not effects else NOTHING if effects.get(side) is None else mm(effects[side], 2, signed=True)


@dataclass(frozen=True)
class TrialRow:
    """One trial, as texts.

    Attributes:
        name: Name of the trial.
        held_out: Whether it was left out of the fit.
        usable: False when its track should not be used as it is; None when that isn't known yet.
        cells: One a column.
        findings: What was found about lost tracks.
        divergence: Why the simulation failed, or empty.
    """

    name: str
    held_out: bool
    usable: bool | None
    cells: tuple[str, ...]
    findings: tuple[str, ...]
    divergence: str


@dataclass(frozen=True)
class TrialTable:
    """All trials. `columns` are the headings of the cells, with units."""

    columns: tuple[str, ...]
    rows: tuple[TrialRow, ...]


def trial_table(run: ReportedRun) -> TrialTable:
    """One row a trial, by frequency and name; columns of what trials have."""
    columns = _columns(run)
    rows = [
        TrialRow(
            name=trial.name,
            held_out=trial.held_out,
            usable=trial.quality.get("usable"),
            cells=tuple(cell(trial) for cell in columns.values()),
            findings=tuple(str(finding) for finding in trial.quality.get("findings") or ()),
            divergence=str(trial.figures.get("divergence") or ""),
        )
        for trial in run.trials
    ]
    return TrialTable(tuple(columns), tuple(rows))


def _columns(run: ReportedRun) -> dict[str, Callable[[ReportedTrial], str]]:
    def of(name: str, figure: Figure) -> Callable[[ReportedTrial], str]:
        unknown = name not in UNSIMULATED
        return lambda trial: NOTHING if trial.diverged and unknown else figure.text(trial.figures.get(name))

    def reading(sensor: Sensor) -> Callable[[ReportedTrial], str]:
        figure = sensor_figure(sensor.name, sensor.unit)
        return lambda trial: figure.text((trial.figures.get(SENSORS) or {}).get(sensor.name))

    columns: dict[str, Callable[[ReportedTrial], str]] = {}
    if any(trial.quality.get("duration") for trial in run.trials):
        columns["Length (s)"] = lambda trial: text(trial.quality.get("duration"), 2)
    if any(trial.quality.get("nominal_frequency") for trial in run.trials):
        columns["Set frequency (Hz)"] = lambda trial: text(trial.quality.get("nominal_frequency"), 2)
    if run.has_beat:
        columns["Identified frequency (Hz)"] = _identified
        columns["Motor angle at the first frame (°)"] = (
            lambda trial: NOTHING if trial.diverged else degrees(trial.figures.get("phase"))
        )  # fmt: skip
    if run.robot.trials.sensors:
        columns["Playback error (mm)"] = of("loss", FIGURES["aligned_marker_error"])
    for name, figure in figures_for(run.registered).items():
        if name not in ("frequency", SENSORS) and figure.of != "head" and figure.per_trial and run.has(name):
            columns[figure.heading] = of(name, figure)
    columns |= {f"{sensor.name} ({sensor.unit})": reading(sensor) for sensor in run.robot.trials.sensors}
    return columns


def _identified(trial: ReportedTrial) -> str:
    identified = trial.quality.get("frequency")
    if identified is None:
        return text(trial.figures.get("frequency"), 3)
    return spread(identified, trial.quality.get("frequency_std"))


def settings_rows(run: ReportedRun) -> tuple[tuple[str, str], ...]:
    """Every setting as label and text."""
    settings = asdict(run.settings)
    unused = () if asks_a_vlm(run.settings.advisor) else ("briefing",)
    apart = (*_LABELS, *_APART, *_UNUSED.get(run.settings.protocol, ()), *unused)
    names = [*_LABELS, *(name for name in settings if name not in apart)]
    return (
        *((_LABELS.get(name, name), _text(settings[name])) for name in names),
        *_prefixed("Engine", settings["engine"]),
        *_prefixed("Version", settings["versions"]),
    )


def _prefixed(prefix: str, content: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(f"{prefix}: {name.replace('_', ' ')}", _text(value)) for name, value in content.items()]


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        items = cast("Sequence[Any]", value)
        if items and all(isinstance(one, float) for one in items):
            shown = ", ".join(significant(one) for one in items[:_SHOWN_NUMBERS])
            return shown if len(items) <= _SHOWN_NUMBERS else f"{shown}, … ({len(items)} numbers)"
        return ", ".join(_text(one) for one in items) or "none"
    if isinstance(value, dict):
        return json.dumps(value, ensure_ascii=False)
    return significant(value) if isinstance(value, float) else str(value)
