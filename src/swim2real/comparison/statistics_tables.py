"""The tables of a comparison, for people: the form of the paper's Table II, and all that it leaves out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from swim2real.comparison.protocols import MarkerKind, figures_of
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import (
    ERRORS,
    Array,
    MethodStatistics,
    Spread,
    differences,
    method_statistics,
    numbers,
    reached,
)
from swim2real.comparison.statistics_cells import (
    Cell,
    Table,
    as_number,
    difference_cell,
    known,
    marked,
    mm_cell,
    spread_cell,
)
from swim2real.comparison.statistics_detail import (
    LeftOut,
    StepStatistics,
    left_out,
    marker_errors,
    nan_mean,
    speeds,
    step_statistics,
)

THEORY = "elongated body theory"


def tables(results: ComparisonResults, protocol: str, theory: Mapping[str, float] | None = None) -> tuple[Table, ...]:
    """All tables of a protocol that have rows, the paper's first; none without finished runs.

    Args:
        results: Of the comparison.
        protocol: `aligned`, `paper` or `playback`.
        theory: Speeds that elongated body theory predicts, by trial [m/s].
    """
    methods = method_statistics(results, protocol)
    if not methods:
        return ()
    made = (
        paper_table(methods),
        sureness_table(methods),
        figure_table(methods, results.sensors),
        seed_table(methods),
        reach_table(methods),
        step_table(methods),
        velocity_table(methods, theory),
        marker_table(methods, results.markers),
        left_out_table(results, methods),
    )
    return tuple(table for table in made if table is not None)


def paper_table(methods: Sequence[MethodStatistics]) -> Table:
    """Best, worst and AUC, as in the paper's Table II."""
    rows = [(one.method, (spread_cell(one.final), mm_cell(one.final.worst), spread_cell(one.auc))) for one in methods]
    about = _about(methods)
    return marked(
        Table(
            "paper", f"Calibration performance over {_seeds(methods)}, {about}",
            ("Method", "Best (mm)", "Worst (mm)", "AUC (mm)"), tuple(rows),
            f"Best: mean ± standard deviation of each seed's lowest {methods[0].words.loss}. Worst: the highest "
            f"of them. AUC: mean over the {methods[0].curves.shape[1]} evaluations of the lowest so far.",
        )
    )  # fmt: skip


def sureness_table(methods: Sequence[MethodStatistics]) -> Table:
    """How surely the best method is best."""
    final, auc = differences(methods), differences(methods, "auc")
    rows = [
        (one.method, (mm_cell(one.final.median), difference_cell(final[one.method]), difference_cell(auc[one.method])))
        for one in methods
    ]
    return marked(
        Table(
            "sureness", f"Difference to the best method, {_about(methods)}",
            ("Method", "Median (mm)", "Best: above the lowest (mm)", "AUC: above the lowest (mm)"), tuple(rows),
            "Difference to the method with the lowest mean, which has a dash, with its 95 % bootstrap interval over "
            "seeds, paired by seed. With few seeds such an interval is too narrow.",
        ),
        skip=(1, 2),
    )  # fmt: skip


def figure_table(methods: Sequence[MethodStatistics], sensors: Mapping[str, str]) -> Table:
    """Every figure at the best parameters that there is."""
    wanted = figures_of(methods[0].protocol, sensors)
    figures = [figure for figure in wanted if any(one.figures[figure.name].known.size for one in methods)]
    rows = [
        (one.method, tuple(spread_cell(one.figures[f.name], f.digits, f.factor) for f in figures)) for one in methods
    ]
    return marked(
        Table(
            "figures", f"All figures at the best parameters, {_about(methods)}",
            ("Method", *(figure.heading for figure in figures)), tuple(rows), "Mean ± standard deviation over seeds.",
        )
    )  # fmt: skip


def seed_table(methods: Sequence[MethodStatistics]) -> Table:
    """The best loss of every seed."""
    seeds = sorted({seed for one in methods for seed in one.seeds})
    rows = [(one.method, tuple(mm_cell(one.by_seed("final").get(seed)) for seed in seeds)) for one in methods]
    heads = ("Method", *(f"Seed {seed} (mm)" for seed in seeds))
    return marked(Table("seeds", f"Best loss of every seed, {_about(methods)}", heads, tuple(rows)))


def reach_table(methods: Sequence[MethodStatistics], errors: Sequence[float] = ERRORS) -> Table:
    """How many evaluations it takes to reach given errors."""
    rows: list[tuple[str, tuple[Cell, ...]]] = []
    for one in methods:
        cells: list[Cell] = []
        for found in reached(one, errors):
            total = len(one.runs)
            shown = f"{found.median:g}" if math.isfinite(found.median) else "not reached"
            value = found.median if math.isfinite(found.median) else None
            cells.append(Cell(f"{shown} ({found.count}/{total})", value))
        rows.append((one.method, tuple(cells)))
    heads = ("Method", *(f"≤ {1e3 * error:g} mm" for error in errors))
    return marked(
        Table(
            "reached", f"Evaluations to an error, {_about(methods)}", heads, tuple(rows),
            "Median over all seeds, and how many of them got there; 'not reached' where the median seed did not.",
        )
    )  # fmt: skip


def step_table(methods: Sequence[MethodStatistics]) -> Table | None:
    """Accept rates and step shares of the methods with rounds."""
    found = [(one.method, steps) for one in methods if (steps := step_statistics(one.runs)) is not None]
    if not found:
        return None
    sizes = sorted({size for _, steps in found for size in steps.by_size}, reverse=True)
    rows = [(method, _steps(steps, sizes)) for method, steps in found]
    heads = (
        "Method", "Calls a run", "Rounds", "Accepted (%)", *(f"at step {size:g} (%)" for size in sizes),
        "Evaluations an accepted one", "Cut short",
    )  # fmt: skip
    return Table(
        "steps", f"Proposals and line search, {_about(methods)}", heads, tuple(rows),
        "Over all seeds. A round is a proposal and its steps; shares are of the accepted rounds. Rounds that the "
        "budget cut short are in none of the other columns.",
    )  # fmt: skip


def velocity_table(methods: Sequence[MethodStatistics], theory: Mapping[str, float] | None = None) -> Table | None:
    """Error in speed by frequency; elongated body theory has a row where its speeds are given."""
    found = [(one.method, one_speeds) for one in methods if (one_speeds := speeds(one.runs)) is not None]
    if not found:
        return None
    first = found[0][1]
    rows = [
        (method, (*(mm_cell(float(e)) for e in nan_mean(one.errors, axis=0)), spread_cell(one.mean_error)))
        for method, one in found
    ]
    if theory is not None:
        errors = abs(numbers([theory.get(name) for name in first.trials]) - first.real)
        rows.append((THEORY, (*map(mm_cell, errors.tolist()), mm_cell(Spread(errors).mean))))
    heads = ("Method", *(f"{f:.2f} Hz (mm/s)" for f in first.frequencies.tolist()), "Mean (mm/s)")
    real = ", ".join(f"{1e3 * speed:.0f}" for speed in first.real.tolist())
    return marked(
        Table(
            "velocity", f"Velocity error by frequency, {_about(methods)}", heads, tuple(rows),
            f"|simulated − real|, mean over seeds. The real speeds are {real} mm/s.",
        )
    )  # fmt: skip


def marker_table(methods: Sequence[MethodStatistics], markers: Sequence[str]) -> Table:
    """Error of each marker, of swims with and without registration."""
    words = methods[0].words
    several = len(words.markers) > 1
    rows = [
        (f"{one.method}, {of}" if several else one.method, tuple(mm_cell(float(e)) for e in _by_marker(one, kind)))
        for one in methods
        for kind, of in words.markers
    ]
    heads = ("Method", *(f"{marker} (mm)" for marker in markers))
    note = f"Mean over seeds and over the trials in which tracking has the marker. {words.markers_note}"
    return Table("markers", f"{words.markers_title}, {_about(methods)}", heads, tuple(rows), note)


def left_out_table(results: ComparisonResults, methods: Sequence[MethodStatistics]) -> Table | None:
    """Error on trials that a fit did not know."""
    protocol = methods[0].protocol
    found = [(one.method, out) for one in methods if (out := left_out(results, one.method, protocol)) is not None]
    if not found:
        return None
    names = [name for name in results.trials if any(name in out.trials for _, out in found)]
    spreads: dict[str, Callable[[LeftOut], Spread]] = {
        "Left out (mm)": lambda out: Spread(out.unseen),
        "Same, when fitted (mm)": lambda out: Spread(out.in_fit),
    }
    if any(Spread(out.velocity).known.size for _, out in found):
        spreads["Velocity, left out (mm/s)"] = lambda out: Spread(out.velocity)
    rows = [
        (
            method,
            (
                *(spread_cell(spread(out)) for spread in spreads.values()),
                *(mm_cell(out.of_trial(name).mean) for name in names),
            ),
        )
        for method, out in found
    ]
    heads = ("Method", *spreads, *(f"{name} (mm)" for name in names))
    return marked(
        Table(
            "left-out", f"Trials left out of the fit, {_about(methods)}", heads, tuple(rows),
            "Each run leaves one trial out and is judged on it; mean ± standard deviation over trials and seeds. "
            "'Same, when fitted' is the error on the same trials of the runs that knew them.",
        ),
        skip=(1,),
    )  # fmt: skip


def _by_marker(method: MethodStatistics, kind: MarkerKind) -> Array:
    """Mean over seeds [m]. Shape (M,)."""
    return nan_mean(marker_errors(method.runs, kind), axis=0)


def _about(methods: Sequence[MethodStatistics]) -> str:
    first = methods[0]
    return f"{first.protocol} protocol, {first.curves.shape[1]} evaluations"


def _seeds(methods: Sequence[MethodStatistics]) -> str:
    counts = sorted({len(one.runs) for one in methods})
    return f"{counts[0]} seed{'s' * (counts[0] > 1)}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]} seeds"


def _steps(steps: StepStatistics, sizes: Sequence[float]) -> tuple[Cell, ...]:
    def percent(share: float | None) -> Cell:
        return Cell(as_number(share, 0, 100), known(share))

    calls = float(steps.calls.mean())
    return (
        Cell(as_number(calls), calls),
        Cell(str(steps.rounds), steps.rounds),
        percent(steps.accept_rate),
        *(percent(steps.shares.get(size)) for size in sizes),
        Cell(as_number(steps.steps_per_accepted), known(steps.steps_per_accepted)),
        Cell(str(steps.cut_short), steps.cut_short),
    )
