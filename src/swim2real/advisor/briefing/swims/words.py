"""How the simulated robot swims at the best point so far, compared with the real one, in words and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.tables import mm, number, table

_CLOSE = 0.02  # relative difference that isn't worth a word
_SAME_POWER = 0.1  # likewise, of the exponent of frequency
_SAME_ANGLE = 5.0  # deg, likewise
_PAPER = (
    "The simulated motor turns at the frequency that was asked of the real one, which may turn at another, and starts "
    "at angle 0, so no phase is compared."
)

Facts = Mapping[str, Any]


def swim_details(facts: Facts) -> list[str]:
    """What differs in short, then tables by trial and by marker."""
    return [*_short(facts), _by_trial(facts), *_by_marker(facts)]


def swim_called(trial: Facts) -> str:
    """A swim by its name and its frequency."""
    return f"{trial['name']} ({trial['frequency']:.2f} Hz)"


def _short(facts: Facts) -> list[str]:
    """The main differences in sentences."""
    found, by_name = facts["differences"], {trial["name"]: trial for trial in facts["incumbent"]["trials"]}
    lines: list[str] = []
    if found["worst_trial"]:
        worst = by_name[found["worst_trial"]]
        lines.append(f"The worst trial is {swim_called(worst)}: {mm(worst['error'], 1)} mm. {_shares(facts)}".rstrip())
    if found["backward"]:
        rows = [by_name[name] for name in found["backward"]]
        where = "all frequencies" if len(rows) == len(by_name) else _frequencies(rows)
        lines.append(f"The simulated robot swims backward, last marker first, at {where}.")
    lines.extend(_speed(found))
    lines.extend(_amplitude(found, facts["robot"]["markers"][-1]))
    lines.extend(_wave(found))
    return ["In short:\n" + "\n".join(f"- {line}" for line in lines)] if lines else []


def _shares(facts: Facts) -> str:
    figures = facts["incumbent"]["figures"]
    shape, progress = figures.get("shape_error"), figures.get("progress_error")
    if shape is None or progress is None:
        return ""
    sentence = (
        f"Over all trials the difference in progress, so in speed, is {mm(progress, 1)} mm and the difference in the "
        f"shape of the beat {mm(shape, 1)} mm: "
    )
    if progress > 2 * shape:
        return sentence + "speed matters most."
    return sentence + ("the beat matters most." if shape > 2 * progress else "both matter.")


def _speed(found: Facts) -> list[str]:
    rows = [row for row in found["by_trial"] if row["speed_ratio"] is not None]
    if not rows:
        return []
    groups = {
        "too fast": [row for row in rows if row["speed_ratio"] > 1 + _CLOSE],
        "too slow": [row for row in rows if row["speed_ratio"] < 1 - _CLOSE],
    }
    found_off = [
        f"{verdict} at " + ("all frequencies" if len(group) == len(rows) else _frequencies(group))
        for verdict, group in groups.items()
        if group
    ]
    fits = len(rows) - sum(map(len, groups.values()))
    verdict = " and ".join(found_off) + (", else right" if found_off and fits else "") or "about right everywhere"
    lines = [f"The simulated speed is {verdict}: {_trend(found, 'speed_ratio')}."]
    real, simulated = found["speed_exponent"]["real"], found["speed_exponent"]["simulated"]
    if real is not None and simulated is not None:
        if abs(simulated - real) < _SAME_POWER:
            verdict = "which fits"
        else:
            verdict = f"so it rises too {'steeply' if simulated > real else 'little'} with frequency"
        lines.append(
            f"Where it swims forward, its speed grows with frequency to the power {simulated:.2f}, the real one to the "
            f"power {real:.2f}: {verdict}."
        )
    return lines


def _amplitude(found: Facts, last: str) -> list[str]:
    ratio = found["median"]["amplitude_ratio"]
    if ratio is None:
        return [f"The beat of the last marker, {last}, can't be compared."]
    size = f"{100 * abs(ratio - 1):.0f} % {'wider' if ratio > 1 else 'narrower'} than"
    size = f"{ratio:.1f} times as wide as" if ratio >= 2 else size
    verdict = "about as wide as" if abs(ratio - 1) <= _CLOSE else size
    return [f"The simulated {last}, the last marker, beats {verdict} the real one: {_trend(found, 'amplitude_ratio')}."]


def _wave(found: Facts) -> list[str]:
    real, simulated = found["median"]["lag_real_deg"], found["median"]["lag_simulated_deg"]
    if real is None or simulated is None:
        return []
    if abs(simulated - real) <= _SAME_ANGLE:
        verdict = "which fits"
    elif simulated < real:
        verdict = f"so the simulated wave runs too fast: {found['lag_to']} swings too much in step with the rest"
    else:
        verdict = f"so the simulated wave runs too slowly: {found['lag_to']} trails too much"
    return [
        f"The beat runs as a wave from {found['lag_from']} to {found['lag_to']}. {found['lag_to']} is "
        f"{number(simulated)} deg of a beat behind in simulation and {number(real)} deg in reality, {verdict}."
    ]


def _trend(found: Facts, key: str) -> str:
    """A ratio's median and how it changes with frequency."""
    trend, median = found["trend"][key], f"median ratio {found['median'][key]:.2f}"
    if trend is None:
        return median
    low, high = trend["low"], trend["high"]
    ends = f"{low:.2f} at {trend['low_frequency']:.2f} Hz, {high:.2f} at {trend['high_frequency']:.2f} Hz"
    way = "rising" if high > low + _CLOSE else "falling" if high < low - _CLOSE else "nearly the same"
    return f"{median}, {ends} ({way})"


def _frequencies(rows: Sequence[Facts]) -> str:
    return ", ".join(f"{row['frequency']:.2f}" for row in rows) + " Hz"


def _by_trial(facts: Facts) -> str:
    found = facts["differences"]
    rows: list[list[str]] = []
    for trial, ratios in zip(facts["incumbent"]["trials"], found["by_trial"], strict=True):
        figures, speed = trial["figures"], trial["velocity"]
        rows.append(
            [
                trial["name"], number(trial["frequency"], 2), mm(trial["error"], 1),
                mm(figures.get("progress_error"), 1), mm(figures.get("shape_error"), 1),
                mm(speed["real"]), mm(speed["simulated"]), number(ratios["speed_ratio"], 2),
                number(ratios["amplitude_ratio"], 2), number(ratios["lag_real_deg"]),
                number(ratios["lag_simulated_deg"]), number(figures.get("left_out_share"), 0, 100),
            ]
        )  # fmt: skip
    last = facts["robot"]["markers"][-1]
    lag = f"lag {found['lag_from']} to {found['lag_to']}" if found["lag_from"] else "lag"
    columns = (
        "trial", "Hz", "error mm", "progress mm", "shape mm", "real mm/s", "sim mm/s", "speed ratio",
        f"{last} ratio", f"{lag} real deg", "sim deg", "lost %",
    )  # fmt: skip
    how = (
        "A row a trial. `error`: the trial's part of the loss; `progress`: how far the simulated robot is ahead or "
        "behind on average; `shape`: what differs in the body's own motion. Speeds are forward, negative is backward. "
        "Ratios are simulated / real: a speed ratio of 0.80 means 20 % too slow. "
        f"`{last} ratio`: sideways amplitude of the last marker, 1.20 means that the simulated one beats 20 % wider. "
        "`lag`: by how much of a beat (360 deg) the last marker is behind; larger is a slower wave, 0 a stiff swing. "
        "`lost`: share of the real marker positions that couldn't be used; distrust rows with much of it."
    )
    return f"### Trials\n\n{how}\n\n{table(columns, rows)}"


def _by_marker(facts: Facts) -> list[str]:
    trials, found = facts["incumbent"]["trials"], facts["differences"]
    beating = [i for i, row in enumerate(found["by_marker"]) if row["amplitude_ratio"] is not None]
    rows = [
        [
            row["name"], mm(row["amplitude_real"]), mm(row["amplitude_simulated"]), number(row["amplitude_ratio"], 2),
            number(row["phase_difference_deg"], 0, signed=True), mm(row["error"], 1),
        ]
        for row in found["by_marker"]
    ]  # fmt: skip
    headings = ("marker", "real mm", "sim mm", "ratio", "phase deg", "error mm")
    how = (
        "A row a marker, head first; medians over the trials. Amplitude of the sideways beat in the frame of the first "
        "two markers, real and simulated, and their ratio. `phase`: simulated minus real; +10 means that the simulated "
        "marker is 10 deg of a beat ahead of the real one, -10 that it comes later. `error`: the marker's mean part of "
        "the loss. n/a: the marker hardly moves sideways (less than 1 mm) on one side, or was lost."
    )
    parts = [f"### Markers\n\n{how}\n\n{table(headings, rows)}"]
    if facts["compared"]["protocol"] == "paper":
        parts.append(_PAPER)
    names = ("marker", *(f"{trial['frequency']:.2f} Hz" for trial in trials))
    if beating:
        ratios = _grid(trials, beating, lambda one: number(one["amplitude"]["ratio"], 2))
        parts.append(
            f"Amplitude ratio by marker and trial (1.20: simulated beats 20 % wider):\n\n{table(names, ratios)}"
        )
    if beating and facts["compared"]["protocol"] == "aligned":
        phases = _grid(trials, beating, lambda one: number(one["phase_difference_deg"], 0, signed=True))
        parts.append(f"Phase by marker and trial, in deg (+: the simulated marker is ahead):\n\n{table(names, phases)}")
    kind, what = ("shape_error", "Error in shape alone, without the difference in progress")
    if facts["compared"]["protocol"] == "paper":  # without phase and registration, the shape's part says little
        kind, what = ("error", "Error by marker and trial")
    errors = _grid(trials, range(len(found["by_marker"])), lambda one: mm(one[kind], 1))
    parts.append(f"{what}, in mm:\n\n{table(names, errors)}")
    return [*parts, _rest(facts)]


def _grid(trials: Sequence[Facts], markers: Sequence[int], cell: Any) -> list[list[str]]:
    return [[trials[0]["markers"][i]["name"], *(cell(trial["markers"][i]) for trial in trials)] for i in markers]


def _rest(facts: Facts) -> str:
    """On the mean sideways positions, which no parameter explains."""
    counted = "counts it" if facts["compared"]["protocol"] == "paper" else "doesn't count it"
    offset = facts["incumbent"]["figures"].get("static_offset")
    size = f" by {mm(offset)} mm on average" if offset is not None else ""
    return (
        f"The markers' mean positions differ{size}: where they were put on the robot, or a body that isn't straight at "
        f"rest. No parameter explains that, and the loss {counted}."
    )
