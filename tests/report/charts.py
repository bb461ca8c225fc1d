"""What tests ask of charts: lines by the text that they show, and that a chart is sound within a page."""

import re
from xml.etree import ElementTree

from swim2real.report.pages import inline_svg
from swim2real.report.style import TITLE, VARIABLES


def line(figure, title: str):
    """The line of a chart that shows a text where one points at it."""
    return next(found for found in figure.axes[0].lines if found.get_gid() == TITLE + title)


def check(charts) -> None:
    """Charts are sound XML in the colors of the theme, need nothing from elsewhere, and share no names."""
    names: list[str] = []
    for name, draw in charts.items():
        text = inline_svg(draw, name)
        root = ElementTree.fromstring(text)
        assert root.tag == "svg"
        own = [element.attrib["id"] for element in root.iter() if "id" in element.attrib]
        wanted = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text))
        assert wanted <= set(own), name
        names += own
        assert not re.findall(r"(?:fill|stroke): #", text), name
        assert set(re.findall(r"var\((--[^)]+)\)", text)) <= VARIABLES.keys(), name
        assert "nan" not in text.lower().replace("finance", ""), name
    assert len(set(names)) == len(names)


def titles_of(figure) -> tuple[str, str]:
    """Titles of the axes of a chart."""
    axes = figure.axes[0]
    return axes.get_xlabel(), axes.get_ylabel()
