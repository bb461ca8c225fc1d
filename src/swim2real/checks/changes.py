"""What real trials may be other than what they are taken for: an algebra of the changes that would make them right.

In the order of their simplicity: another scale, another sign or other axes, another order of markers, columns or files,
another clock. Each is a function of trials; whether it explains them is judged elsewhere, by their motion or by poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from markertrack import frames
from markertrack.track import MarkerTrack
from swim2real.formatting import listed
from swim2real.robots.robot import Robot
from swim2real.trials import Signals, Trial

Array = NDArray[np.float64]
Undo = Callable[[Sequence[Trial]], list[Trial]]

_MOST_SWAPS = 66  # pairs of markers or columns that are tried
_SCALES = [1.12**k for k in range(-14, 15) if k]  # of markers
_FACTORS = {
    "degrees in place of radians": np.pi / 180, "radians in place of degrees": 180 / np.pi,
    "turns in place of radians": 2 * np.pi, "thousandths (mm, mN, mA)": 1e-3, "thousands (km, kN)": 1e3,
    "hundredths (cm, %)": 1e-2,
}  # fmt: skip
_NEAR = 1.7  # times, within which a factor is taken for that of a unit
_FAR = 3.0  # times, within which sizes may differ by parameters alone
_SAMPLES = 200  # frames by which clocks are compared
_LONGEST, _STRETCH = 1.5, 16.0  # s by which a clock is shifted, times by which it is stretched, at most


@dataclass(frozen=True)
class Change:
    """A change that would make trials right.

    Attributes:
        said: What the trials are if it does, and what to type, as the end of a sentence.
        undo: Makes it, for each of some trials.
        streams: Streams that it is about, `markers` or names of sensors; None for all.
        scale: By how much it makes the markers' distances larger.
    """

    said: str
    undo: Undo
    streams: tuple[str, ...] | None = None
    scale: float = 1.0


def each(change: Callable[[Trial], Trial]) -> Undo:
    """The same for every trial."""
    return lambda trials: [change(trial) for trial in trials]


def moved(trial: Trial, positions: Array) -> Trial:
    """The trial, or its first frames, with its markers elsewhere. Shape (T, M, 2)."""
    track = trial.track
    return replace(
        trial, track=MarkerTrack(track.times[: len(positions)], positions, track.confidence[: len(positions)])
    )


def _placed(change: Callable[[Array], Array]) -> Undo:
    return each(lambda trial: moved(trial, change(trial.track.positions)))


def of_distances(robot: Robot) -> Iterator[Change]:
    """What markers may be that changes the distances between them."""
    names, count = robot.marker_names, len(robot.marker_names)
    for unit, scale in (("mm", 1e-3), ("cm", 1e-2)):
        said = f"its markers look like {unit}, not m: say the unit of the columns"
        change = _placed(lambda places, scale=scale: scale * places)
        yield Change(f"{said} (--markers {names[0]}=XCOLUMN,YCOLUMN:{unit} …)", change, None, scale)
    check = (
        "check the camera file's lengths, the unit of the columns (--markers NAME=XCOLUMN,YCOLUMN:UNIT), or the model's"
    )
    for scale in _SCALES if count > 1 else ():
        said = f"its markers are about {1 / scale:.2g} times as far apart as the robot's; {check}"
        yield Change(said, _placed(lambda places, scale=scale: scale * places), None, scale)
    for i, j in _pairs(count):
        order = [j if m == i else i if m == j else m for m in range(count)]
        yield Change(
            f"markers {names[i]} and {names[j]} look swapped; click them again, or swap their columns (--markers)",
            _placed(lambda places, order=order: places[:, order]),
        )


def of_places(robot: Robot, beside: Array) -> Iterator[Change]:
    """What markers may be that keeps the distances between them: other axes, another origin, the other end first.

    Args:
        robot: Whose they should be.
        beside: How far they lie from it as a whole, right and up [m]. Shape (2,).
    """
    first, last = robot.marker_names[0], robot.marker_names[-1]
    right, up = ("xyz"[axis] for axis in robot.plane)
    camera = f"the camera sees {right} to its right and {up} up; mend the camera file"
    if robot.trials.frame is None and robot.trials.swims is None:  # else its place is of no importance
        for said, turn in {
            "its axes look swapped": [[0, 1], [1, 0]], f"its {up} looks upside down": [[1, 0], [0, -1]],
            f"its {right} looks mirrored": [[-1, 0], [0, 1]], "it looks turned by 180 degrees": [[-1, 0], [0, -1]],
            "it looks turned by 90 degrees": [[0, -1], [1, 0]], "it looks turned by -90 degrees": [[0, 1], [-1, 0]],
        }.items():  # fmt: skip
            change = _placed(lambda places, turn=turn: places @ np.transpose(turn))
            yield Change(f"{said}: {camera}, or the columns of --markers", change)
        yield Change(
            f"it lies beside the robot by {right} {1e3 * beside[0]:+.0f} mm, {up} {1e3 * beside[1]:+.0f} mm; check the "
            f"camera file's origin, which must be the model's",
            _placed(lambda places: places - beside),
        )
    elif robot.trials.swims is None:  # a robot that looks the same in a mirror, as long as it doesn't move
        said = f"it moves as the robot does in a mirror: {camera}, or the signs of all commands"
        yield Change(said, _placed(lambda places: places * [1.0, -1.0]))
    if len(robot.marker_names) > 1:
        said = f"its markers fit the robot in the other order, from {last} to {first}; click, or name, {first} first"
        yield Change(said, _placed(lambda places: places[:, ::-1]))


def of_pixels(robot: Robot, trials: Sequence[Trial], played: Sequence[Trial]) -> Iterator[Change]:
    """Positions that were never turned into meters: of another scale, from the corner of a picture whose y is down."""
    pairs = [(_centered(real), _centered(made)) for real, made in zip(trials, played, strict=True)]
    real, made = (float(np.sqrt(np.nanmean(np.square(np.concatenate(one))))) for one in zip(*pairs, strict=True))
    if robot.trials.frame is None and made > 0 and not 1 / _FAR < real / made < _FAR:
        factor = made / real
        places = zip(trials, played, strict=True)
        start = {one.name: (one.track.positions[0], other.track.positions[0]) for one, other in places}

        def undo(trial: Trial) -> Trial:
            real, made = start[trial.name]
            flipped = factor * (trial.track.positions - np.nanmean(real, axis=0)) * [1.0, -1.0]
            return moved(trial, flipped + np.nanmean(made, axis=0))

        yield Change(
            f"its markers look like pixels, of about {1e3 * factor:.2g} mm, y down: say --markers "
            f"NAME=XCOLUMN:{factor:.2g},YCOLUMN:-{factor:.2g}, or use import-tracks with a camera file",
            each(undo), None, factor,
        )  # fmt: skip


def of_commands(robot: Robot, trials: Sequence[Trial]) -> Iterator[Change]:
    """What tables of commands may be."""
    names = [name for name, drive in robot.trials.controls.items() if drive.table]
    if not names or any(trial.controls is None for trial in trials):
        return
    every = {name: (name, 1.0) for name in names}
    for what, factor in _FACTORS.items():
        scaled = {name: (name, factor) for name in names}
        yield Change(f"commands look like {what}: say NAME=COLUMN:UNIT (--controls)", _columns("controls", scaled))
    for name in names:
        said = f"commands of actuator '{name}' look of the other sign: say NAME=COLUMN:-1, or turn the model's gear"
        yield Change(said, _columns("controls", {**every, name: (name, -1.0)}))
    for i, j in _pairs(len(names)):
        one, other = names[i], names[j]
        said = f"commands of '{one}' and '{other}' look swapped; name their columns the other way round (--controls)"
        yield Change(said, _columns("controls", {**every, one: (other, 1.0), other: (one, 1.0)}))
    yield from _exchanged(trials, "controls", None)


def of_readings(robot: Robot, trials: Sequence[Trial], played: Sequence[Trial]) -> Iterator[Change]:
    """What tables of readings may be, beside what the robot would read."""
    names = [sensor.name for sensor in robot.trials.sensors]
    if any(trial.sensors is None for trial in trials):
        return
    every = {name: (name, 1.0) for name in names}
    for unit in dict.fromkeys(sensor.unit for sensor in robot.trials.sensors):  # a table has them all in one
        alike = [sensor.name for sensor in robot.trials.sensors if sensor.unit == unit]
        who = f"readings of sensor{'s' * (len(alike) > 1)} {listed([repr(name) for name in alike])}"
        for what, factor in _FACTORS.items():
            said = f"{who} look like {what}: say NAME=COLUMN:UNIT (--sensors)"
            yield Change(said, _columns("sensors", {**every, **{name: (name, factor) for name in alike}}), tuple(alike))
    for name in names if all(one.sensors is not None for one in played) else ():
        real, made = (np.concatenate([_column(one, name) for one in some]) for some in (trials, played))
        sizes = float(np.nanstd(real)), float(np.nanstd(made))
        if not all(size > 0 for size in sizes):
            continue
        factor, who = sizes[1] / sizes[0], f"readings of sensor '{name}'"
        near = {what: times for what, times in _FACTORS.items() if 1 / _NEAR < factor / times < _NEAR}
        for what, times in near.items() if len(names) > 1 else ():
            said = f"{who} look like {what}: say NAME=COLUMN:UNIT (--sensors)"
            yield Change(said, _columns("sensors", {**every, name: (name, times)}), (name,))
        if not near and not 1 / _FAR < factor < _FAR:
            said = f"{who} vary {1 / factor:.3g} times as much as the robot's own; give their unit (--sensors)"
            yield Change(said, _columns("sensors", {**every, name: (name, factor)}), (name,))
        said = f"{who} look of the other sign: say NAME=COLUMN:-1 (--sensors), or turn the model's axis"
        yield Change(said, _columns("sensors", {**every, name: (name, -1.0)}), (name,))
        gap = float(np.nanmean(real) - np.nanmean(made))
        said = f"{who} are {gap:+.3g} beside the robot's own; subtract that"
        yield Change(said, _columns("sensors", every, {name: gap}), (name,))
    for i, j in _pairs(len(names)):
        one, other = names[i], names[j]
        which = f"sensors '{one}' and '{other}'{'' if robot.marker_names else ', or the commands that move them,'}"
        said = f"{which} look swapped; name their columns the other way round (--sensors)"
        yield Change(said, _columns("sensors", {**every, one: (other, 1.0), other: (one, 1.0)}), (one, other))
    yield from _exchanged(trials, "sensors", tuple(names))


def of_clocks(robot: Robot, trials: Sequence[Trial], driven: Sequence[Trial]) -> Iterator[Change]:
    """Streams that may be on another clock than the commands.

    Args:
        robot: The robot.
        trials: Real trials.
        driven: What it does, as its commands have it, each as long as these last.
    """
    readings = tuple(sensor.name for sensor in robot.trials.sensors)
    unit, begin = (
        "say the unit of the time (--time COLUMN:UNIT)",
        "say when the log begins (--from), or shift its time_s",
    )
    several = [slice(k, k + 1) for k in range(len(trials))] if len(trials) > 1 else []
    for some in (slice(None), *several):  # a clock may be that of one trial alone
        if robot.marker_names:
            clocks = _Clocks(robot, trials[some], driven[some], "markers")
            for late in clocks.lags():
                words = ("late", "early") if late > 0 else ("early", "late")
                said = f"its film seems {abs(late):.2f} s {words[0]}, or its commands as {words[1]}"
                yield Change(f"{said}; {begin}", each(partial(_shifted, later=-late, stream="markers")))
                if readings:
                    yield Change(
                        f"{said}, readings included; {begin}", each(partial(_shifted, later=-late, stream="film"))
                    )
            for ratio in clocks.ratios():
                said = f"its frames last {ratio:.3g} times as long as what drove it: give --fps, about"
                rate = f"{ratio * trials[0].fps:.4g}, the rate at which the camera took them"
                slower = partial(_stretched, factor=1 / ratio, filmed=True)
                yield Change(f"{said} {rate}, or {unit}", each(slower))
        if readings:
            clocks = _Clocks(robot, trials[some], driven[some], "readings")
            for late in clocks.lags():
                words = ("late", "early") if late > 0 else ("early", "late")
                said = f"its readings seem {abs(late):.2f} s {words[0]}, or its commands as {words[1]}"
                yield Change(f"{said}; {begin}", each(partial(_shifted, later=-late, stream="readings")), readings)
            for ratio in clocks.ratios():
                said = f"its readings last {ratio:.3g} times as long as what drove it: {unit}"
                yield Change(said, each(partial(_stretched, factor=1 / ratio, filmed=False)), readings)


class _Clocks:
    """How a stream lies on another clock than what its commands make of the robot."""

    def __init__(self, robot: Robot, trials: Sequence[Trial], driven: Sequence[Trial], stream: str) -> None:
        self._pairs: list[tuple[Array, Array, Array, Array]] = []
        self._ratios: list[float] = []
        names = tuple(sensor.name for sensor in robot.trials.sensors)
        for real, made in zip(trials, driven, strict=True):
            if made.divergence is not None:
                continue
            both = [_numbers(one, robot.trials.frame, stream, names) for one in (real, made)]
            (times, values), (sim_times, simulated) = both
            kept = np.unique(np.linspace(0, len(times) - 1, _SAMPLES).astype(int))
            self._pairs.append((times[kept], values[kept], sim_times, simulated))
            self._ratios.append(float(np.ptp(times) / max(np.ptp(sim_times), 1e-9)))
        both = [np.fmax(np.nanstd(one[1], axis=0), np.nanstd(one[3], axis=0)) for one in self._pairs]
        sizes = np.maximum(np.mean(both, axis=0), 1e-9) if both else np.ones(1)
        self._sizes = np.full_like(sizes, sizes.max()) if stream == "markers" else sizes

    def lags(self) -> list[float]:
        """By how much it is late [s], where that explains it best."""
        if not self._pairs:
            return []
        step = float(np.median([np.diff(times).mean() for times, *_ in self._pairs]))
        count = int(min(_LONGEST, 0.5 * min(np.ptp(times) for times, *_ in self._pairs)) / step)
        lags = step * np.arange(-count, count + 1, dtype=float)
        return self._least(lags, lambda lag: self._error(1.0, lag), 0.0, step)

    def ratios(self) -> list[float]:
        """How many times as long it lasts, where that explains it best; and as its length beside the commands' says."""
        grid = np.exp(np.arange(-np.log(_STRETCH), np.log(_STRETCH), 0.02))
        found = self._least(grid, lambda ratio: self._error(ratio, 0.0), 1.0, 0.02) if self._pairs else []
        lengths = [float(np.median(self._ratios))] if self._ratios else []
        return [*found, *(one for one in lengths if abs(np.log(one)) > 0.03)]

    def _error(self, ratio: float, lag: float) -> float:
        errors: list[float] = []
        for times, values, sim_times, simulated in self._pairs:
            at = (times - lag) / ratio
            there = np.stack([np.interp(at, sim_times, column) for column in simulated.T], axis=1)
            off = (values - there) / self._sizes
            errors.append(float(np.sqrt(np.nanmean(np.square(off - np.nanmean(off, axis=0))))))
        return float(np.mean(errors))

    def _least(self, grid: Array, error: Callable[[float], float], none: float, step: float) -> list[float]:
        """The best two places of a grid, refined, beside the one that changes nothing."""
        errors = np.array([error(float(one)) for one in grid])
        lowest = [k for k in range(1, len(grid) - 1) if errors[k] <= min(errors[k - 1], errors[k + 1])]
        found: list[float] = []
        for k in sorted(lowest, key=lambda k: errors[k])[:2]:
            best = minimize_scalar(error, bounds=(float(grid[k - 1]), float(grid[k + 1])), method="bounded")
            if abs(float(best.x) - none) > step and best.fun < error(none):
                found.append(float(best.x))
        return sorted(found, key=lambda one: abs(one - none))


def _numbers(trial: Trial, frame: tuple[int, int] | None, stream: str, names: Sequence[str]) -> tuple[Array, Array]:
    """Times and numbers of a stream. Shapes (T,) and (T, N)."""
    if stream == "markers":
        places = trial.track.positions if frame is None else frames.to_body(trial.track.positions, frame)
        return trial.track.times, places.reshape(len(places), -1)
    assert trial.sensors is not None  # else there would be nothing to compare
    return trial.sensors.times, np.stack([trial.sensors.column(name) for name in names], axis=1)


def _pairs(count: int) -> list[tuple[int, int]]:
    pairs = list(combinations(range(count), 2))
    return pairs if len(pairs) <= _MOST_SWAPS else [(i, i + 1) for i in range(count - 1)]


def _centered(trial: Trial) -> Array:
    positions = trial.track.positions
    return (positions - np.nanmean(positions, axis=0)).ravel()


def _column(trial: Trial, name: str) -> Array:
    assert trial.sensors is not None
    return trial.sensors.column(name)


def _columns(kind: str, sources: Mapping[str, tuple[str, float]], gaps: Mapping[str, float] | None = None) -> Undo:
    """Columns of a table made of others, times a factor, less a number."""

    def undo(trial: Trial) -> Trial:
        table: Signals = getattr(trial, kind)
        taken = {name: sources.get(name, (name, 1.0)) for name in table.names}
        values = [
            factor * table.column(source) - (gaps or {}).get(name, 0.0) for name, (source, factor) in taken.items()
        ]
        return replace(trial, **{kind: Signals(table.times, table.names, np.stack(values, axis=1))})

    return each(undo)


def _exchanged(trials: Sequence[Trial], kind: str, streams: tuple[str, ...] | None) -> Iterator[Change]:
    """Tables of two trials that may be exchanged."""
    for i, j in _pairs(len(trials)):
        pair = {trials[i].name: trials[j], trials[j].name: trials[i]}

        def undo(some: Sequence[Trial], pair: Mapping[str, Trial] = pair) -> list[Trial]:
            return [replace(one, **{kind: getattr(pair[one.name], kind)}) if one.name in pair else one for one in some]

        both = all(trial.controls is not None and trial.sensors is not None for trial in trials)
        other = f", or those of {'sensors' if kind == 'controls' else 'controls'}" * both
        said = f"their tables of {kind}{other} look exchanged; give each trial its own (--{kind})"
        yield Change(said, undo, streams)


def _shifted(trial: Trial, later: float, stream: str) -> Trial:
    """Markers or readings on a clock that is later; of a film the other streams are earlier, which is the same."""
    controls, sensors = trial.controls, trial.sensors
    stream = stream if trial.track.marker_count else "markers"  # its frames are its readings
    if stream != "readings" and controls is not None:
        controls = replace(controls, times=controls.times - later)
    if stream == "film" and sensors is not None:
        sensors = replace(sensors, times=sensors.times - later)
    if stream == "readings" and sensors is not None:
        sensors = replace(sensors, times=sensors.times + later)
    return replace(trial, controls=controls, sensors=sensors)


def _stretched(trial: Trial, factor: float, filmed: bool) -> Trial:
    """A film, or readings, on a clock that goes slower."""
    track, sensors = trial.track, trial.sensors
    if filmed or not track.marker_count:
        track = MarkerTrack(factor * track.times, track.positions, track.confidence)
    if not filmed and sensors is not None:
        sensors = replace(sensors, times=factor * sensors.times)
    return replace(trial, track=track, sensors=sensors)
