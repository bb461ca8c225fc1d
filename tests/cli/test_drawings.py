"""`overlay` and `view`: drawings, simulated markers on a person's own film, and a robot without a display."""

import json
import shutil

import numpy as np
import pytest

from films import slowed
from markertrack.video import VideoReader, VideoWriter


def test_overlays_of_recordings_are_written(program, words, tmp_path):
    out = tmp_path / "out"
    program(*words[: words.index("--video")], "--fps", 10, "--width", 320).done()
    assert sorted(path.name for path in out.iterdir()) == ["a.mp4", "a.png", "all.png", "b.mp4", "b.png"]
    with VideoReader(out / "a.mp4") as film:
        assert film.info.width == 320
        assert sum(1 for _ in film) == 6


SIZE = (320, 240)
SCALE = 400.0  # px/m
ORIGIN = (120.0, 230.0)  # px, of the world
PIVOT = (160, 30)  # px, 0.1 m to the right of it and 0.5 m above


@pytest.fixture
def words(pendulum_folder, tmp_path) -> list:
    """A command; the film begins 0.2 s before the trial."""
    values, camera = tmp_path / "parameters.json", tmp_path / "camera.json"
    robot = {"robot": "pendulum", "robot_file": str(pendulum_folder / "pendulum.toml")}
    dampings = {"shoulder_damping": 0.004, "elbow_damping": 0.001}
    values.write_text(json.dumps({"format": 1, **robot, "parameters": dampings}))
    plane = [[1 / SCALE, 0, -ORIGIN[0] / SCALE], [0, -1 / SCALE, ORIGIN[1] / SCALE], [0, 0, 1]]
    camera.write_text(json.dumps({"format": 1, "homography": plane}))
    (tmp_path / "films").mkdir()
    with VideoWriter(tmp_path / "films" / "a.mp4", *SIZE, fps=20.0) as film:
        for k in range(20):
            film.write(np.full((SIZE[1], SIZE[0], 3), 120, dtype=np.uint8), k / 20)
    return [
        "overlay", values, "--reference", pendulum_folder / "tracks", "--out", tmp_path / "out", "--horizon", 0.5,
        "--video", tmp_path / "films" / "a.mp4", "--camera", camera, "--from", 0.2,
    ]  # fmt: skip


def test_markers_lie_on_the_film_where_the_camera_sees_them(program, words, tmp_path) -> None:
    program(*words).done()
    assert program.out.strip() == f"{tmp_path / 'out' / 'a.on-film.mp4'}: 11 frames"
    with VideoReader(tmp_path / "out" / "a.on-film.mp4") as film:
        frames = [frame.image.astype(int) for frame in film]
    assert len(frames) == 11
    assert frames[0].shape == (SIZE[1], SIZE[0], 3)
    for image in (frames[0], frames[-1]):
        blue = image[:, :, 2] - image[:, :, 0] > 60
        assert blue[PIVOT[1], PIVOT[0]]
        assert np.argwhere(blue)[:, 0].max() > PIVOT[1] + 60  # the end hangs below


def test_a_film_whose_rate_was_given_is_drawn_on_the_camera_s_clock(program, words, pendulum_folder, tmp_path):
    clock = {"track": {"origin": "first frame of a.mp4", "rate": 20.0, "known_by": "given"}}
    shutil.copytree(pendulum_folder / "tracks", tmp_path / "tracks")
    index = json.loads((tmp_path / "tracks" / "reference.json").read_text())
    index["trials"][0]["timebases"] = clock
    (tmp_path / "tracks" / "reference.json").write_text(json.dumps(index))
    slowed(tmp_path / "films" / "a.mp4", tmp_path / "slow.mp4", 8).replace(tmp_path / "films" / "a.mp4")
    program(*[tmp_path / "tracks" if word == pendulum_folder / "tracks" else word for word in words]).done()
    assert program.out.strip() == f"{tmp_path / 'out' / 'a.on-film.mp4'}: 11 frames"


def without(words: list, option: str) -> list:
    k = words.index(option)
    return words[:k] + words[k + 2 :]


def test_what_is_missing_or_wrong_is_named(program, words, tmp_path) -> None:
    other = tmp_path / "films" / "q.mp4"
    other.write_bytes((tmp_path / "films" / "a.mp4").read_bytes())
    for given, code, part in (
        (without(words, "--camera"), 1, "there is no scale"), (without(words, "--video"), 2, "--camera is of your own"),
        ([*without(words, "--from"), "--from", 0.99], 1, "has no frame of trial 'a'"),
        ([*without(words, "--video"), "--video", other], 1, "no trial is named 'q'; there are a, b"),
        ([*words, "--pieces", 0.2], 2, "--pieces cuts trials"),
    ):  # fmt: skip
        assert part in program(*given).sentence(code)
    assert not list(tmp_path.rglob("*.part*"))


@pytest.mark.slow
def test_a_film_that_was_tracked_from_a_time_on_is_drawn_without_being_told(program, shot, tmp_path) -> None:
    program(
        "track", shot.video, "--markers", shot.points, "--to", tmp_path / "reference", "--camera", shot.camera
    ).done()
    words = ["overlay", "published", "--reference", tmp_path / "reference", "--out", tmp_path / "out"]
    program(*words, "--protocol", "aligned", "--video", shot.video, "--camera", shot.camera).done()
    assert "37 frames" in program.out
    assert "warning" not in program.err
    lens = {"format": 1, "homography": [[0.002, 0, 0], [0, -0.002, 0], [0, 0, 1]]}
    (tmp_path / "other.json").write_text(json.dumps(lens))
    program(*words, "--protocol", "aligned", "--video", shot.video, "--camera", tmp_path / "other.json").done()
    assert "give the same --camera as to track" in program.err


@pytest.fixture
def no_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("no_display")
def test_a_film_of_a_robot_file_without_opengl(program, pendulum_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    film = tmp_path / "view.mp4"
    said = program(
        "view", pendulum_folder / "pendulum.toml", "--reference", pendulum_folder / "tracks", "--seconds", 0.5,
        "--film", film, "--width", 320,
    )  # fmt: skip
    assert said.code == 0
    assert "rendered by outlines, since no OpenGL works here (install libegl1" in " ".join(said.out.split())
    frames = [frame.image.astype(int) for frame in VideoReader(film)]
    assert len(frames) == 16
    assert frames[0].shape == (180, 320, 3)
    assert np.abs(frames[-1] - frames[0]).max() > 60  # it moves
