"""Swims of a robot with known parameters, as tracks that a camera and a person would have made.

A synthetic reference differs from the simulator that is calibrated in all that real tracks differ in: a finer time
step, another motor angle at the start, another place and heading in the pool, camera noise, markers placed by hand,
lost tracks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from markertrack.track import MarkerTrack
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, Trial, TrialSet
from swimbase.arrays import Array


@dataclass(frozen=True)
class SyntheticCamera:
    """Camera and its errors, between a swim and its track.

    Attributes:
        fps: Frames a second.
        noise: Standard deviation of a marker position [m].
        placement: Standard deviation of each marker's static offset on the body [m].
        timestep: Timestep of the physics [s]; None for the robot's own.
        lost: Trial name to (marker, neighbor that it collapses onto, time from which on [s]).
    """

    fps: float = 60.0
    noise: float = 0.0
    placement: float = 0.0
    timestep: float | None = None
    lost: Mapping[str, tuple[int, int, float]] | None = None


def synthetic_reference(
    robot: Robot, values: Values, frequencies: Sequence[float], seconds: float, camera: SyntheticCamera, seed: int,
    threads: int | None = None,
) -> TrialSet:  # fmt: skip
    """Steady swims of a robot with known parameters, as tracks.

    Args:
        robot: What swims.
        values: Its parameters.
        frequencies: Frequencies of the motor [Hz].
        seconds: Length of each trial [s].
        camera: Noise and losses.
        seed: Seed of everything random.
        threads: Swims simulated at a time.

    Returns:
        Trials named after their frequencies, such as `f1_50`.
    """
    rng = np.random.default_rng([seed, 1])
    simulated = steady_swims(robot, values, frequencies, seconds, 1 / camera.fps, rng, camera.timestep, threads)
    return TrialSet(tuple(_seen(trial, camera, rng) for trial in simulated), robot.marker_names)


def steady_swims(
    robot: Robot, values: Values, frequencies: Sequence[float], seconds: float, sample_interval: float,
    rng: np.random.Generator, timestep: float | None = None, threads: int | None = None,
) -> TrialSet:  # fmt: skip
    """Steady swims from random motor angles on, named after their frequencies.

    Args:
        robot: What swims.
        values: Its parameters.
        frequencies: Frequencies of the motor [Hz].
        seconds: Length of each swim [s].
        sample_interval: Longest time between samples [s].
        rng: Draws the angles.
        timestep: Timestep of the physics [s]; None for the robot's own.
        threads: Swims simulated at a time.
    """
    body = replace(robot, build=_with_timestep(robot, timestep))
    angles = rng.uniform(0, 2 * np.pi, len(frequencies))
    swims = [
        Swim(swim_name(f), Actuation(f, angle, 0.1), seconds) for f, angle in zip(frequencies, angles, strict=True)
    ]
    return Simulator(body, threads, sample_interval).simulate(values, swims)


def swim_name(frequency: float) -> str:
    """Name of a swim by its frequency [Hz], such as `f1_50`."""
    return f"f{frequency:.2f}".replace(".", "_")


def turned(positions: Array, angle: float) -> Array:
    """World positions turned about the origin [m]. Shape (T, M, 2)."""
    return positions @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def placed_by_hand(positions: Array, placement: float, rng: np.random.Generator) -> Array:
    """Markers beside their places: a static offset each on its part of the body [m]. Shape (T, M, 2)."""
    if not placement:
        return positions
    axes = np.gradient(positions, axis=1)
    axes[:, :2] = (positions[:, 1] - positions[:, 0])[:, None]  # the head is rigid
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    sideways = np.stack([-axes[..., 1], axes[..., 0]], axis=-1)
    offsets = rng.normal(0, placement, (positions.shape[1], 2))
    offsets[:2, 0] = 0.0  # lengthwise the head markers set the scale; sideways they turn the body frame
    return positions + offsets[:, :1] * axes + offsets[:, 1:] * sideways


def _with_timestep(robot: Robot, timestep: float | None):
    def build(values: Values) -> mujoco.MjSpec:
        spec = robot.build(values)
        if timestep is not None:
            spec.option.timestep = timestep
        return spec

    return build


def _seen(trial: Trial, camera: SyntheticCamera, rng: np.random.Generator) -> Trial:
    times = np.arange(int(np.floor(trial.track.duration * camera.fps + 1e-6)) + 1) / camera.fps
    samples = np.round(times / np.diff(trial.track.times)[0]).astype(int)
    positions = trial.track.positions[np.minimum(samples, trial.track.frame_count - 1)]
    positions = turned(positions, rng.uniform(-np.pi, np.pi)) + rng.uniform(-0.5, 0.5, 2)  # where in the pool
    positions = placed_by_hand(positions, camera.placement, rng)
    positions = positions + rng.normal(0, camera.noise, positions.shape) if camera.noise else positions
    lost = (camera.lost or {}).get(trial.name)
    if lost is not None:
        marker, neighbor, start = lost
        late = times >= start
        positions[late, marker] = positions[late, neighbor] + rng.normal(0, 1e-3, (int(late.sum()), 2))
    return replace(
        trial, track=MarkerTrack(times, positions), provenance=f"synthetic, {camera.fps:g} fps, hidden parameters"
    )
