"""What the page's calls do is what the commands do, in the files that they write."""

import io
import json
import re
import shutil
import time
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from live_page import FILM, serving, unpacked
from PIL import Image

from drawn_swimmers import Swimmer, film
from markertrack.points import load_points
from markertrack.video import VideoReader, VideoWriter
from swim2real import load_reference, open_run
from swim2real.calibration import Problem
from swim2real.demo.example import FILMS, hidden_values
from swim2real.robots.fish import FISH
from swim2real.settings import EvaluationSettings, VlmAccess
from swim2real.ui import marking
from swim2real.ui.films import FilmCache
from swim2real.ui.project import Project
from swimbase.errors import ArgumentError
from vlm_server import replies

QUERY = f"?film={FILM}&robot=fish"
TRACKED = f"{QUERY}&reference=reference&trial=f0_50"
FIT = {"reference": "reference", "robot": "fish"}


def refused(served, name, body):
    status, answer = served.ask("POST", f"/api/{name}", json.dumps(body).encode())
    assert status == 400
    return json.loads(answer)["error"]


def test_a_frame_is_that_of_the_film(served):
    status, body = served.ask("GET", f"/api/frame?film={FILM}&number=100")
    assert status == 200
    with VideoReader(FILMS / FILM) as reader:
        image = next(frame.image for frame in reader if frame.index == 100)
    assert np.abs(np.asarray(Image.open(io.BytesIO(body)), dtype=int) - image).mean() < 2


def test_an_early_picture_is_of_a_frame_nearby(served):
    for number in (200, 3):
        answer = served.response("GET", f"/api/frame?film={FILM}&number={number}&early=1")
        near = int(answer.headers["X-Frame"])
        assert 0 <= number - near <= 180  # 3 s
        with VideoReader(FILMS / FILM) as reader:
            image = next(frame.image for frame in reader if frame.index == near)
        assert np.abs(np.asarray(Image.open(io.BytesIO(answer.body)), dtype=int) - image).mean() < 2


def test_the_browsers_player_gets_the_parts_of_the_film_that_it_asks_for(served):
    address, content = served.call("film", query=QUERY)["address"], (FILMS / FILM).read_bytes()
    assert served.ask("GET", address, Authorization="") == (200, content)
    for asked, part in (("bytes=100-199", content[100:200]), ("bytes=7-", content[7:])):
        answer = served.response("GET", address, Range=asked, Authorization="")
        assert (answer.status, answer.body) == (206, part)
        assert answer.headers["Content-Range"].endswith(f"/{len(content)}")
    assert served.ask("GET", address, Range=f"bytes={len(content)}-")[0] == 416


def marks(served, kind="points"):
    return dict(served.call("marks", query=f"{QUERY}&kind={kind}"))


def test_points_are_saved_as_track_takes_them(served, films):
    about = served.call("film", query=QUERY)
    assert (about["width"], about["height"], about["frames"], about["track"]) == (1280, 720, 241, None)
    path = films / "f0_50.points.json"
    before = path.read_bytes()
    assert marks(served) == {0: json.loads(before)["markers"]}
    markers = {name: [100.0 + 40 * m, 300.5] for m, name in enumerate(about["names"])}
    asked = {"film": FILM, "robot": "fish", "kind": "points", "frame": 3}
    served.call("mark", {**asked, "put": markers})  # of another frame: they are new
    anchor = load_points(path, about["names"], 1280, 720)
    assert anchor.frame == 3
    np.testing.assert_array_equal(anchor.points, list(markers.values()))
    saves = served.call("job")["saves"]
    served.call("mark", {**asked, "put": {"M2": [1.0, 2.0]}, "drop": ["M5"]})
    assert served.call("job")["saves"] == saves + 1
    assert marks(served) == {3: {name: at for name, at in {**markers, "M2": [1.0, 2.0]}.items() if name != "M5"}}
    for wrong in ({"M0": ["x", 1]}, [], {"M0": [1, 2, 3]}):
        assert re.match("call 'mark': |points: ", refused(served, "mark", {**asked, "put": wrong}))
    assert len(marks(served)[3]) == 8
    path.write_text(json.dumps([[float(m), 1.0] for m in range(9)]))  # a plain list, as `track` takes it
    served.call("mark", {**asked, "frame": 0, "put": {"M2": [7.0, 2.0]}})
    assert (marks(served)[0]["M2"], marks(served)[0]["M8"]) == ([7, 2], [8, 1])
    path.write_text(json.dumps({"markers": {"snout": [1, 2]}}))
    assert "snout, which robot 'fish' doesn't have" in refused(served, "mark", {**asked, "put": markers})
    path.write_bytes(before)


def test_tables_beside_a_film_are_taken_and_tags_under_its_points_are_read(tmp_path, monkeypatch):
    image, places = np.full((240, 380, 3), 255, np.uint8), {"a": [70, 120], "b": [190, 120], "c": [310, 120]}
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number, (x, y) in enumerate(places.values()):
        tag = cv2.aruco.generateImageMarker(tags, number, 60)
        image[y - 30 : y + 30, x - 30 : x + 30] = tag[..., None]
    with VideoWriter(tmp_path / "swim.mp4", 380, 240, 30) as writer:
        for _ in range(3):
            writer.write(image)
    (tmp_path / "swim.points.json").write_text(json.dumps({"markers": places}))
    (tmp_path / "swim.controls.csv").write_text("time_s,motor\n0,1\n")
    taken, report = [], SimpleNamespace(lost_share=[0.0], trial="swim", frames=3)
    track = lambda film, points, robot, settings, *folder, **more: taken.append((settings, more)) or track  # noqa: E731
    track.report = report
    monkeypatch.setattr(marking, "track_video", track)
    robot = SimpleNamespace(marker_names=tuple(places))
    marking.track(tmp_path / "swim.mp4", robot, tmp_path / "to", None, False, FilmCache(), None)
    ((settings, more),) = taken
    assert (settings.tracker, settings.tags) == ("aruco", "APRILTAG_36h11")
    assert (more["controls"], more["sensors"]) == (tmp_path / "swim.controls.csv", None)


def test_a_film_that_is_written_and_a_folder_without_one_are_no_fault(tmp_path):
    (tmp_path / "half.mp4").write_bytes((FILMS / FILM).read_bytes()[:32])
    with serving(tmp_path) as server:
        assert [film["path"] for film in server.call("project")["films"]] == ["half.mp4"]
        status, answer = server.ask("GET", "/api/film?film=half.mp4&robot=fish")
        assert status == 400
        assert "cut off" in json.loads(answer)["error"]
        shutil.copy(FILMS / FILM, tmp_path / "half.mp4")
        assert server.call("film", query="?film=half.mp4&robot=fish")["frames"] == 241


def seen_live(served):
    """Number of a frame and places in it, while a film is tracked."""
    until = time.monotonic() + 200
    while not (job := served.call("job"))["places"] and job["running"]:
        assert time.monotonic() < until, job
        time.sleep(0.02)
    assert job["places"], job
    return job["done"] - 1, unpacked(job["places"], -1)


@pytest.fixture(scope="module")
def live(served):
    """Places that were seen while the film was tracked by the page's call."""
    served.call("track", {"film": FILM, "robot": "fish"})
    assert "under way" in refused(served, "track", {"film": FILM, "robot": "fish"})
    assert served.call("job")["title"] == f"tracking {FILM}"
    seen, job = seen_live(served), served.ended()
    assert "241 frames" in job["said"], job
    return seen


@pytest.fixture(scope="module")
def tracked(live, films):
    """The film, tracked by the page's call."""
    return load_reference(films / "reference")


@pytest.mark.slow
def test_places_are_seen_while_a_film_is_tracked(served, live, tracked):
    number, places = live
    track = unpacked(served.call("film", query=TRACKED)["track"]["positions"], 241, 9)
    assert np.nanmax(np.linalg.norm(places - track[number], axis=1)) < 1  # px


@pytest.mark.slow
def test_a_track_and_its_corrections(served, films, tracked):
    (film,) = (film for film in served.call("project")["films"] if film["path"] == FILM)
    assert (film["reference"], film["trial"], film["points"]) == ("reference", "f0_50", True)
    track = served.call("film", query=TRACKED)["track"]
    assert (track["first"], track["frames"]) == (0, 241)
    place = unpacked(track["positions"], 241, 9)[100, 4].round(1).tolist()
    asked = {"film": FILM, "robot": "fish", "kind": "corrections"}
    served.call("mark", {**asked, "frame": 100, "put": {"M4": place, "M5": None}})
    served.call("mark", {**asked, "frame": 90, "put": {"M5": None}})
    served.call("mark", {**asked, "frame": 90, "put": {}, "drop": ["M5"]})
    served.call("mark", {**asked, "frame": 100, "put": {}, "drop": ["M5"]})
    served.call("track", {"film": FILM, "robot": "fish"})
    assert "241 frames" in served.ended()["said"]
    assert marks(served, "corrections") == {100: {"M4": place}}


@pytest.mark.slow
def test_a_midline_is_followed_from_two_clicks(tmp_path):
    swimmer = Swimmer(length=200.0, speed=0.4, frequency=2.0)
    film(tmp_path / "f2_00.mp4", [swimmer], count=60)
    query = "?film=f2_00.mp4&robot=fish"
    with serving(tmp_path) as server:
        assert server.call("film", query=f"{query}&midline=true")["names"] == ["M0", "M8"]
        markers = dict(zip(("M0", "M8"), swimmer.midline(0)[[0, -1]].tolist(), strict=True))
        asked = {"film": "f2_00.mp4", "robot": "fish", "kind": "points", "frame": 0}
        server.call("mark", {**asked, "put": markers})
        server.call("track", {"film": "f2_00.mp4", "robot": "fish", "midline": True})
        number, places = seen_live(server)
        assert "60 frames" in server.ended()["said"]
        track = server.call("film", query=f"{query}&reference=reference&trial=f2_00")["track"]
        positions = unpacked(track["positions"], 60, 9)
    assert load_reference(tmp_path / "reference")["f2_00"].midline
    for places_, time_ in ((places, number / 30), (positions[59], 59 / 30)):
        off = np.linalg.norm(places_[:, None] - swimmer.midline(time_), axis=2).min(axis=1)
        assert np.nanmax(off) < 5  # px from the true midline, whichever end is the head


@pytest.mark.slow
def test_a_simulation_is_that_of_the_product(served, films, tracked):
    about, values = served.call("fit", FIT), hidden_values()
    assert about["values"] == FISH.space.published
    answer = served.call("simulate", {**FIT, "values": values, "trial": "f0_50"})
    reference = load_reference(films / "reference")  # corrected since
    compared = Problem.with_settings(FISH, reference, EvaluationSettings()).evaluate(values).trials[0]
    assert answer["errors"]["f0_50"] == pytest.approx(compared.motion_error, rel=1e-6)
    scene = served.call("scene", {**FIT, "trial": "f0_50"})
    assert (scene["film"], scene["markers"]) == (FILM, 9)
    real, simulated = (unpacked(text, -1, 9) for text in (scene["real"], answer["simulated"]))
    assert np.nanmedian(np.linalg.norm(simulated - real, axis=2)) < 5  # px: nearly the hidden fish
    seen = unpacked(served.call("film", query=TRACKED)["track"]["positions"], 241, 9)[: len(real)]
    assert np.nanmedian(np.linalg.norm(real - seen, axis=2)) < 1  # the rings are on the film's markers
    beyond = {**values, "fluid_kutta_lift": 1e9}
    assert "fluid_kutta_lift" in refused(served, "simulate", {**FIT, "values": beyond})
    assert "no trial" in refused(served, "simulate", {**FIT, "values": values, "trial": "x"})


@pytest.mark.slow
def test_a_search_is_a_run_that_the_commands_take(served, films, tracked):
    begin = {**FIT, "values": FISH.space.published}
    served.call("search", begin)
    until = time.monotonic() + 200
    while served.call("job").get("done", 0) < 3:
        assert time.monotonic() < until
        time.sleep(0.1)
    assert "under way" in refused(served, "search", begin)
    assert served.call("stop", {})["stopping"]
    job = served.ended()
    assert not job["fault"], job
    run = open_run(films / "fit-1")
    assert run.outcome is not None
    assert run.values == job["values"]
    assert job["bests"][-1][1] == pytest.approx(1e3 * min(run.losses))
    (listed,) = served.call("project")["runs"]
    assert (listed["path"], listed["robot"], listed["reference"]) == ("fit-1", "fish", "reference")
    served.call("work", {"kind": "resume", "run": "fit-1"})
    until = time.monotonic() + 200
    while served.call("job").get("done", 0) < len(run.losses) + 1 and time.monotonic() < until:
        time.sleep(0.1)
    served.call("stop", {})
    assert "run fit-1" in served.ended()["said"]
    before, run = run, open_run(films / "fit-1")
    assert run.losses[: len(before.losses)] == before.losses
    assert len(run.losses) > len(before.losses)
    for kind, file in (("export", "model.xml"), ("report", "report.html")):
        served.call("work", {"kind": kind, "run": "fit-1"})
        assert "is written" in served.ended()["said"]
        assert (films / "fit-1" / file).is_file()
    about = served.call("fit", {**FIT, "run": "fit-1", "begin": "fit-1"})
    assert about["values"] == run.values
    left = {**run.values, "fluid_kutta_lift": 2.0}
    served.call("keep", {**FIT, "run": "fit-1", "values": left, "held": ["f0_50"], "left": True})
    assert "values-1.json is written" in served.call("keep", {**FIT, "values": left})["said"]
    *_, run_, sliders, kept = served.call("project")["runs"]
    assert (run_["path"], run_["run"]) == ("fit-1", "fit-1")
    assert (sliders["path"], sliders["run"], sliders["reference"]) == ("sliders.json", "fit-1", "reference")
    assert (kept["path"], kept["run"], kept["robot"], kept["usable"]) == ("values-1.json", None, "fish", True)
    about = served.call("fit", {**FIT, "run": "fit-1", "begin": "sliders.json"})
    assert (about["values"], about["held"]) == (left, ["f0_50"])
    served.call("ask", {**FIT, "values": run.values})
    assert FISH.space.check(served.ended()["values"])


@pytest.mark.slow
def test_a_vlm_is_asked_where_the_server_was_told_so(served, films, tracked, vlm, monkeypatch):
    content = {"diagnosis": "too slow", "reasoning": "lift", "parameters": {"fluid_kutta_lift": 2.0}}
    vlm.script(then=replies(json.dumps(content)))
    monkeypatch.setattr(served.project, "advisor", "openai:some-model")
    monkeypatch.setattr(served.project, "access", VlmAccess(base_url=vlm.url("openai"), tries=1))
    served.call("ask", {**FIT, "values": FISH.space.published})
    job = served.ended()
    assert (job["said"], round(job["values"]["fluid_kutta_lift"], 9)) == ("too slow lift", 2.0)
    assert list((films / "asked-1").rglob("call_*.json"))
    with pytest.raises(ArgumentError, match="'files'; on the page it must be physics or PROVIDER:MODEL"):
        Project(films, advisor="files")
