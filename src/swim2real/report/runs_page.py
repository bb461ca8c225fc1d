"""The page of several runs side by side: figures, parameters, paths, and what differs in their settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from swim2real.calibration.convergence import best_losses
from swim2real.report.headline import poor_fit, split
from swim2real.report.pages import Charts, render_page, write_page
from swim2real.report.run import ReportedRun, incumbent, read_run
from swim2real.report.run_charts import SMALLEST
from swim2real.report.style import WIDE, chart_name, legend_over, log_axis, method_styles, new_chart, titled
from swim2real.report.tables import ParameterRow, parameter_rows, settings_rows
from swim2real.report.trial_charts import common_ranges, drawn_trials, path_markers_of, paths
from swim2real.report.units import NOTHING, listed
from swim2real.robots.robot import Robot

PAGE = "runs.html"

APART = 10.0  # % of a parameter's range, by which values may differ before they are said to
_MOST_CHARTS = 36
_COMPARABLE = {
    "protocol": "protocol", "start": "start", "horizon": "horizon", "hold_out": "held-out trials",
    "reference_fingerprint": "trials", "pieces": "pieces",
}  # fmt: skip
_ALWAYS_APART = ("Begun",)


@dataclass(frozen=True)
class ParameterLine:
    """A parameter in all runs.

    Attributes:
        name: Identifier.
        rows: As each run has it; None where it has no such parameter.
        apart: Largest difference of its places within the bounds [%], as text; a dash where they can't be compared.
        note: `differs`, `other bounds`, or empty.
    """

    name: str
    rows: tuple[ParameterRow | None, ...]
    apart: str
    note: str


def write_runs_page(runs: Sequence[tuple[str | Path, Robot]], path: str | Path) -> Path:
    """Writes one page that shows several runs side by side.

    Args:
        runs: Two or more run folders, each with the robot that it calibrated.
        path: The file.

    Returns:
        Where the page is.

    Raises:
        RunError: A run has nothing to report or is damaged, or the page can't be written.
        ParameterError: A run is of another robot.
    """
    read = [read_run(folder, robot) for folder, robot in runs]
    shown = content(read)
    charts: Charts = shown.pop("charts")
    return write_page(
        Path(path), render_page("runs.html.j2", shown, charts, style="report.css runs.css", script="report.js")
    )


def content(runs: Sequence[ReportedRun]) -> dict[str, Any]:
    """Everything that the template shows."""
    labels = [f"{_letter(i)} {run.name}" for i, run in enumerate(runs)]
    trials = _shared_trials(runs)
    charts: dict[str, Callable[[], Figure]] = {"convergence": partial(_convergence, runs, labels)}
    for k, name in enumerate(trials):
        charts |= _path_charts(runs, k, name)
    return {
        "runs": runs,
        "labels": labels,
        "letters": [_letter(i) for i in range(len(runs))],
        "differences": _differences(runs),
        "warnings": [(labels[i], one) for i, run in enumerate(runs) for one in _warnings(run)],
        "figures": _figures(runs),
        "parameters": parameter_lines(runs),
        "trials": trials,
        "settings": _settings(runs),
        "apart": f"{APART:g}",
        "charts": charts,
    }


def parameter_lines(runs: Sequence[ReportedRun]) -> tuple[ParameterLine, ...]:
    """Every parameter of any run, in the order of the first run that has it."""
    tables: list[dict[str, ParameterRow]] = [{row.name: row for row in parameter_rows(run)} for run in runs]
    scales = {run.space.scale for run in runs}
    lines: list[ParameterLine] = []
    for name in dict.fromkeys(name for table in tables for name in table):
        rows = tuple(table.get(name) for table in tables)
        known = [row for row in rows if row is not None]
        alike = len({(row.lower, row.upper) for row in known}) == 1 and len(scales) == 1
        places = [row.position for row in known]
        apart = max(places) - min(places)
        note = "other bounds" if len({(row.lower, row.upper) for row in known}) > 1 else ""
        if alike and apart > APART:
            note = "differs"
        lines.append(ParameterLine(name, rows, f"{apart:.0f} %" if alike and len(known) > 1 else NOTHING, note))
    return tuple(lines)


def _letter(index: int) -> str:
    """What a run is called: A to Z, then A2 and so on."""
    return chr(ord("A") + index % 26) + (str(index // 26 + 1) if index >= 26 else "")


def _warnings(run: ReportedRun) -> list[str]:
    found = [*run.warnings, *poor_fit(run)]
    if incumbent(run.entries) is None:
        found.append("every simulation of it diverged")
    if run.unfinished:
        found.append("it has not ended or is not whole, so some of it is missing here; its own page says what")
    return found


def _differences(runs: Sequence[ReportedRun]) -> str:
    """A sentence when the figures of the runs aren't of the same thing; else empty."""
    apart = [words for key, words in _COMPARABLE.items() if len({repr(getattr(run.settings, key)) for run in runs}) > 1]
    return f"The runs differ in {listed(apart)}, so their figures aren't of the same thing." if apart else ""


def _figures(runs: Sequence[ReportedRun]) -> list[tuple[str, str, bool, list[tuple[str, str]]]]:
    """Label, name and weight of each figure, and its texts on fitted and on held-out trials in each run."""
    tables = [{row.name: row for row in split(run)} for run in runs]
    first = {row.name: row for table in reversed(tables) for row in table.values()}
    names = dict.fromkeys(name for table in tables for name in table)
    lines: list[tuple[str, str, bool, list[tuple[str, str]]]] = []
    for name in names:
        cells: list[tuple[str, str]] = []
        for table in tables:
            texts = table[name].cells[1:] if name in table else ()
            cells.append((texts[0] if texts else NOTHING, texts[1] if len(texts) > 1 else ""))
        lines.append((first[name].label, name, first[name].main, cells))
    return lines


def _settings(runs: Sequence[ReportedRun]) -> dict[str, Any]:
    """The settings that differ, as label and texts, and how many are the same."""
    tables: list[Mapping[str, str]] = [dict(settings_rows(run)) for run in runs]
    names = [name for name in dict.fromkeys(n for table in tables for n in table) if name not in _ALWAYS_APART]
    lines = [(name, [table.get(name, NOTHING) for table in tables]) for name in names]
    differing = [(name, texts) for name, texts in lines if len(set(texts)) > 1]
    return {"differing": differing, "same": len(lines) - len(differing)}


def _shared_trials(runs: Sequence[ReportedRun]) -> tuple[str, ...]:
    """Names of the trials that two runs or more have drawn, at most as many as a page bears."""
    names = [one.compared.name for run in runs for one in run.saved if run.marker_names]
    shared = tuple(dict.fromkeys(name for name in names if names.count(name) > 1))
    return drawn_trials(shared)[: max(1, _MOST_CHARTS // len(runs))]


def _path_charts(runs: Sequence[ReportedRun], number: int, name: str) -> dict[str, Callable[[], Figure]]:
    """The paths of a trial in every run that has it, on one scale."""
    found = {i: one.compared for i, run in enumerate(runs) for one in run.saved if one.compared.name == name}
    shown = {i: path_markers_of([trial], runs[i].marker_names) for i, trial in found.items()}
    ranges = [common_ranges([trial], shown[i]) for i, trial in found.items()]
    box = tuple((min(r[k][0] for r in ranges), max(r[k][1] for r in ranges)) for k in (0, 1))
    return {
        f"paths-{number}-{i}": partial(paths, trial, runs[i].marker_names, runs[i].robot, (box[0], box[1]))
        for i, trial in found.items()
    }


def _convergence(runs: Sequence[ReportedRun], labels: Sequence[str]) -> Figure:
    """The best loss so far of every run, from its first evaluation that didn't fail."""
    kinds = list(dict.fromkeys(run.loss for run in runs))
    figure, axes = new_chart(WIDE, 2.9, "evaluation", f"loss: {' or '.join(kinds)} (mm)", legend_rows=1)
    low, high = [], []
    for (label, style), run in zip(method_styles(labels).items(), runs, strict=True):
        begun = next((i for i, entry in enumerate(run.entries) if not entry["failed"]), None)
        if begun is None:
            continue
        best = np.maximum(1e3 * np.array(best_losses(run.entries)[begun:]), SMALLEST)
        (line,) = axes.step(
            range(begun + 1, len(run.entries) + 1), best, where="post", color=style.light, linewidth=1.6,
            label=chart_name(label, 24), **style.pattern,
        )  # fmt: skip
        titled(line, label)
        low.append(float(best.min()))
        high.append(float(best.max()))
    axes.set_xlim(0.4, max(len(run.entries) for run in runs) + 0.6)
    log_axis(axes.yaxis, min(low, default=1e2) / 1.25, max(high, default=1e3) * 1.25)
    if low:
        legend_over(axes)
    return figure
