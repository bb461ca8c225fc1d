"""Figures of a comparison for papers: vector and pixels, without LaTeX, the same look for a method in all of them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from swim2real import store
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import method_statistics
from swim2real.errors import RunError
from swim2real.report.chronophotography import chronophotography
from swim2real.report.comparison_charts import convergence, line_search, markers, strip, velocity
from swim2real.report.style import method_styles, paper_style

FIGURES = "figures"
_log = logging.getLogger(__name__)


def write_figures(
    results: ComparisonResults, folder: str | Path, theory: Mapping[str, float] | None = None
) -> list[Path]:  # fmt: skip
    """Writes each figure as PDF, SVG and PNG into the folder `figures` of a comparison.

    The same results give the same files, to the last byte, with the same matplotlib. Figures of what the trials have
    none of, as frequencies, are left out, and so is one whose data are not there, with a warning in the log.

    Args:
        results: The results of the comparison.
        folder: The folder of the comparison; its run folders hold the swims.
        theory: Speeds that elongated body theory predicts, by trial [m/s].

    Returns:
        The files, by protocol.

    Raises:
        RunError: They can't be written.
    """
    place = Path(folder) / FIGURES
    styles = method_styles(results.methods)
    paths: list[Path] = []
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"can't make '{place}': {error.strerror or error}") from error
    with paper_style():
        for protocol in results.protocols:
            methods = method_statistics(results, protocol)
            if not methods:
                _log.warning("no figures for protocol %s: it has no finished runs", protocol)
                continue
            drawn = {
                "convergence": convergence(methods, styles),
                "strip": strip(methods, styles),
                "velocity": velocity(methods, styles, theory) if methods[0].description.has_frequencies else None,
                "line-search": line_search(methods, styles),
                "markers": markers(methods, styles, results.markers),
            }
            if methods[0].description.has_frequencies:
                try:
                    drawn["chronophotography"] = chronophotography(methods, styles, Path(folder))
                except RunError as error:
                    _log.warning("no chronophotography for protocol %s: %s", protocol, error)
            for name, figure in drawn.items():
                if figure is not None:
                    paths += _save(figure, place, f"{name}-{protocol}")
    return paths


def _save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Writes a figure as PDF, SVG and PNG (300 dots an inch), without dates."""
    metadata = {
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
        "svg": {"Date": None, "Creator": None},
        "png": {"Software": None},
    }
    paths = [folder / f"{name}.{kind}" for kind in metadata]
    figure.draw_without_rendering()  # arranges the axes once for all files
    figure.set_layout_engine("none")
    try:
        for path, (kind, said) in zip(paths, metadata.items(), strict=True):
            with store.whole_file(path) as part:
                figure.savefig(part, format=kind, dpi=300, metadata=said)
    except OSError as error:
        raise RunError(f"can't write figure '{name}' to '{folder}': {error.strerror or error}") from error
    return paths
