import os
import socket
from pathlib import Path

import hypothesis
import mujoco
import pytest

from films import Shot, shoot
from pools import film
from swim2real.trials import TrialSet, load_reference, save_reference

# the same examples every time, and no time limit for one, since machines are shared
hypothesis.settings.register_profile("swim2real", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("swim2real")

PROJECT = Path(__file__).resolve().parents[1]
HERE = ("127.0.0.1", "::1", "localhost")


@pytest.fixture(scope="session", autouse=True)
def no_network():
    """No test may talk to another machine."""
    patches = pytest.MonkeyPatch()

    def guarded(connect):
        def only_here(self, address):
            if self.family in (socket.AF_INET, socket.AF_INET6) and address[0] not in HERE:
                raise AssertionError(f"a test tried to connect to {address}")
            return connect(self, address)

        return only_here

    for name in ("connect", "connect_ex"):
        patches.setattr(socket.socket, name, guarded(getattr(socket.socket, name)))
    yield
    patches.undo()


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


@pytest.fixture(scope="session")
def pool_folder(tmp_path_factory) -> Path:
    """A reference folder with two short swims of a fish with hidden parameters. Don't write into it."""
    folder = tmp_path_factory.mktemp("pool") / "reference"
    save_reference(film(), folder)
    return folder


@pytest.fixture(scope="session")
def pool(pool_folder) -> TrialSet:
    """The same, read."""
    return load_reference(pool_folder)


@pytest.fixture(scope="session")
def shot(tmp_path_factory) -> Shot:
    """A film of 37 frames, f1_50.mp4. Don't write into its folder."""
    return shoot(tmp_path_factory.mktemp("shot"))


@pytest.fixture(scope="session")
def clip(tmp_path_factory) -> Shot:
    """A film of 7 frames, f1_25.mp4. Don't write into its folder."""
    return shoot(tmp_path_factory.mktemp("clip"), "f1_25", seconds=0.2)
