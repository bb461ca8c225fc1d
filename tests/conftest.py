import os
from pathlib import Path

import hypothesis
import mujoco
import pytest

from swim2real.trials import TrialSet, load_reference

# the same examples every time, and no time limit for one, since machines are shared
hypothesis.settings.register_profile("swim2real", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("swim2real")

PROJECT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with the published tracks and the reference rollouts, which the project doesn't hold itself."""
    folder = (PROJECT / os.environ.get("SWIM2REAL_SHARED", "../shared")).resolve()
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder}; set SWIM2REAL_SHARED")
    return folder


@pytest.fixture(scope="session")
def tracks(shared: Path) -> TrialSet:
    """The published tracks that are there, however many."""
    folder = shared / "data" / "fishsim-markers"
    if not folder.is_dir():
        pytest.skip(f"no published tracks at {folder}")
    return load_reference(folder)


@pytest.fixture(scope="session")
def new_fluid_law() -> bool:
    """Whether the installed engine is from MuJoCo 3.14 on, where the ellipsoid fluid forces differ."""
    return tuple(map(int, mujoco.__version__.split(".")[:2])) >= (3, 14)
