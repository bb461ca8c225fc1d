"""The page of several runs side by side: figures, parameters, paths, and what differs in their settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from swim2real.formatting import NOTHING
from swim2real.report.errors import ErrorRow, error_rows, warnings
from swim2real.report.pages import Charts, PageContext, write_page
from swim2real.report.run import ReportedRun, incumbent, read_run
from swim2real.report.run_charts import common_ranges, draw_best, drawn_trials, path_markers_of, paths
from swim2real.report.style import WIDE, chart_name, legend_over, log_axis, method_styles, new_chart, titled
from swim2real.report.tables import ParameterRow, parameter_rows, settings_rows
from swim2real.robots.robot import Robot

PAGE = "runs.html"

_APART = 0.1  # of a parameter's range, by which values may differ before they are said to
_MOST_CHARTS = 36
_COMPARABLE = {
    "protocol": "protocol", "start": "start", "horizon": "horizon", "hold_out": "held-out trials",
    "reference_fingerprint": "trials", "pieces": "pieces",
}  # fmt: skip


@dataclass(frozen=True)
class ParameterLine:
    """A parameter in all runs.

    Attributes:
        name: Identifier.
        rows: As each run has it; None where it has no such parameter.
        apart: Largest difference of its places within the bounds, as text; a dash where they can't be compared.
        note: `differs`, `other bounds`, or empty.
    """

    name: str
    rows: tuple[ParameterRow | None, ...]
    apart: str
    note: str


@dataclass(frozen=True)
class RunsPage(PageContext):
    """Everything that the page shows.

    Attributes:
        runs: The runs.
        labels: A letter and the name of each.
        unlike: What the runs differ in, so that their figures aren't of the same thing.
        warnings: Labels and sentences.
        figures: Each figure that a run has, and its row in each run.
        parameters: Every parameter of any run.
        trials: Names of the trials whose paths are drawn.
        differing: Settings that differ, as label and texts.
        same: How many settings are the same.
    """

    runs: tuple[ReportedRun, ...]
    labels: list[str]
    unlike: list[str]
    warnings: list[tuple[str, str]]
    figures: list[tuple[ErrorRow, list[ErrorRow | None]]]
    parameters: tuple[ParameterLine, ...]
    trials: tuple[str, ...]
    differing: list[tuple[str, list[str]]]
    same: int


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
    context = runs_context([read_run(folder, robot) for folder, robot in runs])
    return write_page(Path(path), context, "runs.html.j2", "report.js", "runs.css")


def runs_context(runs: Sequence[ReportedRun]) -> RunsPage:
    """Everything that the template shows."""
    labels = [f"{chr(ord('A') + i % 26)}{i // 26 + 1 if i >= 26 else ''} {run.name}" for i, run in enumerate(runs)]
    names = [one.compared.name for run in runs for one in run.saved if run.marker_names]
    shared = tuple(dict.fromkeys(name for name in names if names.count(name) > 1))
    trials = drawn_trials(shared)[: max(1, _MOST_CHARTS // len(runs))]
    charts: Charts = {"convergence": partial(_convergence, runs, labels)}
    for k, name in enumerate(trials):
        charts |= _path_charts(runs, k, name)
    unlike = [words for key, words in _COMPARABLE.items() if len({repr(getattr(r.settings, key)) for r in runs}) > 1]
    tables = [{row.name: row for row in error_rows(run)} for run in runs]
    first = {row.name: row for table in reversed(tables) for row in table.values()}
    settings = [settings_rows(run) for run in runs]
    lines = [(name, [table.get(name, NOTHING) for table in settings]) for name in _names(settings) if name != "Begun"]
    differing = [(name, texts) for name, texts in lines if len(set(texts)) > 1]
    return RunsPage(
        title=f"{len(runs)} runs side by side",
        charts=charts,
        runs=tuple(runs),
        labels=labels,
        unlike=unlike,
        warnings=[(label, said) for label, run in zip(labels, runs, strict=True) for said in _warnings(run)],
        figures=[(first[name], [table.get(name) for table in tables]) for name in _names(tables)],
        parameters=parameter_lines(runs),
        trials=trials,
        differing=differing,
        same=len(lines) - len(differing),
    )


def parameter_lines(runs: Sequence[ReportedRun]) -> tuple[ParameterLine, ...]:
    """Every parameter of any run, in the order of the first run that has it."""
    tables = [{row.parameter.name: row for row in parameter_rows(run)} for run in runs]
    scales = {run.space.scale for run in runs}
    lines: list[ParameterLine] = []
    for name in _names(tables):
        rows = tuple(table.get(name) for table in tables)
        known = [row for row in rows if row is not None]
        same_bounds = len({(row.parameter.lower, row.parameter.upper) for row in known}) == 1
        places = [row.position for row in known]
        apart, comparable = max(places) - min(places), same_bounds and len(scales) == 1
        note = "" if same_bounds else "other bounds"
        if comparable and apart > _APART:
            note = "differs"
        shown = f"{100 * apart:.0f} %" if comparable and len(known) > 1 else NOTHING
        lines.append(ParameterLine(name, rows, shown, note))
    return tuple(lines)


def _names(tables: Sequence[Mapping[str, object]]) -> list[str]:
    """Names that any table has."""
    return list(dict.fromkeys(name for table in tables for name in table))


def _warnings(run: ReportedRun) -> list[str]:
    found = [*warnings(run)]
    if incumbent(run.entries) is None:
        found.append("every simulation of it diverged")
    if run.unfinished:
        found.append("it has not ended or is not whole, so some of it is missing here; its own page says what")
    return found


def _path_charts(runs: Sequence[ReportedRun], number: int, name: str) -> Charts:
    """The paths of a trial in every run that has it, on one scale."""
    found = {i: one.compared for i, run in enumerate(runs) for one in run.saved if one.compared.name == name}
    ranges = [common_ranges([trial], path_markers_of(trial, runs[i].marker_names)) for i, trial in found.items()]
    across, up = ((min(r[k][0] for r in ranges), max(r[k][1] for r in ranges)) for k in (0, 1))
    return {
        f"paths-{number}-{i}": partial(paths, trial, runs[i].marker_names, runs[i].robot, (across, up))
        for i, trial in found.items()
    }


def _convergence(runs: Sequence[ReportedRun], labels: Sequence[str]) -> Figure:
    """The best loss so far of every run, from its first evaluation that didn't fail."""
    kinds = list(dict.fromkeys(run.loss for run in runs))
    figure, axes = new_chart(WIDE, 2.9, "evaluation", f"loss: {' or '.join(kinds)} (mm)", legend_rows=1)
    losses: list[float] = []
    for (label, style), run in zip(method_styles(labels).items(), runs, strict=True):
        if incumbent(run.entries) is not None:
            look = {"color": style.light, "linewidth": 1.6, "label": chart_name(label, 24), **style.pattern}
            line, best = draw_best(axes, run, **look)
            titled(line, label)
            losses += [float(best.min()), float(best.max())]
    axes.set_xlim(0.4, max(len(run.entries) for run in runs) + 0.6)
    log_axis(axes.yaxis, min(losses, default=1e2) / 1.25, max(losses, default=1e3) * 1.25)
    if losses:
        legend_over(axes)
    return figure
