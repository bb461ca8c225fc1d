"""A simulated trial against its real one: at the real time stamps, in phase and registered where that is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from markertrack import frames
from markertrack.track import MarkerTrack
from swim2real.objective.alignment import align, register
from swim2real.objective.head import head_motion
from swim2real.objective.target import SensorTarget, Target, framed_progress
from swim2real.objective.trial import (
    ComparedBeat,
    ComparedHead,
    ComparedProgress,
    ComparedSensor,
    ComparedTrial,
    LossFigure,
)
from swim2real.trials import Trial
from swimbase.arrays import Array
from swimbase.errors import TrialError


def compare_steady(target: Target, simulated: Trial, *, fit_phase: bool = True) -> ComparedTrial:
    """Compares a steady swim in the body frame, and in the frame of its path where the target has one.

    Args:
        target: The real swim, as `steady_target` makes it.
        simulated: The simulated swim from motor angle 0 on; it covers the trial, and one period more to fit a phase.
        fit_phase: Whether phase and registration are fitted and the loss is the motion error, or the aligned error
            without a path; otherwise both are zero, as the paper's text has it, and the loss is its Eq. 1.

    Raises:
        TrialError: It was simulated for too short a time.
    """
    if target.frequency is None or target.swim is None:
        raise TrialError(f"trial '{target.name}' has no beat; it can't be compared as a steady swim")
    loss_figure: LossFigure = "marker_error"
    if fit_phase:
        loss_figure = "aligned_marker_error" if target.head is None else "motion_error"
    kept, motionless = len(target.times), np.zeros(target.real.shape[1:])
    if simulated.divergence is not None:
        nothing = np.full_like(target.real, np.nan)
        return replace(
            _compared(target, loss_figure, nothing, nothing, np.full(kept, np.nan), float("nan")),
            divergence=simulated.divergence,
            beat=ComparedBeat(target.frequency, target.beat_frequency or target.frequency, 0.0, 0.0, nothing),
            head=None if target.head is None else ComparedHead(target.head, None),
        )
    period = 1 / target.frequency
    lead = period if fit_phase else 0.0
    sim_times = simulated.track.times - simulated.track.times[0]
    if sim_times[-1] + 1e-6 < target.sample_times[-1] + lead:
        raise TrialError(
            f"trial '{simulated.name}': simulated for {sim_times[-1]:.2f} s, "
            f"{target.sample_times[-1] + lead:.2f} s are compared"
        )
    shift, registration = 0.0, motionless
    if fit_phase:
        body = CubicSpline(sim_times, simulated.track.body.reshape(len(sim_times), -1))
        alignment = align(
            lambda t: body(t).reshape(len(t), *motionless.shape), target.real, target.times, target.weights, period
        )
        shift, registration = alignment.shift, alignment.registration
    sampled = MarkerTrack(
        target.sample_times, CubicSpline(sim_times, simulated.track.positions)(target.sample_times + shift)
    )
    body_simulated = sampled.body[:kept]
    head = None
    if target.head is not None:
        moved = head_motion(sampled.times, sampled.positions, target.frequency).until(kept)
        head = ComparedHead(target.head, moved)
    offsets = registration if fit_phase else register(target.real - body_simulated, target.weights)
    beat = ComparedBeat(
        frequency=target.frequency,
        real_frequency=target.beat_frequency or target.frequency,
        phase=2 * np.pi * target.frequency * shift,
        static_offset=float(np.linalg.norm(offsets, axis=1).mean()),
        swim_residual=(sampled.swim - target.swim)[:kept],
    )
    if target.trial.midline:
        body_simulated = slid(body_simulated + registration, target.real) - registration
    compared = _compared(
        target, loss_figure, body_simulated, sampled.course[:kept], sampled.progress[:kept], sampled.speed
    )
    progress = None if compared.progress is None else replace(compared.progress, first_beats=simulated.first_beats)
    return replace(compared, registration=registration, beat=beat, head=head, progress=progress)


def compare_playback(target: Target, simulated: Trial) -> ComparedTrial:
    """Compares a recording at its own time stamps; nothing is fitted.

    Args:
        target: The recording, as `playback_target` makes it.
        simulated: Its playback, with the track at the recording's time stamps, and the sensors at those of the
            recording's sensors that lie within the track.

    Raises:
        TrialError: It was simulated at other times.
    """
    if not np.array_equal(target.times, simulated.track.times):
        raise TrialError(f"trial '{simulated.name}': it wasn't simulated at the recording's time stamps")
    world = simulated.track.positions
    progress, velocity = None, float("nan")
    if target.progress is not None and target.frame is not None:
        progress = np.full(len(world), np.nan)
        if simulated.divergence is None or np.isfinite(world).any():
            progress = framed_progress(target.times, world, target.weights, target.frame)
        velocity = frames.slope(target.times, progress)
    positions = world if target.frame is None else frames.to_body(world, target.frame)
    if target.trial.midline:
        positions = slid(positions, target.real)
    return replace(
        _compared(target, "aligned_marker_error", positions, world, progress, velocity),
        sensors=tuple(_compared_sensor(sensor, simulated) for sensor in target.sensors),
        divergence=simulated.divergence,
    )


def slid(simulated: Array, real: Array) -> Array:
    """Simulated markers, slid along the real body to beside the places of its midline, as far as the head is.

    Places on a midline are at distances from the head, but aren't the body's own points: where they are along the body
    isn't known as well as across it. The head is: by how far it is ahead all markers may be.

    Args:
        simulated: Markers in a row from head to tail [m]. Shape (T, M, 2).
        real: Places along the midline [m]. Shape (T, M, 2).

    Returns:
        Shape (T, M, 2).
    """
    tangents = np.gradient(real, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        tangents = tangents / np.linalg.norm(tangents, axis=2, keepdims=True)
    ahead = ((simulated - real) * tangents).sum(axis=2, keepdims=True)
    return simulated - np.nan_to_num(ahead - ahead[:, :1]) * np.nan_to_num(tangents)


def _compared(
    target: Target, loss_figure: LossFigure, simulated: Array, path: Array, progress: Array | None, velocity: float
) -> ComparedTrial:
    """Builds the parts of every compared trial, and the way that it has come if that is scored."""
    way = None
    if target.progress is not None and target.velocity is not None and progress is not None:
        way = ComparedProgress(target.progress, progress, target.velocity, velocity)
    return ComparedTrial(
        name=target.name,
        loss_figure=loss_figure,
        times=target.times,
        weights=target.weights,
        real=target.real,
        simulated=simulated,
        registration=np.zeros(target.real.shape[1:]),
        path_real=target.path,
        path_simulated=path,
        frame=target.frame,
        progress=way,
    )


def _compared_sensor(target: SensorTarget, simulated: Trial) -> ComparedSensor:
    readings = np.full(len(target.times), np.nan)
    if simulated.divergence is None:
        if simulated.sensors is None or not np.array_equal(simulated.sensors.times, target.times):
            raise TrialError(f"trial '{simulated.name}': its sensors weren't simulated at the recording's time stamps")
        readings = simulated.sensors.column(target.name)
    return ComparedSensor(target.name, target.meters_per_unit, target.times, target.readings, readings)
