"""Tables of a run's page: parameters within their bounds, trials and how well they are met, settings and versions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast

from swim2real.calibration import Sensitivity
from swim2real.formatting import NOTHING, degrees, mm, number, significant, spread
from swim2real.objective.figures import SENSORS, UNSIMULATED, Figure, figures_for, sensor_figure
from swim2real.parameters import Parameter
from swim2real.parameters.known import Known, known
from swim2real.report.run import ReportedRun, ReportedTrial
from swim2real.robots.robot import Sensor
from swim2real.settings import asks_a_vlm

_ON_BOUND = 0.01  # of the unit cube
_LABELS = {
    "robot_fingerprint": "Robot fingerprint (sha256)",
    "budget": "Budget (evaluations)",
    "scale": "Scale of the search",
    "probes": "Parameters measured first",
    "horizon": "Horizon (s compared of each trial)",
    "hold_out": "Held-out trials",
    "reference_fingerprint": "Reference fingerprint (sha256)",
    "created": "Begun",
}
_UNUSED = {"playback": ("start",)}  # settings that mean nothing under a protocol
_SHOWN_NUMBERS = 3


@dataclass(frozen=True)
class ParameterRow:
    """One parameter at its best value.

    Attributes:
        parameter: Its name, unit, bounds and published value.
        value: At the best parameters.
        position: Within the bounds on the run's scale, from 0 to 1.
        published_position: Position of the published value.
        effect: What a step does; None where that wasn't measured.
        interval: Its 95 % interval in a run that was studied; else values at which the error rises by a tenth, all
            other parameters following, in its unit. None where neither is known.
        known: How well the trials determine it, which is at most roughly without a study; None without an interval.
    """

    parameter: Parameter
    value: float
    position: float
    published_position: float
    effect: Sensitivity | None
    interval: tuple[float, float] | None = None
    known: Known | None = None

    @property
    def unit(self) -> str:
        """Empty for a pure number."""
        return "" if self.parameter.unit == "-" else self.parameter.unit

    @property
    def bound(self) -> str:
        """`lower` or `upper` when it lies on that bound, else empty."""
        return "lower" if self.position <= _ON_BOUND else "upper" if self.position >= 1 - _ON_BOUND else ""

    def change(self, side: str) -> str:
        """Change of the loss for a step to a side [mm], signed."""
        return "" if self.effect is None else mm(getattr(self.effect, side), 2, signed=True)


def parameter_rows(run: ReportedRun) -> tuple[ParameterRow, ...]:
    """One row per parameter, in the order of the space."""
    effects = {effect.name: effect for effect in run.of_best.sensitivity or ()}
    published = run.space.to_cube({p.name: min(max(p.published, p.lower), p.upper) for p in run.space})
    positions = run.space.to_cube(run.best.values)
    return tuple(
        ParameterRow(p, run.best.values[p.name], float(at), float(there), effects.get(p.name), *_known(run, p.name))
        for p, at, there in zip(run.space, positions, published, strict=True)
    )


def interval_name(run: ReportedRun) -> str:
    """Name of the intervals of `parameter_rows`; empty where they aren't known."""
    return "95 % interval" if run.studied is not None else "fits about as well" if run.of_best.ranges else ""


def _known(run: ReportedRun, name: str) -> tuple[tuple[float, float] | None, Known | None]:
    """The interval of a parameter, and how well it is known."""
    if run.studied is not None:
        one = run.studied.intervals[name]
        return one.interval_95, one.known
    ends = run.of_best.ranges.get(name)
    if ends is None:
        return None, None
    at = list(run.space.names).index(name)
    low, high = (float(run.space.to_cube({**run.best.values, name: end})[at]) for end in ends)
    return ends, known(high - low, sure=False)


@dataclass(frozen=True)
class TrialTable:
    """All trials by frequency and name. `columns` are headings with units; each row has a cell for each."""

    columns: tuple[str, ...]
    rows: tuple[tuple[ReportedTrial, tuple[str, ...]], ...]


def trial_table(run: ReportedRun) -> TrialTable:
    """One row per trial; columns of what trials have."""

    def of(name: str, figure: Figure) -> Callable[[ReportedTrial], str]:
        simulated = name not in UNSIMULATED
        return lambda t: NOTHING if t.diverged and simulated else figure.text(getattr(t.figures, name))

    def reading(sensor: Sensor) -> Callable[[ReportedTrial], str]:
        figure = sensor_figure(sensor.name, sensor.unit)
        return lambda trial: figure.text(trial.figures.sensor_errors.get(sensor.name))

    known = figures_for(run.registered)
    columns: dict[str, Callable[[ReportedTrial], str]] = {}
    if any(trial.checked.duration for trial in run.trials):
        columns["Length (s)"] = lambda trial: number(trial.checked.duration, 2)
    if any(trial.checked.nominal_frequency for trial in run.trials):
        columns["Set frequency (Hz)"] = lambda trial: number(trial.checked.nominal_frequency, 2)
    if run.has_beat:
        columns["Identified frequency (Hz)"] = lambda trial: (
            number(trial.figures.frequency, 3) if trial.checked.frequency is None
            else spread(trial.checked.frequency, trial.checked.frequency_std)
        )  # fmt: skip
        columns["Motor angle at the first frame (°)"] = (
            lambda trial: NOTHING if trial.diverged else degrees(trial.figures.phase)
        )  # fmt: skip
    if run.robot.trials.sensors:
        columns["Playback error (mm)"] = of("loss", known["aligned_marker_error"])
    for name, figure in known.items():
        if name not in ("frequency", SENSORS) and figure.of != "head" and figure.per_trial and run.has(name):
            columns[figure.heading] = of(name, figure)
    columns |= {f"{sensor.name} ({sensor.unit})": reading(sensor) for sensor in run.robot.trials.sensors}
    rows = tuple((trial, tuple(cell(trial) for cell in columns.values())) for trial in run.trials)
    return TrialTable(tuple(columns), rows)


def settings_rows(run: ReportedRun) -> dict[str, str]:
    """Every setting as text, by its label."""
    settings = asdict(run.settings)
    unused = () if asks_a_vlm(run.settings.advisor) else ("briefing",)
    apart = ("engine", "versions", *_UNUSED.get(run.settings.protocol, ()), *unused)
    rows = {
        _LABELS.get(name, name.replace("_", " ").capitalize()): value
        for name, value in settings.items() if name not in apart
    }  # fmt: skip
    for key in ("engine", "versions"):
        rows |= {f"{key.removesuffix('s').capitalize()}: {n.replace('_', ' ')}": v for n, v in settings[key].items()}
    return {label: _text(value) for label, value in rows.items()}


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
        return ", ".join(f"{name} {_text(one)}" for name, one in cast("Mapping[str, Any]", value).items())
    return significant(value) if isinstance(value, float) else str(value)
