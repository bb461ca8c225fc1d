"""Getting the published tracks, from a folder and from a server on this machine. The internet is never asked."""

import gc
import hashlib
import re
import shutil
import threading
import warnings
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pooch
import pytest

from swim2real.errors import TrialError
from swim2real.trials import fetch as room
from swim2real.trials import load_reference
from swim2real.trials.fetch import PAGE, SHA256, SOURCE, fetch

PUBLISHED_SHA256 = {
    "markers_f0_50.csv": "04172540fc0f46fb2e7d0fc3367e12291bc1f47a61d92e443809ff353c61958d",
    "markers_f2_25.csv": "850a6e09f57e4d8e76eda502e39067e13bdf79f4867801481596211c82ca0e89",
}
BY_HAND = f"By hand: get the files of {PAGE} and run `swim2real fetch --from FOLDER --to …`"


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def refusal(*arguments: object) -> str:
    with pytest.raises(TrialError) as caught:
        fetch(*arguments)
    return str(caught.value)


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
    monkeypatch.setattr(room, "SHA256", {name: digest(table) for name, table in content.items()})
    return content


@pytest.fixture
def folder(tables, tmp_path):
    """A folder with the eight stand-ins."""
    path = tmp_path / "by hand"
    path.mkdir()
    for name, table in tables.items():
        (path / name).write_bytes(table)
    return path


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


# what is published


def test_the_published_files_are_fixed():
    assert len(SHA256) == 8
    assert all(re.fullmatch("[0-9a-f]{64}", value) for value in SHA256.values())
    assert {name: SHA256[name] for name in PUBLISHED_SHA256} == PUBLISHED_SHA256
    assert SOURCE.startswith("https://")
    assert "/08880b6" in SOURCE
    assert "/08880b6" in PAGE


# from a folder


def test_the_published_tracks_are_taken_from_a_folder(shared, tracks, tmp_path):
    source = shared / "data" / "fishsim-markers"
    seen = {}
    taken = fetch(tmp_path / "reference", source, seen.__setitem__)
    there = {path.name for path in source.glob("*.csv")}
    assert seen == {name: "taken" if name in there else "not there" for name in SHA256}
    for found in (taken, load_reference(tmp_path / "reference")):
        assert found.names == tracks.names
        for trial in found:
            raw = tracks[trial.name]
            assert trial.nominal_frequency == raw.nominal_frequency
            assert trial.meters_per_pixel == raw.meters_per_pixel
            np.testing.assert_array_equal(trial.track.times, raw.track.times)
            np.testing.assert_array_equal(trial.track.positions, raw.track.positions)


def test_all_eight_are_taken_from_a_folder_that_has_them(folder, tmp_path):
    seen = {}
    fetch(tmp_path / "reference", folder, seen.__setitem__)
    assert seen == dict.fromkeys(SHA256, "taken")
    found, raw = load_reference(tmp_path / "reference"), load_reference(folder)
    assert found.names == raw.names
    assert len(found) == 8
    for one, other in zip(found, raw, strict=True):
        np.testing.assert_allclose(one.track.positions, other.track.positions, atol=1e-6)


def test_other_files_of_a_folder_are_left_out(folder, tmp_path):
    (folder / "markers_f3_00.csv").write_bytes(made_up(9))
    (folder / "notes.txt").write_text("mine")
    assert "f3_00" not in fetch(tmp_path / "reference", folder).names


def test_a_changed_file_is_refused_by_name(folder, tmp_path):
    changed = folder / "markers_f1_25.csv"
    changed.write_bytes(changed.read_bytes().replace(b"1", b"2", 1))
    message = refusal(tmp_path / "reference", folder)
    assert message.startswith(f"{changed} isn't the published file: its sha256 is {digest(changed.read_bytes())[:12]}…")
    assert PAGE in message
    assert not (tmp_path / "reference").exists()


def test_a_published_track_with_other_line_ends_is_refused_by_name(shared, tmp_path):
    source = shared / "data" / "fishsim-markers"
    if not (source / "markers_f1_00.csv").is_file():
        pytest.skip(f"no published tracks at {source}")
    copy = tmp_path / "copy"
    copy.mkdir()
    for path in source.glob("*.csv"):
        shutil.copy(path, copy)
    changed = copy / "markers_f1_00.csv"
    changed.write_bytes(changed.read_bytes() + b"\r\n")
    assert refusal(tmp_path / "reference", copy).startswith(f"{changed} isn't the published file")


def test_a_folder_without_any_is_refused(tmp_path):
    assert refusal(tmp_path / "reference", tmp_path).startswith(
        f"'{tmp_path}' holds none of the published files (markers_f0_50.csv, "
    )
    assert not (tmp_path / "reference").exists()


def test_a_folder_that_isnt_there_is_refused(tmp_path):
    nothing = str(tmp_path / "nothing")
    assert refusal(tmp_path / "reference", nothing).startswith(f"'{nothing}' is no folder; ")


def test_a_reference_that_is_there_isnt_overwritten(folder, tmp_path):
    target = tmp_path / "reference"
    fetch(target, folder)
    before = {path.name: path.read_bytes() for path in target.iterdir()}
    assert refusal(target, folder) == (
        f"'{target}' holds a reference already; remove it or choose another folder with --to"
    )
    assert {path.name: path.read_bytes() for path in target.iterdir()} == before


def test_a_target_that_cant_be_made_is_told(folder, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "can't write reference folder" in refusal(tmp_path / "file" / "reference", folder)


# from a server


def test_all_are_downloaded_and_become_a_reference(server, folder, tmp_path):
    seen = {}
    found = fetch(tmp_path / "reference", f"{server.address}/tracks", seen.__setitem__)
    assert seen == dict.fromkeys(SHA256, "downloaded")
    assert sorted(server.requests) == sorted(server.files)
    raw = load_reference(folder)
    for trials in (found, load_reference(tmp_path / "reference")):
        assert trials.names == raw.names
        for one, other in zip(trials, raw, strict=True):
            np.testing.assert_allclose(one.track.positions, other.track.positions, atol=1e-6)


def test_the_default_is_the_published_place(server, tmp_path, monkeypatch):
    monkeypatch.setattr(room, "SOURCE", f"{server.address}/tracks/")
    assert len(fetch(tmp_path / "reference")) == 8


def test_a_file_that_the_server_lacks_is_told(server, tmp_path):
    server.files.pop("/tracks/markers_f1_00.csv")
    message = refusal(tmp_path / "reference", f"{server.address}/tracks/")
    assert message == (
        f"markers_f1_00.csv from {server.address}/tracks/ can't be downloaded (HTTPError). {BY_HAND}"
    )  # fmt: skip
    assert not (tmp_path / "reference").exists()


def test_a_file_of_other_content_is_refused(server, tmp_path):
    server.files["/tracks/markers_f1_00.csv"] = b"<html>Please log in</html>"
    message = refusal(tmp_path / "reference", f"{server.address}/tracks")
    assert message == f"markers_f1_00.csv from {server.address}/tracks isn't the published file. {BY_HAND}"
    assert not (tmp_path / "reference").exists()


def test_without_a_server_the_message_says_how_to_do_it_by_hand(server, tmp_path):
    server.close()
    message = refusal(tmp_path / "reference", server.address)
    assert message == f"markers_f0_50.csv from {server.address} can't be downloaded (ConnectionError). {BY_HAND}"
    assert not (tmp_path / "reference").exists()


@pytest.mark.parametrize("source", ["ftp://127.0.0.1/tracks", "file:///tracks", "://", "http://", "http://[::1"])
def test_an_address_of_another_kind_is_refused(source, tmp_path):
    assert refusal(tmp_path / "reference", source).startswith(f"'{source}' is no address to download from; ")
