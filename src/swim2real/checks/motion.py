"""Share of the motion of real trials that a robot leaves unexplained: one number, for markers and sensors alike.

A share of 0 is a playback that meets every marker and reading, 1 one as far off as a robot that stays where the trial
begins. Parameters that are merely off are no fault of the trials, so shares are also taken after a short search.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.optimize import least_squares

from markertrack.track import MarkerTrack
from swim2real.objective import compare_playback, playback_target
from swim2real.objective.target import Target
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.forward_model import model_of
from swim2real.simulation.playback import PlaybackSimulator, Rollout
from swim2real.trials import Trial, TrialSet
from swimbase.arrays import Array
from swimbase.errors import TrialError

MARKERS = "markers"
_DIVERGED = 3.0  # share of what diverges, and the most that counts
_STEP = 0.02  # of a parameter's range, for slopes
_ENOUGH = 0.03  # relative gain below which a search ends
_TINY = 1e-9  # m
_LONGEST, _RATE = 10.0, 60.0  # s of commands that are followed, and how often [Hz]


@dataclass(frozen=True)
class Part:
    """Part of one stream of a trial that a playback leaves unexplained.

    Attributes:
        residual: Simulated minus real, as a share of the stream's motion; the squares add up to that of the share.
        error: Root mean square error, in the meters that it counts as [m].
        unlike: Share that no offset and positive gain of each column explains either: what parameters that are far
            off change least.
        diverged: Whether there is no playback.
    """

    residual: Array
    error: float
    unlike: float
    diverged: bool

    @cached_property
    def share(self) -> float:
        """Root mean square error as a share of that of a robot that stays where the trial begins."""
        return min(float(np.linalg.norm(self.residual)), _DIVERGED)


Parts = Mapping[str, Part]
"""By stream: `markers`, and the names of sensors."""


def share(trials: Sequence[Parts], streams: Sequence[str] | None = None) -> float:
    """Root mean square share of some streams of trials, or of all."""
    return _root_mean([part.share for part in _of(trials, streams)])


def unlike(trials: Sequence[Parts], streams: Sequence[str] | None = None) -> float:
    """The same of the shares that gains and offsets leave."""
    return _root_mean([part.unlike for part in _of(trials, streams)])


def error(parts: Parts) -> float:
    """Root mean square errors of a trial's streams, added up [m]."""
    return sum(part.error for part in parts.values())


def _of(trials: Sequence[Parts], streams: Sequence[str] | None) -> list[Part]:
    return [part for one in trials for name, part in one.items() if streams is None or name in streams]


def _root_mean(shares: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(shares)))) if shares else 0.0


@dataclass(frozen=True)
class Prepared:
    """A trial, ready to be played back many times from the same start.

    Attributes:
        trial: The trial, as long as it is played back.
        target: What its playback is compared with.
        sizes: How far each stream moves [m].
        rollout: The request for its playback, from a start that is known.
    """

    trial: Trial
    target: Target
    sizes: Mapping[str, float]
    rollout: Rollout


class Motion:
    """Plays trials back and compares them; all checks have their players from here.

    Attributes:
        robot: The robot, whose trials are recordings.
        player: Plays them back.
    """

    def __init__(self, robot: Robot, threads: int | None = None) -> None:
        """Makes it for a robot; threads are simulations at a time, by default as many as there are cores."""
        self.robot, self.player = robot, PlaybackSimulator(robot, threads)

    def request(self, trial: Trial, seconds: float | None) -> Rollout:
        """The request for the first seconds of a trial, or for all; the whole trial shows its start.

        Raises:
            TrialError: The trial can't be played back.
        """
        return replace(self.player.request(trial), trial=trial.cut(seconds))

    def prepared(self, trial: Trial, begin: Values, like: Prepared | None = None) -> Prepared | None:
        """A trial with its start, found with a candidate's values; None where it can't be played back.

        Args:
            trial: The trial.
            begin: The candidate's values.
            like: The same trial with other commands, whose start is taken over if it shows the same motion.
        """
        about, every = self.robot.trials, np.ones(trial.track.confidence.shape)
        if like is not None and _same_motion(trial, like.trial):
            driven = replace(like.rollout.trial, controls=trial.controls)
            return replace(like, trial=trial, rollout=replace(like.rollout, trial=driven))
        try:
            rollout = self.player.request(trial)
            target = playback_target(rollout.trial, every, about.frame, about.score_progress, about.scales)
        except TrialError:  # `misfits` reports it
            return None
        return self._begun([Prepared(trial, target, _sizes(target), rollout)], begin)[0]

    def parts(self, trials: Sequence[Prepared], candidates: Sequence[Values]) -> list[list[Parts]]:
        """Parts that are left unexplained, by candidate and trial."""
        if not trials:
            return [[] for _ in candidates]
        made = self.played(trials, candidates)
        return [[_parts(trial, one[trial.trial.name]) for trial in trials] for one in made]

    def played(self, trials: Sequence[Prepared], candidates: Sequence[Values]) -> list[TrialSet]:
        """Playbacks of trials, by candidate."""
        return self.player.simulate_many(candidates, [trial.rollout for trial in trials])

    def driven(self, trials: Sequence[Trial], values: Values) -> TrialSet:
        """Motion of a candidate from rest under the whole of each trial's commands."""
        whole: list[Rollout] = []
        for trial in trials:
            begin = float(trial.track.times[0])
            end = np.inf if trial.controls is None else float(trial.controls.times[-1])
            times = np.arange(begin, begin + np.clip(end - begin, 2 / _RATE, _LONGEST), 1 / _RATE)
            nowhere = np.full((len(times), trial.track.marker_count, 2), np.nan)
            whole.append(Rollout(replace(trial, track=MarkerTrack(times, nowhere), sensors=None)))
        return self.player.simulate(values, whole)

    def searched(self, trials: Sequence[Prepared], begin: Values, steps: int) -> tuple[Values, list[Parts]]:
        """A short search by least squares, and what it leaves unexplained of each trial.

        Args:
            trials: The trials.
            begin: Values at which it begins.
            steps: Steps that it takes at most.
        """
        space = self.robot.space

        @cache
        def at(*point: float) -> tuple[Values, list[Prepared], list[Parts]]:
            """Values of a point, the trials with the starts that suit these, and what is left unexplained."""
            values = space.to_values(np.clip(point, 0.0, 1.0))
            begun = self._begun(trials, values)
            return values, begun, self.parts(begun, [values])[0]

        def residual(point: Array) -> Array:
            return _stacked(at(*point)[2])

        def slopes(point: Array) -> Array:
            changes = np.where(point < 0.5, _STEP, -_STEP)
            ends = [space.to_values(point + change) for change in np.diag(changes)]
            made = np.stack([_stacked(parts) for parts in self.parts(at(*point)[1], ends)], axis=1)
            return (made - residual(point)[:, None]) / changes

        first = np.clip(space.to_cube(begin), 1e-6, 1 - 1e-6)
        found = least_squares(residual, first, slopes, bounds=(0.0, 1.0), ftol=_ENOUGH, max_nfev=steps)
        values, _, parts = at(*found.x)
        return values, parts

    def _begun(self, trials: Sequence[Prepared], values: Values) -> list[Prepared]:
        """The trials with starts that suit other values."""
        shown = [one.rollout.stretch is not None or one.rollout.first is not None for one in trials]
        model = model_of(self.robot, values) if any(shown) else ""
        made: list[Prepared] = []
        for one, fitted in zip(trials, shown, strict=True):
            if fitted and not isinstance(model, str):  # of none, `played` says why
                data, _ = self.player.begin(model, replace(one.rollout, state=None), values)
                state = data.qpos.copy(), data.qvel.copy(), data.act.copy()
                one = replace(one, rollout=replace(one.rollout, state=state))
            made.append(one)
        return made


def _same_motion(one: Trial, other: Trial) -> bool:
    """Compares markers, readings and times of two trials, whatever commands there were."""
    same = np.array_equal(one.track.times, other.track.times) and one.sensors is other.sensors
    return same and np.array_equal(one.track.positions, other.track.positions, equal_nan=True)


def _parts(prepared: Prepared, played: Trial) -> Parts:
    target, diverged = prepared.target, played.divergence is not None
    compared, parts = compare_playback(target, played), dict[str, Part]()
    columns = {sensor.name: (sensor.real[:, None], sensor.simulated[:, None]) for sensor in compared.sensors}
    count = len(compared.times)
    columns[MARKERS] = compared.real.reshape(count, -1), compared.simulated.reshape(count, -1)
    for name, vector in _split(target, compared.residual_vector()).items():
        size = prepared.sizes[name]
        off = np.full(len(vector), _DIVERGED * size / np.sqrt(len(vector))) if diverged else vector
        unlike = 1.0 if diverged else _unlike(*columns[name])
        parts[name] = Part(off / size, float(np.linalg.norm(off)), unlike, diverged)
    return parts


def _unlike(real: Array, simulated: Array) -> float:
    """Share of real columns that no offset and positive gain of each explains. Shapes (T, N)."""
    known = np.isfinite(real) & np.isfinite(simulated)
    counts = np.maximum(known.sum(axis=0), 1)
    seen, made = (np.where(known, one, 0.0) for one in (real, simulated))
    seen, made = (np.where(known, one - one.sum(axis=0) / counts, 0.0) for one in (seen, made))
    gains = np.maximum((seen * made).sum(axis=0) / np.maximum(np.square(made).sum(axis=0), _TINY**2), 0.0)
    left, whole = np.square(seen - gains * made).sum(), np.square(seen).sum()
    return float(np.sqrt(left / max(float(whole), _TINY**2)))


def _stacked(parts: Sequence[Parts]) -> Array:
    return np.concatenate([part.residual for one in parts for part in one.values()])


def _split(target: Target, vector: Array) -> dict[str, Array]:
    """The residual vector of a trial, by stream."""
    lengths = {MARKERS: 2 * target.weights.size} if target.weights.size else {}
    lengths |= {sensor.name: len(sensor.times) for sensor in target.sensors}
    return dict(zip(lengths, np.split(vector, np.cumsum(list(lengths.values()))[:-1]), strict=True))


def _sizes(target: Target) -> dict[str, float]:
    """Sizes of the motion of each stream from where it begins [m]: root mean squares of what a robot at rest misses."""
    trial, track = target.trial, target.trial.track
    seen = np.isfinite(track.positions).all(axis=2).argmax(axis=0)  # the first frame of each marker
    first = np.repeat(track.positions[seen, np.arange(track.marker_count)][None], track.frame_count, axis=0)
    sensors = trial.sensors
    if sensors is not None:
        sensors = sensors.between(track.times[0], track.times[-1])
        known = np.isfinite(sensors.values)
        mean = np.nan_to_num(sensors.values).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        sensors = replace(sensors, values=np.repeat(mean[None], len(sensors.times), axis=0))
    still = compare_playback(target, Trial(trial.name, MarkerTrack(track.times, first), sensors=sensors))
    return {
        name: max(float(np.linalg.norm(one)), _TINY) for name, one in _split(target, still.residual_vector()).items()
    }
