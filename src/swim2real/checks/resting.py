"""The start that suits recordings: at rest in the model's own pose or a keyframe, or fitted to their first stretch.

Straight lines through the first frames show where each marker begins and how fast, those of a playback from a pose what
commands do at once. A pose suits where both agree, unless a fitted start leaves much less of the motion unexplained.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.checks.motion import Motion, error
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON
from swim2real.simulation.start import FITTED, MARKERS, REST, STRETCH, WINDOW, FirstFrames
from swim2real.trials import Trial, TrialSet
from swimbase.arrays import Array, Mask
from swimbase.errors import Swim2RealError, TrialError

_LONG = 0.5  # s that are played back
_STILL = 0.05  # of the motion's size: farther off a pose, it isn't at rest in it
_MOVING = 0.02  # of its size: moving farther in the window of first frames, it is in motion
_SURE = 4.0  # standard errors of a velocity that is none
_WORSE = 1.5  # times the error from a fitted start, from which on a recording doesn't begin as the file says
_STRONGER = 5.0  # times the model's own, which what drives a robot may do at once
_MOST_KEYS = 8  # keyframes that are tried


@dataclass(frozen=True)
class _Beginning:
    """The beginning of a recording beside the model in a pose at rest.

    Attributes:
        off: Distance from this pose, a mean over the markers [m].
        speed: Velocity of the fastest marker [m/s].
        marker: Its name, or that of the sensor.
        rests: Whether it begins there, at rest.
    """

    off: float
    speed: float
    marker: str
    rests: bool


@dataclass(frozen=True)
class _BetterStart:
    """The start that suits a recording.

    Attributes:
        start: `rest` where it begins in the model's own pose, at rest; else `fitted`.
        rest: Error of a playback with the robot's own values that begins at rest [m].
        fitted: Error of one whose start is fitted [m].
    """

    start: str
    rest: float
    fitted: float


def better_starts(robot: Robot, reference: TrialSet) -> dict[str, _BetterStart]:
    """The better of rest and fitted for each recording whose start isn't known, by the data and by what both lead to.

    A command that jumps as a recording begins speaks for neither: what it does at once, the model does, too.
    """
    return _better(robot, reference, _begun(robot, reference, REST))


def started(robot: Robot, reference: TrialSet) -> Robot:
    """The robot, with the start that suits all recordings where its file names none."""
    if robot.trials.start_named or robot.trials.steady:
        return robot
    fitted = any(one.start == FITTED for one in better_starts(robot, reference).values())
    return robot.starting(FITTED if fitted else REST)


def other_start(robot: Robot, reference: TrialSet) -> str | None:
    """A proposal of a start where the recordings speak against the one that the robot file names, in a sentence."""
    named = robot.trials.start
    if not robot.trials.start_named or not (rest := _begun(robot, reference, REST)):
        return None
    better = _better(robot, reference, rest).values()
    off, fitted = (1e3 * float(np.mean([getattr(one, start) for one in better])) for start in (REST, FITTED))
    misses = f" (with the model's own values they are {off:.2g} mm off from rest, {fitted:.2g} mm from a fitted start)"
    if named not in (FITTED, MARKERS):
        for name, one in _begun(robot, reference, named).items():
            if not one.rests:
                return (
                    f"trial '{name}' begins {1e3 * one.off:.1f} mm from the pose of start = \"{named}\", {one.marker} "
                    f'moving by {1e3 * one.speed:.0f} mm/s: say start = "fitted" in the robot file'
                ) + misses * (fitted < off)
        return None
    keys = [robot.model.key(k).name for k in range(min(robot.model.nkey, _MOST_KEYS))]
    for pose in dict.fromkeys((REST, *filter(None, keys))):
        begun = rest if pose == REST else _begun(robot, reference, pose)
        speaks_against = pose == REST and any(one.start == FITTED for one in better)
        if len(begun) == len(rest) and not speaks_against and all(one.rests for one in begun.values()):
            where = "the model's own pose" if pose == REST else f"keyframe '{pose}'"
            count = "The recording begins" if len(begun) == 1 else f"All {len(begun)} recordings begin"
            return (
                f"{count} at rest in {where}, within {1e3 * max(one.off for one in begun.values()):.1f} mm: start = "
                f'"{pose}" in the robot file says so, and leaves less to be found than "{named}"'
            ) + misses * (pose == REST)
    return _worse_than_fitted(robot, reference) if named == MARKERS else None


def _worse_than_fitted(robot: Robot, reference: TrialSet) -> str | None:
    """A sentence where straight lines through first frames don't show how a recording starts, as of fast motion."""
    lines, fitted = (_errors(robot, reference, start, STRETCH) for start in (MARKERS, FITTED))
    for name, off in lines.items():
        if off > _WORSE * fitted[name]:
            return (
                f"trial '{name}' moves too fast for straight lines through its first frames (start = \"{MARKERS}\"), "
                f"which put the first {STRETCH:g} s {1e3 * off:.2g} mm off, a fitted start {1e3 * fitted[name]:.2g} "
                f'mm: say start = "fitted" in the robot file'
            )
    return None


def _begun(robot: Robot, reference: TrialSet, pose: str) -> dict[str, _Beginning]:
    """Beginnings of recordings whose start isn't known, beside a pose, by trial.

    Nothing of swims, of a pose from which the model can't be simulated, and of recordings that show nothing.
    """
    if robot.trials.steady or reference.marker_names != robot.marker_names:
        return {}
    trials = [trial for trial in reference if not trial.start and not trial.start_velocities]
    try:
        motion = Motion(robot.starting(pose))
        made = motion.player.simulate(robot.space.published, [motion.request(trial, _LONG) for trial in trials])
    except Swim2RealError:  # `misfits` reports it
        return {}
    pairs = zip(trials, made, strict=True)
    return {real.name: one for real, played in pairs if (one := _beginning(robot, real, played)) is not None}


def _beginning(robot: Robot, trial: Trial, played: Trial) -> _Beginning | None:
    """The beginning of a recording beside a playback of it from a pose; None where nothing shows it."""
    real, made = _shown(robot, robot.trials.unwrapped(trial)[0]), _shown(robot, played)
    if real is None or made is None or played.divergence is not None:
        return None
    try:
        first = FirstFrames(real, real.track.confidence)
    except TrialError:
        return None
    count, known = len(first.times), first.known
    seen, model = real.track.positions[:count], made.track.positions[:count]
    if robot.marker_names and robot.trials.frame is not None:  # its place in the world is of no importance
        model = _laid_on(model, first.places, known)
    (place, own), frames = first.lines(model), np.isfinite(seen).all(axis=2).sum(axis=0)
    left = seen - first.places - first.velocities * first.times[:, None, None]
    errors = np.sqrt(np.nansum(np.square(left), axis=(0, 2)) / np.maximum(frames - 2, 1))  # of markers
    errors /= max(float(np.std(first.times)), 1e-9) * np.sqrt(np.maximum(frames, 1))  # of velocities
    share = (first.velocities * own)[known].sum() / max(float(np.square(own[known]).sum()), 1e-30)
    beyond = np.linalg.norm(first.velocities - np.clip(share, 0.0, _STRONGER) * own, axis=1)
    places = np.where(real.track.confidence[:, :, None] > 0, real.track.positions, np.nan)[:, known]
    size = float(np.linalg.norm(np.subtract(*np.nanpercentile(places, [95, 5], axis=0)), axis=1).max())
    size = min(size, robot.size if robot.marker_names else size)
    moving = known & (WINDOW * beyond > np.maximum(_MOVING * size, _SURE * WINDOW * errors))
    off, speeds = np.linalg.norm(place - first.places, axis=1), np.linalg.norm(first.velocities, axis=1)
    distance, fastest = float(off[known].mean()), int(np.argmax(known * speeds))
    name = (robot.marker_names or robot.sensed_places)[fastest]
    return _Beginning(distance, float(speeds[fastest]), name, not moving.any() and distance < _STILL * size)


def _shown(robot: Robot, trial: Trial) -> Trial | None:
    """A trial whose markers show its places; without any, sensors take their parts [m]. None where nothing does."""
    if robot.marker_names:
        return trial
    sensors = [one for one in robot.trials.sensors if one.name in robot.sensed_places]
    if trial.sensors is None or not sensors:
        return None
    read = trial.sensors.between(trial.track.times[0], trial.track.times[-1])
    columns = np.stack([one.meters_per_unit * read.column(one.name) for one in sensors], axis=1)
    return replace(trial, track=MarkerTrack(read.times, np.stack([columns, np.zeros_like(columns)], axis=2)))


def _laid_on(played: Array, seen: Array, known: Mask) -> Array:
    """A motion, turned and shifted so that its first frame lies on what was seen. Shapes (T, M, 2), (M, 2), (M,)."""
    plane = np.array([1.0, 1.0j])
    moved, wanted = played @ plane, seen[known] @ plane
    moved = moved - moved[0, known].mean()
    turn = (np.conj(moved[0, known]) * (wanted - wanted.mean())).sum()
    laid = moved * np.exp(1j * np.angle(turn)) + wanted.mean()
    return np.stack([laid.real, laid.imag], axis=2)


def _better(robot: Robot, reference: TrialSet, begun: Mapping[str, _Beginning]) -> dict[str, _BetterStart]:
    """The start that suits recordings which begin like this beside the model's own pose."""
    rest, fitted = (_errors(robot, map(reference.__getitem__, begun), start, HORIZON) for start in (REST, FITTED))
    made: dict[str, _BetterStart] = {}
    for name, one in begun.items():
        rests = one.rests and not rest[name] > _WORSE * fitted[name]
        rests = rests or (np.isfinite(rest[name]) and fitted[name] == np.inf)
        made[name] = _BetterStart(REST if rests else FITTED, rest[name], fitted[name])
    return made


def _errors(robot: Robot, trials: Iterable[Trial], start: str, seconds: float) -> dict[str, float]:
    """Root mean square errors of trials' streams from a start with the robot's own values, added up [m].

    NaN for a trial that can't be played back, infinite for a playback that diverges.
    """
    motion, values, found = Motion(robot.starting(start)), robot.space.published, dict[str, float]()
    for trial in trials:
        ready = motion.prepared(trial.cut(seconds), values)
        parts = motion.parts([ready], [values])[0][0] if ready else {}
        diverged = any(part.diverged for part in parts.values())
        found[trial.name] = np.inf if diverged else error(parts) if ready else np.nan
    return found
