"""Charts take most of a page's time; most tests are about what else a page shows."""

import pytest
from markupsafe import Markup

from swim2real.report import pages


@pytest.fixture(autouse=True)
def _quick(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have charts in tests that ask for `drawn`."""
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(pages, "inline_svg", lambda draw, name: Markup("<svg></svg>"))


@pytest.fixture
def drawn() -> None:
    """Pages have their charts."""
