"""How simulated trials differ from real ones at the best point so far: by trial, by marker, and over time.

Sentences, columns and tables of what no trial has are left out: a beat, a way that was come, windows of time, sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from swim2real.advisor.briefing.facts import (
    EvaluationFacts,
    Known,
    MarkerFacts,
    Ratio,
    RoundFacts,
    TrialFacts,
    highest,
    mean,
)
from swim2real.advisor.briefing.texts import NOTHING, degrees, mm, number, pair, reading, span, table
from swim2real.objective.figures import FIGURES
from swim2real.robots.robot import Robot

_CLOSE = 0.02  # relative difference that isn't worth a word
_SAME_POWER = 0.1  # the same, of the exponent of frequency
_SAME_ANGLE = 5.0  # deg, the same
_CHANGED = 1.5  # between the halves of a trial: from here on it grows
_MOST_OF = 0.5  # of an error: from here on its constant part is named
_TINY = 1e-4  # m: below it nothing is off
_SAID = {  # of figures with a column of their own, as who judges a fit by them needs it
    "progress_error": "how far the simulated robot is ahead or behind on average.",
    "shape_error": "what differs in the frame of the head, without the way that it has come.",
    "recoil_error": "what the yaw and the sway of the head add.",
    "heading_error": "how far it turns away.",
    "left_out_share": "share of the real marker positions that couldn't be used; distrust rows with much of it.",
}
_LARGE = 20e-3  # m: from here on differences are told in whole millimeters
_GRID = 8  # trials that tables by marker and trial have
_IN_TIME = 3  # trials whose differences are told window by window
_PAPER = (
    "The simulated motor turns at the frequency that was asked of the real one, which may turn at another, and starts "
    "at angle 0, so no phase is compared."
)


@dataclass(frozen=True)
class Axes:
    """The axes of the frame of comparison in words.

    Attributes:
        directions: Of a difference of places.
        ways: Of each axis, which way a positive and which way a negative difference leads.
        picture: How a picture lies.
    """

    directions: str
    ways: tuple[tuple[str, str], tuple[str, str]]
    picture: str

    @classmethod
    def of(cls, robot: Robot) -> Axes:
        """Those of a robot's trials."""
        frame = robot.trials.frame
        if frame is None:
            right, up = ("xyz"[axis] for axis in robot.plane)
            return cls(
                f"first to the right (the world's {right}), then up (the world's {up})",
                (("to the right", "to the left"), ("up", "down")),
                f"{right} right, {up} up",
            )
        origin, ahead = (robot.marker_names[marker] for marker in frame)
        behind = " (being behind counts as well)" if robot.trials.score_progress else ""
        return cls(
            f"first from {origin} toward {ahead}{behind}, then to the left of that line",
            ((f"from {origin} toward {ahead}", f"from {ahead} toward {origin}"), ("to the left", "to the right")),
            f"{origin} at the origin, {ahead} to its right",
        )


def describe_trials(facts: RoundFacts) -> list[str]:
    """Paragraphs and tables: what differs in short, then by trial, and how the head moves."""
    here = facts.here
    lines = [
        *_where(facts), *_when(here), *_other_way(facts), *_from_rest(facts), *_speed(here), *_amplitude(facts),
        *_recoil(here), *_wave(facts), *_heading(here), *_sensors(here),
    ]  # fmt: skip
    short = ["In short:\n" + "\n".join(f"- {line}" for line in lines)] if lines else []
    tables = [_by_trial(facts), *_head_motion(here.trials), *_by_marker(facts), *_static_offset(here), *_in_time(facts)]
    return [*short, *tables]


def trial_label(trial: TrialFacts) -> str:
    """A trial by its name and, where it has one, its frequency."""
    return trial.name if trial.frequency is None else f"{trial.name} ({trial.frequency:.2f} Hz)"


def _where(facts: RoundFacts) -> list[str]:
    here = facts.here
    trial = highest(here.trials, [trial.error for trial in here.trials])
    if trial is None:
        return []
    lines = [f"The worst trial is {trial_label(trial)}: {mm(trial.error)} mm. {_shares(here)}".rstrip()]
    marker = highest(here.markers, [marker.error for marker in here.markers])
    if marker is not None and marker.error is not None:
        line = f"The marker that is farthest off is {marker.name}: {mm(marker.error)} mm on average."
        if marker.offset is not None and math.hypot(*marker.offset) >= max(_MOST_OF * marker.error, _TINY):
            parts = zip(marker.offset, Axes.of(facts.robot).ways, strict=True)
            offset = " and ".join(f"{mm(abs(part))} mm {ways[0] if part >= 0 else ways[1]}" for part, ways in parts)
            line += f" Much of that is constant: on average the simulated one is off by {offset}."
        lines.append(line)
    return lines


def _shares(here: EvaluationFacts) -> str:
    figures = here.figures
    shape, progress, recoil = figures.shape_error, figures.progress_error, figures.recoil_error
    if shape is None or progress is None:
        return ""
    speed = f"Over all trials the difference in progress, so in speed, is {mm(progress)} mm"
    if recoil is not None:
        return (
            f"{speed}, in the shape of the motion {mm(shape)} mm, and in the recoil of the head, its yaw and sway, "
            f"{mm(recoil)} mm."
        )
    most = "speed matters most" if progress > 2 * shape else "the shape matters most"
    verdict = most if progress > 2 * shape or shape > 2 * progress else "both matter"
    return f"{speed} and the difference in the shape of the motion {mm(shape)} mm: {verdict}."


def _when(here: EvaluationFacts) -> list[str]:
    first, second = (mean(halves) for halves in zip(*(trial.halves for trial in here.trials), strict=True))
    if first is None or second is None or max(first, second) < _TINY:
        return []
    verdict = "it is there all the time"
    if second > _CHANGED * first:
        verdict = "it grows with time"
    elif first > _CHANGED * second:
        verdict = "it fades with time, so the beginning matters most"
    return [
        f"Markers are off by {mm(first)} mm in the first half of a trial and by {mm(second)} mm in the second, "
        f"by the mean differences in windows of time: {verdict}."
    ]


def _other_way(facts: RoundFacts) -> list[str]:
    trials = facts.here.trials
    other = [trial for trial in trials if (trial.speed_ratio or 0.0) < 0]
    if all((facts.from_rest.get(trial.name) or 0.0) < 0 for trial in other):  # told there
        return []
    where = "all trials" if len(other) == len(trials) else _labels(other)
    return [f"The simulated robot goes the other way, last marker first, in {where}."]


def _from_rest(facts: RoundFacts) -> list[str]:
    speeds = [(trial, facts.from_rest.get(trial.name)) for trial in facts.here.trials]
    forward = [trial for trial, speed in speeds if speed is not None and speed > 0]
    backward = [trial for trial, speed in speeds if speed is not None and speed <= 0]
    if not forward and not backward:
        return []
    if not forward or not backward:
        way = "forward" if forward else "backward, last marker first,"
        return [f"Started at rest, the simulated robot goes {way} in all trials."]
    return [
        f"Started at rest, the simulated robot goes forward in {_labels(forward)}, and backward, last marker first, in "
        f"{_labels(backward)}. It has two steady motions, and the parameters decide which one it falls into: near that "
        "border a small change looks like a cliff."
    ]


def _speed(here: EvaluationFacts) -> list[str]:
    ratios = [(trial, trial.speed_ratio) for trial in here.trials if trial.speed_ratio is not None]
    if not ratios:
        return []
    groups = {
        "too fast": [trial for trial, ratio in ratios if ratio > 1 + _CLOSE],
        "too slow": [trial for trial, ratio in ratios if ratio < 1 - _CLOSE],
    }
    off = [
        f"{verdict} in {'all trials' if len(group) == len(ratios) else _labels(group)}"
        for verdict, group in groups.items()
        if group
    ]
    fits = len(ratios) - sum(map(len, groups.values()))
    verdict = " and ".join(off) + (", else right" if off and fits else "") or "about right everywhere"
    lines = [f"The simulated speed is {verdict}: {_trend(here, 'speed_ratio')}."]
    real, simulated = here.exponent("real"), here.exponent("simulated")
    if real is not None and simulated is not None:
        verdict = f"so it rises too {'steeply' if simulated > real else 'little'} with frequency"
        lines.append(
            f"Where it goes forward, its speed grows with frequency to the power {simulated:.2f}, the real one to the "
            f"power {real:.2f}: {'which fits' if abs(simulated - real) < _SAME_POWER else verdict}."
        )
    return lines


def _amplitude(facts: RoundFacts) -> list[str]:
    here = facts.here
    ratio = here.ratio("amplitude_ratio")
    if facts.beats:
        last = facts.robot.marker_names[-1]
        if ratio is None:
            return [f"The beat of the last marker, {last}, can't be compared."]
        return [f"The simulated {last}, the last marker, beats {_width(ratio)}: {_trend(here, 'amplitude_ratio')}."]
    ratios = [(marker.ratio, marker.name) for marker in here.markers if marker.ratio is not None]
    if not ratios or ratio is None:
        return []
    (low, least), (high, most) = min(ratios), max(ratios)
    by_marker = f", from {low:.2f} ({least}) to {high:.2f} ({most})" if high - low > _CLOSE else ""
    return [f"The simulated markers move {_width(ratio)}: {_trend(here, 'amplitude_ratio')}{by_marker}."]


def _width(ratio: float) -> str:
    if abs(ratio - 1) <= _CLOSE:
        return "about as wide as in reality"
    if ratio >= 2:
        return f"{ratio:.1f} times as wide as in reality"
    return f"{100 * abs(ratio - 1):.0f} % {'wider' if ratio > 1 else 'narrower'} than in reality"


def _recoil(here: EvaluationFacts) -> list[str]:
    yaw, sway = here.ratio("yaw_ratio"), here.ratio("sway_ratio")
    if yaw is None or sway is None:
        return []
    return [
        f"The simulated head yaws {_width(yaw)}: {_trend(here, 'yaw_ratio')}. It sways {_width(sway)}: "
        f"{_trend(here, 'sway_ratio')}."
    ]


def _wave(facts: RoundFacts) -> list[str]:
    front, real, simulated = facts.here.front, facts.here.lag("real"), facts.here.lag("simulated")
    if front is None or real is None or simulated is None:
        return []
    first, last = facts.robot.marker_names[front], facts.robot.marker_names[-1]
    if abs(simulated - real) <= _SAME_ANGLE:
        verdict = "which fits"
    elif simulated < real:
        verdict = f"so the simulated wave runs too fast: {last} swings too much in step with the rest"
    else:
        verdict = f"so the simulated wave runs too slowly: {last} trails too much"
    return [
        f"The beat runs as a wave from {first} to {last}. {last} is {number(simulated, 0)} deg of a beat behind in "
        f"simulation and {number(real, 0)} deg in reality, {verdict}."
    ]


def _heading(here: EvaluationFacts) -> list[str]:
    heading = here.figures.heading_error
    return (
        [] if heading is None else [f"Its heading turns away from the real one's by {degrees(heading)} deg on average."]
    )


def _sensors(here: EvaluationFacts) -> list[str]:
    return [
        f"Sensor {one.sensor.name} is off by {reading(one.error)} {one.sensor.unit} on average, which adds "
        f"{mm(one.sensor.meters_per_unit * one.error)} mm to the loss."
        for one in here.sensors
        if one.error is not None
    ]


def _trend(here: EvaluationFacts, name: Ratio) -> str:
    """A ratio's median and how it changes from the lowest to the highest frequency that have it."""
    text = f"median ratio {here.ratio(name):.2f}"
    known = [(getattr(trial, name), trial.frequency) for trial in here.trials if trial.frequency is not None]
    known = [(ratio, frequency) for ratio, frequency in known if ratio is not None]
    if len(known) < 2:
        return text
    (low, slowest), (high, fastest) = known[0], known[-1]
    way = "rising" if high > low + _CLOSE else "falling" if high < low - _CLOSE else "nearly the same"
    return f"{text}, {low:.2f} at {slowest:.2f} Hz, {high:.2f} at {fastest:.2f} Hz ({way})"


def _labels(trials: Sequence[TrialFacts]) -> str:
    return ", ".join(trial_label(trial) for trial in trials)


def _by_trial(facts: RoundFacts) -> str:
    """A row per trial."""
    columns = _columns(facts)
    how = " ".join(["A row a trial.", *(text for _, text, _ in columns if text)])
    cells = [[cell(trial) for _, _, cell in columns] for trial in facts.here.trials]
    return f"### Trials\n\n{how}\n\n{table([name for name, _, _ in columns], cells)}"


def _columns(facts: RoundFacts) -> list[tuple[str, str, Callable[[TrialFacts], str]]]:
    """Heading, explanation, and what a cell says of a trial."""
    here, last = facts.here, facts.robot.marker_names[-1]
    columns: list[tuple[str, str, Callable[[TrialFacts], str]]] = []

    def add(heading: str, explanation: str, cell: Callable[[TrialFacts], str]) -> None:
        columns.append((heading, explanation, cell))

    def add_figure(name: str, digits: int = 1) -> None:
        figure = FIGURES[name]
        said, heading = f"`{figure.short}`: {_SAID[name]}", figure.column.replace("°", "deg")
        add(heading, said, lambda trial: number(getattr(trial.figures, name), digits, figure.factor))

    def has(figure: str) -> bool:
        return any(getattr(trial.figures, figure) is not None for trial in here.trials)

    add("trial", "", lambda trial: trial.name)
    beats, windows = has("frequency"), any(trial.edges for trial in here.trials)
    if beats:
        add("Hz", "", lambda trial: number(trial.frequency, 2))
    if windows:
        add("s", "`s`: how long it is.", lambda trial: number(trial.edges[-1] - trial.edges[0], 2))
    add("error mm", "`error`: the trial's part of the loss.", lambda trial: mm(trial.error))
    if here.sensors:
        said = "`markers`: what the markers have of it; then the mean error of each sensor."
        add("markers mm", said, lambda trial: mm(trial.figures.aligned_marker_error))
    for i, one in enumerate(here.sensors):
        add(f"{one.sensor.name} {one.sensor.unit}", "", lambda trial, i=i: reading(trial.sensors[i].error))
    for name in ("progress_error", "shape_error", "recoil_error", "heading_error"):
        if has(name):
            add_figure(name)
    if any(trial.velocity_real is not None for trial in here.trials):
        add("real mm/s", "Speeds are forward, negative is backward.", lambda trial: mm(trial.velocity_real))
        add("sim mm/s", "", lambda trial: mm(trial.figures.velocity_simulated))
        said = "Ratios are simulated / real: a speed ratio of 0.80 means 20 % too slow."
        add("speed ratio", said, lambda trial: number(trial.speed_ratio, 2))
    said = f"`{last} ratio`: amplitude of the last marker; 1.20 means that it beats 20 % wider."
    median = "`amplitude ratio`: the median over the markers that move; 1.20 means 20 % too wide."
    head, said = (f"{last} ratio", said) if beats else ("amplitude ratio", median)
    add(head, said, lambda trial: number(trial.amplitude_ratio, 2))
    if beats:
        lag = "lag" if here.front is None else f"lag {facts.robot.marker_names[here.front]} to {last}"
        said = "`lag`: by how much of a beat (360 deg) the last marker is behind; 0 is a stiff swing."
        add(f"{lag} real deg", "", lambda trial: number(trial.lag("real", here.front), 0))
        add("sim deg", said, lambda trial: number(trial.lag("simulated", here.front), 0))
    add("worst marker", "", _worst_marker)
    if windows:
        said = "`most off at`: when the markers' mean places are farthest off."
        add("most off at s", said, lambda trial: span(trial.worst_window))
    add_figure("left_out_share", 0)
    return columns


def _worst_marker(trial: TrialFacts) -> str:
    worst = highest(trial.markers, [marker.error for marker in trial.markers])
    return NOTHING if worst is None else worst.name


def _head_motion(trials: Sequence[TrialFacts]) -> list[str]:
    """How far the head yaws and sways in each trial, where the whole motion is compared."""
    if not any("yaw_real" in trial.figures.model_fields_set for trial in trials):
        return []
    how = (
        "How far the head swings about its path, at the frequency of the beat: its heading (yaw) and its place to the "
        "side (sway). `phase`: simulated minus real, + means that the simulated one is ahead. `turn`: the slow turn of "
        "the real course, which isn't compared."
    )
    columns = (
        "trial", "Hz", "yaw real deg", "sim deg", "phase deg", "sway real mm", "sim mm", "phase deg", "turn deg/s",
    )  # fmt: skip
    rows: list[list[str]] = []
    for trial in trials:
        known = trial.figures
        yaw = [degrees(known.yaw_real), degrees(known.yaw_simulated), _phase(known.yaw_lag)]
        sway = [mm(known.sway_real), mm(known.sway_simulated), _phase(known.sway_lag)]
        rows.append([trial.name, number(trial.frequency, 2), *yaw, *sway, degrees(known.turn_rate_real)])
    return [f"### Motion of the head\n\n{how}\n\n{table(columns, rows)}"]


def _phase(lag: Known) -> str:
    return degrees(lag, 0, signed=True)


def _by_marker(facts: RoundFacts) -> list[str]:
    here, paper = facts.here, facts.here.figures.protocol == "paper"
    amplitudes = "standard deviation of its place along the line that it moves along most."
    if facts.beats:
        amplitudes = "sideways beat in the frame of the head."
    how = [
        "A row a marker, over all trials. `error`: its mean part of the loss. Amplitudes, real and simulated, are "
        f"medians of the {amplitudes}"
    ]
    columns: list[tuple[str, Callable[[MarkerFacts], str]]] = [
        ("marker", lambda marker: marker.name),
        ("error mm", lambda marker: mm(marker.error)),
        ("real mm", lambda marker: mm(marker.real)),
        ("sim mm", lambda marker: mm(marker.simulated)),
        ("ratio", _marker_ratio),
    ]
    if any(marker.ahead is not None for marker in here.markers):
        columns.append(("phase deg", _marker_phase))
        how.append(
            "`phase`: simulated minus real; +10 means that the simulated marker is 10 deg of a beat ahead of the real "
            "one, -10 that it comes later."
        )
    if any(marker.offset for marker in here.markers):
        columns.append(("offset mm", lambda marker: pair(marker.offset, 1)))
        directions = Axes.of(facts.robot).directions
        how.append(f"`offset`: by how much its mean place differs, simulated minus real: {directions}.")
    how.append("n/a: the marker hardly moves, or was lost.")
    cells = [[cell(marker) for _, cell in columns] for marker in here.markers]
    text = f"### Markers\n\n{' '.join(how)}\n\n{table([name for name, _ in columns], cells)}"
    return [text, *([_PAPER] if paper else []), *_grids(facts)]


def _grids(facts: RoundFacts) -> list[str]:
    """Tables by marker and trial; of many trials the worst."""
    here, shown = facts.here, _worst_trials(facts.here.trials, _GRID)
    if len(shown) < 2 and not facts.beats:
        return []
    which = "" if len(shown) == len(here.trials) else f", the {len(shown)} worst trials"

    def grid(title: str, cell: Callable[[MarkerFacts], str], markers: Sequence[int]) -> list[str]:
        rows = [[facts.robot.marker_names[i], *(cell(trial.markers[i]) for trial in shown)] for i in markers]
        return [f"{title}{which}:\n\n{table(['marker', *(trial.name for trial in shown)], rows)}"] if rows else []

    every = range(len(here.markers))
    several = [marker for trial in shown for marker in trial.markers]
    # under the paper's protocol, without phase and registration, the shape's part says little
    if here.figures.protocol != "paper" and any(marker.shape_error is not None for marker in several):
        title = "Error in shape alone, without the difference in progress, in mm"
        grids = grid(title, lambda marker: mm(marker.shape_error), every)
    else:
        grids = grid("Error by marker and trial, in mm", lambda marker: mm(marker.error), every)
    moving = [i for i in every if here.markers[i].ratio is not None]
    grids += grid("Ratio of amplitudes by marker and trial (1.20: simulated 20 % wider)", _marker_ratio, moving)
    if any(marker.ahead is not None for marker in several):
        grids += grid("Phase by marker and trial, in deg (+: the simulated marker is ahead)", _marker_phase, moving)
    return grids


def _marker_ratio(marker: MarkerFacts) -> str:
    return number(marker.ratio, 2)


def _marker_phase(marker: MarkerFacts) -> str:
    return number(marker.ahead, 0, signed=True)


def _static_offset(here: EvaluationFacts) -> list[str]:
    """On the mean positions in trials that can be registered, which no parameter explains."""
    offset = here.figures.static_offset
    if offset is None:
        return []
    counted = "counts it" if here.figures.protocol == "paper" else "doesn't count it"
    return [
        f"The markers' mean positions differ by {mm(offset, 0)} mm on average: where they were put on the robot, or a "
        f"body that isn't straight at rest. No parameter explains that, and the loss {counted}."
    ]


def _in_time(facts: RoundFacts) -> list[str]:
    trials = facts.here.trials
    shown = [trial for trial in _worst_trials(trials, _IN_TIME) if trial.error is not None and trial.edges]
    if not shown:
        return []
    how = (
        f"Mean differences in windows of time, simulated minus real: {Axes.of(facts.robot).directions}, in mm; of "
        "sensors in their own unit. What swings to and fro within a window cancels out, so a marker may have a large "
        "error and small differences here."
    )
    if len(shown) < len(trials):
        how += f" The {len(shown)} worst trials."
    return [f"### Over time\n\n{how}", *(f"Trial {trial.name}:\n\n{_windows(trial)}" for trial in shown)]


def _windows(trial: TrialFacts) -> str:
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
