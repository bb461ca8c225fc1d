"""Whether recordings begin at rest, in a pose that the model has, or in motion.

A parabola through the first frames shows where each marker begins and how fast; what is commanded at once shows in its
acceleration. Stretches of several lengths are taken: a short one of what moves at once, a long one of what stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swim2real.checks.motion import Motion
from swim2real.errors import Swim2RealError
from swim2real.robots.robot import Robot, Trials
from swim2real.settings import HORIZON
from swim2real.simulation.playback import PlaybackSimulator
from swim2real.simulation.start import FITTED, MARKERS, REST
from swim2real.trials import Trial, TrialSet

Array = NDArray[np.float64]

_FRAMES = (5, 10)  # first frames that tell a velocity
_LONG = 0.3  # s of first frames that tell it of what stays at rest
_UNIT_TIME = 0.1  # s, that makes ways of velocities
_STILL = 0.05  # of the motion's size: farther off its pose, or moving farther in this time, it isn't at rest in it
_MOVING = 0.02  # of its size: moving farther in this time, it is in motion
_SURE = 4.0  # standard errors of a velocity that is none
_ALIKE = 0.5  # share by which velocities of several stretches may differ
_LEAST = 4  # frames in which a marker is seen
_WORSE = 1.5  # times the error from a fitted start, from which on a recording doesn't begin at rest
_STRONGER = 5.0  # times the model's own, which what drives a robot may do at once
_MOST_KEYS = 8  # keyframes that are tried


@dataclass(frozen=True)
class Beginning:
    """How a recording begins, beside the model in a pose at rest.

    Attributes:
        off: Distance from this pose, a mean over the markers [m].
        speed: Velocity of the marker that has the largest [m/s].
        marker: Its name, or that of the sensor.
        rests: Whether it begins there, at rest.
        moves: Whether it is surely in motion.
    """

    off: float
    speed: float
    marker: str
    rests: bool
    moves: bool


def poses_of_rest(robot: Robot, reference: TrialSet) -> dict[str, dict[str, Beginning]]:
    """How each recording begins beside each pose that a robot file may name: `rest` and the model's keyframes.

    Recordings whose start is known aren't looked at; of swims there is nothing.

    Returns:
        By pose and trial. A pose from which the model can't be simulated isn't there.
    """
    about = robot.trials
    if about.swims is not None or reference.marker_names != robot.marker_names:
        return {}
    trials = [trial for trial in reference if not trial.start and not trial.start_velocities]
    model = robot.model
    names = [model.key(k).name for k in range(min(model.nkey, _MOST_KEYS))]
    found: dict[str, dict[str, Beginning]] = {}
    for pose in dict.fromkeys((REST, *filter(None, names))):
        placed = replace(robot, trials=replace(about, start=pose))
        simulator = PlaybackSimulator(placed)
        try:
            begun = [trial.cut(_LONG) for trial in trials]
            made = simulator.simulate(robot.space.published, [simulator.request(trial) for trial in begun])
        except Swim2RealError:  # `misfits` reports it
            continue
        pairs = zip(trials, made, strict=True)
        found[pose] = {
            real.name: one for real, simulated in pairs
            if simulated.divergence is None and (one := _beginning(robot, about, real, simulated)) is not None
        }  # fmt: skip
    return found


def in_motion(robot: Robot, reference: TrialSet) -> list[str]:
    """A warning for each recording that is in motion where the robot file says that it begins at rest."""
    about = robot.trials
    if about.swims is not None or about.start in (FITTED, MARKERS) or not about.start_named:
        return []
    return [
        f"trial '{name}' moves as it begins ({one.marker} by {1e3 * one.speed:.0f} mm/s), and start is "
        f'"{about.start}" in the robot file, which is at rest; say start = "fitted", or begin where it still rests'
        for name, one in poses_of_rest(robot, reference).get(about.start, {}).items() if one.moves
    ]  # fmt: skip


@dataclass(frozen=True)
class BetterStart:
    """Which start suits a recording.

    Attributes:
        start: `rest` where it begins in the model's own pose, at rest; else `fitted`.
        rest: Error of a playback with the robot's own values that begins at rest [m].
        fitted: Error of one whose start is fitted [m].
    """

    start: str
    rest: float
    fitted: float


def better_starts(robot: Robot, reference: TrialSet) -> dict[str, BetterStart]:
    """Which of rest and fitted suits each recording whose start isn't known, by the data and by what both lead to.

    A command that jumps as a recording begins speaks for neither: what it does at once, the model does, too.
    """
    return _better(robot, reference, poses_of_rest(robot, reference).get(REST, {}))


def _better(robot: Robot, reference: TrialSet, begun: Mapping[str, Beginning]) -> dict[str, BetterStart]:
    """The same, of recordings that begin like this beside the model's own pose."""
    made: dict[str, BetterStart] = {}
    if not begun:
        return made
    players = [Motion(replace(robot, trials=replace(robot.trials, start=s))) for s in (REST, FITTED)]
    for name, one in begun.items():
        trial = reference[name].cut(HORIZON)
        rest, fitted = (_error(player, trial) for player in players)
        rests = one.rests and not rest > _WORSE * fitted
        made[name] = BetterStart(REST if rests or (np.isfinite(rest) and fitted == np.inf) else FITTED, rest, fitted)
    return made


def _error(motion: Motion, trial: Trial) -> float:
    """Root mean square errors of a trial's streams with the robot's own values, added up [m].

    NaN for a trial that can't be played back, infinite for a playback that diverges.
    """
    values = motion.robot.space.published
    ready = motion.prepared(trial, values)
    if ready is None:
        return np.nan
    parts = motion.parts([ready], [values])[0][0].values()
    return np.inf if any(part.diverged for part in parts) else sum(part.error for part in parts)


def started(robot: Robot, reference: TrialSet) -> Robot:
    """The robot, with the start that suits all recordings where its file names none."""
    about = robot.trials
    if about.start_named or about.swims is not None:
        return robot
    fitted = any(one.start == FITTED for one in better_starts(robot, reference).values())
    return replace(robot, trials=replace(about, start=FITTED if fitted else REST))


def other_start(robot: Robot, reference: TrialSet) -> str | None:
    """A proposal of a start where the recordings speak against the one that the robot file names, in a sentence."""
    about = robot.trials
    if about.swims is not None or not about.start_named:
        return None
    found = poses_of_rest(robot, reference)
    better = _better(robot, reference, found.get(REST, {}))
    if not better:
        return None
    rest, fitted = (1e3 * float(np.mean([getattr(one, start) for one in better.values()])) for start in (REST, FITTED))
    misses = f" (with the model's own values they are {rest:.2g} mm off from rest, {fitted:.2g} mm from a fitted start)"
    if about.start not in (FITTED, MARKERS):
        named = found.get(about.start, {})
        off = [name for name, one in named.items() if not one.rests and not one.moves]  # `in_motion` reports the others
        if not off:
            return None
        where = f'{1e3 * named[off[0]].off:.1f} mm from the pose of start = "{about.start}"'
        return f"trial '{off[0]}' begins {where}: say start = \"fitted\" in the robot file" + misses * (fitted < rest)
    for pose, begun in found.items():
        if len(begun) < len(better) or not all(one.rests for one in begun.values()):
            continue
        if pose == REST and any(one.start == FITTED for one in better.values()):
            continue
        off = 1e3 * max(one.off for one in begun.values())
        where = "the model's own pose" if pose == REST else f"keyframe '{pose}'"
        count = "The recording begins" if len(begun) == 1 else f"All {len(begun)} recordings begin"
        return (
            f'{count} at rest in {where}, within {off:.1f} mm: start = "{pose}" in the robot file says so, and '
            f'leaves less to be found than "{about.start}"' + misses * (pose == REST)
        )
    return None


def _beginning(robot: Robot, about: Trials, real: Trial, simulated: Trial) -> Beginning | None:
    """How a recording begins beside one that was simulated from a pose; None where nothing shows it."""
    if robot.marker_names:
        names, times = robot.marker_names, real.track.times
        places = np.where(real.track.confidence[:, :, None] > 0, real.track.positions, np.nan)
        played, played_at = simulated.track.positions, simulated.track.times
    else:
        names = robot.sensed_places
        if not names or real.sensors is None or simulated.sensors is None:
            return None
        scales = np.array([sensor.meters_per_unit for sensor in about.sensors if sensor.name in names])
        read = about.unwrapped(real)[0].sensors or real.sensors
        times = read.times
        places = (scales * np.stack([read.column(name) for name in names], axis=1))[:, :, None]
        played = (scales * np.stack([simulated.sensors.column(name) for name in names], axis=1))[:, :, None]
        played_at = simulated.sensors.times
    since = times - times[0]
    counts = sorted({min(count, len(since)) for count in (*_FRAMES, int(np.searchsorted(since, _LONG, side="right")))})
    fits = [_motion(since[:count], places[:count]) for count in counts if count >= min(_FRAMES)]
    slowest = min(fits, key=lambda fit: _way(fit), default=None)
    if slowest is None or not np.isfinite(slowest.noise).any() or not np.isfinite(fits[0].noise).any():
        return None
    size, count = _size(robot, places), min(counts[0], len(played_at))
    if robot.marker_names and about.frame is not None:  # its place in the world is of no importance
        played = _laid_on(played, fits[0].place)
    off = np.linalg.norm(fits[0].place - played[0], axis=1)
    if not np.isfinite(off).any():
        return None
    distance, first, second = float(np.nanmean(off)), fits[0], fits[min(1, len(fits) - 1)]
    fastest = int(np.nanargmax(np.linalg.norm(first.velocity, axis=1)))
    velocity, other = first.velocity[fastest], second.velocity[fastest]
    speed, noise = float(np.linalg.norm(velocity)), max(first.noise[fastest], second.noise[fastest])
    own = (
        _motion(played_at[:count] - played_at[0], played[:count]).velocity[fastest]
        if count >= _LEAST
        else 0.0 * velocity
    )
    own = own * np.clip(velocity @ own / max(float(own @ own), 1e-30), 0.0, _STRONGER)
    moves = (
        speed > _SURE * noise * first.spread
        and _UNIT_TIME * speed > _MOVING * size
        and float(np.linalg.norm(velocity - other)) < _ALIKE * float(np.linalg.norm(other))
        and float(np.linalg.norm(velocity - own)) > _ALIKE * speed  # else a command that jumps moves it at once
    )
    rests = not moves and distance < _STILL * size
    return Beginning(distance, speed, names[fastest], rests, bool(moves))


def _size(robot: Robot, places: Array) -> float:
    """How far the marker comes that moves most [m], and no more than the robot is large."""
    seen = np.isfinite(places).all(axis=-1).any(axis=0)
    low, high = np.nanpercentile(places[:, seen], [5, 95], axis=0)
    farthest = float(np.linalg.norm(high - low, axis=1).max())
    return min(farthest, robot.size if robot.marker_names else farthest)


@dataclass(frozen=True)
class _Motion:
    """A parabola through the first frames of each marker, NaN where one is seen in fewer than four.

    Attributes:
        place: Where it begins [m]. Shape (M, D).
        velocity: How fast [m/s]. Shape (M, D).
        noise: Standard deviation of what is left, per axis [m]. Shape (M,).
        spread: Standard error of the velocity that a noise of 1 m makes [m/s].
    """

    place: Array
    velocity: Array
    noise: Array
    spread: float


def _motion(since: Array, places: Array) -> _Motion:
    """Parabolas through places, shape (K, M, D), at times, shape (K,)."""
    markers, axes = places.shape[1:]
    place, velocity = np.full((2, markers, axes), np.nan)
    noise = np.full(markers, np.nan)
    spread = float(np.linalg.norm(np.linalg.pinv(np.vander(since, 3, increasing=True))[1]))
    for m in range(markers):
        seen = np.isfinite(places[:, m]).all(axis=-1)
        if seen.sum() < _LEAST:
            continue
        design = np.vander(since[seen], 3, increasing=True)
        coefficients = np.linalg.pinv(design) @ places[seen, m]
        left = places[seen, m] - design @ coefficients
        place[m], velocity[m] = coefficients[0], coefficients[1]
        noise[m] = np.sqrt(np.square(left).sum() / ((seen.sum() - 3) * axes))
    return _Motion(place, velocity, noise, spread)


def _way(motion: _Motion) -> float:
    """How far a marker may come in the unit of time [m], the one that may come farthest."""
    ways = _UNIT_TIME * (np.linalg.norm(motion.velocity, axis=1) + motion.spread * motion.noise)
    return float(np.max(ways[np.isfinite(ways)], initial=-1.0)) if np.isfinite(ways).any() else np.inf


def _laid_on(played: Array, seen: Array) -> Array:
    """A motion, turned and shifted so that its first frame lies on what was seen. Shapes (T, M, 2), (M, 2)."""
    known, pose = np.isfinite(seen).all(axis=-1), played[0]
    if known.sum() < 2:
        return np.full_like(played, np.nan)
    middle, wanted = pose[known].mean(axis=0), seen[known].mean(axis=0)
    moved, target = pose[known] - middle, seen[known] - wanted
    angle = np.arctan2((moved[:, 0] * target[:, 1] - moved[:, 1] * target[:, 0]).sum(), (moved * target).sum())
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return (played - middle) @ turn + wanted
