import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from live_page import FILM, Served, serving

from swim2real.demo.example import FILMS


@pytest.fixture(scope="session")
def films(tmp_path_factory) -> Path:
    """A folder with a film, its points and the camera, as a person has them."""
    folder = tmp_path_factory.mktemp("ui") / "pool"
    folder.mkdir()
    for name in (FILM, "f0_50.points.json", "camera.json"):
        shutil.copy(FILMS / name, folder / name)
    return folder


@pytest.fixture(scope="session")
def served(films) -> Iterator[Served]:
    with serving(films) as server:
        yield server
