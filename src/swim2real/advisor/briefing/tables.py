"""The tables of a briefing: by parameter, trial, marker, window of time and measurement.

Columns and tables of what no trial has are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from swim2real.advisor.briefing.facts import MarkerFacts, RoundFacts, TrialFacts, highest
from swim2real.advisor.briefing.texts import NOTHING, degrees, mm, number, pair, reading, significant, span, table
from swim2real.objective.figures import FIGURES

_LARGE = 20e-3  # m: from here on differences are told in whole millimeters
_GRID = 8  # trials that tables by marker and trial have
_IN_TIME = 3  # trials whose differences are told window by window
_SAID = {  # of figures with a column of their own, as who judges a fit by them needs it
    "progress_error": "how far the simulated robot is ahead or behind on average.",
    "shape_error": "what differs in the frame of the head, without the way that it has come.",
    "recoil_error": "what the yaw and the sway of the head add.",
    "heading_error": "how far it turns away.",
    "left_out_share": "share of the real marker positions that couldn't be used; distrust rows with much of it.",
}


class Column(NamedTuple):
    """A column: its heading, what it means in a sentence if that needs saying, and what it has of a thing."""

    heading: str
    cell: Callable[[Any], str]
    meaning: str = ""


def columns_table(columns: Sequence[Column], things: Sequence[TrialFacts | MarkerFacts]) -> str:
    """A row per thing."""
    return table([one.heading for one in columns], [[one.cell(thing) for one in columns] for thing in things])


def parameter_table(facts: RoundFacts) -> str:
    """The parameters with the first and the current values."""
    first, here = (one.candidate.point for one in (facts.situation.first, facts.situation.incumbent))
    values = zip(facts.space, facts.space.to_values(first).values(), facts.space.to_values(here).values(), strict=True)
    rows = [
        [
            one.name, one.unit, *map(significant, (one.lower, one.upper, begun, current)), number(place, 2),
            one.meaning,
        ]
        for (one, begun, current), place in zip(values, here, strict=True)
    ]  # fmt: skip
    return table(("parameter", "unit", "lower", "upper", "first", "current", "place", "meaning"), rows)


def trial_columns(facts: RoundFacts) -> list[Column]:
    """Columns of the table with a row per trial."""
    here, trials, last = facts.here, facts.here.trials, facts.robot.marker_names[-1]

    def has(figure: str) -> bool:
        return any(getattr(trial.figures, figure) is not None for trial in trials)

    def of_figure(name: str, digits: int = 1) -> Column:
        figure = FIGURES[name]
        said, heading = f"`{figure.short}`: {_SAID[name]}", figure.column.replace("°", "deg")
        return Column(heading, lambda t: number(getattr(t.figures, name), digits, figure.factor), said)

    beats, windows = has("frequency"), any(trial.edges for trial in trials)
    columns = [Column("trial", lambda t: t.name)]
    if beats:
        columns.append(Column("Hz", lambda t: number(t.frequency, 2)))
    if windows:
        columns.append(Column("s", lambda t: number(t.edges[-1] - t.edges[0], 2), "`s`: how long it is."))
    columns.append(Column("error mm", lambda t: mm(t.error), "`error`: the trial's part of the loss."))
    if here.sensors:
        said = "`markers`: what the markers have of it; then the mean error of each sensor."
        columns.append(Column("markers mm", lambda t: mm(t.figures.aligned_marker_error), said))
    for i, one in enumerate(here.sensors):
        columns.append(Column(f"{one.sensor.name} {one.sensor.unit}", lambda t, i=i: reading(t.sensors[i].error)))
    parts = ("progress_error", "shape_error", "recoil_error", "heading_error")
    columns += [of_figure(name) for name in parts if has(name)]
    if any(trial.velocity_real is not None for trial in trials):
        said = "Ratios are simulated / real: a speed ratio of 0.80 means 20 % too slow."
        columns += [
            Column("real mm/s", lambda t: mm(t.velocity_real), "Speeds are forward, negative is backward."),
            Column("sim mm/s", lambda t: mm(t.figures.velocity_simulated)),
            Column("speed ratio", lambda t: number(t.speed_ratio, 2), said),
        ]
    name, said = "amplitude ratio", "the median over the markers that move; 1.20 means 20 % too wide."
    if beats:
        name, said = f"{last} ratio", "amplitude of the last marker; 1.20 means that it beats 20 % wider."
    columns.append(Column(name, lambda t: number(t.amplitude_ratio, 2), f"`{name}`: {said}"))
    if beats:
        lag = "lag" if here.front is None else f"lag {facts.robot.marker_names[here.front]} to {last}"
        said = "`lag`: by how much of a beat (360 deg) the last marker is behind; 0 is a stiff swing."
        columns += [
            Column(f"{lag} real deg", lambda t: number(t.lag("real", here.front), 0)),
            Column("sim deg", lambda t: number(t.lag("simulated", here.front), 0), said),
        ]
    columns.append(Column("worst marker", _worst_marker))
    if windows:
        said = "`most off at`: when the markers' mean places are farthest off."
        columns.append(Column("most off at s", lambda t: span(t.worst_window), said))
    return [*columns, of_figure("left_out_share", 0)]


def _worst_marker(trial: TrialFacts) -> str:
    worst = highest(trial.markers, [marker.error for marker in trial.markers])
    return NOTHING if worst is None else worst.name


def head_table(trials: Sequence[TrialFacts]) -> str:
    """How far the head yaws and sways in each trial."""
    columns = (
        "trial", "Hz", "yaw real deg", "sim deg", "phase deg", "sway real mm", "sim mm", "phase deg", "turn deg/s",
    )  # fmt: skip
    rows: list[list[str]] = []
    for trial in trials:
        known = trial.figures
        lags = [degrees(lag, 0, signed=True) for lag in (known.yaw_lag, known.sway_lag)]
        yaw = [degrees(known.yaw_real), degrees(known.yaw_simulated), lags[0]]
        sway = [mm(known.sway_real), mm(known.sway_simulated), lags[1]]
        rows.append([trial.name, number(trial.frequency, 2), *yaw, *sway, degrees(known.turn_rate_real)])
    return table(columns, rows)


def marker_columns(facts: RoundFacts) -> list[Column]:
    """Columns of the table with a row per marker, over all trials."""
    columns = [
        Column("marker", lambda m: m.name),
        Column("error mm", lambda m: mm(m.error)),
        Column("real mm", lambda m: mm(m.real)),
        Column("sim mm", lambda m: mm(m.simulated)),
        Column("ratio", _ratio),
    ]
    if any(marker.ahead is not None for marker in facts.here.markers):
        said = (
            "`phase`: simulated minus real; +10 means that the simulated marker is 10 deg of a beat ahead of the real "
            "one, -10 that it comes later."
        )
        columns.append(Column("phase deg", _phase, said))
    if any(marker.offset for marker in facts.here.markers):
        said = f"`offset`: by how much its mean place differs, simulated minus real: {facts.axes.directions}."
        columns.append(Column("offset mm", lambda m: pair(m.offset, 1), said))
    return columns


def marker_grids(facts: RoundFacts) -> list[tuple[str, str]]:
    """Titles and tables by marker and trial; of many trials the worst."""
    here, shown = facts.here, _worst_trials(facts.here.trials, _GRID)
    if len(shown) < 2 and not facts.beats:
        return []
    every, several = list(range(len(here.markers))), [marker for trial in shown for marker in trial.markers]
    moving = [i for i in every if here.markers[i].ratio is not None]
    # under the paper's protocol, without phase and registration, the shape's part says little
    if here.figures.protocol != "paper" and any(marker.shape_error is not None for marker in several):
        title = "Error in shape alone, without the difference in progress, in mm"
        grids = [(title, _shape, every)]
    else:
        grids = [("Error by marker and trial, in mm", _error, every)]
    grids.append(("Ratio of amplitudes by marker and trial (1.20: simulated 20 % wider)", _ratio, moving))
    if any(marker.ahead is not None for marker in several):
        grids.append(("Phase by marker and trial, in deg (+: the simulated marker is ahead)", _phase, moving))
    which = "" if len(shown) == len(here.trials) else f", the {len(shown)} worst trials"
    columns = ["marker", *(trial.name for trial in shown)]
    return [
        (
            f"{title}{which}",
            table(columns, [[here.markers[i].name, *(cell(t.markers[i]) for t in shown)] for i in markers]),
        )
        for title, cell, markers in grids
        if markers
    ]


def _error(marker: MarkerFacts) -> str:
    return mm(marker.error)


def _shape(marker: MarkerFacts) -> str:
    return mm(marker.shape_error)


def _ratio(marker: MarkerFacts) -> str:
    return number(marker.ratio, 2)


def _phase(marker: MarkerFacts) -> str:
    return number(marker.ahead, 0, signed=True)


def worst_trials_in_time(trials: Sequence[TrialFacts]) -> list[TrialFacts]:
    """The trials whose differences are told window by window."""
    return [trial for trial in _worst_trials(trials, _IN_TIME) if trial.error is not None and trial.edges]


def windows_table(trial: TrialFacts) -> str:
    """Mean differences of markers and sensors in windows of time."""
    digits = 0 if max((size for size in trial.off if size is not None), default=0.0) >= _LARGE else 1
    columns = ["marker", *(f"{span(edges)} s" for edges in pairwise(trial.edges))]
    rows = [[marker.name, *(pair(place, digits) for place in marker.windows)] for marker in trial.markers]
    rows += [
        [f"{one.sensor.name} {one.sensor.unit}", *(reading(value, signed=True) for value in one.windows)]
        for one in trial.sensors
        if one.windows
    ]
    return table(columns, rows)


def _worst_trials(trials: Sequence[TrialFacts], most: int) -> list[TrialFacts]:
    """The worst ones, in their own order."""
    worst = sorted(trials, key=lambda trial: -(math.inf if trial.error is None else trial.error))[:most]
    return [trial for trial in trials if any(trial is one for one in worst)]
