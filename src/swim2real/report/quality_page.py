"""The page of `quality --plot`: which marker is lost when, and how each trial swims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from markertrack.kinematics import Kinematics
from markertrack.quality import LostMarkers, runs
from swim2real.report.pages import PageContext, write_page
from swim2real.report.style import LIGHT, WIDE, chart_name, new_chart, titled
from swim2real.trials import Trial


@dataclass(frozen=True)
class _QualityPage(PageContext):
    trials: list[tuple[str, float]]  # name and share that is left out
    swimming: dict[str, list[tuple[str, str]]]  # quantities and values by name of the trial


def write_quality_page(
    checked: Sequence[tuple[Trial, LostMarkers]], names: Sequence[str], path: str | Path,
    swimming: Mapping[str, Kinematics] | None = None,
) -> Path:  # fmt: skip
    """Writes one self-contained HTML file.

    Args:
        checked: Trials, and what is lost in each.
        names: Names of the M markers.
        path: Path of the file.
        swimming: Kinematics of trials, by their names.

    Raises:
        RunError: The file can't be written.
    """
    charts = {f"lost-{i}": partial(_lost_markers, trial, lost, names) for i, (trial, lost) in enumerate(checked)}
    trials = [(trial.name, lost.left_out_share) for trial, lost in checked]
    values = {
        name: [(f"{quantity} [{unit}]", str(one)) for quantity, unit, one in motion.table(tuple(names))]
        for name, motion in (swimming or {}).items()
    }
    return write_page(Path(path), _QualityPage("Lost markers", dict(charts), trials, values), "quality.html.j2")


def _lost_markers(trial: Trial, lost: LostMarkers, names: Sequence[str]) -> Figure:
    """The frames in which each marker is lost, over time; the first marker at the top."""
    figure, axes = new_chart(WIDE, 0.6 + 0.19 * len(names), "time (s)", "")
    times = trial.track.times
    ends = np.append(times[1:], 2 * times[-1] - times[-2] if len(times) > 1 else times[-1] + 1)
    for m, name in enumerate(names):
        spans = [(times[first], ends[end - 1] - times[first]) for first, end in runs(lost.lost[:, m])]
        axes.axhspan(m - 0.38, m + 0.38, color=LIGHT["page"], linewidth=0, zorder=0)
        titled(axes.broken_barh(spans, (m - 0.38, 0.76), facecolor=LIGHT["real"], linewidth=0), f"{name} is lost")
    axes.grid(visible=False)
    axes.set(xlim=(times[0], ends[-1]), ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), [chart_name(name) for name in names])
    axes.tick_params(axis="y", length=0)
    return figure
