"""From charts and a template to a page in one file, which opens without a network and without a library."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from swim2real.formatting import count, dollars, duration, listed, mm, number, percent, shortened, significant
from swim2real.report.style import TITLE, VARIABLES, page_style
from swimbase import store
from swimbase.errors import RunError
from swimbase.escaping import script_source, visible

Charts = dict[str, Callable[[], Figure]]

_TEMPLATES = Path(__file__).parent / "templates"

_VARIABLE_OF_LIGHT = {light: f"var({name})" for name, (light, _) in VARIABLES.items()}
_COLOR = re.compile("|".join(_VARIABLE_OF_LIGHT))
_NUMBER = re.compile(r"-?\d+\.\d+")
_TEXT = re.compile(r">[^<]*[\"#][^<]*<")
_DROPPED = re.compile(
    r"<\?xml.*?\?>|<!DOCTYPE.*?>|<!--.*?-->|<metadata>.*?</metadata>|<style type=\"text/css\">.*?</style>"
    r"| xmlns(:\w+)?=\"[^\"]*\"| version=\"1\.1\"| (width|height)=\"[\d.]+pt\"| transform=\"rotate\(-0 [^\"]*\)\"",
    re.DOTALL,
)


@dataclass(frozen=True)
class PageContext:
    """Content of a template; each page has a class of its own.

    Attributes:
        title: Title of the page.
        charts: What draws each chart, by name; the template's `plot` shows it.
    """

    title: str
    charts: Charts


def write_page(path: Path, context: PageContext, template: str, script: str = "", style: str = "") -> Path:
    """Writes a page whole or not at all. The same content gives the same page, to the last byte.

    Args:
        path: The file.
        context: What the page shows; texts are escaped, and what isn't seen of them becomes codes.
        template: Name of the template.
        script: Names of our own scripts beside the template, apart by spaces; a browser runs no others on the page.
        style: Names of style sheets beside the template that come after `report.css`.

    Raises:
        RunError: It can't be written.
    """
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=_seen,
    )  # fmt: skip
    for shown in (count, dollars, duration, listed, mm, number, percent, shortened, significant):
        environment.filters[shown.__name__] = shown
    own, styles = _files(script), _files(f"report.css {style}")
    page = environment.get_template(template).render(
        {field: getattr(context, field) for field in context.__dataclass_fields__}
        | {"charts": {name: inline_svg(draw, name) for name, draw in context.charts.items()}},
        script=own, style=styles, variables=VARIABLES, scripts=Markup(script_source(own) if own else "'none'"),
    )  # fmt: skip
    with store.writing(path, RunError, "make room or allow writing there"):
        store.write_text(path, page)
    return path


def _files(names: str) -> Markup:
    return Markup("\n".join((_TEMPLATES / name).read_text(encoding="utf-8") for name in names.split()))


def _seen(value: Any) -> Any:
    return visible(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def inline_svg(draw: Callable[[], Figure], name: str) -> Markup:
    """A chart as an element of a page: scalable, in the page's font and colors, with names that are its own.

    Args:
        draw: What draws the chart.
        name: A name that no other chart of the page has.
    """
    out = StringIO()
    with page_style(), mpl.rc_context({"svg.hashsalt": name}), warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Glyph .* missing from font"
        )  # the page's own font has it, or nothing is lost
        draw().savefig(out, format="svg")
    text = _TEXT.sub(lambda found: found[0].replace('"', "&quot;").replace("#", "&#35;"), visible(out.getvalue()))
    text = _DROPPED.sub("", text)
    # texts that show where one points: of a drawn thing, of a point of a scatter plot
    text = re.sub(rf'<g id="{TITLE}([^"]*)">', r"<g><title>\1</title>", text)
    text = re.sub(
        rf'<a xlink:href="{TITLE}([^"]*)"[^>]*>(.*?)</a>', r"<g><title>\1</title>\2</g>", text, flags=re.DOTALL
    )
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r" font-family: [^;\"]*;", "", text)
    text = text.replace("xlink:href", "href")
    text = re.sub(r' (d|x|y)="([^"]*)"', lambda match: f' {match[1]}="{_short(match[2])}"', text)
    text = _COLOR.sub(lambda match: _VARIABLE_OF_LIGHT[match[0]], text)
    return Markup(re.sub(r">\s+<", "><", text).strip())


def _short(numbers: str) -> str:
    """A path or a coordinate to a tenth of a point, curves to a hundredth; a letter for a line is said once."""
    curved = re.search("[CQ]", numbers) is not None
    digits = 2 if curved else 1
    rounded = _NUMBER.sub(lambda number: f"{round(float(number[0]), digits):g}", numbers)
    spaced = re.sub(r"\s+", " ", rounded).strip()
    return spaced if curved else re.sub(r"(?<=\d) L (?=[-\d])", " ", spaced)
