"""The trials: what drove them, how well they are met, and what tracking lost."""

from __future__ import annotations

from dataclasses import dataclass

from swim2real.report.run import ReportedRun
from swim2real.report.units import NOTHING, degrees, mm, percent, spread, text


@dataclass(frozen=True)
class TrialRow:
    """One trial, as texts; frequencies [Hz], speeds [mm/s], errors [mm], the phase [°].

    Attributes:
        name: Of the trial.
        held_out: Whether it was left out of the fit.
        usable: False when its track should not be used as it is; None when that isn't known yet.
        nominal: Frequency that the motor was set to.
        frequency: Identified, ± its standard deviation.
        phase: Motor angle at the first frame.
        velocity_real: Forward.
        velocity_simulated: Forward, or that the simulation diverged.
        aligned: Aligned marker error.
        shape: Shape error.
        marker: The paper's Eq. 1.
        left_out: Share of marker positions that don't count.
        findings: About lost tracks.
        divergence: Why the simulation failed, or empty.
    """

    name: str
    held_out: bool
    usable: bool | None
    nominal: str
    frequency: str
    phase: str
    velocity_real: str
    velocity_simulated: str
    aligned: str
    shape: str
    marker: str
    left_out: str
    findings: tuple[str, ...]
    divergence: str


def trial_rows(run: ReportedRun) -> tuple[TrialRow, ...]:
    """One row a trial, by frequency."""
    rows: list[TrialRow] = []
    for trial in run.trials:
        figures, quality, failed = trial.figures, trial.quality, trial.diverged
        identified = quality.get("frequency")
        rows.append(
            TrialRow(
                name=trial.name,
                held_out=trial.held_out,
                usable=quality.get("usable"),
                nominal=text(quality.get("nominal_frequency"), 2),
                frequency=text(figures["frequency"], 3)
                if identified is None
                else spread(identified, quality.get("frequency_std")),
                phase=NOTHING if failed else degrees(figures["phase"]),
                velocity_real=mm(figures["velocity_real"]),
                velocity_simulated="diverged" if failed else mm(figures["velocity_simulated"]),
                aligned=NOTHING if failed else mm(figures["aligned_marker_error"]),
                shape=NOTHING if failed else mm(figures["shape_error"]),
                marker=NOTHING if failed else mm(figures["marker_error"]),
                left_out=percent(figures["left_out_share"]),
                findings=tuple(str(finding) for finding in quality.get("findings") or ()),
                divergence=str(figures.get("divergence") or ""),
            )
        )
    return tuple(rows)
