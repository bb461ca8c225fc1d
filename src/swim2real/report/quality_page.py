"""The page of `quality --plot`: which marker is lost when, and how the body's lengths hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swim2real.errors import MissingExtraError
from swim2real.report.palette import LIGHT
from swim2real.tracking import LostMarkers
from swim2real.trials import Trial


def write_quality_page(
    checked: Sequence[tuple[Trial, LostMarkers]], names: Sequence[str], path: str | Path
) -> Path:  # fmt: skip
    """Writes one self-contained HTML file.

    Args:
        checked: Trials, and what is lost in each.
        names: Of the M markers.
        path: Where to.

    Raises:
        MissingExtraError: plotly isn't installed.
        OSError: The file can't be written.
    """
    try:
        import plotly.graph_objects as go
        from plotly.subplots import make_subplots
    except ImportError:
        raise MissingExtraError("the plot needs plotly; install it with: pip install 'swim2real[report]'") from None
    titles = [f"{trial.name}: {100 * lost.left_out_share:.1f} % left out" for trial, lost in checked]
    figure = make_subplots(rows=len(checked), cols=1, subplot_titles=titles, vertical_spacing=0.25 / (len(checked) + 1))
    for row, (trial, lost) in enumerate(checked, start=1):
        figure.add_trace(
            go.Heatmap(
                x=trial.track.times, y=list(names), z=lost.lost.T.astype(int), showscale=False, zmin=0, zmax=1,
                colorscale=[[0, "#eef1f4"], [1, LIGHT['real']]],
                hovertemplate="%{y} at %{x:.2f} s: %{z:d} (1 = lost)<extra></extra>",
            ),
            row=row, col=1,
        )  # fmt: skip
        figure.update_yaxes(autorange="reversed", row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(checked), col=1)
    figure.update_layout(
        title="Lost markers (colored) over time, first marker at the top",
        height=150 + 210 * len(checked),
        template="plotly_white",
    )
    target = Path(path)
    target.write_text(figure.to_html(include_plotlyjs=True, full_html=True), encoding="utf-8")
    return target
