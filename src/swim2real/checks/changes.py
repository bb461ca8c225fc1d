"""Changes that would make real trials right which aren't what they are taken for: an algebra.

In the order of their simplicity: another scale, another sign or other axes, another order of markers, columns or files,
another clock. Each is a function of trials; whether it explains them is judged elsewhere, by their motion or by poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from typing import TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from markertrack import frames
from markertrack.track import MarkerTrack
from swim2real.formatting import listed
from swim2real.robots.robot import Robot
from swim2real.trials import Signals, Trial
from swimbase.arrays import Array

Item = TypeVar("Item")
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
        said: The trials' fault if it does, and what to type, as the end of a sentence.
        undo: Makes it, for each of some trials.
        streams: Streams that it is about, `markers` or names of sensors; None for all.
        scale: By how much it makes the markers' distances larger.
    """

    said: str
    undo: Undo
    streams: tuple[str, ...] | None = None
    scale: float = 1.0


def _each(change: Callable[[Trial], Trial]) -> Undo:
    """The same for every trial."""
    return lambda trials: [change(trial) for trial in trials]


def moved(trial: Trial, positions: Array) -> Trial:
    """The trial, or its first frames, with its markers elsewhere. Shape (T, M, 2)."""
    track = trial.track.frames(slice(len(positions)))
    return replace(trial, track=MarkerTrack(track.times, positions, track.confidence))


def _placed(change: Callable[[Array], Array]) -> Undo:
    return _each(lambda trial: moved(trial, change(trial.track.positions)))


def _scaled(scale: float) -> Undo:
    return _placed(lambda places: scale * places)


def of_distances(robot: Robot) -> Iterator[Change]:
    """Changes of the distances between markers."""
    names, count = robot.marker_names, len(robot.marker_names)
    for unit, scale in (("mm", 1e-3), ("cm", 1e-2)):
        said = f"its markers look like {unit}, not m: say the unit of the columns"
        yield Change(f"{said} (--markers {names[0]}=XCOLUMN,YCOLUMN:{unit} …)", _scaled(scale), None, scale)
    check = "check the camera file's lengths, the unit of the columns (--markers NAME=XCOLUMN,YCOLUMN:UNIT)"
    for scale in _SCALES if count > 1 else ():
        said = f"its markers are about {1 / scale:.2g} times as far apart as the robot's; {check}, or the model's"
        yield Change(said, _scaled(scale), None, scale)
    for i, j in _pairs(range(count)):
        order = list(range(count))
        order[i], order[j] = j, i
        said = f"markers {names[i]} and {names[j]} look swapped; click them again, or swap their columns (--markers)"
        yield Change(said, _placed(lambda places, order=order: places[:, order]))


def of_places(robot: Robot, beside: Array) -> Iterator[Change]:
    """Changes of markers that keep the distances between them: other axes, another origin, the other end first.

    Args:
        robot: Whose they should be.
        beside: How far they lie from it as a whole, right and up [m]. Shape (2,).
    """
    first, last = robot.marker_names[0], robot.marker_names[-1]
    right, up = ("xyz"[axis] for axis in robot.plane)
    camera = f"the camera sees {right} to its right and {up} up; mend the camera file"
    if robot.trials.frame is None:  # else its place is of no importance
        for said, turn in {
            "its axes look swapped": [[0, 1], [1, 0]], f"its {up} looks upside down": [[1, 0], [0, -1]],
            f"its {right} looks mirrored": [[-1, 0], [0, 1]], "it looks turned by 180 degrees": [[-1, 0], [0, -1]],
            "it looks turned by 90 degrees": [[0, -1], [1, 0]], "it looks turned by -90 degrees": [[0, 1], [-1, 0]],
        }.items():  # fmt: skip
            change = _placed(lambda places, turn=turn: places @ np.transpose(turn))
            yield Change(f"{said}: {camera}, or the columns of --markers", change)
        by = f"by {right} {1e3 * beside[0]:+.0f} mm, {up} {1e3 * beside[1]:+.0f} mm"
        said = f"it lies beside the robot {by}; check the camera file's origin, which must be the model's"
        yield Change(said, _placed(lambda places: places - beside))
    elif not robot.trials.steady:  # a robot that looks the same in a mirror, as long as it doesn't move
        said = f"it moves as the robot does in a mirror: {camera}, or the signs of all commands"
        yield Change(said, _placed(lambda places: places * [1.0, -1.0]))
    if first != last:
        said = f"its markers fit the robot in the other order, from {last} to {first}; click, or name, {first} first"
        yield Change(said, _placed(lambda places: places[:, ::-1]))


def of_pixels(robot: Robot, trials: Sequence[Trial], played: Sequence[Trial]) -> Iterator[Change]:
    """Positions that were never turned into meters: of another scale, from the corner of a picture whose y is down."""
    real, made = (float(np.sqrt(np.nanmean(np.square(np.concatenate([*map(_centered, s)]))))) for s in (trials, played))
    if robot.trials.frame is not None or not made > 0 or 1 / _FAR < real / made < _FAR:
        return
    factor = made / real
    pairs = zip(trials, played, strict=True)
    begun = {one.name: (one.track.positions[0], other.track.positions[0]) for one, other in pairs}

    def undo(trial: Trial) -> Trial:
        corner, origin = (np.nanmean(places, axis=0) for places in begun[trial.name])
        return moved(trial, factor * (trial.track.positions - corner) * [1.0, -1.0] + origin)

    said = (
        f"its markers look like pixels, of about {1e3 * factor:.2g} mm, y down: say --markers "
        f"NAME=XCOLUMN:{factor:.2g},YCOLUMN:-{factor:.2g}, or use import-tracks with a camera file"
    )
    yield Change(said, _each(undo), None, factor)


def of_commands(robot: Robot, trials: Sequence[Trial]) -> Iterator[Change]:
    """Changes of tables of commands."""
    names = [name for name, drive in robot.trials.controls.items() if drive.table]
    if not names or any("controls" not in trial.signals for trial in trials):
        return
    for what, factor in _FACTORS.items():
        scaled = {name: (name, factor) for name in names}
        yield Change(f"commands look like {what}: say NAME=COLUMN:UNIT (--controls)", _columns("controls", scaled))
    for name in names:
        said = f"commands of actuator '{name}' look of the other sign: say NAME=COLUMN:-1, or turn the model's gear"
        yield Change(said, _columns("controls", {name: (name, -1.0)}))
    for one, other in _pairs(names):
        said = f"commands of '{one}' and '{other}' look swapped; name their columns the other way round (--controls)"
        yield Change(said, _columns("controls", {one: (other, 1.0), other: (one, 1.0)}))
    yield from _exchanged(trials, "controls", None)


def of_readings(robot: Robot, trials: Sequence[Trial], played: Sequence[Trial]) -> Iterator[Change]:
    """Changes of tables of readings, beside what the robot would read."""
    units = {sensor.name: sensor.unit for sensor in robot.trials.sensors}
    if any("sensors" not in trial.signals for trial in trials):
        return

    def change(said: str, sources: Mapping[str, tuple[str, float]], less: float = 0.0) -> Change:
        return Change(said, _columns("sensors", sources, less), tuple(sources))

    for unit in dict.fromkeys(units.values()):  # a table has them all in one
        alike = [name for name in units if units[name] == unit]
        who = f"readings of sensor{'s' * (len(alike) > 1)} {listed([repr(name) for name in alike])}"
        for what, factor in _FACTORS.items():
            said = f"{who} look like {what}: say NAME=COLUMN:UNIT (--sensors)"
            yield change(said, {name: (name, factor) for name in alike})
    for name in units if all("sensors" in one.signals for one in played) else ():
        real, made = (np.concatenate([_readings(one).column(name) for one in some]) for some in (trials, played))
        sizes = float(np.nanstd(real)), float(np.nanstd(made))
        if not min(sizes) > 0:
            continue
        factor, who = sizes[1] / sizes[0], f"readings of sensor '{name}'"
        near = {what: times for what, times in _FACTORS.items() if 1 / _NEAR < factor / times < _NEAR}
        for what, times in near.items() if len(units) > 1 else ():
            yield change(f"{who} look like {what}: say NAME=COLUMN:UNIT (--sensors)", {name: (name, times)})
        if not near and not 1 / _FAR < factor < _FAR:
            said = f"{who} vary {1 / factor:.3g} times as much as the robot's own; give their unit (--sensors)"
            yield change(said, {name: (name, factor)})
        said = f"{who} look of the other sign: say NAME=COLUMN:-1 (--sensors), or turn the model's axis"
        yield change(said, {name: (name, -1.0)})
        gap = float(np.nanmean(real) - np.nanmean(made))
        yield change(f"{who} are {gap:+.3g} beside the robot's own; subtract that", {name: (name, 1.0)}, gap)
    for one, other in _pairs(list(units)):
        which = f"sensors '{one}' and '{other}'{'' if robot.marker_names else ', or the commands that move them,'}"
        said = f"{which} look swapped; name their columns the other way round (--sensors)"
        yield change(said, {one: (other, 1.0), other: (one, 1.0)})
    yield from _exchanged(trials, "sensors", tuple(units))


def of_clocks(robot: Robot, trials: Sequence[Trial], driven: Sequence[Trial]) -> Iterator[Change]:
    """Streams that may be on another clock than the commands.

    Args:
        robot: The robot.
        trials: Real trials.
        driven: Trials that its commands make of it, each as long as these last.
    """
    readings = tuple(robot.trials.scales)
    unit = "say the unit of the time (--time COLUMN:UNIT)"
    begin = "say when the log begins (--from), or shift its time_s"
    several = [slice(k, k + 1) for k in range(len(trials))] if len(trials) > 1 else []
    for some in (slice(None), *several):  # a clock may be that of one trial alone
        if robot.marker_names:
            clocks = _Clocks(robot, trials[some], driven[some], readings=False)
            for late in clocks.lags():
                said = _late("its film seems", late)
                yield Change(f"{said}; {begin}", _shifted(controls=late))
                if readings:
                    yield Change(f"{said}, readings included; {begin}", _shifted(controls=late, sensors=late))
            for ratio in clocks.ratios():
                said = f"its frames last {ratio:.3g} times as long as what drove it: give --fps, about"
                rate = f"{ratio * trials[0].fps:.4g}, the rate at which the camera took them"
                yield Change(f"{said} {rate}, or {unit}", _each(partial(_faster, ratio=ratio, filmed=True)))
        if readings:
            clocks = _Clocks(robot, trials[some], driven[some], readings=True)
            for late in clocks.lags():  # without a film, its frames are its readings
                undo = _shifted(sensors=-late) if robot.marker_names else _shifted(controls=late)
                yield Change(f"{_late('its readings seem', late)}; {begin}", undo, readings)
            for ratio in clocks.ratios():
                said = f"its readings last {ratio:.3g} times as long as what drove it: {unit}"
                yield Change(said, _each(partial(_faster, ratio=ratio, filmed=False)), readings)


def _late(what: str, late: float) -> str:
    one, other = ("late", "early") if late > 0 else ("early", "late")
    return f"{what} {abs(late):.2f} s {one}, or its commands as {other}"


class _Clocks:
    """A stream of trials beside what their commands make of the robot, to find the clock that brings both together."""

    def __init__(self, robot: Robot, trials: Sequence[Trial], driven: Sequence[Trial], readings: bool) -> None:
        """Takes the markers, or the readings, of trials and of what their commands make."""
        self._pairs: list[tuple[Array, Array, Array, Array]] = []
        for real, made in zip(trials, driven, strict=True):
            if made.divergence is None:
                (times, values), simulated = (_numbers(one, robot, readings) for one in (real, made))
                kept = np.unique(np.linspace(0, len(times) - 1, _SAMPLES).astype(int))
                self._pairs.append((times[kept], values[kept], *simulated))
        both = [np.fmax(np.nanstd(real, axis=0), np.nanstd(made, axis=0)) for _, real, _, made in self._pairs]
        sizes = np.maximum(np.mean(both, axis=0), 1e-9) if both else np.ones(1)
        self._sizes = sizes if readings else np.full_like(sizes, sizes.max())

    def lags(self) -> list[float]:
        """Delays of the stream [s] that explain it best."""
        if not self._pairs:
            return []
        step = float(np.median([np.diff(times).mean() for times, *_ in self._pairs]))
        count = int(min(_LONGEST, 0.5 * min(np.ptp(times) for times, *_ in self._pairs)) / step)
        lags = step * np.arange(-count, count + 1, dtype=float)
        return self._least(lags, lambda lag: self._error(1.0, lag), 0.0, step)

    def ratios(self) -> list[float]:
        """Ratios of its duration to the commands', where one explains it best; and that of both lengths."""
        if not self._pairs:
            return []
        grid = np.exp(np.arange(-np.log(_STRETCH), np.log(_STRETCH), 0.02))
        found = self._least(grid, lambda ratio: self._error(ratio, 0.0), 1.0, 0.02)
        length = float(np.median([np.ptp(times) / max(np.ptp(driven), 1e-9) for times, _, driven, _ in self._pairs]))
        return [*found, length] if abs(np.log(length)) > 0.03 else found

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


def _numbers(trial: Trial, robot: Robot, readings: bool) -> tuple[Array, Array]:
    """Times and numbers of a trial's readings, or markers. Shapes (T,) and (T, N)."""
    if readings:
        table = _readings(trial)
        return table.times, np.stack([table.column(name) for name in robot.trials.scales], axis=1)
    places, frame = trial.track.positions, robot.trials.frame
    places = places if frame is None else frames.to_body(places, frame)
    return trial.track.times, places.reshape(len(places), -1)


def _readings(trial: Trial) -> Signals:
    return trial.signals["sensors"]


def _pairs(items: Sequence[Item]) -> list[tuple[Item, Item]]:
    pairs = list(combinations(items, 2))
    return pairs if len(pairs) <= _MOST_SWAPS else list(pairwise(items))


def _centered(trial: Trial) -> Array:
    positions = trial.track.positions
    return (positions - np.nanmean(positions, axis=0)).ravel()


def _columns(kind: str, sources: Mapping[str, tuple[str, float]], less: float = 0.0) -> Undo:
    """Columns of a table made of others, times a factor, less a number."""

    def undo(trial: Trial) -> Trial:
        table, values = trial.signals[kind], trial.signals[kind].values.copy()
        for name, (source, factor) in sources.items():
            values[:, table.names.index(name)] = factor * table.column(source) - less
        return replace(trial, **{kind: replace(table, values=values)})

    return _each(undo)


def _exchanged(trials: Sequence[Trial], kind: str, streams: tuple[str, ...] | None) -> Iterator[Change]:
    """Tables of two trials that may be exchanged."""
    both = all(len(trial.signals) == 2 for trial in trials)
    other = f", or those of {'sensors' if kind == 'controls' else 'controls'}" * both
    said = f"their tables of {kind}{other} look exchanged; give each trial its own (--{kind})"
    for one, two in _pairs(trials):
        tables = {one.name: two.signals[kind], two.name: one.signals[kind]}

        def undo(trial: Trial, tables: Mapping[str, Signals] = tables) -> Trial:
            return replace(trial, **{kind: tables[trial.name]}) if trial.name in tables else trial

        yield Change(said, _each(undo), streams)


def _shifted(**later: float) -> Undo:
    """Tables that are later, by so many seconds."""

    def undo(trial: Trial) -> Trial:
        tables = {kind: table for kind, table in trial.signals.items() if kind in later}
        made = {kind: replace(table, times=table.times + later[kind]) for kind, table in tables.items()}
        return replace(trial, **made)

    return _each(undo)


def _faster(trial: Trial, ratio: float, filmed: bool) -> Trial:
    """A film, or readings, on a clock that goes faster."""
    track, sensors = trial.track, trial.sensors
    if filmed or not track.marker_count:
        track = MarkerTrack(track.times / ratio, track.positions, track.confidence)
    if not filmed and sensors is not None:
        sensors = replace(sensors, times=sensors.times / ratio)
    return replace(trial, track=track, sensors=sensors)
