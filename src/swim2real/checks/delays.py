"""Delays of commands and readings: one per stream, estimated with all parameters, where it matters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from swim2real.checks.motion import Motion, Parts, Prepared, error, share
from swim2real.parameters import Parameter, ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.robots.targets import Delay
from swim2real.trials import TrialSet
from swimbase.arrays import Array

_MOST = 0.1  # s
_MATTERS = 0.9  # of the error, below which a delay matters
_EXPLAINED = 0.25  # share of the motion above which a delay says nothing
_STEPS = 4  # of a search
_TRIED = (-0.05, -0.015, -0.005, 0.005, 0.015, 0.05)  # s, one of which lowers the error where a delay matters
_MAY_MATTER = 0.97  # of the error, below which a delay is searched for
_DIFFERENCE = 0.02  # of a parameter's range
_TRIALS, _SECONDS = 4, 2.0  # that are compared, s of each
_LINES = {"commands": 'control "*" delay', "readings": 'sensor "*" delay'}


def delays(robot: Robot, reference: TrialSet, values: Values) -> list[str]:
    """A sentence for each stream of recordings that seems late or early, with what to write into the robot file.

    Args:
        robot: The robot.
        reference: Recordings.
        values: Values of its parameters, about which a short search goes with the delay and without.
    """
    found: list[str] = []
    if robot.trials.steady:
        return found
    streams, base = list(_streams(robot, reference)), Motion(robot)
    trials = [trial.cut(_SECONDS) for trial in reference.trials[:_TRIALS]]
    as_it_is = [one for trial in trials if streams and (one := base.prepared(trial, values)) is not None]
    if not as_it_is:
        return found
    streams = [one for one in streams if _may_matter(Motion(_with_delay(robot, one)), as_it_is, values, one)]
    begin = base.searched(as_it_is, values, _STEPS)[0] if streams else values
    for stream in streams:
        late, after = Motion(_with_delay(robot, stream)).searched(as_it_is, {**begin, stream: 0.0}, _STEPS)
        own = {name: late[name] for name in robot.space.names}
        _, before = base.searched(as_it_is, own, _STEPS)  # as far as with the delay
        if share(after) > _EXPLAINED or not _error(after) < _MATTERS * _error(before):
            continue
        seconds = late[stream]
        found.append(
            f"the {stream} seem {1e3 * abs(seconds):.0f} ms {'late' if seconds < 0 else 'early'}; without "
            f"that the error falls from {1e3 * _error(before):.3g} to {1e3 * _error(after):.3g} mm: calibrate a "
            f"parameter with targets = '{_LINES[stream]}', about {seconds:.3f} s{_held(as_it_is, stream, seconds)}"
        )
    return found


def _may_matter(motion: Motion, trials: Sequence[Prepared], values: Values, stream: str) -> bool:
    """Whether some delay leaves clearly less unexplained, once the other parameters follow by their slopes."""
    space = motion.robot.space
    point = np.clip(space.to_cube({**values, stream: 0.0}), 0.0, 1.0)
    changes = np.diag(np.where(point < 0.5, _DIFFERENCE, -_DIFFERENCE))[:-1]
    ends = [space.to_values(point), *(space.to_values(point + change) for change in changes)]
    ends += [{**ends[0], stream: seconds} for seconds in _TRIED]
    made = motion.parts(trials, ends)
    vectors = [np.concatenate([part.residual for parts in each for part in parts.values()]) for each in made]
    own, moved, late = vectors[0], vectors[1 : len(point)], vectors[len(point) :]
    slopes = np.stack([one - own for one in moved], axis=1)

    def left(vector: Array) -> float:
        return float(np.linalg.norm(vector - slopes @ np.linalg.lstsq(slopes, vector, rcond=1e-3)[0]))

    return min(map(left, late)) < _MAY_MATTER * left(own)


def _streams(robot: Robot, reference: TrialSet) -> Iterator[str]:
    """Streams that may be late and that no parameter delays."""
    kinds = {delay.kind for each in robot.delays.values() for delay in each}
    if any(drive.table for drive in robot.trials.controls.values()) and not kinds & {"control", "trial"}:
        yield "commands"
    if robot.trials.sensors and robot.marker_names and not kinds & {"sensor", "trial"}:
        yield "readings"


def _with_delay(robot: Robot, stream: str) -> Robot:
    """The robot with a parameter that delays a stream."""
    delay = Delay.parse(_LINES[stream])
    assert delay is not None
    late = Parameter(stream, "s", -_MOST, _MOST, "", 0.0)
    names = robot.space.names
    return replace(
        robot,
        space=ParameterSpace((*robot.space, late), robot.space.scale),
        build=lambda values: robot.build({name: values[name] for name in names}),
        delays={**robot.delays, stream: (delay,)},
    )


def _held(trials: list[Prepared], stream: str, seconds: float) -> str:
    """A hint that a command changes between its rows, where it is late by half the time between them."""
    rows = [one.trial.controls.times for one in trials if one.trial.controls is not None]
    half = float(np.median([np.median(np.diff(times)) for times in rows if len(times) > 1] or [0.0])) / 2
    if stream != "commands" or not 0.3 * half < -seconds < 1.7 * half:
        return ""
    return (
        ', or say "interpolated table" under [recordings.controls], if they are of a command that changes between rows'
    )


def _error(trials: list[Parts]) -> float:
    """Errors of trials, a mean over them [m]."""
    return float(np.mean([error(one) for one in trials]))
