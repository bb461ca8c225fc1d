"""The one table of figures of merit, which is also the model of what is recorded of a fit.

A figure is a field of `Figures`, if it has a mean over trials, or of `TrialFigures`, with a `Figure` that says how it
is shown. `ComparedTrial.figures` has its value under the same name. Records, `outcome.json`, tables, reports and
briefings take names, labels, units and meanings from here. Values are in SI.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from swim2real.formatting import number
from swimbase.checking import Number, Positive

Fact = Number | None
"""A figure; None for what a simulation that diverged doesn't have."""
Text = Annotated[str, Field(max_length=100_000)]

SENSORS = "sensor_errors"
_FACTORS: Mapping[str, float] = {"mm": 1e3, "mm/s": 1e3, "°": 180 / math.pi, "°/s": 180 / math.pi, "%": 100.0}


@dataclass(frozen=True)
class Figure:
    """Label, unit and meaning of a figure.

    Attributes:
        label: What it is.
        unit: Unit in which it is shown; values are in SI.
        meaning: In a sentence.
        short: Heading of a column.
        of: What it describes: the `fit`, the motion of the `head`, or the `tracks` of the real markers.
        digits: Digits after the point; None for three significant ones.
        per_trial: Whether tables with a row per trial have a column for it.
    """

    label: str
    unit: str
    meaning: str
    short: str
    of: Literal["fit", "head", "tracks"] = "fit"
    digits: int | None = 1
    per_trial: bool = True

    @property
    def factor(self) -> float:
        """Factor from SI to the unit; sensors are recorded in their own."""
        return 1.0 if self.digits is None else _FACTORS.get(self.unit, 1.0)

    @property
    def heading(self) -> str:
        """Label and unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    @property
    def column(self) -> str:
        """Heading of a column and unit."""
        return f"{self.short} {self.unit}".rstrip()

    def text(self, value: float | None) -> str:
        """A value in the unit that is shown, with a real minus sign; a dash for None, NaN and infinity."""
        return number(value, self.digits, self.factor)


class _Part(BaseModel):
    """A part of a JSON file; keys that a later version adds are kept."""

    model_config = ConfigDict(frozen=True, extra="allow")


class Figures(_Part):
    """Figures of a trial, or means over trials. What a trial doesn't have is None.

    Attributes:
        loss: What is minimized [m].
    """

    motion_error: Annotated[
        Fact,
        Figure(
            "Motion error", "mm",
            "Mean distance between simulated and real markers in the frame of the path, once phase and placement of "
            "the markers are accounted for: shape, recoil and progress together.", "motion",
        ),
    ] = None  # fmt: skip
    recoil_error: Annotated[
        Fact,
        Figure(
            "Recoil error", "mm", "What differences in the yaw and the sway of the head move markers by.", "recoil",
            "head",
        ),
    ] = None  # fmt: skip
    yaw_error: Annotated[
        Fact, Figure("Yaw error", "°", "Difference in the amplitude of the head's yaw.", "yaw", "head", per_trial=False)
    ] = None
    sway_error: Annotated[
        Fact,
        Figure("Sway error", "mm", "Difference in the amplitude of the head's sway.", "sway", "head", per_trial=False),
    ] = None
    marker_error: Annotated[
        Fact,
        Figure(
            "Marker error (paper's Eq. 1)", "mm",
            "Mean distance over all markers and frames, no registration, nothing left out; only start and heading are "
            "removed.", "Eq. 1",
        ),
    ] = None  # fmt: skip
    aligned_marker_error: Annotated[
        Fact,
        Figure(
            "Aligned marker error", "mm",
            "Mean distance between simulated and real markers once phase and placement of the markers are accounted "
            "for: shape and progress together.", "aligned",
        ),
    ] = None  # fmt: skip
    shape_error: Annotated[
        Fact,
        Figure("Shape error", "mm", "How the body bends: the same without how far it has come.", "shape"),
    ] = None
    progress_error: Annotated[
        Fact,
        Figure(
            "Progress error", "mm",
            "Mean difference in how far it has come along its line of travel, over the compared time.", "progress",
        ),
    ] = None  # fmt: skip
    static_offset: Annotated[
        Fact,
        Figure(
            "Static offset", "mm",
            "Markers are placed by hand: mean constant shift of a marker against its place in the simulation. "
            "Reported, not counted in the loss.", "offset", per_trial=False,
        ),
    ] = None  # fmt: skip
    heading_error: Annotated[
        Fact,
        Figure(
            "Heading error", "°", "Difference in the turn since the first frame. Reported, not counted in the loss.",
            "heading",
        ),
    ] = None  # fmt: skip
    velocity_error: Annotated[
        Fact,
        Figure("Velocity error", "mm/s", "Difference in speed along the line of travel.", "speed", per_trial=False),
    ] = None
    sensor_errors: Annotated[
        dict[str, Fact], Figure("Sensor errors", "", "Mean difference of the readings, each in its own unit.", "")
    ] = {}
    left_out_share: Annotated[
        Fact,
        Figure(
            "Left out", "%", "Share of marker positions that don't count because tracking lost the marker.",
            "lost", "tracks",
        ),
    ] = None  # fmt: skip
    unweighted_error: Annotated[
        Fact,
        Figure(
            "Error with lost markers", "mm",
            "What the aligned error would be if frames in which tracking lost a marker counted too.", "with lost",
            "tracks", per_trial=False,
        ),
    ] = None  # fmt: skip
    loss: Fact = None


class Beat(_Part):
    """Beat of the markers: one number per marker."""

    amplitude: list[Fact]
    phase: list[Fact]
    mean: list[Fact]


class Windows(_Part):
    """Mean residuals in windows of time."""

    edges: list[Number]
    markers: list[list[list[Fact]]]
    sensors: dict[str, list[Fact]] = {}


class TrialFigures(Figures):
    """Figures of one trial, and what `ComparedTrial.evidence` gives per marker.

    Attributes:
        yaw_real_std: Standard error of the amplitude of the real head's yaw [rad]; the other three likewise.
        yaw_lag: Phase of the simulated head's yaw relative to the real one's [rad]; that of the sway likewise.
        phase: Motor angle at the first frame [rad].
        first_beats: Simulated speed over the first two beats from rest [m/s].
        divergence: Why the simulation failed, or None.
    """

    frequency: Annotated[Fact, Figure("Frequency", "Hz", "Frequency of the simulated motor.", "f", digits=3)] = None
    velocity_real: Annotated[Fact, Figure("Real speed", "mm/s", "Forward speed of the real robot.", "v real")] = None
    velocity_simulated: Annotated[
        Fact, Figure("Simulated speed", "mm/s", "Forward speed, negative when it goes tail first.", "v sim")
    ] = None
    yaw_real: Annotated[
        Fact, Figure("Real yaw", "°", "Amplitude of the real head's yaw at the beat.", "yaw real", "head")
    ] = None
    yaw_simulated: Annotated[
        Fact, Figure("Simulated yaw", "°", "Amplitude of the simulated head's yaw.", "yaw sim", "head")
    ] = None
    sway_real: Annotated[
        Fact, Figure("Real sway", "mm", "Amplitude of the real head's sway at the beat.", "sway real", "head")
    ] = None
    sway_simulated: Annotated[
        Fact, Figure("Simulated sway", "mm", "Amplitude of the simulated head's sway.", "sway sim", "head")
    ] = None
    turn_rate_real: Annotated[
        Fact, Figure("Real turn", "°/s", "Slow turn of the real course, which isn't compared.", "turn real", "head")
    ] = None
    turn_rate_simulated: Annotated[
        Fact, Figure("Simulated turn", "°/s", "Slow turn of the simulated course.", "turn sim", "head", per_trial=False)
    ] = None
    yaw_real_std: Fact = None
    yaw_simulated_std: Fact = None
    yaw_lag: Fact = None
    sway_real_std: Fact = None
    sway_simulated_std: Fact = None
    sway_lag: Fact = None
    phase: Fact = None
    first_beats: Fact = None
    divergence: Text | None = None
    motion_marker_errors: list[Fact] = []
    marker_errors: list[Fact] = []
    aligned_marker_errors: list[Fact] = []
    shape_marker_errors: list[Fact] = []
    seen_shares: list[Fact] = []
    beat_real: Beat | None = None
    beat_simulated: Beat | None = None
    path_beat_real: Beat | None = None
    path_beat_simulated: Beat | None = None
    offset: list[tuple[Fact, Fact]] = []
    amplitude_real: list[Fact] = []
    amplitude_simulated: list[Fact] = []
    windows: Windows | None = None

    @model_validator(mode="after")
    def _one_per_marker(self) -> Self:
        if len(self.amplitude_real) != len(self.amplitude_simulated):
            raise ValueError("'amplitude_real' and 'amplitude_simulated' differ in length; both have one per marker")
        return self


class FitFigures(Figures):
    """Means over trials, and the figures of each trial.

    Attributes:
        protocol: Name of the protocol.
        horizon: Seconds that are compared, None for all of each trial.
        trials: Figures of each trial by its name.
    """

    protocol: Text = "aligned"
    horizon: Positive | None = None
    trials: dict[str, TrialFigures] = {}

    @property
    def error(self) -> float | None:
        """Error of the fit [m]: the loss, without what it adds to a swim that goes tail first. None if one diverged."""
        if any(trial.divergence for trial in self.trials.values()):
            return None
        name = {"motion": "motion_error", "paper": "marker_error"}.get(self.protocol, "aligned_marker_error")
        error = None if self.sensor_errors else getattr(self, name)
        return self.loss if error is None else error


FIGURES: dict[str, Figure] = {
    name: figure
    for name, field in sorted(TrialFigures.model_fields.items(), key=lambda item: item[0] in Figures.model_fields)
    for figure in field.metadata
    if isinstance(figure, Figure)
}
"""Every figure that is shown, by its name; those of a trial alone first."""
AVERAGED = tuple(name for name in FIGURES if name in Figures.model_fields)
"""Names of the figures that have a mean over trials."""
UNSIMULATED = ("frequency", "velocity_real", "yaw_real", "sway_real", "turn_rate_real", "left_out_share")
"""Names of the figures that are known of a trial whose simulation diverged, too."""


def figures_for(registered: bool) -> dict[str, Figure]:
    """Every figure by its name; where nothing is registered, the aligned error is simply the markers' error."""
    if registered:
        return FIGURES
    meaning = "Mean distance between simulated and real markers at the same times."
    aligned = replace(FIGURES["aligned_marker_error"], label="Marker error", short="markers", meaning=meaning)
    return {**FIGURES, "aligned_marker_error": aligned}


def sensor_figure(name: str, unit: str) -> Figure:
    """Label and unit of a sensor's error."""
    return Figure(name, unit, "Mean difference of the readings.", name, digits=None)


def figure_values(figures: Figures) -> dict[str, float | None]:
    """The figures that a fit or a trial has, by name; errors of sensors as `sensor_errors.NAME`."""
    values = {name: getattr(figures, name) for name in FIGURES if name in figures.model_fields_set and name != SENSORS}
    return values | {f"{SENSORS}.{name}": error for name, error in figures.sensor_errors.items()}
