"""How a recording starts: at rest, in a keyframe, as its trial says, or as its first frames show."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend

from swim2real.errors import EngineError, TrialError
from swim2real.simulation.pose import SCALAR, PoseFit
from swim2real.trials import Trial

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 0.1  # s of first frames that show how a recording starts
_FRAMES = 5  # at least
_TRIES = 6
_WINDOWS = 10  # of first frames that show how fast a recording moves
_MOTION = 0.9  # of the motion's power, above noise
_STILL = 1e-6  # m: a correction that is none
REST, MARKERS, FITTED = "rest", "markers", "fitted"
STARTS = (REST, MARKERS, FITTED)
"""What a start may be, beside a keyframe."""


class FirstFrames:
    """What the first frames of a track show: where each marker starts and how fast, by a straight line through them.

    Attributes:
        times: Times of the frames since the first one [s]. Shape (K,).
        known: Markers that are seen at least twice. Shape (M,).
        places: Positions at the first time stamp [m]. Shape (M, 2).
        velocities: Velocities of the markers [m/s]. Shape (M, 2).
    """

    def __init__(self, trial: Trial, weights: Array, least: int = _FRAMES) -> None:
        """Takes the frames of a trial that count.

        Args:
            trial: Real trial.
            weights: Weights, 0 where a marker isn't believed. Shape (T, M).
            least: Frames that it takes at least.

        Raises:
            TrialError: No marker is seen twice.
        """
        track = trial.track
        since = track.times - track.times[0]
        count = max(int(np.searchsorted(since, WINDOW, side="right")), min(least, len(since)))
        positions = track.positions[:count]
        self.times = since[:count]
        self._counted = (weights[:count] > 0) & np.isfinite(positions).all(axis=2)
        self.known: Mask = self._counted.sum(axis=0) > 1
        if not self.known.any():
            raise TrialError(
                f"trial '{trial.name}': no marker is seen twice in its first {self.times[-1]:.2f} s, so nothing tells "
                f"its start; cut the video, or write 'start' into reference.json"
            )
        self.places, self.velocities = self.lines(positions)

    def lines(self, positions: Array) -> tuple[Array, Array]:
        """Straight lines through the frames in which each marker counts. Shape (K, M, 2) to (M, 2) and (M, 2)."""
        weights = self._counted.astype(float)
        total = np.maximum(weights.sum(axis=0), 1.0)
        moments = weights * (self.times[:, None] - weights.T @ self.times / total)
        counted = np.where(self._counted[:, :, None], positions, 0.0)
        slopes = np.einsum("km,kmi->mi", moments, counted) / np.maximum(np.square(moments).sum(axis=0), 1e-12)[:, None]
        middle = counted.sum(axis=0) / total[:, None]
        return middle - slopes * (weights.T @ self.times / total)[:, None], slopes


def start_at_keyframe(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> None:
    """Puts the model into one of its keyframes.

    Raises:
        EngineError: It has none of this name.
    """
    names = [model.key(i).name for i in range(model.nkey)]
    if name not in names:
        raise EngineError(f"start is '{name}'; it must be one of {', '.join((*STARTS, *names))}")
    mujoco.mj_resetDataKeyframe(model, data, names.index(name))
    data.time = 0.0


def start_at_joints(model: mujoco.MjModel, data: mujoco.MjData, trial: Trial) -> None:
    """Moves the joints that a trial names to where it says.

    Raises:
        TrialError: The model has no such joint, or not a sliding or turning one.
    """
    for name, value in _scalar(model, trial, trial.start).items():
        data.qpos[model.joint(name).qposadr[0]] = value
    for name, value in _scalar(model, trial, trial.start_velocities).items():
        data.qvel[model.joint(name).dofadr[0]] = value


def start_at_markers(
    fit: PoseFit, first: FirstFrames, guess: Array, simulated: Callable[[Array, Array], Array | None]
) -> tuple[Array, Array]:
    """The state whose simulation has the same straight lines through its first frames as the recording.

    A line through a path that bends begins beside it, and has the slope of its middle. By how much is seen in the
    simulation and taken from the real lines, again and again (a fixed-point iteration with Anderson's acceleration).

    Args:
        fit: Fits poses of the model.
        first: First frames of the recording.
        guess: Pose to begin with. Shape (nq,).
        simulated: From a state, positions of the markers at the times of the first frames, (K, M, 2) m; None if it
            diverges.

    Returns:
        Positions and velocities of the joints. Shapes (nq,) and (nv,).
    """
    known, shape = first.known, first.places.shape
    real = _stacked(first.places, first.velocities)
    counted = np.tile(np.repeat(known, 2), (2, 1))
    wanted, qpos, qvel, least = real, guess, np.zeros(0), np.inf
    inputs: list[Array] = []
    outputs: list[Array] = []
    best = None
    for _ in range(_TRIES):
        qpos = fit.pose(wanted[0].reshape(shape), known, qpos).qpos
        qvel = fit.velocities(qpos, wanted[1].reshape(shape) / WINDOW, known)
        positions = simulated(qpos, qvel)
        if positions is None:
            break
        lines = _stacked(*first.lines(positions))
        missed = float(np.linalg.norm((lines - real)[counted]))
        if missed < least:
            best, least = (qpos, qvel), missed
        inputs.append(wanted)
        outputs.append(np.where(counted, real - lines + _stacked(*fit.motion(qpos, qvel)), real))
        wanted = _accelerated(inputs, outputs)
        if np.abs(wanted - inputs[-1]).max() < _STILL:
            break
    return best or (qpos, qvel)


def _stacked(places: Array, velocities: Array) -> Array:
    """Places, and ways in the time of the window [m]. Shape (2, 2 M)."""
    return np.stack([places.ravel(), WINDOW * velocities.ravel()])


def _accelerated(inputs: list[Array], outputs: list[Array]) -> Array:
    """Anderson's next point of the iteration outputs = f(inputs)."""
    if len(inputs) == 1:
        return outputs[-1]
    gaps = np.array([(g - x).ravel() for x, g in zip(inputs, outputs, strict=True)])
    images = np.array([g.ravel() for g in outputs])
    shares = np.linalg.lstsq(np.diff(gaps, axis=0).T, gaps[-1], rcond=1e-3)[0]
    return (images[-1] - shares @ np.diff(images, axis=0)).reshape(inputs[0].shape)


def _scalar(model: mujoco.MjModel, trial: Trial, given: Mapping[str, float]) -> Mapping[str, float]:
    names = [model.joint(j).name for j in range(model.njnt) if int(model.jnt_type[j]) in SCALAR]
    for name in given:
        if name not in names:
            raise TrialError(
                f"trial '{trial.name}' starts with joint '{name}', which isn't one of the model's sliding and turning "
                f"joints ({', '.join(names) or 'none'})"
            )
    return given


def too_fast(trial: Trial, weights: Array) -> list[str]:
    """A warning where first frames take longer than a quarter of the period of the fastest motion; else nothing.

    Args:
        trial: Recording whose start is shown by its markers.
        weights: Weights, 0 where a marker isn't believed. Shape (T, M).
    """
    window = float(FirstFrames(trial, weights).times[-1])
    fastest = fastest_frequency(trial, weights, _WINDOWS * window)
    if fastest is None or window <= 1 / (4 * fastest):
        return []
    return [
        f"its start is a straight line through its first {window:.2g} s, more than a quarter of the period of its "
        f'motion ({fastest:.2g} Hz), so it may be wrong; say start = "fitted" in the robot file'
    ]


def fastest_frequency(trial: Trial, weights: Array, seconds: float) -> float | None:
    """Frequency below which nine tenths of the markers' motion are [Hz]; None where it is too short or mostly noise.

    Args:
        trial: A recording.
        weights: Weights, 0 where a marker isn't believed. Shape (T, M).
        seconds: How much of it is looked at, from its first frame on [s].
    """
    track = trial.track
    count = int(np.searchsorted(track.times - track.times[0], seconds, side="right"))
    if count < 2 * _FRAMES:
        return None
    times = track.times[:count]
    even = np.linspace(times[0], times[-1], count)
    power = np.zeros(count // 2 + 1)
    for marker in range(track.marker_count):
        counted = weights[:count, marker] > 0
        for axis in range(2):
            known = counted & np.isfinite(track.positions[:count, marker, axis])
            if 2 * known.sum() > count:
                way = np.interp(even, times[known], track.positions[:count, marker, axis][known])
                power += np.square(np.abs(np.fft.rfft(detrend(way) * np.hanning(count))))
    above = np.maximum(power - 2 * np.median(power), 0.0)
    if not above.sum() > power.sum() / 2:
        return None
    frequencies = np.fft.rfftfreq(count, float(even[1] - even[0]))
    return float(frequencies[np.searchsorted(np.cumsum(above), _MOTION * above.sum())])
