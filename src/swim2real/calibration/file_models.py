"""What the files of a run folder must be like, wherever they come from: settings, record and evidence.

What is checked here is what is read again; keys that a later version adds are kept as they are.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from swim2real.checking import Number, PathText, Positive

Whole = Annotated[int, Field(strict=True, ge=0, le=10**9)]
Fact = Number | None
"""A figure; None for what a simulation that diverged doesn't have."""
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Text = Annotated[str, Field(max_length=100_000)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow")


class RunSettings(_Part):
    """What `settings.json` of a run says; every key may be missing, since versions and methods differ."""

    format: Any = None
    chained: bool = False
    robot: Text | None = None
    robot_file: PathText | None = None
    protocol: Text | None = None
    start: Text | None = None
    horizon: Positive | None = None
    pieces: Positive | None = None
    method: Text | None = None
    advisor: Text | None = None
    budget: Whole = 0
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    first: Text | None = None
    starts: Whole | None = None
    scale: Literal["log", "linear"] = "log"
    max_steps: Whole | None = None
    early_stop: bool = True
    give_up: bool | Number | None = None
    probes: Whole = 0
    hold_out: list[Text] = []
    reference_fingerprint: Text | None = None
    reference: Text | None = None
    engine: dict[str, Any] | None = None
    commit: Text | None = None
    versions: dict[str, Text] = {}
    created: Text | None = None


class Beat(_Part):
    """How markers beat: one number a marker."""

    amplitude: list[Fact]
    phase: list[Fact]
    mean: list[Fact]


class Windows(_Part):
    """Mean residuals in windows of time."""

    edges: list[Number]
    markers: list[list[list[Fact]]]
    sensors: dict[str, list[Fact]] = {}


class Evidence(_Part):
    """Figures in SI, of a trial or of all."""

    loss: Fact = None
    motion_error: Fact = None
    recoil_error: Fact = None
    yaw_error: Fact = None
    sway_error: Fact = None
    aligned_marker_error: Fact = None
    shape_error: Fact = None
    progress_error: Fact = None
    heading_error: Fact = None
    velocity_error: Fact = None
    static_offset: Fact = None
    marker_error: Fact = None
    unweighted_error: Fact = None
    left_out_share: Fact = None
    sensor_errors: dict[str, Fact] = {}


class TrialEvidence(Evidence):
    """Figures of a trial, and what they are made of."""

    velocity_real: Fact = None
    velocity_simulated: Fact = None
    yaw_real: Fact = None
    yaw_simulated: Fact = None
    yaw_real_std: Fact = None
    yaw_simulated_std: Fact = None
    yaw_lag: Fact = None
    sway_real: Fact = None
    sway_simulated: Fact = None
    sway_real_std: Fact = None
    sway_simulated_std: Fact = None
    sway_lag: Fact = None
    turn_rate_real: Fact = None
    turn_rate_simulated: Fact = None
    frequency: Fact = None
    phase: Fact = None
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
    offset: list[list[Fact]] = []
    amplitude_real: list[Fact] = []
    amplitude_simulated: list[Fact] = []
    windows: Windows | None = None


class FitEvidence(Evidence):
    """Figures of all trials, and of each."""

    protocol: Text = "aligned"
    horizon: Positive | None = None
    trials: dict[str, TrialEvidence] = {}


class Proposal(_Part):
    """What an advisor proposed."""

    point: list[Number]
    diagnosis: Text = ""
    reasoning: Text = ""
    notes: dict[str, Any] = {}


class Note(_Part):
    """How a candidate came about."""

    source: Text | None = None
    round: Whole | None = None
    step_size: Number | None = None
    parameter: Text | Whole | None = None  # a name, or an index of the cube
    proposal: Proposal | None = None


class RecordedEvaluation(_Part):
    """A line of the record."""

    index: Whole
    loss: Number
    failed: Annotated[bool, Field(strict=True)]
    reason: Text | None = None
    lower_bound: bool | None = None
    point: list[Share]
    values: dict[str, Number]
    note: Note
    evidence: FitEvidence
    seconds: Number | None = None


class TrialSummary(_Part):
    """What was found in a real trial."""

    usable: bool | None = None
    findings: list[Text] = []
    duration: Fact = None
    frames: Whole | None = None
    frequency: Fact = None
    frequency_std: Fact = None
    phase: Fact = None
    phase_std: Fact = None
    start_speed: Fact = None
    start_speed_std: Fact = None
    amplitude: Fact = None
    explained: Fact = None
    nominal_frequency: Fact = None
    meters_per_pixel: Fact = None
    lost_share: list[Fact] = []
    left_out_share: Fact = None
    head_spread: Fact = None
    body_spread: Fact = None
    controls: list[Text] = []
    sensors: list[Text] = []


class Swum(_Part):
    """A swim from rest."""

    frequency: Number
    speed: Fact
    divergence: Text | None


class Effect(_Part):
    """Effect of a parameter on the loss."""

    name: Text
    lower: Fact
    upper: Fact
    speed: Fact
    verdict: Text


class OutcomeFile(_Part):
    """The content of `outcome.json`."""

    fit: FitEvidence
    held_out: FitEvidence | None = None
    evaluations: Whole | None = None
    from_rest: dict[str, Swum] = {}
    trials: dict[str, TrialSummary] = {}
    sensitivity: list[Effect] | None = None
    engine: dict[str, Any] = {}
    marker_names: list[Text] = []
