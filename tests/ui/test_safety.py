"""Who may ask the page's server, and for what."""

import json
import os
import random
import re
import shutil
import socket
import stat
import string
from contextlib import suppress
from pathlib import Path

import pytest

pytest.importorskip("tornado", reason="the page needs tornado; install the extra ui")

from swim2real.ui import server as module
from swim2real.ui.calls import CALLS
from swim2real.ui.project import Project
from swim2real.ui.server import listening, open_browser
from swimbase.errors import ArgumentError


def test_the_page_holds_nothing_of_the_folder_and_lets_only_its_own_script_run(served):
    status, body = served.ask("GET", "/", token="none")
    assert status == 200
    assert b"f0_50" not in body
    policy = re.search(rb'Content-Security-Policy" content="([^"]*)"', body).group(1).decode()
    assert "default-src 'none'" in policy
    assert re.search(r"script-src 'sha256-[^;' ]+';", policy)
    assert b"http://" not in body.replace(b"http://www.w3.org", b"")
    assert b"https://" not in body


@pytest.mark.parametrize(
    "headers",
    [
        {"token": "none"}, {"token": "é"}, {"Authorization": ""}, {"Host": "pool.example"}, {"Host": "127.0.0.1.x.io"},
        {"Host": ""}, {"Host": "localhost:x"}, {"Origin": "http://pool.example"}, {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"}, {"Cookie": "token=TOKEN", "Authorization": ""},
    ],
)  # fmt: skip
def test_strangers_are_refused(served, headers):
    for method in ("GET", "POST"):
        for call in ("project", "frame?film=f0_50.mp4&number=0", "stop", "nothing"):
            status, body = served.ask(method, f"/api/{call}", **headers)
            assert status == 403
            assert b"f0_50" not in body


def test_a_token_in_the_address_is_none(served):
    assert served.ask("GET", f"/api/project?token={served.token}", Authorization="")[0] == 403


def test_a_films_address_is_of_that_film_alone(served, films):
    address = served.call("film", query="?film=f0_50.mp4&robot=fish")["address"]
    (films / "other.mp4").write_bytes(b"other")
    _, _, seal, name = address.split("/")
    assert name == "f0_50.mp4"
    (films.parent / "secret.mp4").write_bytes(b"secret")
    for wrong in (
        f"/film/{seal}/other.mp4",
        f"/film/{seal[:-1]}/{name}",
        f"/film/x/{name}",
        f"/film/{seal}/../secret.mp4",
    ):
        status, body = served.ask("GET", wrong)
        assert (status, body.find(b"other")) == (403, -1)
    assert served.ask("GET", address, Host="pool.example")[0] == 403
    assert served.ask("GET", address, Origin="null")[0] == 403
    (films / "other.mp4").unlink()


def test_the_near_end_of_a_tunnel_is_this_machine(served):
    host = "localhost:9999"
    assert served.ask("GET", "/api/project", Host=host, Origin=f"http://{host}")[0] == 200


@pytest.mark.parametrize("name", ["../secret.mp4", "/etc/passwd", "link.mp4", "a\0b", "x/../../secret.mp4", "~/x"])
def test_nothing_outside_of_the_folder_is_read(served, films, name):
    (films.parent / "secret.mp4").write_bytes(b"secret")
    if not (films / "link.mp4").is_symlink():
        (films / "link.mp4").symlink_to(films.parent / "secret.mp4")
    quoted = "".join(f"%{byte:02x}" for byte in name.encode())
    for call in (f"film?film={quoted}&robot=fish", f"frame?film={quoted}&number=0"):
        status, body = served.ask("GET", f"/api/{call}")
        assert status == 400
        sentence = json.loads(body)["error"]
        assert "isn't in the folder" in sentence or "no video" in sentence  # of ~/x, a name in it that isn't there
    values = {"values": {}}
    fits = [{"reference": name, "robot": "fish"}, {"reference": ".", "robot": f"{name}.toml"},
            {"reference": ".", "robot": "fish", "run": name}]  # fmt: skip
    bodies = [("fit", one) for one in fits] + [(call, {**one, **values}) for one in fits for call in ("search", "keep")]
    bodies += [("fit", {"reference": ".", "robot": "fish", "begin": name}), ("work", {"kind": "report", "run": name})]
    bodies += [("mark", {"film": name, "robot": "fish", "kind": "points", "frame": 0, "put": {}})]
    for call, content in bodies:
        assert served.ask("POST", f"/api/{call}", json.dumps(content).encode())[0] == 400
    assert sorted(path.name for path in films.parent.iterdir() if path.suffix not in (".json", ".mp4")) == ["pool"]
    assert "link.mp4" not in {film["path"] for film in served.call("project")["films"]}


def test_links_inside_of_the_folders_lead_nowhere(served, films):
    (films.parent / "secret.json").write_text('{"secret": 1}')
    for place in ("trials/reference.json", "old/settings.json", "old/record.jsonl", "link.points.json"):
        (films / place).parent.mkdir(exist_ok=True)
        if not (films / place).is_symlink():
            (films / place).symlink_to(films.parent / "secret.json")
    shutil.copy(films / "f0_50.mp4", films / "link2.mp4")
    (films / "link2.points.json").symlink_to(films.parent / "secret.json")
    fit = {"reference": "trials", "robot": "fish"}
    status, body = served.ask("POST", "/api/fit", json.dumps(fit).encode())
    assert (status, b"isn't in the folder" in body, b'secret"' in body) == (400, True, False)
    status, body = served.ask("GET", "/api/marks?film=link2.mp4&robot=fish&kind=points")
    assert (status, b"is a link" in body) == (400, True)
    (films / "link2.mp4").unlink()
    project = served.call("project")
    assert not {"trials", "old"} & {one["path"] for one in (*project["references"], *project["runs"])}


def test_odd_requests_are_refused_and_the_server_goes_on(served):
    draw = random.Random(0)
    names = [*(call.split()[1] for call in CALLS), "", "x", "..", "%2e%2e"]
    for _ in range(400):
        path = f"/api/{draw.choice(names)}?" + "".join(draw.choices(string.ascii_letters + "&=%./?", k=20))
        body = draw.choice([b"", b"[" * 20000, b"{}", b"null", b'{"film":1}', b'{"film":"f0_50.mp4"}', os.urandom(40)])
        status, _ = served.ask(draw.choice(["GET", "POST", "PUT", "DELETE", "PATCH"]), path.replace(" ", ""), body)
        assert status in (200, 400, 403, 404, 405), path
    assert served.call("project")["films"]
    with suppress(ConnectionError):  # it hangs up before all has come
        assert served.ask("POST", "/api/stop", b" " * (1 << 21) + b"{}")[0] in (400, 413)
    assert served.call("project")["films"]


def test_raw_noise_is_no_request(served):
    draw = random.Random(1)
    for _ in range(50):
        with socket.create_connection(("127.0.0.1", served.port), timeout=5) as connection:
            connection.sendall(draw.randbytes(draw.randrange(1, 400)) + b"\r\n\r\n")
            connection.shutdown(socket.SHUT_WR)
            assert b"f0_50" not in connection.recv(1 << 16)
    assert served.call("project")["films"]


def test_it_listens_on_this_machine_alone():
    (one,) = listening(0)
    with one:
        assert one.getsockname()[0] == "127.0.0.1"


def test_a_port_in_use_and_a_folder_that_is_none_are_sentences(served, tmp_path):
    with pytest.raises(ArgumentError, match=rf"--port {served.port} can't be used .*leave --port out"):
        listening(served.port)
    with pytest.raises(ArgumentError, match="--port is 70000"):
        listening(70000)
    with pytest.raises(ArgumentError, match=r"is no folder; give"):
        Project(tmp_path / "nothing")
    assert Project(tmp_path).content().films == []


def test_the_browser_gets_the_token_from_a_file_of_its_users_own(monkeypatch):
    opened = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(module.webbrowser, "open", lambda address: opened.append(address) or True)
    remove = open_browser("http://127.0.0.1:1/#token")
    (address,) = opened
    file = Path(address.removeprefix("file://"))
    assert "token" not in address
    assert "#token" in file.read_text()
    assert (stat.S_IMODE(file.stat().st_mode), stat.S_IMODE(file.parent.stat().st_mode)) == (0o600, 0o700)
    remove()
    assert not file.parent.exists()
