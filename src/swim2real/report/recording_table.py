"""The recordings: how long they are, how well they are met, and what tracking lost."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from swim2real.report.run import ReportedRun, ReportedTrial
from swim2real.report.units import NOTHING, mm, percent, significant, text


@dataclass(frozen=True)
class RecordingRow:
    """One recording, as texts.

    Attributes:
        name: Of the trial.
        held_out: Whether it was left out of the fit.
        usable: False when its track should not be used as it is; None when that isn't known yet.
        cells: One a column.
        findings: About lost tracks.
        divergence: Why the simulation failed, or empty.
    """

    name: str
    held_out: bool
    usable: bool | None
    cells: tuple[str, ...]
    findings: tuple[str, ...]
    divergence: str


@dataclass(frozen=True)
class RecordingTable:
    """All recordings. `columns` are the headings of the cells, with units."""

    columns: tuple[str, ...]
    rows: tuple[RecordingRow, ...]


def recording_table(run: ReportedRun) -> RecordingTable:
    """One row a trial, by name; columns of what there is."""
    columns = _columns(run)
    rows = [
        RecordingRow(
            name=trial.name,
            held_out=trial.held_out,
            usable=trial.quality.get("usable"),
            cells=tuple(cell(trial) for cell in columns.values()),
            findings=tuple(str(finding) for finding in trial.quality.get("findings") or ()),
            divergence=str(trial.figures.get("divergence") or ""),
        )
        for trial in run.trials
    ]
    return RecordingTable(tuple(columns), tuple(rows))


def _columns(run: ReportedRun) -> dict[str, Callable[[ReportedTrial], str]]:
    about = run.robot.recordings

    def length(name: str) -> Callable[[ReportedTrial], str]:
        return lambda trial: NOTHING if trial.diverged else mm(trial.figures.get(name))

    def reading(name: str) -> Callable[[ReportedTrial], str]:
        return lambda trial: significant((trial.figures.get("sensor_errors") or {}).get(name))

    found: dict[str, Callable[[ReportedTrial], str]] = {
        "Length (s)": lambda trial: text(trial.quality.get("duration"), 2)
    }
    if any(trial.quality.get("nominal_frequency") for trial in run.trials):
        found["Frequency (Hz)"] = lambda trial: text(trial.quality.get("nominal_frequency"), 2)
    if about.sensors:
        found["Playback error (mm)"] = length("loss")
    found["Marker error (mm)"] = length("aligned_marker_error")
    if about.score_progress:
        found["Shape (mm)"] = length("shape_error")
    found |= {f"{sensor.name} ({sensor.unit})": reading(sensor.name) for sensor in about.sensors}
    if about.score_progress:
        found["Real speed (mm/s)"] = lambda trial: mm(trial.figures.get("velocity_real"))
        found["Simulated speed (mm/s)"] = length("velocity_simulated")
    if about.frame is not None:
        found["Heading (°)"] = lambda trial: text(trial.figures.get("heading_error"), 1, 180 / math.pi)
    found["Left out"] = lambda trial: percent(trial.figures.get("left_out_share"))
    return found
