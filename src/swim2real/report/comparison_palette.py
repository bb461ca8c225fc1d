"""How each method looks, the same on the page and in the figures for papers.

The colors of the known methods stay apart for readers with any of the usual kinds of color blindness; line patterns and
marks tell them apart in gray as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from swim2real.report.palette import DARK_OF_LIGHT


@dataclass(frozen=True)
class MethodStyle:
    """Look of a method.

    Attributes:
        light: Color on a light ground.
        dark: Color on a dark ground.
        mark: Of points, in matplotlib's letters.
        symbol: Of points, in plotly's words.
        pattern: Of lines, in plotly's words.
    """

    light: str
    dark: str
    mark: str
    symbol: str
    pattern: str

    @property
    def dashes(self) -> tuple[float, ...]:
        """Line pattern in multiples of the width, as matplotlib takes it; empty for a solid line."""
        return _DASHES[self.pattern]


_DASHES: dict[str, tuple[float, ...]] = {
    "solid": (), "dash": (4, 1.6), "dashdot": (4, 1.4, 1, 1.4), "dot": (1, 1.3), "longdash": (7, 1.8)
}  # fmt: skip

_KNOWN = {
    "line-search": MethodStyle("#0072b2", "#4da6e8", "o", "circle", "solid"),
    "no-line-search": MethodStyle("#56b4e9", "#a8dcff", "s", "square", "dash"),
    "warm-start": MethodStyle("#cc79a7", "#ee9fcb", "v", "triangle-down", "dashdot"),
    "bayesopt": MethodStyle("#009e73", "#2fc79a", "^", "triangle-up", "solid"),
    "cma-es": MethodStyle("#d55e00", "#ff7d3b", "D", "diamond", "dash"),
    "random": MethodStyle("#636a73", "#7d8794", "X", "x", "dot"),
    "staged": MethodStyle("#e69f00", "#ffc44d", "P", "cross", "longdash"),
    "least-squares": MethodStyle("#332288", "#8f83ff", "p", "pentagon", "dashdot"),
}
# for advisors and scales beyond those: told apart by pattern and mark once the colors repeat
_OTHERS = (
    MethodStyle("#882255", "#d0477f", "<", "triangle-left", "dash"),
    MethodStyle("#7a6a00", "#b8a43a", ">", "triangle-right", "dashdot"),
    MethodStyle("#117766", "#7fe0d0", "h", "hexagon", "dot"),
    MethodStyle("#882256", "#d04780", "*", "star", "dot"),
    MethodStyle("#7a6a01", "#b8a43b", "d", "diamond-tall", "longdash"),
    MethodStyle("#117767", "#7fe0d1", "8", "octagon", "solid"),
)

METHOD_DARK_OF_LIGHT = {style.light: style.dark for style in (*_KNOWN.values(), *_OTHERS)} | DARK_OF_LIGHT


def method_styles(methods: Sequence[str]) -> dict[str, MethodStyle]:
    """The look of each method of a comparison; those without a look of their own get one by their order."""
    unknown = [method for method in dict.fromkeys(methods) if method not in _KNOWN]
    others = {method: _OTHERS[i % len(_OTHERS)] for i, method in enumerate(unknown)}
    return {method: _KNOWN.get(method) or others[method] for method in methods}
