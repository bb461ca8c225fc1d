"""From a template to a page in one file, which opens without a network."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swim2real.errors import MissingExtraError, RunError

_TEMPLATES = Path(__file__).parent / "templates"


def fill(template: str, content: Mapping[str, Any], **parts: str) -> str:
    """A page as text, with the library that draws its figures.

    Args:
        template: Its name.
        content: What it shows; texts are escaped.
        parts: Names of our own files beside the template, several after one another with a space; they are put in as
            they are.

    Raises:
        MissingExtraError: plotly or jinja2 isn't installed.
    """
    try:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
        from markupsafe import Markup
        from plotly.offline import get_plotlyjs  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise MissingExtraError(
            "the report needs plotly and jinja2; install them with: pip install 'swim2real[report]'"
        ) from error
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    own = {
        key: Markup("\n".join((_TEMPLATES / name).read_text(encoding="utf-8") for name in names.split()))
        for key, names in parts.items()
    }
    return environment.get_template(template).render(**content, **own, plotly=Markup(get_plotlyjs()))


def write_page(path: Path, page: str) -> Path:
    """Writes a page at once, so that a reader never sees half of it.

    Raises:
        RunError: It can't be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(page, encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise RunError(f"can't write '{path}': {error.strerror or error}; make room or allow writing there") from error
    return path
