"""How simulated markers differ from real ones at the best point so far: over all trials, by trial, and over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from swim2real.advisor.briefing.differences import off_by_window
from swim2real.advisor.briefing.formatting import mm, number, pair, reading, span, table

_LARGE = 20e-3  # m: from here on differences are told in whole millimeters
_GRID = 8  # trials that tables by marker and trial have
_IN_TIME = 3  # trials whose differences are told window by window
_PAPER = (
    "The simulated motor turns at the frequency that was asked of the real one, which may turn at another, and starts "
    "at angle 0, so no phase is compared."
)

Facts = Mapping[str, Any]


def describe_markers(facts: Facts) -> list[str]:
    """Paragraphs and tables: what differs by marker, what no parameter explains, and what differs over time."""
    return [*_by_marker(facts), *_static_offset(facts), *_in_time(facts)]


def _by_marker(facts: Facts) -> list[str]:
    trials, rows, protocol = facts["incumbent"]["trials"], facts["differences"]["by_marker"], facts["compared"]
    has = {key for row in rows for key, figure in row.items() if figure is not None}
    beats = facts["robot"]["beats"]
    columns: list[tuple[str, Callable[[Facts], str]]] = [
        ("marker", lambda row: row["name"]),
        ("error mm", lambda row: mm(row["error"], 1)),
        ("real mm", lambda row: mm(row["amplitude_real"], 1)),
        ("sim mm", lambda row: mm(row["amplitude_simulated"], 1)),
        ("ratio", lambda row: number(row["amplitude_ratio"], 2)),
    ]
    how = [
        "A row a marker, over all trials. `error`: its mean part of the loss. Amplitudes, real and simulated, are "
        "medians of the",
        "sideways beat in the frame of the head."
        if beats
        else "standard deviation of its place along the line that it moves along most.",
    ]
    if "phase_difference_deg" in has:
        columns.append(("phase deg", lambda row: number(row["phase_difference_deg"], 0, signed=True)))
        how.append(
            "`phase`: simulated minus real; +10 means that the simulated marker is 10 deg of a beat ahead of the real "
            "one, -10 that it comes later."
        )
    if any("offset" in marker and marker["offset"] for trial in trials for marker in trial["markers"]):
        columns.append(("offset mm", lambda row: pair(row["offset"], 1)))
        how.append(f"`offset`: by how much its mean place differs, simulated minus real: {protocol['axes']}.")
    how.append("n/a: the marker hardly moves, or was lost.")
    cells = [[cell(row) for _, cell in columns] for row in rows]
    parts = [f"### Markers\n\n{' '.join(how)}\n\n{table([name for name, _ in columns], cells)}"]
    if protocol["protocol"] == "paper":
        parts.append(_PAPER)
    return [*parts, *_grids(facts)]


def _grids(facts: Facts) -> list[str]:
    """Tables by marker and trial; of many trials the worst."""
    trials = facts["incumbent"]["trials"]
    shown = _worst_trials(facts, _GRID)
    if len(shown) < 2 and not facts["robot"]["beats"]:
        return []
    which = "" if len(shown) == len(trials) else f", the {len(shown)} worst trials"
    names = ("marker", *(trial["name"] for trial in shown))
    moving = [i for i, row in enumerate(facts["differences"]["by_marker"]) if row["amplitude_ratio"] is not None]

    def grid(title: str, cell: Callable[[Facts], str], markers: Sequence[int]) -> list[str]:
        rows = [[shown[0]["markers"][i]["name"], *(cell(trial["markers"][i]) for trial in shown)] for i in markers]
        return [f"{title}{which}:\n\n{table(names, rows)}"] if rows else []

    every = range(len(facts["robot"]["markers"]))
    # under the paper's protocol, without phase and registration, the shape's part says little
    has_shape = any(marker["shape_error"] is not None for trial in shown for marker in trial["markers"])
    kind, title = "error", "Error by marker and trial, in mm"
    if has_shape and facts["compared"]["protocol"] != "paper":
        kind, title = "shape_error", "Error in shape alone, without the difference in progress, in mm"
    grids = grid(title, lambda marker: mm(marker[kind], 1), every)
    grids += grid("Ratio of amplitudes by marker and trial (1.20: simulated 20 % wider)", _amplitude_ratio, moving)
    if any(marker["phase_difference_deg"] is not None for trial in shown for marker in trial["markers"]):
        grids += grid("Phase by marker and trial, in deg (+: the simulated marker is ahead)", _phase, moving)
    return grids


def _amplitude_ratio(marker: Facts) -> str:
    return number(marker["amplitude"]["ratio"], 2)


def _phase(marker: Facts) -> str:
    return number(marker["phase_difference_deg"], 0, signed=True)


def _static_offset(facts: Facts) -> list[str]:
    """On the mean positions in trials that can be registered, which no parameter explains."""
    offset = facts["incumbent"]["figures"].get("static_offset")
    if offset is None:
        return []
    counted = "counts it" if facts["compared"]["protocol"] == "paper" else "doesn't count it"
    return [
        f"The markers' mean positions differ by {mm(offset)} mm on average: where they were put on the robot, or a "
        f"body that isn't straight at rest. No parameter explains that, and the loss {counted}."
    ]


def _in_time(facts: Facts) -> list[str]:
    shown = [t for t in _worst_trials(facts, _IN_TIME) if t["error"] is not None and t["edges"]]
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
    columns = ["marker", *(span(list(edges)) + " s" for edges in pairwise(trial["edges"]))]
    rows = [[marker["name"], *(pair(vector, digits) for vector in marker["windows"])] for marker in trial["markers"]]
    rows += [
        [f"{sensor['name']} {sensor['unit']}", *(reading(mean, signed=True) for mean in sensor["windows"])]
        for sensor in trial["sensors"]
        if sensor["windows"]
    ]
    return table(columns, rows)


def _worst_trials(facts: Facts, most: int) -> list[Facts]:
    """The worst ones, in their own order."""
    trials = facts["incumbent"]["trials"]
    worst = sorted(trials, key=lambda trial: -(math.inf if trial["error"] is None else trial["error"]))[:most]
    return [trial for trial in trials if trial in worst]
