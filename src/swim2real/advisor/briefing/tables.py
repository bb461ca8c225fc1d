"""The tables of a briefing: by parameter, trial, marker, window of time and measurement.

Columns and tables of what no trial has are left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from swim2real.advisor.briefing.facts import MarkerFacts, RoundFacts, TrialFacts, highest
from swim2real.advisor.briefing.texts import NOTHING, degrees, mm, number, pair, reading, significant, span, table
from swim2real.objective.figures import FIGURES
from swim2real.parameters import ParameterSpace

_LARGE = 20e-3  # m: from here on differences are reported in whole millimeters
_GRID = 8  # trials that tables by marker and trial have
_EVERYWHERE = "Measured for a tenth of the range more:"  # what follows holds in the middle of the bounds
_LITTLE = "less than 2 %"
_WHICH = re.compile(r"tail joint \d \([^)]*\)|joint \d+")  # what alone tells parameters of a kind apart
_IN_TIME = 3  # trials whose differences are reported window by window
_SAID = {  # of figures with a column of their own, as who judges a fit by them needs it
    "progress_error": "how far the simulated robot is ahead or behind on average.",
    "shape_error": "what differs in the frame of the head, without the way that it has come.",
    "recoil_error": "what the yaw and the sway of the head add.",
    "heading_error": "how far it turns away.",
    "left_out_share": "share of the real marker positions that couldn't be used; weigh rows with much of it less.",
}


class Column(NamedTuple):
    """A column: its heading, what it means in a sentence if that needs saying, and what it has of a thing."""

    heading: str
    cell: Callable[[Any], str]
    meaning: str = ""


def columns_table(columns: Sequence[Column], things: Sequence[TrialFacts | MarkerFacts]) -> str:
    """A row per thing."""
    return table([one.heading for one in columns], [[one.cell(thing) for one in columns] for thing in things])


def meaning_table(facts: RoundFacts) -> str:
    """The parameters with bounds, the model's own values and meanings; a row for those that differ in place alone."""
    rows: dict[tuple[str, ...], list[tuple[str, str]]] = {}
    for one in facts.space:
        meaning = one.meaning.partition(_EVERYWHERE)[0].strip()
        limits = map(significant, (one.lower, one.upper, one.published))
        rows.setdefault((one.unit, *limits, _WHICH.sub("", meaning)), []).append((one.name, meaning))
    return table(
        ("parameter", "unit", "lower", "upper", "own", "meaning"),
        [
            [", ".join(name for name, _ in alike), *key[:4], alike[0][1] + (" The others alike." if alike[1:] else "")]
            for key, alike in rows.items()
        ],
    )


def effects_in_the_middle(space: ParameterSpace) -> str:
    """Effects that parameters have in the middle of their bounds, where somebody has measured them: a line for each."""
    found = ((one.name, one.meaning.partition(_EVERYWHERE)[2]) for one in space)
    return "\n".join(f"- {name}:{text}" for name, text in found if text and _LITTLE not in text)


def values_told(facts: RoundFacts) -> str:
    """The current values of the parameters with their places in the unit cube."""
    here = facts.situation.incumbent.candidate.point
    values = zip(facts.space.to_values(here).items(), here, strict=True)
    return ", ".join(f"{name} {significant(value)} ({number(place, 2)})" for (name, value), place in values)


def meanings(facts: RoundFacts) -> str:
    """Meanings of the tables' columns, those that need saying."""
    columns = [*trial_columns(facts), *(marker_columns(facts) if facts.here.markers else ())]
    return "\n".join(f"- {one.meaning}" for one in columns if one.meaning)


def trial_columns(facts: RoundFacts) -> list[Column]:
    """Columns of the table with a row per trial."""
    here, trials, last = facts.here, facts.here.trials, "".join(facts.robot.marker_names[-1:])

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
    if here.sensors and here.markers:
        said = "`markers`: what the markers have of it; then the mean error of each sensor."
        columns.append(Column("markers mm", lambda t: mm(t.figures.aligned_marker_error), said))
    for i, one in enumerate(here.sensors):
        columns.append(Column(f"{one.sensor.name} {one.sensor.unit}", lambda t, i=i: reading(t.sensors[i].error)))
    parts = ("progress_error", "shape_error", "recoil_error", "heading_error")
    columns += [of_figure(name) for name in parts if has(name)]
    if any(trial.velocity_real is not None for trial in trials):
        columns += [
            Column("real mm/s", lambda t: mm(t.velocity_real), "Speeds are forward, negative is backward."),
            Column("speed ratio", lambda t: number(t.speed_ratio, 2)),
        ]
    if facts.from_rest:
        said = (
            "`first beats`: forward speed over the first two beats from rest; near 0, or below, the trial is about to "
            "turn last marker first."
        )
        columns.append(Column("first beats mm/s", lambda t: mm(facts.from_rest.get(t.name, (None, None))[1]), said))
    if here.markers:
        name, said = "amplitude ratio", "of amplitudes, the median over the markers that move."
        if beats:
            name, said = f"{last} ratio", "of amplitudes of the last marker."
        columns.append(Column(name, lambda t: number(t.amplitude_ratio, 2), f"`{name}`: {said}"))
    if windows and here.markers:
        columns.append(Column("worst marker", _worst_marker))
    if windows and here.markers:
        said = "`most off at`: when the markers' mean places are farthest off."
        columns.append(Column("most off at s", lambda t: span(t.worst_window), said))
    columns += _head_columns() if here.has_head else []
    return [*columns, *([of_figure("left_out_share", 0)] if has("left_out_share") else [])]


def _worst_marker(trial: TrialFacts) -> str:
    worst = highest(trial.markers, [marker.error for marker in trial.markers])
    return NOTHING if worst is None else worst.name


def _head_columns() -> list[Column]:
    """Columns of the head's motion in the table with a row per trial."""
    said = "`yaw`, `sway`: how far the head turns and goes to the side about its path, real, simulated, and the phase."
    return [
        Column("yaw real deg", lambda t: degrees(t.figures.yaw_real), said),
        Column("sim", lambda t: degrees(t.figures.yaw_simulated)),
        Column("phase deg", lambda t: degrees(t.figures.yaw_lag, 0, signed=True)),
        Column("sway real mm", lambda t: mm(t.figures.sway_real)),
        Column("sim", lambda t: mm(t.figures.sway_simulated)),
        Column("phase deg", lambda t: degrees(t.figures.sway_lag, 0, signed=True)),
    ]


_AMPLITUDES = {
    "beats": "`real` of a marker: median amplitude of its sideways beat in the frame of the head.",
    "moves": "`real` of a marker: median standard deviation of its place along the line that it moves along most.",
}


def marker_columns(facts: RoundFacts) -> list[Column]:
    """Columns of the table with a row per marker, over all trials."""
    columns = [
        Column("marker", lambda m: m.name),
        Column("error mm", lambda m: mm(m.error), "`error` of a marker: its mean part of the loss, over all trials."),
        Column("real mm", lambda m: mm(m.real), _AMPLITUDES["beats" if facts.beats else "moves"]),
        Column("ratio", _ratio),
    ]
    if any(marker.ahead is not None for marker in facts.here.markers):
        said = "`phase`: simulated minus real, above 0 where the simulated one is ahead."
        columns.append(Column("phase deg", lambda marker: number(marker.ahead, 0, signed=True), said))
    if facts.beats and len(facts.here.trials) > 1:
        said = (
            "`most shape`: its largest error in shape and the trial; one that stands out may be swapped or bent there."
        )
        columns.append(Column("most shape mm", lambda m: _most_shape(m, facts.here.trials), said))
    if any(marker.offset for marker in facts.here.markers):
        said = f"`offset`: by how much its mean place differs, simulated minus real: {facts.axes.directions}."
        columns.append(Column("offset mm", lambda m: pair(m.offset, 1), said))
    return columns


def _most_shape(marker: MarkerFacts, trials: Sequence[TrialFacts]) -> str:
    errors = [(one.shape_error, trial.name) for trial in trials for one in trial.markers if one.name == marker.name]
    known = [(error, name) for error, name in errors if error is not None]
    return f"{mm(max(known)[0])} {max(known)[1]}" if known else NOTHING


def marker_grid(facts: RoundFacts) -> tuple[str, str] | None:
    """Title and table of errors by marker and trial; of many trials the worst."""
    here, shown = facts.here, _worst_trials(facts.here.trials, _GRID)
    if len(shown) < 2 or not here.markers or facts.beats:
        return None
    title, cell = "Error by marker and trial, in mm", "error"
    # under the paper's protocol, without phase and registration, the shape's part says little
    if here.figures.protocol != "paper" and any(one.shape_error is not None for t in shown for one in t.markers):
        title, cell = "Error in shape alone, without the difference in progress, in mm", "shape_error"
    which = "" if len(shown) == len(here.trials) else f", the {len(shown)} worst trials"
    rows = [[one.name, *(mm(getattr(t.markers[i], cell)) for t in shown)] for i, one in enumerate(here.markers)]
    return f"{title}{which}", table(["marker", *(trial.name for trial in shown)], rows)


def _ratio(marker: MarkerFacts) -> str:
    return number(marker.ratio, 2)


def worst_trials_in_time(trials: Sequence[TrialFacts]) -> list[TrialFacts]:
    """Trials whose differences are reported window by window."""
    return [trial for trial in _worst_trials(trials, _IN_TIME) if trial.error is not None and trial.edges]


def windows_table(trial: TrialFacts) -> str:
    """Mean differences of markers and sensors in windows of time."""
    digits = 0 if max((size for size in trial.off if size is not None), default=0.0) >= _LARGE else 1
    columns = ["marker" if trial.markers else "sensor", *(f"{span(edges)} s" for edges in pairwise(trial.edges))]
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
