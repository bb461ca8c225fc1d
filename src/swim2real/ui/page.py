"""The page: one document made of the parts of the pages that `pick` and `review` write, and of its own."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from markertrack.pages import filled


@cache
def page() -> str:
    """The page, which holds nothing but its script: what it shows it asks for, with the token of its address."""
    return filled(Path(__file__).parent / "ui.html", "swim2real ui", "", {}, allowed=" blob:; connect-src 'self'")
