"""How simulated trials differ from real ones at the best point so far, in words and tables.

Sentences, columns and tables of what no trial has are left out: a beat, a way that was come, windows of time, sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.formatting import (
    UNKNOWN,
    degrees,
    mm,
    number,
    reading,
    span,
    table,
)
from swim2real.objective.figures import FIGURES

_CLOSE = 0.02  # relative difference that isn't worth a word
_SAME_POWER = 0.1  # the same, of the exponent of frequency
_SAME_ANGLE = 5.0  # deg, the same
_CHANGED = 1.5  # between the halves of a trial: from here on it grows
_MOST_OF = 0.5  # of an error: from here on its constant part is named
_TINY = 1e-4  # m: below it nothing is off
_PARTS = ("progress_error", "shape_error", "recoil_error", "heading_error")  # figures with a column of their own
_LOST = "left_out_share"

Facts = Mapping[str, Any]
Column = tuple[str, Callable[[Facts, Facts], str]]


def describe_trials(facts: Facts) -> list[str]:
    """Paragraphs and tables: what differs in short, then by trial, and how the head moves."""
    return [*_short(facts), _by_trial(facts), *_head_motion(facts)]


def trial_label(trial: Facts) -> str:
    """A trial by its name and, where it has one, its frequency."""
    return trial["name"] if trial["frequency"] is None else f"{trial['name']} ({trial['frequency']:.2f} Hz)"


def _short(facts: Facts) -> list[str]:
    """The main differences in sentences."""
    overall = facts["differences"]
    lines = [
        *_where(facts), *_when(overall), *_other_way(facts), *_from_rest(facts), *_speed(overall), *_amplitude(facts),
        *_recoil(overall), *_wave(overall), *_heading(facts), *_sensors(overall),
    ]  # fmt: skip
    return ["In short:\n" + "\n".join(f"- {line}" for line in lines)] if lines else []


def _where(facts: Facts) -> list[str]:
    overall = facts["differences"]
    if overall["worst_trial"] is None:
        return []
    trial = next(trial for trial in facts["incumbent"]["trials"] if trial["name"] == overall["worst_trial"])
    lines = [f"The worst trial is {trial_label(trial)}: {mm(trial['error'], 1)} mm. {_shares(facts)}".rstrip()]
    if overall["worst_marker"] is not None:
        marker = next(marker for marker in overall["by_marker"] if marker["name"] == overall["worst_marker"])
        line = f"The marker that is farthest off is {marker['name']}: {mm(marker['error'], 1)} mm on average."
        if marker["offset"] is not None and math.hypot(*marker["offset"]) >= max(_MOST_OF * marker["error"], _TINY):
            parts = zip(marker["offset"], facts["compared"]["ways"], strict=True)
            offset = " and ".join(f"{mm(abs(part), 1)} mm {ways[0] if part >= 0 else ways[1]}" for part, ways in parts)
            line += f" Much of that is constant: on average the simulated one is off by {offset}."
        lines.append(line)
    return lines


def _shares(facts: Facts) -> str:
    figures = facts["incumbent"]["figures"]
    shape, progress, recoil = (figures.get(f"{name}_error") for name in ("shape", "progress", "recoil"))
    if shape is None or progress is None:
        return ""
    if recoil is not None:
        return (
            f"Over all trials the difference in progress, so in speed, is {mm(progress, 1)} mm, in the shape of the "
            f"motion {mm(shape, 1)} mm, and in the recoil of the head, its yaw and sway, {mm(recoil, 1)} mm."
        )
    sentence = (
        f"Over all trials the difference in progress, so in speed, is {mm(progress, 1)} mm and the difference in the "
        f"shape of the motion {mm(shape, 1)} mm: "
    )
    if progress > 2 * shape:
        return sentence + "speed matters most."
    return sentence + ("the shape matters most." if shape > 2 * progress else "both matter.")


def _when(overall: Facts) -> list[str]:
    first, second = overall["halves"]
    if first is None or second is None or max(first, second) < _TINY:
        return []
    verdict = "it is there all the time"
    if second > _CHANGED * first:
        verdict = "it grows with time"
    elif first > _CHANGED * second:
        verdict = "it fades with time, so the beginning matters most"
    return [
        f"Markers are off by {mm(first, 1)} mm in the first half of a trial and by {mm(second, 1)} mm in the second, "
        f"by the mean differences in windows of time: {verdict}."
    ]


def _other_way(facts: Facts) -> list[str]:
    names, trials = facts["differences"]["other_way"], facts["incumbent"]["trials"]
    from_rest = facts["incumbent"]["from_rest"]
    if all((from_rest.get(name) or 0.0) < 0 for name in names):  # told there
        return []
    if len(names) == len(trials):
        return ["The simulated robot goes the other way, last marker first, in all trials."]
    labels = [trial_label(trial) for trial in trials if trial["name"] in names]
    return [f"The simulated robot goes the other way, last marker first, in {', '.join(labels)}."]


def _from_rest(facts: Facts) -> list[str]:
    speeds, trials = facts["incumbent"]["from_rest"], facts["incumbent"]["trials"]
    known = [trial for trial in trials if speeds.get(trial["name"]) is not None]
    forward = [trial for trial in known if speeds[trial["name"]] > 0]
    backward = [trial for trial in known if trial not in forward]
    if not known:
        return []
    if not forward or not backward:
        way = "forward" if forward else "backward, last marker first,"
        return [f"Started at rest, the simulated robot goes {way} in all trials."]
    return [
        f"Started at rest, the simulated robot goes forward in {_names(forward)}, and backward, last marker first, in "
        f"{_names(backward)}. It has two steady motions, and the parameters decide which one it falls into: near that "
        "border a small change looks like a cliff."
    ]


def _speed(overall: Facts) -> list[str]:
    rows = [row for row in overall["by_trial"] if row["speed_ratio"] is not None]
    if not rows:
        return []
    groups = {
        "too fast": [row for row in rows if row["speed_ratio"] > 1 + _CLOSE],
        "too slow": [row for row in rows if row["speed_ratio"] < 1 - _CLOSE],
    }
    off = [
        f"{verdict} " + ("in all trials" if len(group) == len(rows) else f"in {_names(group)}")
        for verdict, group in groups.items()
        if group
    ]
    fits = len(rows) - sum(map(len, groups.values()))
    verdict = " and ".join(off) + (", else right" if off and fits else "") or "about right everywhere"
    lines = [f"The simulated speed is {verdict}: {_trend(overall, 'speed_ratio')}."]
    real, simulated = overall["speed_exponent"]["real"], overall["speed_exponent"]["simulated"]
    if real is not None and simulated is not None:
        if abs(simulated - real) < _SAME_POWER:
            verdict = "which fits"
        else:
            verdict = f"so it rises too {'steeply' if simulated > real else 'little'} with frequency"
        lines.append(
            f"Where it goes forward, its speed grows with frequency to the power {simulated:.2f}, the real one to the "
            f"power {real:.2f}: {verdict}."
        )
    return lines


def _amplitude(facts: Facts) -> list[str]:
    overall = facts["differences"]
    ratio = overall["median"]["amplitude_ratio"]
    if facts["robot"]["beats"]:
        last = facts["robot"]["markers"][-1]
        if ratio is None:
            return [f"The beat of the last marker, {last}, can't be compared."]
        return [f"The simulated {last}, the last marker, beats {_width(ratio)}: {_trend(overall, 'amplitude_ratio')}."]
    ratios = [
        (row["amplitude_ratio"], row["name"]) for row in overall["by_marker"] if row["amplitude_ratio"] is not None
    ]
    if not ratios or ratio is None:
        return []
    (low, least), (high, most) = min(ratios), max(ratios)
    by_marker = f", from {low:.2f} ({least}) to {high:.2f} ({most})" if high - low > _CLOSE else ""
    return [f"The simulated markers move {_width(ratio)}: {_trend(overall, 'amplitude_ratio')}{by_marker}."]


def _width(ratio: float) -> str:
    if abs(ratio - 1) <= _CLOSE:
        return "about as wide as in reality"
    if ratio >= 2:
        return f"{ratio:.1f} times as wide as in reality"
    return f"{100 * abs(ratio - 1):.0f} % {'wider' if ratio > 1 else 'narrower'} than in reality"


def _recoil(overall: Facts) -> list[str]:
    yaw, sway = overall["median"]["yaw_ratio"], overall["median"]["sway_ratio"]
    if yaw is None or sway is None:
        return []
    return [
        f"The simulated head yaws {_width(yaw)}: {_trend(overall, 'yaw_ratio')}. It sways {_width(sway)}: "
        f"{_trend(overall, 'sway_ratio')}."
    ]


def _wave(overall: Facts) -> list[str]:
    real, simulated = overall["median"]["lag_real_deg"], overall["median"]["lag_simulated_deg"]
    if real is None or simulated is None:
        return []
    if abs(simulated - real) <= _SAME_ANGLE:
        verdict = "which fits"
    elif simulated < real:
        verdict = f"so the simulated wave runs too fast: {overall['lag_to']} swings too much in step with the rest"
    else:
        verdict = f"so the simulated wave runs too slowly: {overall['lag_to']} trails too much"
    return [
        f"The beat runs as a wave from {overall['lag_from']} to {overall['lag_to']}. {overall['lag_to']} is "
        f"{number(simulated)} deg of a beat behind in simulation and {number(real)} deg in reality, {verdict}."
    ]


def _heading(facts: Facts) -> list[str]:
    heading = facts["incumbent"]["figures"].get("heading_error")
    if heading is None:
        return []
    return [f"Its heading turns away from the real one's by {degrees(heading)} deg on average."]


def _sensors(overall: Facts) -> list[str]:
    return [
        f"Sensor {sensor['name']} is off by {reading(sensor['error'])} {sensor['unit']} on average, which adds "
        f"{mm(sensor['meters_per_unit'] * sensor['error'], 1)} mm to the loss."
        for sensor in overall["sensors"]
        if sensor["error"] is not None
    ]


def _trend(overall: Facts, key: str) -> str:
    """A ratio's median and how it changes with frequency."""
    trend, median = overall["trend"][key], f"median ratio {overall['median'][key]:.2f}"
    if trend is None:
        return median
    low, high = trend["low"], trend["high"]
    ends = f"{low:.2f} at {trend['low_frequency']:.2f} Hz, {high:.2f} at {trend['high_frequency']:.2f} Hz"
    way = "rising" if high > low + _CLOSE else "falling" if high < low - _CLOSE else "nearly the same"
    return f"{median}, {ends} ({way})"


def _names(rows: Sequence[Facts]) -> str:
    return ", ".join(trial_label(row) for row in rows)


def _by_trial(facts: Facts) -> str:
    """A row a trial."""
    trials, rows = facts["incumbent"]["trials"], facts["differences"]["by_trial"]
    columns = _trial_columns(facts)
    names = [name for name, _ in columns]
    cells = [[cell(trial, row) for _, cell in columns] for trial, row in zip(trials, rows, strict=True)]
    return f"### Trials\n\n{_trial_columns_explained(facts, names)}\n\n{table(names, cells)}"


def _trial_columns(facts: Facts) -> list[Column]:
    overall, trials = facts["differences"], facts["incumbent"]["trials"]
    has = {name for trial in trials for name, figure in trial["figures"].items() if figure is not None}
    columns: list[Column] = [("trial", lambda trial, row: trial["name"])]
    beats = any(trial["frequency"] is not None for trial in trials)
    if beats:
        columns.append(("Hz", lambda trial, row: number(trial["frequency"], 2)))
    if windows := any(trial["edges"] for trial in trials):
        columns.append(("s", lambda trial, row: number(trial["edges"][-1] - trial["edges"][0], 2)))
    columns.append(("error mm", lambda trial, row: mm(trial["error"], 1)))
    if overall["sensors"]:
        columns.append(("markers mm", lambda trial, row: mm(trial["figures"].get("aligned_marker_error"), 1)))
    for i, sensor in enumerate(overall["sensors"]):
        name = f"{sensor['name']} {sensor['unit']}"
        columns.append((name, lambda trial, row, i=i: reading(trial["sensors"][i]["error"])))
    columns += [
        (_column(name), lambda trial, row, name=name: _shown(name, trial["figures"].get(name)))
        for name in _PARTS
        if name in has
    ]
    if any(trial["velocity"]["real"] is not None for trial in trials):
        columns += [
            ("real mm/s", lambda trial, row: mm(trial["velocity"]["real"], 1)),
            ("sim mm/s", lambda trial, row: mm(trial["velocity"]["simulated"], 1)),
            ("speed ratio", lambda trial, row: number(row["speed_ratio"], 2)),
        ]
    last = f"{facts['robot']['markers'][-1]} " if beats else "amplitude "
    columns.append((f"{last}ratio", lambda trial, row: number(row["amplitude_ratio"], 2)))
    if beats:
        lag = f"lag {overall['lag_from']} to {overall['lag_to']}" if overall["lag_from"] else "lag"
        columns += [
            (f"{lag} real deg", lambda trial, row: number(row["lag_real_deg"])),
            ("sim deg", lambda trial, row: number(row["lag_simulated_deg"])),
        ]
    columns.append(("worst marker", lambda trial, row: row["worst_marker"] or UNKNOWN))
    if windows:
        columns.append(("most off at s", lambda trial, row: span(row["worst_time"])))
    return [*columns, (_column(_LOST), lambda trial, row: _shown(_LOST, trial["figures"].get(_LOST)))]


def _column(name: str) -> str:
    """Heading of a figure's column, in plain letters."""
    return FIGURES[name].column.replace("°", "deg")


def _shown(name: str, figure: float | None) -> str:
    return number(figure, FIGURES[name].digits or 0, FIGURES[name].factor)


def _trial_columns_explained(facts: Facts, names: Sequence[str]) -> str:
    last = facts["robot"]["markers"][-1]
    parts = {
        "s": "`s`: how long it is.",
        "error mm": "`error`: the trial's part of the loss.",
        "markers mm": "`markers`: what the markers have of it; then the mean error of each sensor.",
        **{_column(name): f"`{FIGURES[name].short}`: {FIGURES[name].meaning}" for name in (*_PARTS, _LOST)},
        "real mm/s": "Speeds are forward, negative is backward.",
        "speed ratio": "Ratios are simulated / real: a speed ratio of 0.80 means 20 % too slow.",
        f"{last} ratio": f"`{last} ratio`: amplitude of the last marker; 1.20 means that it beats 20 % wider.",
        "amplitude ratio": "`amplitude ratio`: the median over the markers that move; 1.20 means 20 % too wide.",
        "sim deg": "`lag`: by how much of a beat (360 deg) the last marker is behind; 0 is a stiff swing.",
        "most off at s": "`most off at`: when the markers' mean places are farthest off.",
    }
    return " ".join(["A row a trial.", *(text for name, text in parts.items() if name in names)])


def _head_motion(facts: Facts) -> list[str]:
    """How far the head yaws and sways in each trial, where the whole motion is compared."""
    trials = facts["incumbent"]["trials"]
    if not any("yaw_real" in trial["figures"] for trial in trials):
        return []
    how = (
        "How far the head swings about its path, at the frequency of the beat: its heading (yaw) and its place to the "
        "side (sway). `phase`: simulated minus real, + means that the simulated one is ahead. `turn`: the slow turn of "
        "the real course, which isn't compared."
    )
    columns = (
        "trial", "Hz", "yaw real deg", "sim deg", "phase deg", "sway real mm", "sim mm", "phase deg", "turn deg/s",
    )  # fmt: skip
    rows = [
        [
            trial["name"], number(trial["frequency"], 2), *_swing(trial["figures"], "yaw", degrees),
            *_swing(trial["figures"], "sway", lambda size: mm(size, 1)),
            degrees(trial["figures"].get("turn_rate_real")),
        ]
        for trial in trials
    ]  # fmt: skip
    return [f"### Motion of the head\n\n{how}\n\n{table(columns, rows)}"]


def _swing(figures: Facts, name: str, shown: Callable[[float | None], str]) -> list[str]:
    """Its amplitude, real and simulated, and the difference of their phases."""
    lag = figures.get(f"{name}_lag")
    phase = number(lag, 0, 180 / math.pi, signed=True)
    return [shown(figures.get(f"{name}_real")), shown(figures.get(f"{name}_simulated")), phase]
