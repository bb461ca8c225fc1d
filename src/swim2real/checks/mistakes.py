"""Mistakes of a reference that can't be the robot's: another unit, order, origin, axes, clock, sign or sensor.

A mistake is known by what undoes it. Trials are doubted where the robot can't have moved like that: no pose has its
markers, or a short search of the parameters leaves much of the motion unexplained. They are named after the simplest
change of which that isn't true; what no change explains is reported as it is.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from markertrack.quality import check_plausible
from markertrack.track import MarkerTrack
from swim2real.checks.changes import (
    Change,
    moved,
    of_clocks,
    of_commands,
    of_distances,
    of_pixels,
    of_places,
    of_readings,
)
from swim2real.checks.motion import Motion, Parts, Prepared, error, share, unlike
from swim2real.formatting import listed
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.pose import PoseFit
from swim2real.trials import Trial, TrialSet
from swimbase.arrays import Array
from swimbase.errors import TrialError

Item = TypeVar("Item")

_FRAMES = 5  # of a trial in which poses are looked for
_NO_POSE, _NEITHER = 0.04, 0.1  # of the robot's size: root mean square beside any pose that is doubted, and reported
_UNDONE = 0.55  # of the misfit, below which a change has undone the mistake
_FOLLOWED = 0.25  # share of the motion that a short search may leave of trials that are right
_EXPLAINED = 0.15  # share up to which a change explains the motion, whatever another one leaves
_BETTER = 0.6  # of a trial's share, below which a change has undone its mistake
_SHOWS = 0.9  # of a trial's share, below which a change explains more of it
_ALIKE = 1.3  # times the least share, up to which a simpler change explains as much
_TRIALS, _SECONDS = 4, 2.0  # that are searched, s of each
_SEARCH, _FINALISTS = 4, 3  # steps of a search, changes that get one of their own
_MOST = 3  # mistakes of one reference that are named


@dataclass(frozen=True)
class _Verdict:
    """Fit of trials with a robot.

    Attributes:
        doubts: What is probably wrong with them, a sentence each.
        shares: Share of the motion that stays unexplained after a short search, by recording.
        errors: Root mean square error that markers and sensors add up to, with the robot's own values and after the
            search, by recording [m].
    """

    doubts: tuple[str, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict[str, float])
    errors: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])

    def summary(self, names: Sequence[str]) -> str:
        """Says in a sentence whether the trials fit: of recordings their whole motion.

        Args:
            names: Names of all trials.
        """
        if not self.shares:
            return f"All trials have poses of the robot: {', '.join(names)}."
        worst = max(self.shares, key=lambda name: self.shares[name])
        own, searched = (1e3 * one for one in self.errors[worst])
        errors = f"{own:.3g} mm with the robot's own values, {searched:.3g} mm after a short search"
        if self.shares[worst] <= _FOLLOWED:
            rest = f", which leaves {100 * self.shares[worst]:.2g} % of it unexplained"
            return f"All trials fit: {', '.join(names)}. The motion is off by {errors}{rest} (the worst, '{worst}')."
        return (
            f"All trials start where the model starts; the motion is off by {errors} ('{worst}'), which leaves "
            f"{100 * self.shares[worst]:.0f} % of it unexplained. No single mistake explains that: the parameters are "
            f"far off, or the model lacks something."
        )


def judged(robot: Robot, reference: TrialSet) -> _Verdict:
    """Looks for what is probably wrong with trials.

    Args:
        robot: The robot, with its own values.
        reference: Real trials whose markers have its names.

    Raises:
        EngineError: The robot itself can't be simulated.
    """
    found = _of_poses(robot, reference)
    if found or robot.trials.steady:
        return _Verdict(tuple(found))
    return _Judge(robot, reference).verdict()


@dataclass(frozen=True)
class _Fit:
    """Trials, and what a short search leaves unexplained of each.

    Attributes:
        trials: The trials, whole.
        prepared: The same, as they are played back.
        values: Values that the search found.
        parts: Parts that it leaves unexplained, by trial.
    """

    trials: Sequence[Trial]
    prepared: Sequence[Prepared]
    values: Values
    parts: Sequence[Parts]


@dataclass(frozen=True, eq=False)
class _Tried:
    """A change as it was tried with the robot's own values.

    Attributes:
        ratios: Share that it leaves unexplained beside what was, and the same beside gains and offsets.
        order: Its place in the order of simplicity.
        change: The change.
        of: Numbers of the trials that it is made of.
        trials: All trials, those changed.
        prepared: The same, as they are played back.
    """

    ratios: tuple[float, ...]
    order: int
    change: Change
    of: tuple[int, ...]
    trials: list[Trial]
    prepared: list[Prepared]


class _Judge:
    """Looks for what undoes the mistakes of recordings."""

    def __init__(self, robot: Robot, reference: TrialSet) -> None:
        self.robot, self.motion = robot, Motion(robot)
        self.begin: Values = robot.space.published
        ready = [(trial, one) for trial in reference if (one := self._prepared(trial)) is not None]
        parts = self.motion.parts([one for _, one in ready], [self.begin])[0]
        worst = sorted(sorted(range(len(parts)), key=lambda k: -share([parts[k]]))[:_TRIALS])
        self.trials, self.prepared = [ready[k][0] for k in worst], [ready[k][1] for k in worst]
        self.own = [parts[k] for k in worst]

    def verdict(self) -> _Verdict:
        """Mistakes that the trials probably have, and how much stays unexplained."""
        if not self.trials:
            return _Verdict()
        doubts, fit = list[str](), self._fit(self.trials, self.prepared)
        while len(doubts) < _MOST and any(share([one]) > _FOLLOWED for one in fit.parts):
            better = self._undone(fit)
            if better is None:
                break
            doubts.append(better[0])
            fit = better[1]
        named = list(zip((trial.name for trial in fit.trials), self.own, fit.parts, strict=True))
        return _Verdict(
            tuple(doubts), {name: share([one]) for name, _, one in named},
            {name: (error(own), error(one)) for name, own, one in named},
        )  # fmt: skip

    def _fit(self, trials: Sequence[Trial], prepared: Sequence[Prepared]) -> _Fit:
        return _Fit(trials, prepared, *self.motion.searched(prepared, self.begin, _SEARCH))

    def _undone(self, was: _Fit) -> tuple[str, _Fit] | None:
        """The simplest change that explains about as much as the best one, if that undoes a mistake."""
        (before,) = self.motion.parts(was.prepared, [self.begin])
        changes = enumerate(self._changes(was))
        tried = [one for order, change in changes for one in self._tried(order, change, was, before)]
        best = [one for k in (0, 1) for one in sorted(tried, key=lambda one: (one.ratios[k], one.order))[:_FINALISTS]]
        finals: list[tuple[float, _Tried, _Fit]] = []
        for one in sorted(dict.fromkeys(best), key=lambda one: (min(one.ratios), one.order)):
            if finals and finals[0][0] < _FOLLOWED and min(one.ratios) > _ALIKE * min(finals[0][1].ratios):
                break
            now, streams = self._fit(one.trials, one.prepared), one.change.streams
            gains = [share([now.parts[k]], streams) < _BETTER * share([was.parts[k]], streams) for k in one.of]
            if share(now.parts) < _BETTER * share(was.parts) and any(gains):
                finals = sorted([*finals, (share(now.parts), one, now)], key=lambda final: final[0])
        if not finals:
            return None
        limit = max(_ALIKE * finals[0][0], _EXPLAINED)
        left, one, now = min((final for final in finals if final[0] <= limit), key=lambda final: final[1].order)
        who = f"trial{'s' * (len(one.of) > 1)} {listed([repr(was.trials[k].name) for k in one.of])}"
        return (
            f"{who}: {one.change.said} (a short search then leaves {100 * left:.0f} % of the motion unexplained, and "
            f"{100 * share(was.parts):.0f} % as it is)"
        ), now

    def _tried(self, order: int, change: Change, was: _Fit, before: list[Parts]) -> Iterator[_Tried]:
        """A change of all trials that it changes, and of those alone of which it explains more."""
        changed = change.undo(was.trials)
        ready = [self._prepared(one, like) for one, like in zip(changed, was.prepared, strict=True)]
        prepared = [one for one in ready if one is not None]
        if len(prepared) < len(ready):
            return
        (after,), measures, streams = self.motion.parts(prepared, [self.begin]), (share, unlike), change.streams
        every = tuple(k for k, trial in enumerate(was.trials) if changed[k] is not trial)
        shown = tuple(
            k for k in every if any(f([after[k]], streams) < _SHOWS * f([before[k]], streams) for f in measures)
        )
        for of in dict.fromkeys((every, shown or every)):
            ratios = tuple(f(_mixed(before, after, of), streams) / f(before, streams) for f in measures)
            trials, playable = _mixed(was.trials, changed, of), _mixed(was.prepared, prepared, of)
            yield _Tried(ratios, order, change, of, trials, playable)

    def _changes(self, fit: _Fit) -> Iterator[Change]:
        """All changes, in the order of their simplicity."""
        robot, trials, cut = self.robot, fit.trials, [one.trial for one in fit.prepared]
        played = self.motion.played(fit.prepared, [self.begin])[0].trials
        if robot.marker_names:
            yield from of_pixels(robot, trials, played)
            beside = [real.track.positions[0] - made.track.positions[0] for real, made in zip(cut, played, strict=True)]
            if len(robot.marker_names) == 1:  # of several, poses decide
                yield from of_distances(robot)
            yield from of_places(robot, np.nan_to_num(np.nanmean(np.concatenate(beside), axis=0)))
        yield from of_commands(robot, trials)
        yield from of_readings(robot, cut, played)
        if robot.trials.controls:
            for point in (fit.values, self.begin):
                yield from of_clocks(robot, trials, self.motion.driven(trials, point).trials)

    def _prepared(self, trial: Trial, like: Prepared | None = None) -> Prepared | None:
        return self.motion.prepared(trial.cut(_SECONDS), self.begin, like)


def _mixed(old: Sequence[Item], new: Sequence[Item], of: Container[int]) -> list[Item]:
    """A list with some items of another one."""
    return [new[k] if k in of else item for k, item in enumerate(old)]


class _Poses:
    """Poses of the robot whose markers are where a trial has them."""

    def __init__(self, robot: Robot) -> None:
        self.fit, self._unknowns = PoseFit(robot.model, len(robot.marker_names), robot.plane), robot.model.nv
        self._typical = np.min if robot.trials.steady else np.median

    def of(self, trial: Trial) -> list[tuple[Array, float]]:
        """Pose and error of each frame with two markers or more, each begun from the one before. Shapes (nq,), m."""
        made: list[tuple[Array, float]] = []
        for places in trial.track.positions:
            known = np.isfinite(places).all(axis=1)
            if known.sum() > 1:
                pose = self.fit.pose(places, known, made[-1][0]) if made else self.fit.first(places, known)
                made.append((pose.qpos, pose.error))
        return made

    def misfit(self, trial: Trial, scale: float = 1.0) -> float:
        """Root mean square distance of markers from those of a pose [m], as large as they are seen; 0 where none is.

        The median of the frames, or of swims, whose tracks are lost more easily, the least.
        """
        errors = [error for _, error in self.of(trial)]
        return float(self._typical(errors)) / scale if errors else 0.0

    def beside(self, trial: Trial) -> Array:
        """Distance from the robot as a whole, right and up [m]. Shape (2,)."""
        places = max(trial.track.positions, key=lambda frame: int(np.isfinite(frame).all(axis=1).sum()))
        shift = np.zeros(2)
        for _ in range(40):
            (qpos, _), *_ = self.of(moved(trial, np.repeat(places[None] - shift, 2, axis=0)))
            missed = places - shift - self.fit.motion(qpos, np.zeros(self._unknowns))[0]
            shift = shift + np.nanmean(missed, axis=0)
        return shift


def _some(trial: Trial, count: int) -> Trial:
    """Frames all over a trial, without markers that aren't believed."""
    track = trial.track
    frames = np.unique(np.linspace(0, track.frame_count - 1, count).astype(int))
    seen = np.where(track.confidence[frames, :, None] > 0, track.positions[frames], np.nan)
    return replace(trial, track=MarkerTrack(track.times[frames], seen))


def _of_poses(robot: Robot, reference: TrialSet) -> list[str]:
    """A sentence for trials whose markers no pose of the robot has: their unit, order, axes or origin."""
    if not robot.marker_names:
        return []
    poses, size, found = _Poses(robot), robot.size, dict[str, tuple[str, list[str]]]()
    for trial in reference:
        some, said = _some(trial, _FRAMES), ""
        misfit = poses.misfit(some)
        if misfit <= _NO_POSE * size:
            continue
        try:
            check_plausible(trial.track, robot.rest_markers, robot.marker_names, trial.name)
            said = _unposed(robot, poses, some, misfit)
        except TrialError as refused:
            said = str(refused).removeprefix(f"trial '{trial.name}': ")
        if said:  # of one kind, whatever its numbers
            found.setdefault(re.sub(r"[-+]?\d\S*", "", said), (said, []))[1].append(f"'{trial.name}'")
    return [f"trial{'s' * (len(names) > 1)} {listed(names)}: {said}" for said, names in found.values()]


def _unposed(robot: Robot, poses: _Poses, some: Trial, misfit: float) -> str:
    """The first change that fits about as well as the best, if that undoes the misfit; else what a large one says."""
    beside = poses.beside(some) if robot.trials.frame is None else np.zeros(2)
    changes = [*of_places(robot, beside), *of_distances(robot)]
    tried = [(poses.misfit(one.undo([some])[0], one.scale), one.said) for one in changes]
    least = min(tried)[0]
    if least < _UNDONE * misfit:
        return next(said for off, said in tried if off < max(1.5 * least, _NO_POSE * robot.size / 8))
    if misfit < _NEITHER * robot.size:
        return ""
    return (
        f"its markers are {1e3 * misfit:.0f} mm beside any pose of robot '{robot.name}', and none of the usual "
        f"mistakes explains that; is it a film of this robot, and do its sites lie where the markers are?"
    )
