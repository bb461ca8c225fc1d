"""What a reference probably is where it can't be the robot's: another unit, order, origin, axes, clock, sign or sensor.

A mistake is known by what undoes it. A trial is doubted where the robot, with its own values, misses it: no pose has
its markers, its playback is as far off as a robot that stands still, or a sensor reads what no pose has. It is named
after the one change with which that is no longer so; where no change helps, only poses are reported.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import Swim2RealError, TrialError
from swim2real.formatting import listed
from swim2real.objective import compare_playback, playback_target
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON
from swim2real.simulation.playback import PlaybackSimulator, sensor_address
from swim2real.simulation.pose import PoseFit
from swim2real.simulation.start import nearest
from swim2real.tracking import check_plausible
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet

Array = NDArray[np.float64]

_FRAMES, _MANY_FRAMES = 5, 25  # of a trial in which poses are looked for, of a sensor's
_NO_POSE, _NEITHER = 0.04, 0.1  # of the robot's size: root mean square beside any pose that is doubted, and reported
_UNDONE = 0.55  # of the misfit, below which a change has undone the mistake
_MOST_SWAPS = 66  # pairs of markers that are tried
_SCALES = [1.12**k for k in range(-14, 15) if k]
_MOST_TRIALS = 4  # that are played back
_SECONDS = 10.0  # s, that playing back may take
_ASTRAY, _FOLLOWED = 0.7, 0.65  # errors of doubted trials and of others, as shares of a robot's that stands still
_DRASTIC = 1.1, 0.4  # the same of trials whose commands are doubted
_TINY = 1e-9  # m
_MOST_OFF = 100.0  # of that, too
_OTHERWISE = 1.5  # of the least error, below which something else explains a trial as well
_RATES = {
    6 / 5: "50 for 60 frames per second", 5 / 6: "60 for 50 frames per second", 5 / 4: "24 for 30 frames per second",
    4 / 5: "30 for 24 frames per second", 2.0: "half of the frames per second", 0.5: "twice the frames per second",
    4.0: "a quarter of the frames per second", 0.25: "four times the frames per second",
}  # fmt: skip
_ALIKE, _UNLIKE = 0.35, 0.9  # of a sensor's spread: errors of readings that fit, and of those that don't
_TURNS = {"degrees in place of radians": np.pi / 180, "thousandths (mm)": 1e-3, "turns in place of radians": 2 * np.pi}


@dataclass(frozen=True)
class _Mistake:
    """A mistake.

    Attributes:
        said: What is said of it.
        undo: Undoes it.
        scale: By how much that makes a trial larger.
        instead: Another change, that is no mistake; where it explains a trial as well, nothing is said.
        drastic: Whether it may explain trials of a robot with far other values as well, so that it takes more.
    """

    said: str
    undo: Callable[[Trial], Trial]
    scale: float = 1.0
    instead: Callable[[Trial], Trial] | None = None
    drastic: bool = False


def mistakes(robot: Robot, reference: TrialSet) -> list[str]:
    """A sentence for each trial, or thing in all of them, that is probably not what it is taken for.

    Args:
        robot: The robot, with its own values.
        reference: Real trials whose markers have its names.

    Raises:
        EngineError: The robot itself can't be simulated.
    """
    found = _of_poses(robot, reference)
    if found or robot.trials.swims is not None:
        return found
    read = _of_sensors(robot, reference)
    return read or _of_motion(robot, reference)


class _Poses:
    """Poses of the robot whose markers are where a trial has them."""

    def __init__(self, robot: Robot) -> None:
        self.fit, self._unknowns = PoseFit(robot.model, len(robot.marker_names), robot.plane), robot.model.nv
        self._lost = robot.trials.swims is not None

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
        return float((np.min if self._lost else np.median)(errors)) / scale if errors else 0.0

    def beside(self, trial: Trial) -> Array:
        """How far it is from the robot as a whole, up and right [m]. Shape (2,)."""
        places = max(trial.track.positions, key=lambda frame: int(np.isfinite(frame).all(axis=1).sum()))
        shift = np.zeros(2)
        for _ in range(40):
            (qpos, _), *_ = self.of(_moved(trial, np.repeat(places[None] - shift, 2, axis=0)))
            missed = places - shift - self.fit.motion(qpos, np.zeros(self._unknowns))[0]
            shift = shift + np.nanmean(missed, axis=0)
        return shift


def _moved(trial: Trial, positions: Array) -> Trial:
    """The trial, or its first frames, with its markers elsewhere."""
    return replace(trial, track=MarkerTrack(trial.track.times[: len(positions)], positions))


def _some(trial: Trial, count: int) -> Trial:
    """Frames all over a trial, without markers that aren't believed."""
    track = trial.track
    frames = np.unique(np.linspace(0, track.frame_count - 1, count).astype(int))
    seen = np.where(track.confidence[frames, :, None] > 0, track.positions[frames], np.nan)
    return replace(trial, track=MarkerTrack(track.times[frames], seen))


def _of_poses(robot: Robot, reference: TrialSet) -> list[str]:
    """Trials whose markers no pose of the robot has: their unit, order, axes or origin."""
    if not robot.marker_names:
        return []
    poses, size, found = _Poses(robot), robot.size, dict[str, tuple[str, list[str]]]()
    for trial in reference:
        some, said = _some(trial, _FRAMES), ""
        misfit = poses.misfit(some)
        if misfit <= _NO_POSE * size:
            continue
        try:
            check_plausible(trial, robot.rest_markers, robot.marker_names)
            said = _undone(robot, poses, some, misfit)
        except TrialError as error:
            said = str(error).removeprefix(f"trial '{trial.name}': ")
        if said:  # of one kind, whatever its numbers
            found.setdefault(re.sub(r"[-+]?\d\S*", "", said), (said, []))[1].append(f"'{trial.name}'")
    return [f"trial{'s' * (len(names) > 1)} {listed(names)}: {said}" for said, names in found.values()]


def _undone(robot: Robot, poses: _Poses, some: Trial, misfit: float) -> str:
    """The first change that fits about as well as the best, if that undoes the misfit; else what a large one says."""
    tried = [(poses.misfit(one.undo(some), one.scale), one.said) for one in _of_markers(robot, poses, some)]
    least = min(tried)[0]
    if least < _UNDONE * misfit:
        return next(said for off, said in tried if off < max(1.5 * least, _NO_POSE * robot.size / 8))
    if misfit < _NEITHER * robot.size:
        return ""
    return (
        f"its markers are {1e3 * misfit:.0f} mm beside any pose of robot '{robot.name}', and none of the usual "
        f"mistakes explains that; is it a film of this robot, and do its sites lie where the markers are?"
    )


def _of_markers(robot: Robot, poses: _Poses, some: Trial) -> Iterator[_Mistake]:
    """What markers may be."""
    names, count = robot.marker_names, len(robot.marker_names)

    def placed(change: Callable[[Array], Array]) -> Callable[[Trial], Trial]:
        return lambda trial: _moved(trial, change(trial.track.positions))

    if robot.trials.swims is None and robot.trials.frame is None:  # else its place is of no importance
        right, up = ("xyz"[axis] for axis in robot.plane)
        mend = f"the camera sees {right} to its right and {up} up; mend the camera file, or the columns of --markers"
        for said, turn in {
            "its axes look swapped": [[0, 1], [1, 0]], f"its {up} looks upside down": [[1, 0], [0, -1]],
            f"its {right} looks mirrored": [[-1, 0], [0, 1]], "it looks turned by 180 degrees": [[-1, 0], [0, -1]],
            "it looks turned by 90 degrees": [[0, -1], [1, 0]], "it looks turned by -90 degrees": [[0, 1], [-1, 0]],
        }.items():  # fmt: skip
            yield _Mistake(f"{said}: {mend}", placed(lambda places, turn=turn: places @ np.transpose(turn)))
        shift = poses.beside(some)
        yield _Mistake(
            f"it lies beside the robot by {right} {1e3 * shift[0]:+.0f} mm, {up} {1e3 * shift[1]:+.0f} mm; check the "
            f"camera file's origin, which must be the model's",
            placed(lambda places: places - shift),
        )
    yield _turned(robot)
    pairs = list(combinations(range(count), 2))
    for i, j in pairs if len(pairs) <= _MOST_SWAPS else [(i, i + 1) for i in range(count - 1)]:
        order = [j if m == i else i if m == j else m for m in range(count)]
        yield _Mistake(
            f"markers {names[i]} and {names[j]} look swapped; click them again, or swap their columns (--markers)",
            placed(lambda places, order=order: places[:, order]),
        )
    for scale in _SCALES:
        yield _Mistake(
            f"its markers are about {1 / scale:.2g} times as far apart as the robot's; check the camera file's "
            f"lengths, the unit of the columns (--markers NAME=XCOLUMN,YCOLUMN:UNIT), or the model's",
            placed(lambda places, scale=scale: scale * places),
            scale,
        )


def _turned(robot: Robot) -> _Mistake:
    first, *_, last = robot.marker_names
    said = f"its markers fit the robot in the other order, from {last} to {first}; click, or name, {first} first"
    return _Mistake(said, lambda trial: _moved(trial, trial.track.positions[:, ::-1]))


def _of_motion(robot: Robot, reference: TrialSet) -> list[str]:
    """Whether trials move as the robot does under their commands only by another clock, or with other commands."""
    trials = [trial.cut(HORIZON) for trial in reference.trials[:_MOST_TRIALS]]
    player, begun = PlaybackSimulator(robot), time.monotonic()

    def off(undo: Callable[[Trial], Trial]) -> float:
        """Error of playbacks, as a share of that of a robot that stands still."""
        errors = np.array([playback_errors(robot, player, undo(trial)) for trial in trials])
        return float(np.median(np.minimum(errors[:, 0] / np.maximum(errors[:, 1], _TINY), _MOST_OFF)))

    as_it_is = off(lambda trial: trial)
    if not as_it_is > _ASTRAY:
        return []
    every = (*_of_order(robot), *_of_commands(robot), *_of_readings(robot), *_of_clocks(robot, trials))
    changes = [one for one in every if as_it_is > _DRASTIC[0] or not one.drastic]
    most = int(_SECONDS / (time.monotonic() - begun))
    tried = [(off(one.undo), one) for one in changes[:most]]
    least, best = min(tried, key=lambda one: one[0], default=(np.inf, None))
    if best is None or least > min(_DRASTIC[1] if best.drastic else _FOLLOWED, _UNDONE * as_it_is):
        return []
    if best.instead is not None and off(best.instead) < _OTHERWISE * least:
        return []
    shares = f"{as_it_is:.1f} times as far off as a robot that stands still, and so {least:.1f} times"
    return [f"{best.said} (played back as it is, it is {shares})"]


def _of_order(robot: Robot) -> Iterator[_Mistake]:
    """Of robots that look the same in a mirror, or from the other end, as long as they don't move."""
    if len(robot.marker_names) > 1:
        yield _turned(robot)
    if robot.marker_names:
        for axis in (0, 1):
            flip = np.where(np.arange(2) == axis, -1.0, 1.0)
            yield _Mistake(
                f"the trials move as the robot does in a mirror: the camera sees {'xyz'[robot.plane[0]]} to its right "
                f"and {'xyz'[robot.plane[1]]} up; mend the camera file, or the signs of all commands",
                lambda trial, flip=flip: _moved(trial, trial.track.positions * flip),
            )


def _of_commands(robot: Robot) -> Iterator[_Mistake]:
    names = [name for name, drive in robot.trials.controls.items() if drive.table]

    def changed(change: Mapping[str, tuple[str, float]]) -> Callable[[Trial], Trial]:
        def undo(trial: Trial) -> Trial:
            table = trial.controls
            assert table is not None  # else it couldn't be played back
            sources = [change.get(name, (name, 1.0)) for name in table.names]
            columns = [sign * table.column(source) for source, sign in sources]
            return replace(trial, controls=Signals(table.times, table.names, np.stack(columns, axis=1)))

        return undo

    for name in names:
        said = f"commands of actuator '{name}' look of the other sign; turn its column, or the model's gear"
        yield _Mistake(said, changed({name: (name, -1.0)}), drastic=True)
    for one, other in combinations(names, 2):
        said = f"commands of '{one}' and '{other}' look swapped; name their columns the other way round (--controls)"
        yield _Mistake(said, changed({one: (other, 1.0), other: (one, 1.0)}), drastic=True)


def _of_readings(robot: Robot) -> Iterator[_Mistake]:
    """Of robots without markers, whose encoders tell how they begin, too."""
    for name in () if robot.marker_names else robot.sensed_places:

        def undo(trial: Trial, name: str = name) -> Trial:
            read = trial.sensors
            assert read is not None  # there is nothing else
            return replace(
                trial, sensors=replace(read, values=read.values * np.where(np.array(read.names) == name, -1, 1))
            )

        yield _Mistake(
            f"readings of sensor '{name}' look of the other sign, or what drives it; turn one's column", undo
        )


def _of_clocks(robot: Robot, trials: Sequence[Trial]) -> Iterator[_Mistake]:
    if robot.trials.controls and all(trial.track.marker_count for trial in trials):
        for rate, what in _RATES.items():
            yield _Mistake(
                f"the trials look {rate:.3g} times as long as what drove them: that looks like {what}; give the "
                f"film's true rate (--fps), or the unit of the time (--time COLUMN:UNIT)",
                lambda trial, rate=rate: _slower(trial, 1 / rate),
                # explained as well by other natural frequencies, of which parameters decide
                instead=lambda trial, rate=rate: _slower(trial, 1 / rate, whole=True),
                drastic=abs(np.log(rate)) > 1,
            )


def _slower(trial: Trial, factor: float, *, whole: bool = False) -> Trial:
    """The trial on a clock of its film that goes slower, or of its commands and sensors as well."""
    track, frequency = trial.track, trial.nominal_frequency
    slower = replace(trial, track=MarkerTrack(factor * track.times, track.positions, track.confidence))
    if not whole:
        return slower
    controls, sensors = (
        None if signals is None else replace(signals, times=factor * signals.times)
        for signals in (trial.controls, trial.sensors)
    )
    return replace(
        slower, controls=controls, sensors=sensors, nominal_frequency=frequency / factor if frequency else frequency
    )


def playback_errors(robot: Robot, player: PlaybackSimulator, trial: Trial) -> tuple[float, float]:
    """Error of a trial's playback with the robot's own values, and of a robot that stays as the trial begins [m].

    NaN for a trial that can't be played back, infinite for a playback that diverges. Sensors count where nothing else
    does.
    """
    about, track = robot.trials, trial.track
    scales = {} if robot.marker_names else {sensor.name: sensor.meters_per_unit for sensor in about.sensors}
    try:
        request = player.request(trial)
        played = player.simulate(robot.space.published, [request])[trial.name]
    except TrialError:  # `misfits` reports it
        return np.nan, np.nan
    trial, weights = request.trial, np.ones(track.confidence.shape)
    target = playback_target(trial, weights, about.frame, about.score_progress, scales)
    seen = np.isfinite(track.positions).all(axis=2).argmax(axis=0)  # the first frame of each marker
    first = np.repeat(track.positions[seen, np.arange(track.marker_count)][None], track.frame_count, axis=0)
    sensors = trial.sensors
    if sensors is not None:
        sensors = sensors.between(track.times[0], track.times[-1])
        mean = np.nan_to_num(sensors.values).sum(axis=0) / np.maximum(np.isfinite(sensors.values).sum(axis=0), 1)
        sensors = replace(sensors, values=np.repeat(mean[None], len(sensors.times), axis=0))
    still = compare_playback(target, Trial(trial.name, MarkerTrack(track.times, first), sensors=sensors)).loss
    return np.inf if played.divergence else compare_playback(target, played).loss, still


def _of_sensors(robot: Robot, reference: TrialSet) -> list[str]:
    """Encoders that read what the robot's joints don't do: swapped, of another sign, unit or zero."""
    names = robot.sensed_places
    pairs = [_read(robot, trial, names) for trial in reference.trials] if names else []
    if not pairs:
        return []
    made, read = (np.concatenate(part) for part in zip(*pairs, strict=True))  # (N, S)
    if len(made) < _FRAMES:
        return []
    spread = made.std(axis=0)

    def off(i: int, readings: Array) -> float:
        return float(np.sqrt(np.nanmean(np.square(made[:, i] - readings))) / spread[i])

    seen = [i for i in range(len(names)) if spread[i] > 1e-3 and np.isfinite(read[:, i]).any()]
    wrong = [i for i in seen if off(i, read[:, i]) > _UNLIKE]
    for i, j in combinations(wrong, 2):
        if max(off(i, read[:, j]), off(j, read[:, i])) < _ALIKE:
            swapped = f"'{names[i]}' and '{names[j]}'"
            return [f"sensors {swapped} look swapped; name their columns the other way round (--sensors)"]
    found: list[str] = []
    for i in wrong:
        gap = float(np.nanmean(read[:, i] - made[:, i]))
        changes = {
            "look of the other sign; turn the column, or the model's axis": -read[:, i],
            f"are {gap:+.3g} beside the joint's place; subtract that": read[:, i] - gap,
            **{
                f"look like {unit}: say NAME=COLUMN:UNIT (--sensors)": factor * read[:, i]
                for unit, factor in _TURNS.items()
            },
        }
        said = min(changes, key=lambda one: off(i, changes[one]))
        if off(i, changes[said]) < _ALIKE:
            found.append(f"readings of sensor '{names[i]}' {said}")
    return found


def _read(robot: Robot, trial: Trial, names: Sequence[str]) -> tuple[Array, Array]:
    """What sensors should read by the markers, or by a playback without any, and what they read. Shapes (N, S)."""
    none = np.zeros((0, len(names)))
    if trial.sensors is None or any(name not in trial.sensors.names for name in names):
        return none, none
    ready, periods = robot.trials.unwrapped(trial)
    columns = np.stack([(ready.sensors or trial.sensors).column(name) for name in names], axis=1)
    if not robot.marker_names:
        try:
            player = PlaybackSimulator(robot)
            played = player.simulate(robot.space.published, [player.request(trial)])[trial.name]
        except Swim2RealError:  # `misfits` reports it
            return none, none
        if played.divergence or played.sensors is None:
            return none, none
        within = np.isin(trial.sensors.times, played.sensors.times)
        return np.stack([played.sensors.column(name) for name in names], axis=1), columns[within]
    some, model = _some(trial, _MANY_FRAMES), robot.model
    data, made = mujoco.MjData(model), list[Array]()
    known = np.isfinite(some.track.positions).all(axis=2).sum(axis=1) > 1
    for data.qpos[:], _ in _Poses(robot).of(some):
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_sensorPos(model, data)
        places = [(sensor_address(model, one.name), one.factor) for one in robot.trials.sensors if one.name in names]
        made.append(np.array([factor * data.sensordata[address] for address, factor in places]))
    times = some.track.times[known]
    read = np.stack([np.interp(times, trial.sensors.times, column) for column in columns.T], axis=1)
    columns = zip(np.array(made).reshape(-1, len(names)).T, read.T, names, strict=True)
    return np.stack([nearest(one, real, periods.get(name, 0.0)) for one, real, name in columns], axis=1), read
