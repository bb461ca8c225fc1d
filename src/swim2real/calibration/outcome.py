"""What a run found, kept with it so that a report needs nothing else: figures, and the trials themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict

from swim2real.calibration.from_rest import FromRest
from swim2real.calibration.problem import Problem
from swim2real.calibration.run_folder import OUTCOME, RunFolder
from swim2real.calibration.saved_trials import save_trials
from swim2real.calibration.sensitivity import Sensitivity
from swim2real.objective import evidence
from swim2real.objective.comparison import rounded
from swim2real.parameters import Values


class _File(BaseModel):
    """A part of a JSON file; keys that a later version adds are kept."""

    model_config = ConfigDict(frozen=True, extra="allow")


class Figures(_File):
    """Figures in SI; what a trial hasn't is None, as is a figure of a simulation that diverged.

    Attributes:
        loss: What is minimized [m].
        motion_error: Mean distance in the frame of the path: shape, recoil and progress together [m].
        recoil_error: Mean distance that differences in the head's yaw and sway make [m].
        yaw_error: Difference of the amplitudes of the head's yaw [rad].
        sway_error: Difference of the amplitudes of the head's sway [m].
        aligned_marker_error: Mean distance after phase and registration, difference in progress included [m].
        shape_error: The same without the difference in progress [m].
        progress_error: Mean difference of the way along the swim [m].
        heading_error: Mean difference of the turn since the first frame [rad].
        velocity_error: Difference of the forward speed [m/s].
        static_offset: Mean length of the registration vectors [m].
        marker_error: The paper's Eq. 1: mean distance without registration and weights [m].
        unweighted_error: The aligned error if lost markers counted [m].
        left_out_share: Share of marker positions that don't count.
        sensor_errors: Mean error of each sensor in its own unit.
    """

    loss: float | None = None
    motion_error: float | None = None
    recoil_error: float | None = None
    yaw_error: float | None = None
    sway_error: float | None = None
    aligned_marker_error: float | None = None
    shape_error: float | None = None
    progress_error: float | None = None
    heading_error: float | None = None
    velocity_error: float | None = None
    static_offset: float | None = None
    marker_error: float | None = None
    unweighted_error: float | None = None
    left_out_share: float | None = None
    sensor_errors: dict[str, float | None] = {}


class TrialFigures(Figures):
    """Figures of one trial, and per marker what `ComparedTrial.evidence` gives.

    Attributes:
        velocity_real: Real forward speed [m/s].
        velocity_simulated: Simulated forward speed [m/s], negative when it goes tail first.
        yaw_real: Amplitude of the real head's yaw at the beat [rad].
        yaw_simulated: Amplitude of the simulated head's yaw [rad].
        sway_real: Amplitude of the real head's sway at the beat [m].
        sway_simulated: Amplitude of the simulated head's sway [m].
        frequency: Frequency of the simulated motor [Hz].
        phase: Motor angle at the first frame [rad].
        divergence: Why the simulation failed, or None.
    """

    velocity_real: float | None = None
    yaw_real: float | None = None
    yaw_simulated: float | None = None
    sway_real: float | None = None
    sway_simulated: float | None = None
    velocity_simulated: float | None = None
    frequency: float | None = None
    phase: float | None = None
    divergence: str | None = None


class FitFigures(Figures):
    """Means over trials, and the figures of each trial.

    Attributes:
        protocol: Name of the protocol.
        horizon: Seconds that are compared, None for all of each trial.
        trials: Figures of each trial by its name.
    """

    protocol: str = "aligned"
    horizon: float | None = None
    trials: dict[str, TrialFigures] = {}


class Outcome(_File):
    """What a run found: the content of its `outcome.json`.

    Attributes:
        fit: Figures on the fitted trials.
        held_out: Figures on the held-out trials; None without any.
        from_rest: How each fitted trial's beat swims from rest; empty where trials have no beat.
        trials: What was found in each real trial: `usable`, `findings`, and what drove it.
        sensitivity: Effect of each parameter on the loss; None where nobody asked for it.
        engine: Name and fingerprint of the physics engine.
        marker_names: Names of the markers.
        evaluations: Number of evaluations on record; 0 in runs of earlier versions, which didn't write it.
    """

    fit: FitFigures
    held_out: FitFigures | None = None
    from_rest: dict[str, FromRest] = {}
    trials: dict[str, dict[str, Any]] = {}
    sensitivity: list[Sensitivity] | None = None
    engine: dict[str, Any] = {}
    marker_names: list[str] = []
    evaluations: int = 0

    def to_json(self) -> dict[str, Any]:
        """As the file has it."""
        return self.model_dump(exclude_unset=True)


def conclude(
    folder: RunFolder, problem: Problem, held_out: Problem | None, values: Values,
    sensitivity: Sequence[Sensitivity] | None = None,
) -> Outcome:  # fmt: skip
    """Simulates the best parameters once more, on held-out trials too, and writes figures and trials.

    Args:
        folder: Folder of the run.
        problem: The fitted trials.
        held_out: The held-out trials; None without any.
        values: The best parameters.
        sensitivity: Effect of each parameter on the loss, where it was measured.

    Raises:
        RunError: The folder can't be written.
    """
    fit = problem.evaluate(values)
    on_held_out = None if held_out is None else held_out.evaluate(values)
    content: dict[str, Any] = {
        "fit": evidence(fit),
        "held_out": None if on_held_out is None else evidence(on_held_out),
        **problem.check_fit(values),
        "trials": {**problem.examinations(), **({} if held_out is None else held_out.examinations())},
        "sensitivity": None if sensitivity is None else rounded([s.as_dict() for s in sensitivity]),
        "engine": problem.engine.as_dict(),
        "marker_names": list(problem.robot.marker_names),
        "evaluations": len(folder.record()),
    }
    save_trials(folder, fit, on_held_out)
    folder.write_json(OUTCOME, content)
    return Outcome.model_validate(content)
