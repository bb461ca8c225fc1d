import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does: matrices are small
import socket
import uuid
from pathlib import Path

import hypothesis
import mujoco
import pytest

from swim2real import consent
from swim2real.trials import TrialSet, load_reference, save_reference
from vlm_server import VlmServer

# the same examples every time, and no time limit for one, since machines are shared
hypothesis.settings.register_profile("swim2real", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("swim2real")

PROJECT = Path(__file__).resolve().parents[1]
HERE = ("127.0.0.1", "::1", "localhost")
SECRET = ("_API_KEY", "_AUTH_TOKEN", "_BASE_URL", "_PROXY")


@pytest.fixture(autouse=True)
def only_this_machine(monkeypatch):
    """Fails a test that looks for another machine, even where a client takes that for a network that is down."""
    tried: list[str] = []

    def guard(owner, name, address):
        original = getattr(owner, name)

        def guarded(*args, **kwargs):
            host = address(*args)
            if host is not None and host not in HERE:
                tried.append(str(host))
                raise OSError(f"a test must not reach '{host}'")
            return original(*args, **kwargs)

        monkeypatch.setattr(owner, name, guarded)

    def of_socket(connection, address, *rest):
        return address[0] if connection.family in (socket.AF_INET, socket.AF_INET6) else None

    def of_name(host, *rest):
        return host.decode() if isinstance(host, bytes) else host

    for name in ("connect", "connect_ex"):
        guard(socket.socket, name, of_socket)
    guard(socket, "getaddrinfo", of_name)
    yield tried
    assert not tried, f"the test tried to reach {', '.join(tried)}; only this machine is allowed"


@pytest.fixture(autouse=True)
def no_keys(monkeypatch):
    """No key and no address of whoever runs the tests."""
    for name in list(os.environ):
        if name.upper().endswith(SECRET):
            monkeypatch.delenv(name)


@pytest.fixture(autouse=True)
def nothing_allowed(monkeypatch, tmp_path_factory):
    """No code is allowed from before, and what a test allows is forgotten."""
    monkeypatch.setenv(consent.FOLDER, str(tmp_path_factory.getbasetemp() / f"allowed-{uuid.uuid4()}"))
    monkeypatch.setattr(consent, "_marks", set())


@pytest.fixture
def vlm():
    """A server that answers as a test says."""
    with VlmServer() as server:
        yield server


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
def repeatable_swims(new_fluid_law) -> None:
    """Skips a test of what a fit finds where swims hang on the last digit of their start."""
    if new_fluid_law:
        pytest.skip("with the fluid law of this engine swims hang on the last digit of their start")


@pytest.fixture(scope="session")
def pool_folder(tmp_path_factory) -> Path:
    """A reference folder with two short swims of a fish with hidden parameters. Don't write into it."""
    from pools import film  # heavy, and of no use to the process that hands out the tests

    folder = tmp_path_factory.mktemp("pool") / "reference"
    save_reference(film(), folder)
    return folder


@pytest.fixture(scope="session")
def pool(pool_folder) -> TrialSet:
    """The same, read."""
    return load_reference(pool_folder)


@pytest.fixture(scope="session")
def shot(tmp_path_factory):
    """A film of 37 frames, f1_50.mp4. Don't write into its folder."""
    from films import shoot

    return shoot(tmp_path_factory.mktemp("shot"))


@pytest.fixture(scope="session")
def clip(tmp_path_factory):
    """A film of 7 frames, f1_25.mp4. Don't write into its folder."""
    from films import shoot

    return shoot(tmp_path_factory.mktemp("clip"), "f1_25", seconds=0.2)
