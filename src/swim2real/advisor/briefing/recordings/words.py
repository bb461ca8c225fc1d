"""How a playback differs from its recording at the best point so far, in words and tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from swim2real.advisor.briefing.recordings.differences import off_by_window
from swim2real.advisor.briefing.tables import UNKNOWN, mm, number, table, value

_CLOSE = 0.02  # relative difference that isn't worth a word
_CHANGED = 1.5  # between the halves of a trial: from here on it grows
_MOST_OF = 0.5  # of an error: from here on its constant part is named
_TINY = 1e-4  # m: below it nothing is off
_LARGE = 20e-3  # m: from here on differences are told in whole millimeters
_GRID = 8  # trials that tables by marker and trial have
_IN_TIME = 3  # trials whose differences are told window by window

Facts = Mapping[str, Any]


def recording_details(facts: Facts) -> list[str]:
    """What differs in short, then tables by trial, by marker and over time."""
    return [*_short(facts), _by_trial(facts), *_by_marker(facts), *_in_time(facts)]


def _short(facts: Facts) -> list[str]:
    """The main differences in sentences."""
    found = facts["differences"]
    lines = [*_where(facts), *_when(found), *_amplitude(found), *_travel(facts), *_sensors(found)]
    return ["In short:\n" + "\n".join(f"- {line}" for line in lines)] if lines else []


def _where(facts: Facts) -> list[str]:
    found = facts["differences"]
    if found["worst_trial"] is None:
        return []
    trial = next(one for one in facts["incumbent"]["trials"] if one["name"] == found["worst_trial"])
    lines = [f"The worst trial is {trial['name']}: {mm(trial['error'], 1)} mm."]
    if found["worst_marker"] is not None:
        marker = next(one for one in found["by_marker"] if one["name"] == found["worst_marker"])
        line = f"The marker that is farthest off is {marker['name']}: {mm(marker['error'], 1)} mm on average."
        if marker["offset"] is not None and math.hypot(*marker["offset"]) >= max(_MOST_OF * marker["error"], _TINY):
            parts = zip(marker["offset"], facts["compared"]["ways"], strict=True)
            offset = " and ".join(f"{mm(abs(part), 1)} mm {ways[0] if part >= 0 else ways[1]}" for part, ways in parts)
            line += f" Much of that is constant: on average the simulated one is off by {offset}."
        lines.append(line)
    return lines


def _when(found: Facts) -> list[str]:
    first, second = found["halves"]
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


def _amplitude(found: Facts) -> list[str]:
    ratios = [(row["amplitude_ratio"], row["name"]) for row in found["by_marker"] if row["amplitude_ratio"] is not None]
    middle = found["median"]["amplitude_ratio"]
    if not ratios or middle is None:
        return []
    size = "about as far as the real ones"
    if abs(middle - 1) > _CLOSE:
        size = f"{100 * abs(middle - 1):.0f} % {'farther' if middle > 1 else 'less far'} than the real ones"
    (low, least), (high, most) = min(ratios), max(ratios)
    ends = f", from {low:.2f} ({least}) to {high:.2f} ({most})" if high - low > _CLOSE else ""
    return [f"The simulated markers move {size}: median ratio of amplitudes {middle:.2f}{ends}."]


def _travel(facts: Facts) -> list[str]:
    found, figures = facts["differences"], facts["incumbent"]["figures"]
    lines: list[str] = []
    if found["other_way"]:
        lines.append(f"The simulated robot goes the other way in {', '.join(found['other_way'])}.")
    markers, shape = figures.get("aligned_marker_error"), figures.get("shape_error")
    if facts["compared"]["travels"] and markers is not None and shape is not None:
        lines.append(f"Of the markers' {mm(markers, 1)} mm, {mm(shape, 1)} mm are left without how far it has come.")
    ratio = found["median"]["speed_ratio"]
    if ratio is not None:
        verdict = "about right"
        if abs(ratio - 1) > _CLOSE:
            verdict = "too high" if ratio > 1 else "too low"
        lines.append(f"The simulated speed is {verdict}: median ratio {ratio:.2f}.")
    heading = figures.get("heading_error")
    if heading is not None:
        lines.append(f"Its heading turns away from the real one's by {_degrees(heading)} deg on average.")
    return lines


def _sensors(found: Facts) -> list[str]:
    return [
        f"Sensor {one['name']} is off by {value(one['error'], 3)} {one['unit']} on average, which adds "
        f"{mm(one['worth'] * one['error'], 1)} mm to the loss."
        for one in found["sensors"]
        if one["error"] is not None
    ]


def _by_trial(facts: Facts) -> str:
    """A row a trial. Columns of what no trial has are left out."""
    found, trials = facts["differences"], facts["incumbent"]["trials"]
    pairs = list(zip(trials, found["by_trial"], strict=True))
    columns: list[tuple[str, Callable[[Facts, Facts], str]]] = [
        ("trial", lambda trial, row: trial["name"]),
        ("s", lambda trial, row: number(trial["edges"][-1] - trial["edges"][0], 2)),
        ("error mm", lambda trial, row: mm(trial["error"], 1)),
    ]
    if found["sensors"]:
        columns.append(("markers mm", lambda trial, row: mm(trial["figures"].get("aligned_marker_error"), 1)))
    for i, one in enumerate(found["sensors"]):
        columns.append((f"{one['name']} {one['unit']}", lambda trial, row, i=i: _reading(trial["sensors"][i]["error"])))
    if any("shape_error" in trial["figures"] for trial in trials):
        columns.append(("shape mm", lambda trial, row: mm(trial["figures"].get("shape_error"), 1)))
        columns.append(("heading deg", lambda trial, row: _degrees(trial["figures"].get("heading_error"))))
    if any(trial["velocity"]["real"] is not None for trial in trials):
        columns += [
            ("real mm/s", lambda trial, row: mm(trial["velocity"]["real"], 1)),
            ("sim mm/s", lambda trial, row: mm(trial["velocity"]["simulated"], 1)),
            ("speed ratio", lambda trial, row: number(row["speed_ratio"], 2)),
        ]
    columns += [
        ("amplitude ratio", lambda trial, row: number(row["amplitude_ratio"], 2)),
        ("worst marker", lambda trial, row: row["worst_marker"] or UNKNOWN),
        ("most off at s", lambda trial, row: _span(row["worst_time"])),
        ("lost %", lambda trial, row: number(trial["figures"].get("left_out_share"), 0, 100)),
    ]
    how = [
        "A row a trial. `s`: how long it is; `error`: the trial's part of the loss",
        "; `markers`: what the markers have of it; then the mean error of each sensor" if found["sensors"] else "",
        ". Ratios are simulated / real: 1.20 means 20 % too much. `amplitude ratio`: the median over the markers that "
        "move. `most off at`: when the markers' mean places are farthest off. `lost`: share of the real marker "
        "positions that couldn't be used; distrust rows with much of it.",
    ]
    names = [name for name, _ in columns]
    if "shape mm" in names:
        how.append(
            " `shape`: what differs in the frame, without the way that it has come; `heading`: how far it turns away."
        )
    if "real mm/s" in names:
        how.append(" Speeds are forward, negative is backward.")
    rows = [[cell(trial, row) for _, cell in columns] for trial, row in pairs]
    return f"### Trials\n\n{''.join(how)}\n\n{table(names, rows)}"


def _by_marker(facts: Facts) -> list[str]:
    found = facts["differences"]
    rows = [
        [
            row["name"], mm(row["error"], 1), mm(row["amplitude_real"], 1), mm(row["amplitude_simulated"], 1),
            number(row["amplitude_ratio"], 2), _pair(row["offset"], 1),
        ]
        for row in found["by_marker"]
    ]  # fmt: skip
    how = (
        "A row a marker, over all trials. `error`: its mean distance. Amplitude: the standard deviation of its place "
        "along the line that it moves along most, real and simulated, medians, and their ratio. `offset`: by how much "
        f"its mean place differs, simulated minus real: {facts['compared']['axes']}. n/a: the marker hardly moves, or "
        "was lost."
    )
    headings = ("marker", "error mm", "real mm", "sim mm", "ratio", "offset mm")
    parts = [f"### Markers\n\n{how}\n\n{table(headings, rows)}"]
    shown = _worst_trials(facts, _GRID)
    names = ("marker", *(trial["name"] for trial in shown))
    which = "" if len(shown) == len(facts["incumbent"]["trials"]) else f", the {len(shown)} worst trials"
    if len(shown) > 1:
        errors = _grid(shown, lambda one: mm(one["error"], 1))
        parts.append(f"Error by marker and trial, in mm{which}:\n\n{table(names, errors)}")
        ratios = _grid(shown, lambda one: number(one["amplitude"]["ratio"], 2))
        parts.append(f"Ratio of amplitudes by marker and trial{which}:\n\n{table(names, ratios)}")
    return parts


def _in_time(facts: Facts) -> list[str]:
    shown = [trial for trial in _worst_trials(facts, _IN_TIME) if trial["error"] is not None]
    if not shown:
        return []
    how = (
        f"Mean differences in windows of time, simulated minus real: {facts['compared']['axes']}, in mm; of sensors in "
        "their own unit. What swings to and fro within a window cancels out, so a marker may have a large error and "
        "small differences here."
    )
    if len(shown) < len(facts["incumbent"]["trials"]):
        how += f" The {len(shown)} worst trials."
    return [f"### Over time\n\n{how}", *(f"Trial {trial['name']}:\n\n{_windows(trial)}" for trial in shown)]


def _windows(trial: Facts) -> str:
    digits = 0 if max((size for size in off_by_window(trial) if size is not None), default=0.0) >= _LARGE else 1
    edges = trial["edges"]
    columns = ["marker", *(_span(list(pair)) + " s" for pair in pairwise(edges))]
    rows = [[one["name"], *(_pair(vector, digits) for vector in one["windows"])] for one in trial["markers"]]
    rows += [
        [f"{one['name']} {one['unit']}", *(_reading(mean, signed=True) for mean in one["windows"])]
        for one in trial["sensors"]
        if one["windows"]
    ]
    return table(columns, rows)


def _worst_trials(facts: Facts, most: int) -> list[Facts]:
    """The worst ones, in their own order."""
    trials = facts["incumbent"]["trials"]
    worst = sorted(trials, key=lambda trial: -(math.inf if trial["error"] is None else trial["error"]))[:most]
    return [trial for trial in trials if trial in worst]


def _grid(trials: Sequence[Facts], cell: Callable[[Facts], str]) -> list[list[str]]:
    markers = range(len(trials[0]["markers"]))
    return [[trials[0]["markers"][i]["name"], *(cell(trial["markers"][i]) for trial in trials)] for i in markers]


def _pair(vector: Sequence[float] | None, digits: int) -> str:
    return UNKNOWN if vector is None else ", ".join(mm(part, digits, signed=True) for part in vector)


def _span(times: Sequence[float] | None) -> str:
    return UNKNOWN if times is None else f"{times[0]:.2f} to {times[1]:.2f}"


def _degrees(angle: float | None) -> str:
    return number(angle, 1, 180 / math.pi)


def _reading(reading: float | None, signed: bool = False) -> str:
    if reading is None:
        return UNKNOWN
    return f"{'+' if signed and reading > 0 else ''}{value(reading, 3)}"
