"""Colors for light and dark, and the frame that all figures share.

Figures are written in the light colors; the page swaps each for its dark twin when the reader's theme is dark, so a
color must be taken from here and no two roles may share a light one.
"""

from __future__ import annotations

import html
from typing import Any

Figure = dict[str, Any]  # plotly's JSON: data and layout

# role: (light, dark)
COLORS: dict[str, tuple[str, str]] = {
    "real": ("#c62828", "#ff7f76"),
    "real-fill": ("#c6282826", "#ff7f7638"),
    "simulated": ("#1558b0", "#6db3ff"),
    "simulated-fill": ("#1558b026", "#6db3ff38"),
    "lost": ("#d08b84", "#a0625c"),
    "text": ("#1b2430", "#e7ebf0"),
    "muted": ("#586474", "#a3aebb"),
    "faint": ("#a2acb9", "#66717f"),
    "grid": ("#e2e6eb", "#2b3440"),
    "page": ("#f5f6f8", "#10151b"),
    "surface": ("#fefefe", "#181f27"),
    "good": ("#1a7a3c", "#56c878"),
    "warning": ("#955800", "#e6b450"),
}
LIGHT = {role: pair[0] for role, pair in COLORS.items()}
DARK_OF_LIGHT = dict(COLORS.values())


def label(text: str) -> str:
    """A text from outside as plotly may show it: plotly reads labels as HTML."""
    return html.escape(str(text), quote=True)


def framed(data: list[dict[str, Any]], x: str, y: str, height: int, **more: Any) -> Figure:
    """A figure with the shared layout.

    Args:
        data: Traces.
        x: Title of the x axis, with unit.
        y: Title of the y axis, with unit.
        height: [px].
        more: What else the layout has; `xaxis` and `yaxis` are merged.
    """
    axis = {
        "gridcolor": LIGHT["grid"], "linecolor": LIGHT["faint"], "zeroline": False, "ticks": "outside", "ticklen": 4,
        "tickcolor": LIGHT["faint"], "tickfont": {"size": 12}, "automargin": True,
    }  # fmt: skip
    title = {"standoff": 8, "font": {"size": 13}}
    layout = {
        "height": height,
        "margin": {"l": 8, "r": 12, "t": 10, "b": 8},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {
            "family": "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif",
            "size": 13,
            "color": LIGHT["text"],
        },
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "y": 1.02,
            "yanchor": "bottom",
            "bgcolor": "rgba(0,0,0,0)",
        },
        "hoverlabel": {"bgcolor": LIGHT["surface"], "bordercolor": LIGHT["faint"], "font": {"color": LIGHT["text"]}},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": LIGHT["faint"], "activecolor": LIGHT["text"]},
        "uirevision": "kept",
        **more,
        "xaxis": {**axis, "title": {"text": x, **title}, **more.get("xaxis", {})},
        "yaxis": {**axis, "title": {"text": y, **title}, **more.get("yaxis", {})},
    }
    return {"data": data, "layout": layout}
