"""Charts and simulations take most of a page's time; most tests are about what else a page shows."""

import pytest
from markupsafe import Markup

from swim2real.report import ahead, pages
from swimbase.errors import EngineError


@pytest.fixture(autouse=True)
def _quick(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have charts in tests that ask for `drawn`, and swims from ahead in tests that ask for `simulated`."""

    def diverges(*_: object) -> None:
        raise EngineError("not simulated")

    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(pages, "inline_svg", lambda draw, name: Markup("<svg></svg>"))
    if "simulated" not in request.fixturenames:
        monkeypatch.setattr(ahead, "shown_swim", diverges)


@pytest.fixture
def drawn() -> None:
    """Pages have their charts."""


@pytest.fixture
def simulated() -> None:
    """Films are also from ahead, of robots that roll."""
