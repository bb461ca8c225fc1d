"""What tests ask of charts: lines by the text that they show, and that a chart is sound within a page."""

import re
from xml.etree import ElementTree

from swim2real.report.pages import inline_svg
from swim2real.report.style import TITLE, VARIABLES


def line(figure, title: str):
    """The line of a chart that shows a text where one points at it."""
    return next(found for found in figure.axes[0].lines if found.get_gid() == TITLE + title)


def check(charts) -> None:
    """Charts are sound within a page; see `check_page`."""
    check_page("".join(inline_svg(draw, name) for name, draw in charts.items()))


def check_page(page: str) -> None:
    """The charts of a page are sound XML in the theme's colors, need nothing from elsewhere, and share no names."""
    charts = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert charts
    names: list[str] = []
    for text in charts:
        root = ElementTree.fromstring(text)
        own = [element.attrib["id"] for element in root.iter() if "id" in element.attrib]
        assert set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text)) <= set(own)
        assert not re.findall(r"(?:fill|stroke): #", text)
        assert set(re.findall(r"var\((--[^)]+)\)", text)) <= VARIABLES.keys()
        assert not re.findall(r"\bnan\b", text, re.IGNORECASE)
        names += own
    assert len(set(names)) == len(names)


def titles_of(figure) -> tuple[str, str]:
    """Titles of the axes of a chart."""
    axes = figure.axes[0]
    return axes.get_xlabel(), axes.get_ylabel()
