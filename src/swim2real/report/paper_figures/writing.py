"""Writes all figures of a comparison."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import method_statistics
from swim2real.errors import RunError
from swim2real.report.comparison_palette import method_styles
from swim2real.report.paper_figures.chronophotography import draw_chronophotography
from swim2real.report.paper_figures.convergence import draw_convergence
from swim2real.report.paper_figures.line_search import draw_line_search
from swim2real.report.paper_figures.markers import draw_markers
from swim2real.report.paper_figures.strip import draw_strip
from swim2real.report.paper_figures.style import paper_style, save
from swim2real.report.paper_figures.velocity import draw_velocity

FIGURES = "figures"
_log = logging.getLogger(__name__)


def write_figures(
    results: ComparisonResults, folder: str | Path, theory: Mapping[str, float] | None = None
) -> list[Path]:  # fmt: skip
    """Writes each figure as PDF and PNG into the folder `figures` of a comparison.

    The same results give the same files, to the last byte, with the same matplotlib. A figure whose data are not there
    is left out, with a warning in the log.

    Args:
        results: Of the comparison.
        folder: Of the comparison; its run folders hold the swims.
        theory: Speeds that elongated body theory predicts, by trial [m/s].

    Returns:
        The files, by protocol.

    Raises:
        MissingExtraError: matplotlib isn't installed.
        RunError: They can't be written.
    """
    place = Path(folder) / FIGURES
    styles = method_styles(results.methods)
    paths: list[Path] = []
    with paper_style():
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"can't make '{place}': {error.strerror or error}") from error
        for protocol in results.protocols:
            methods = method_statistics(results, protocol)
            if not methods:
                _log.warning("no figures for protocol %s: it has no finished runs", protocol)
                continue
            drawn = {
                "convergence": draw_convergence(methods, styles),
                "strip": draw_strip(methods, styles),
                "velocity": draw_velocity(methods, styles, theory),
                "line-search": draw_line_search(methods, styles),
                "markers": draw_markers(methods, styles, results.markers),
            }
            try:
                colors = {method: style.light for method, style in styles.items()}
                drawn["chronophotography"] = draw_chronophotography(methods, colors, Path(folder))
            except RunError as error:
                _log.warning("no chronophotography for protocol %s: %s", protocol, error)
            if drawn["velocity"] is None:
                _log.warning("no figure of speed against frequency for protocol %s: its trials have none", protocol)
            for name, figure in drawn.items():
                if figure is not None:
                    paths += save(figure, place, f"{name}-{protocol}")
    return paths
