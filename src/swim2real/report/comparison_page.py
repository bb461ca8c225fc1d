"""The page of a comparison: sortable tables, charts, and links to the runs' own pages, in one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from swim2real.comparison import statistics
from swim2real.comparison.results import ComparisonResults, load_results
from swim2real.comparison.tables import Cell, Table, mm_cell, tables
from swim2real.formatting import duration, mm
from swim2real.report.comparison_charts import convergence, markers, strip, velocity
from swim2real.report.page import REPORT
from swim2real.report.pages import Charts, PageContext, write_page
from swim2real.report.paper_figures import FIGURES
from swim2real.report.style import WIDE, MethodStyle, method_styles
from swimbase.names import file_name_fault

COMPARISON = "comparison.html"


@dataclass(frozen=True)
class _Board:
    """Tables and charts of one protocol.

    Attributes:
        protocol: `aligned`, `paper` or `playback`.
        description: Description of the protocol.
        verdict: Sentences that say who is best and how surely; empty without runs.
        tables: Tables by key.
    """

    protocol: str
    description: statistics.ProtocolDescription
    verdict: tuple[str, ...]
    tables: Mapping[str, Table]


@dataclass(frozen=True)
class _ComparisonPage(PageContext):
    """Everything that the page shows.

    Attributes:
        results: Results of the comparison.
        seeds: All seeds.
        boards: What is shown of each protocol.
        styles: Look of each method.
        runs: Table of all runs.
        pages: Address of each run's own page, empty where there is none.
        papers: Addresses of figures for papers.
    """

    results: ComparisonResults
    seeds: list[int]
    boards: list[_Board]
    styles: dict[str, MethodStyle]
    runs: Table
    pages: list[str]
    papers: list[str]


def write_comparison_report(folder: str | Path, theory: Mapping[str, float] | None = None) -> Path:
    """Writes the page of a comparison into its folder. The same folder gives the same page, to the last byte.

    Args:
        folder: Folder of the comparison, with `results.json`.
        theory: Speeds that elongated body theory predicts, by trial [m/s].

    Returns:
        Where the page is.

    Raises:
        RunError: There are no results, they are damaged, or the page can't be written.
    """
    context = comparison_context(load_results(folder), Path(folder), theory)
    page = Path(folder) / COMPARISON
    return write_page(page, context, "comparison.html.j2", "report.js comparison.js", "comparison.css")


def comparison_context(
    results: ComparisonResults, folder: Path, theory: Mapping[str, float] | None = None
) -> _ComparisonPage:
    """Everything that the template shows."""
    styles = method_styles(results.methods)
    boards: list[_Board] = []
    charts: Charts = {}
    for protocol in results.protocols:
        methods = statistics.method_statistics(results, protocol)
        description = statistics.PROTOCOLS[protocol]
        made = {table.key: table for table in tables(results, protocol, theory)}
        boards.append(_Board(protocol, description, verdict(methods), made))
        if not methods:
            continue
        charts |= {
            f"convergence-{protocol}": partial(convergence, methods, styles, WIDE),
            f"strip-{protocol}": partial(strip, methods, styles, WIDE),
            f"markers-{protocol}": partial(markers, methods, styles, results.markers, WIDE),
        }
        if description.has_frequencies:
            charts[f"velocity-{protocol}"] = partial(velocity, methods, styles, theory, WIDE)
    return _ComparisonPage(
        title=folder.resolve().name,
        charts=charts,
        results=results,
        seeds=sorted({run.seed for run in results.runs}),
        boards=boards,
        styles=styles,
        runs=_run_table(results),
        pages=_run_pages(results, folder),
        papers=[quote(f"{FIGURES}/{path.name}") for path in sorted((folder / FIGURES).glob("*.pdf"))],
    )


def verdict(methods: tuple[statistics.MethodStatistics, ...]) -> tuple[str, ...]:
    """Who is best and how surely, in sentences."""
    if not methods:
        return ()
    best = statistics.best_method(methods)
    loss, count = best.description.loss, len(best.runs)
    first = f"{best.method} has the lowest mean {loss}: {_mm(best.mean('final'))}"
    first += f", and {_mm(best.final.max())} with its worst seed." if count > 1 else ", with a single seed."
    said = [first]
    gaps = [(name, gap) for name, gap in statistics.differences(methods).items() if gap is not None]
    if gaps:
        name, gap = min(gaps, key=lambda pair: pair[1].mean)
        then = f"Next is {name}, {_mm(gap.mean)} above"
        if len(gap.seeds) < 2:
            said.append(f"{then}; one seed doesn't show how surely.")
        else:
            sure = "which leaves out zero" if gap.is_significant else "which holds zero, so it may be chance"
            said.append(f"{then} (95 % interval {_mm(gap.low)} to {_mm(gap.high)}, {len(gap.seeds)} seeds), {sure}.")
    area = statistics.best_method(methods, "auc")
    said.append(f"The lowest mean AUC has {area.method}: {_mm(area.mean('auc'))}.")
    return tuple(said)


def _mm(value: float) -> str:
    return f"{mm(value)} mm"


def _run_table(results: ComparisonResults) -> Table:
    """Every run, with the trial that it left out."""
    rows = [
        (
            run.method,
            (
                Cell(run.protocol), Cell(str(run.seed), run.seed), Cell(run.held_out or "none"), mm_cell(run.best_loss),
                Cell(str(run.best_evaluation), run.best_evaluation), Cell(str(run.calls), run.calls),
                Cell(str(sum(run.failed)), sum(run.failed)), Cell(duration(run.seconds), run.seconds),
            ),
        )
        for run in results.runs
    ]  # fmt: skip
    heads = (
        "Method", "Protocol", "Seed", "Left out", "Best (mm)", "Found at evaluation", "Advisor calls", "Diverged",
        "Time",
    )  # fmt: skip
    return Table("runs", "Every run", heads, tuple(rows))


def _run_pages(results: ComparisonResults, folder: Path) -> list[str]:
    """The address of each run's own page relative to the comparison's, empty where there is none in its folder."""
    within = [PurePosixPath(run.folder).parts for run in results.runs]
    own = [len(parts) > 0 and not any(map(file_name_fault, parts)) for parts in within]
    pages = ["/".join((*parts, REPORT)) for parts in within]
    return [
        quote(page) if is_own and (folder / page).is_file() else "" for page, is_own in zip(pages, own, strict=True)
    ]
