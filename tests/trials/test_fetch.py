"""Getting the published tracks, from a folder and from a server on this machine. The internet is never asked."""

import gc
import hashlib
import shutil
import threading
import warnings
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pooch
import pytest

from refused import refusal, says
from swim2real.trials import fetch as room
from swim2real.trials import load_reference
from swim2real.trials.fetch import PAGE, SHA256, fetch
from swimbase.errors import TrialError


def made_up(number: int) -> bytes:
    """A table as the published ones are: nine markers that move, in pixels."""
    time = np.arange(30)[:, None]
    x = 100 + 30 * np.arange(9) - 2 * time
    y = 200 + (3 + number) * np.sin(0.3 * time - 0.2 * np.arange(9))
    rows = np.stack([x, y], axis=2).reshape(30, 18)
    return "".join(",".join(f"{value:.3f}" for value in row) + "\n" for row in rows).encode()


@pytest.fixture
def tables(monkeypatch) -> dict[str, bytes]:
    """Eight tables that stand for the published ones."""
    content = {name: made_up(number) for number, name in enumerate(SHA256)}
    monkeypatch.setattr(room, "SHA256", {name: hashlib.sha256(table).hexdigest() for name, table in content.items()})
    return content


@pytest.fixture
def folder(tables, tmp_path):
    """A folder with the eight stand-ins, and other files."""
    path = tmp_path / "by hand"
    path.mkdir()
    for name, table in {**tables, "markers_f3_00.csv": made_up(9), "notes.txt": b"mine"}.items():
        (path / name).write_bytes(table)
    return path


@pytest.fixture
def target(tmp_path):
    return tmp_path / "reference"


class Server:
    """Serves files on this machine and remembers what was asked for."""

    def __init__(self):
        self.files: dict[str, bytes] = {}
        self.requests: list[str] = []
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                server.requests.append(self.path)
                content = server.files.get(self.path)
                self.send_response(404 if content is None else 200)
                self.send_header("Content-Length", str(len(content or b"")))
                self.end_headers()
                self.wfile.write(content or b"")

            def log_message(self, *arguments):
                pass

        self._server = HTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01})
        self._thread.start()

    def close(self):
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture
def server(tables, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "*")
    monkeypatch.setattr(pooch.core.time, "sleep", lambda seconds: None)  # between its tries
    one = Server()
    one.files = {f"/tracks/{name}": table for name, table in tables.items()}
    yield one
    one.close()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pooch leaves a refused answer open
        gc.collect()


def test_the_published_tracks_are_taken_from_a_folder(shared, tracks, target):
    source = shared / "data" / "fishsim-markers"
    seen = {}
    taken = fetch(target, source, seen.__setitem__)
    there = {path.name for path in source.glob("*.csv")}
    assert seen == {name: "taken" if name in there else "not there" for name in SHA256}
    for found in (taken, load_reference(target)):
        assert found.names == tracks.names
        for trial in found:
            raw = tracks[trial.name]
            assert trial.nominal_frequency == raw.nominal_frequency
            assert trial.meters_per_pixel == raw.meters_per_pixel
            np.testing.assert_array_equal(trial.track.times, raw.track.times)
            np.testing.assert_array_equal(trial.track.positions, raw.track.positions)


@pytest.mark.parametrize("source", ["folder", "address", "published"])
def test_all_eight_are_taken_wherever_they_are(server, folder, target, monkeypatch, source):
    monkeypatch.setattr(room, "SOURCE", f"{server.address}/tracks/")
    seen = {}
    places = {"folder": folder, "address": f"{server.address}/tracks", "published": None}
    found = fetch(target, places[source], seen.__setitem__)
    assert seen == dict.fromkeys(SHA256, "taken" if source == "folder" else "downloaded")
    assert sorted(server.requests) == ([] if source == "folder" else sorted(server.files))
    (folder / "markers_f3_00.csv").unlink()  # none of the published ones
    raw = load_reference(folder)
    for trials in (found, load_reference(target)):
        assert trials.names == raw.names
        for one, other in zip(trials, raw, strict=True):
            np.testing.assert_allclose(one.track.positions, other.track.positions, atol=1e-6)
    before = {path.name: path.read_bytes() for path in target.iterdir()}
    assert says(refusal(TrialError, fetch, target, folder), f"'{target}'", "already", "--to")
    assert {path.name: path.read_bytes() for path in target.iterdir()} == before


def test_a_published_track_with_other_line_ends_is_refused_by_name(shared, tracks, target, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(shared / "data" / "fishsim-markers", copy)
    changed = copy / f"markers_{tracks.names[0]}.csv"
    changed.write_bytes(changed.read_bytes() + b"\r\n")
    digest = hashlib.sha256(changed.read_bytes()).hexdigest()[:12]
    assert says(refusal(TrialError, fetch, target, copy), changed, "isn't the published file", digest, PAGE)
    assert not target.exists()


def test_places_that_wont_do_are_refused(folder, target, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert says(refusal(TrialError, fetch, target, empty), f"'{empty}'", "none of the published files", "f0_50.csv")
    assert says(refusal(TrialError, fetch, target, tmp_path / "no"), f"'{tmp_path / 'no'}'", "no folder")
    for source in ("ftp://127.0.0.1/tracks", "file:///tracks", "://", "http://", "http://[::1"):
        assert says(refusal(TrialError, fetch, target, source), f"'{source}'", "no address", "http")
    assert not target.exists()
    target.write_text("mine")
    assert "can't write reference folder" in refusal(TrialError, fetch, target / "below", folder)


@pytest.mark.parametrize(("content", "parts"), [
    (None, ("markers_f1_00.csv from {at}", "can't be downloaded (HTTPError)")),
    (b"<html>Please log in</html>", ("markers_f1_00.csv from {at}", "isn't the published file")),
    (b" " * 8_100_000, ("markers_f1_00.csv from {at}", "can't be downloaded (OSError)")),
    ("closed", ("markers_f0_50.csv from {at}", "can't be downloaded (ConnectionError)")),
])  # fmt: skip
def test_what_a_server_lacks_is_reported_with_the_way_by_hand(server, target, content, parts):
    address = f"{server.address}/tracks/"
    if content == "closed":
        server.close()
    else:
        server.files["/tracks/markers_f1_00.csv"] = content
    said = refusal(TrialError, fetch, target, address)
    assert says(said, *(part.format(at=address) for part in parts), "By hand", PAGE, "fetch --from FOLDER")
    assert not target.exists()
