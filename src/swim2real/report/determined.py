"""Identifiability of a run: intervals, combinations and pairs on its page, and the chart of what to film next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from swim2real.formatting import listed
from swim2real.identification.identifiability import Direction
from swim2real.report.pages import Charts
from swim2real.report.run import ReportedRun
from swim2real.report.style import COLUMN, LIGHT, THIRD, chart_name, new_chart, new_figure, paper_style
from swimbase import store
from swimbase.arrays import Array
from swimbase.errors import RunError

CHART = "next.png"
_ROW = 0.17  # inches
_KNOWN, _OPEN = 0.1, 0.7  # spread of a direction up to which it is known, and from which on it is open
_MOST_PAIRS = 3
_NAMED = 3  # parameters of a combination
_CORRELATED = 0.6  # of a pair that is drawn


@dataclass(frozen=True)
class Determined:
    """Findings of a study, for the page.

    Attributes:
        evaluations: That it took.
        number: Number of directions that the trials determine.
        places: Ends of the 95 % intervals within the bounds, from 0 to 1, by parameter.
        known: Combinations that are determined, in words.
        open: Those that are not.
        pairs: Names of the charts of pairs.
        lower: How much lower the study's lowest loss is than the run's [m].
        doubt: Why no parameter counts as determined; empty where some may.
    """

    evaluations: int
    number: float
    places: Mapping[str, tuple[float, float]]
    known: tuple[str, ...]
    open: tuple[str, ...]
    pairs: tuple[str, ...]
    lower: float
    doubt: str


def determined(run: ReportedRun) -> tuple[Determined, Charts] | None:
    """The study's section and its charts; None without a complete study."""
    study = run.studied
    if study is None:
        return None
    draws = np.array(study.draws)
    charts: Charts = {
        f"pair-{run.space.names[i]}-{run.space.names[j]}": partial(_pair, run, draws, i, j) for i, j in _pairs(draws)
    }
    ends = [run.space.to_cube({name: study.intervals[name].interval_95[k] for name in run.space.names}) for k in (0, 1)]
    places = {name: (float(ends[0][i]), float(ends[1][i])) for i, name in enumerate(run.space.names)}
    combined = [one for one in study.directions if len(one.parameters) > 1]
    known = tuple(_worded(one) for one in combined if one.spread <= _KNOWN)
    left = tuple(_worded(one) for one in reversed(combined) if one.spread >= _OPEN)
    return Determined(
        study.evaluations, study.determined, places, known, left, tuple(charts),
        max(run.best.loss - study.lowest.loss, 0.0), study.doubt,
    ), charts  # fmt: skip


def _worded(direction: Direction) -> str:
    """Which parameters go together, and which the other way, with how far the sets spread along it."""
    moves = list(direction.parameters.items())
    up = [name for name, share in moves[:_NAMED] if share > 0]
    down = [name for name, share in moves[:_NAMED] if share < 0]
    more = f" and {len(moves) - _NAMED} more" if len(moves) > _NAMED else ""
    against = f" against {listed(down)}" if down else " together"
    return f"{listed(up)}{against}{more}: {100 * direction.spread:.1f} %"


def _pairs(draws: Array) -> list[tuple[int, int]]:
    """Pairs of parameters that compensate for one another the most, each parameter in one of them."""
    related = np.abs(np.triu(np.corrcoef(draws.T), 1)) * np.minimum.outer(*2 * [draws.std(axis=0)]) ** 0.5
    pairs: list[tuple[int, int]] = []
    strong = np.abs(np.corrcoef(draws.T)) > _CORRELATED
    for flat in np.argsort(-related, axis=None):
        i, j = divmod(int(flat), len(related))
        if len(pairs) == _MOST_PAIRS or not related[i, j] > 0:
            break
        if strong[i, j] and not {i, j} & {k for pair in pairs for k in pair}:
            pairs.append((i, j))
    return pairs


def _pair(run: ReportedRun, draws: Array, i: int, j: int) -> Figure:
    """Sets that fit, in the plane of two parameters, and the best of the run."""
    parameters = list(run.space)
    first, second = (chart_name(f"{p.name} ({p.unit})" if p.unit != "-" else p.name) for p in
                     (parameters[i], parameters[j]))  # fmt: skip
    figure, axes = new_chart(THIRD, 2.5, first, second)
    values = np.array([run.space.to_array(point) for point in draws])
    axes.plot(values[:, i], values[:, j], ".", color=LIGHT["faint"], markersize=4)
    best = run.best.values
    axes.plot(best[parameters[i].name], best[parameters[j].name], "o", color=LIGHT["simulated"], markersize=6)
    return figure


def _volumes(trials: Sequence[Mapping[str, Any]]) -> Figure:
    """Expected volume of the sets' region by trial, the first one highlighted.

    Args:
        trials: With `label` and `volume`, in the order in which they are drawn from the top.
    """
    figure = new_figure(1.4 * COLUMN, 0.6 + _ROW * len(trials))
    axes = figure.add_subplot()
    colors = [LIGHT["good"], *[LIGHT["faint"]] * (len(trials) - 1)]
    axes.barh([chart_name(one["label"]) for one in trials], [100 * one["volume"] for one in trials], color=colors)
    axes.invert_yaxis()
    axes.set(xlabel="expected volume of the sets' region (% of now)", xlim=(0, 100))
    return figure


def write_chart(folder: Path, trials: Sequence[Mapping[str, Any]]) -> None:
    """Writes next.png.

    Raises:
        RunError: It can't be written.
    """
    with paper_style(), store.writing(folder / CHART, RunError), store.whole_file(folder / CHART) as part:
        _volumes(trials).savefig(part, format="png", dpi=200, metadata={"Software": None})
