"""The verdict on a run: good, not finished or not usable, in a sentence with what would help."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from swim2real.calibration.convergence import noise_of
from swim2real.calibration.file_models import Kind, Verdict
from swim2real.calibration.from_rest import FromRest, backward_from_rest
from swim2real.calibration.loop import Search
from swim2real.calibration.problem import Problem
from swim2real.objective import ComparedTrial
from swim2real.objective.motion import extent
from swim2real.objective.trial import TAIL_FIRST_LOSS
from swim2real.optimizers.enough import Sizes, agreeing
from swim2real.robots.robot import Robot, Sensor
from swimbase.arrays import Array

_USABLE = 0.25  # share of the motion that a usable fit leaves unexplained at most
_USABLE_READINGS = 0.1  # the same of readings alone, which hide more, where they are far above the noise
_FAR = 10.0  # times the noise
_NEAR = 4.0  # times the noise of the data, up to which an error is near it
AT_NOISE = 2.0  # times it: where so little is left, nothing can be much lower; of known fits it is 0.7 to 1.6
_ENDS = {
    "budget": "the budget of {made} evaluations is spent", "minutes": "the minutes are over",
    "interrupted": "it was interrupted", "stopped": "it was stopped",
    "most": "the search gave up after {made} evaluations",
}  # fmt: skip
_PARTS = {"shape_error": "shape", "recoil_error": "recoil", "progress_error": "way", "aligned_marker_error": "markers"}


def judge(
    trials: Sequence[ComparedTrial], robot: Robot, search: Search, noise: float | None,
    from_rest: Mapping[str, FromRest] | None = None,
) -> Verdict:  # fmt: skip
    """Judges the best parameters of a run.

    Args:
        trials: Fitted trials, simulated with these parameters.
        robot: The robot.
        search: The search that found them.
        noise: Noise of the data [m]; None where nothing tells it.
        from_rest: Swims from rest that they were tried on.
    """
    if not trials:
        said = f"it has not ended; {search.made} evaluations are on record, and --resume goes on"
        return _verdict("not finished", said, None, search.seconds)
    seconds = None if search.ending == "done" else search.seconds
    longer = "" if seconds is None else f", about {_duration(seconds)} more at this pace"
    on = f"--resume{' without --budget' * (search.ending in ('budget', 'most'))} searches on{longer}"
    failed = next((one for one in trials if one.divergence is not None), None)
    if failed is not None:
        what = f"the simulation of trial '{failed.name}' diverges with the best parameters found"
        return _verdict("not usable", f"{what}; {on}, or try another seed (--seeds 0:3)", None, seconds)
    error, size = error_and_motion(trials, robot)
    share = error / size if size else 0.0
    times = f", {error / noise:.{0 if error > 9.5 * noise else 1}f} times the noise of the data" if noise else ""
    left = f"{100 * share:.{0 if share > 0.015 else 2}f} % of the motion is unexplained ({1e3 * error:.3g} mm{times})"
    worst = _worst(trials, robot.trials.sensors)
    helps = on
    if search.ending == "done":
        look = "film and the charts" if robot.marker_names else "charts"
        lacks = ", add what the model lacks (behind # in its robot file)" if robot.source is not None else ""
        why = search.conclusion or "the search is done"
        helps = f"{why}, so look at the {look} for what is wrong{lacks}, or try other seeds (--seeds 0:3)"
    backward = backward_from_rest(from_rest or {})
    tail_first = next((one.name for one in trials if one.tail_first), None)
    if tail_first is not None:
        added = f"which adds {1e3 * TAIL_FIRST_LOSS:.0f} mm to the loss"
        return _verdict("not usable", f"trial '{tail_first}' is simulated tail first, {added}; {helps}", share, seconds)
    far = bool(noise) and error > _FAR * (noise or 0.0)
    limit = _USABLE_READINGS if far and not robot.marker_names else _USABLE
    if share > limit:
        return _verdict("not usable", f"{left}, {worst}; {helps}", share, seconds)
    if backward is not None:
        return _verdict("not usable", backward.removeprefix("unusable: "), share, seconds)
    near, at = (noise is not None and error <= times * noise for times in (_NEAR, AT_NOISE))
    if search.ending == "done" or (at and search.ending in ("budget", "most")):
        why = "which is near the noise" if near else f"and no parameters that were found explain more: {worst}"
        return _verdict("good", f"{left}, {why}{f'; {search.conclusion}' * bool(search.conclusion)}", share)
    ended = _ENDS.get(search.ending, "it has not ended").format(made=search.made)
    alone = "" if len(search.ends) < 2 else f", {agreeing(search.ends)} of {len(search.ends)} starts agree"
    return _verdict("not finished", f"{ended}{alone}; {left}, {worst}; {on}", share, seconds)


def _verdict(kind: Kind, sentence: str, share: float | None, seconds: float | None = None) -> Verdict:
    return Verdict(kind=kind, sentence=sentence, unexplained=share, seconds=seconds)


def error_and_motion(trials: Sequence[ComparedTrial], robot: Robot) -> tuple[float, float]:
    """Mean error of trials, and the size of their real motion [m]; zeros without any that was simulated.

    Args:
        trials: Compared trials.
        robot: The robot.
    """
    errors, sizes = list[float](), list[float]()
    for trial in (one for one in trials if one.divergence is None):
        off = sum(sensor.meters_per_unit * sensor.error for sensor in trial.sensors)
        errors.append(float(getattr(trial, trial.loss_figure)) + off if robot.marker_names else trial.loss)
        positions = trial.real if trial.progress is None else trial.path_real
        sizes.append(_size(positions, trial.weights, [(one.meters_per_unit, one.real) for one in trial.sensors]))
    return float(np.mean(errors or [0.0])), _root_mean(sizes)


def sizes_of(problem: Problem) -> Sizes:
    """Noise and motion of a problem's trials."""
    sizes: list[float] = []
    for target in (one.target for one in problem.prepared):
        positions = target.real if target.progress is None else target.path
        sizes.append(_size(positions, target.weights, [(s.meters_per_unit, s.readings) for s in target.sensors]))
    return Sizes(noise_of(problem.trials, problem.robot.trials.sensors) or 0.0, _root_mean(sizes))


def _size(positions: Array, weights: Array, readings: Sequence[tuple[float, Array]]) -> float:
    """Size of the motion of a trial [m].

    Root mean square distance of the real markers from their mean places, on the way of a trial that is scored by it,
    else in the frame of comparison, and how far readings are from their means, as they count.
    """
    spread = sum(scale * float(np.nanstd(values)) for scale, values in readings)
    return (extent(positions, weights) if weights.shape[1] else 0.0) + spread


def _root_mean(sizes: Sequence[float]) -> float:
    return math.hypot(*sizes) / math.sqrt(max(len(sizes), 1))


def _worst(trials: Sequence[ComparedTrial], sensors: Sequence[Sensor]) -> str:
    """The trial with the largest error and the part that adds most to it, in words."""
    trial = max(trials, key=lambda one: one.loss)
    figures = trial.figures()
    errors = {what: float(figures.get(name) or 0.0) for name, what in _PARTS.items()}
    if errors["shape"]:
        del errors["markers"]  # which the others make up
    read = figures.get("sensor_errors", {})
    errors |= {f"sensor '{one.name}'": one.meters_per_unit * (read.get(one.name) or 0.0) for one in sensors}
    part = max(errors, key=lambda what: errors[what])
    return f"most in trial '{trial.name}' by its {part} ({1e3 * errors[part]:.3g} mm)"


def _duration(seconds: float) -> str:
    return f"{max(seconds, 1.0):.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
