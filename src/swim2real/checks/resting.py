"""Whether recordings begin at rest, in a pose that the model has, or in motion.

A parabola through the first frames tells where each marker begins and how fast; what is commanded at once shows in its
acceleration. Stretches of several lengths are taken: a short one of what moves at once, a long one of what stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import Swim2RealError
from swim2real.robots.robot import Robot, Trials
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
            begun = [trial.cut(float(trial.track.times[1] - trial.track.times[0])) for trial in trials]
            made = simulator.simulate(robot.space.published, [simulator.request(trial) for trial in begun])
        except Swim2RealError:  # of which `misfits` tells
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
    if about.swims is not None or about.start in (FITTED, MARKERS):
        return []
    return [
        f"trial '{name}' moves as it begins ({one.marker} by {1e3 * one.speed:.0f} mm/s), and start is "
        f'"{about.start}" in the robot file, which is at rest; say start = "fitted", or begin where it still rests'
        for name, one in poses_of_rest(robot, reference).get(about.start, {}).items() if one.moves
    ]  # fmt: skip


def at_rest(robot: Robot, reference: TrialSet) -> str | None:
    """A proposal of a start where all recordings begin at rest in one pose, and the robot file says something else."""
    about = robot.trials
    if about.swims is not None or about.start not in (FITTED, MARKERS):
        return None
    for pose, beginnings in poses_of_rest(robot, reference).items():
        if beginnings and all(one.rests for one in beginnings.values()):
            off = 1e3 * max(one.off for one in beginnings.values())
            where = "the model's own pose" if pose == REST else f"keyframe '{pose}'"
            count = "The recording begins" if len(beginnings) == 1 else f"All {len(beginnings)} recordings begin"
            return (
                f'{count} at rest in {where}, within {off:.1f} mm: start = "{pose}" in the robot file says so, and '
                f'leaves less to be found than "{about.start}"'
            )
    return None


def _beginning(robot: Robot, about: Trials, real: Trial, simulated: Trial) -> Beginning | None:
    """How a recording begins beside one that was simulated from a pose; None where nothing tells it."""
    if robot.marker_names:
        names, times = robot.marker_names, real.track.times
        places = np.where(real.track.confidence[:, :, None] > 0, real.track.positions, np.nan)
        pose = simulated.track.positions[0]
    else:
        names = robot.sensed_places
        if not names or real.sensors is None or simulated.sensors is None:
            return None
        scales = np.array([sensor.meters_per_unit for sensor in about.sensors if sensor.name in names])
        times = real.sensors.times
        places = (scales * np.stack([real.sensors.column(name) for name in names], axis=1))[:, :, None]
        pose = (scales * [simulated.sensors.column(name)[0] for name in names])[:, None]
    since = times - times[0]
    counts = sorted({min(count, len(since)) for count in (*_FRAMES, int(np.searchsorted(since, _LONG, side="right")))})
    fits = [_motion(since[:count], places[:count]) for count in counts if count >= min(_FRAMES)]
    slowest = min(fits, key=lambda fit: _way(fit), default=None)
    if slowest is None or not np.isfinite(slowest.noise).any() or not np.isfinite(fits[0].noise).any():
        return None
    size = _size(robot, places)
    if robot.marker_names and about.frame is not None:  # its place in the world is of no importance
        pose = _laid_on(pose, slowest.place)
    off = np.linalg.norm(slowest.place - pose, axis=1)
    if not np.isfinite(off).any():
        return None
    distance, first, second = float(np.nanmean(off)), fits[0], fits[min(1, len(fits) - 1)]
    fastest = int(np.nanargmax(np.linalg.norm(first.velocity, axis=1)))
    velocity, other = first.velocity[fastest], second.velocity[fastest]
    speed, noise = float(np.linalg.norm(velocity)), max(first.noise[fastest], second.noise[fastest])
    moves = (
        speed > _SURE * noise * first.spread
        and _UNIT_TIME * speed > _MOVING * size
        and float(np.linalg.norm(velocity - other)) < _ALIKE * float(np.linalg.norm(other))
    )
    rests = not moves and max(distance, _way(slowest)) < _STILL * size
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


def _laid_on(pose: Array, seen: Array) -> Array:
    """A pose, turned and shifted as a whole so that it lies on what was seen. Shapes (M, 2)."""
    known = np.isfinite(seen).all(axis=-1)
    if known.sum() < 2:
        return np.full_like(pose, np.nan)
    middle, wanted = pose[known].mean(axis=0), seen[known].mean(axis=0)
    moved, target = pose[known] - middle, seen[known] - wanted
    angle = np.arctan2((moved[:, 0] * target[:, 1] - moved[:, 1] * target[:, 0]).sum(), (moved * target).sum())
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return (pose - middle) @ turn + wanted
