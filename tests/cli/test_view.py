"""`view` without a display: films and sentences."""

import numpy as np
import pytest

from swim2real.video import VideoReader


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
    assert "rendered by outlines, since no OpenGL works here (install libegl1 or libosmesa6)" in " ".join(
        said.out.split()
    )
    frames = [frame.image.astype(int) for frame in VideoReader(film)]
    assert len(frames) == 16
    assert frames[0].shape == (180, 320, 3)
    assert np.abs(frames[-1] - frames[0]).max() > 60  # it moves


@pytest.mark.slow
@pytest.mark.usefixtures("no_display")
def test_mujocos_renderer_films_the_fish_where_opengl_works(program, tmp_path):
    film = tmp_path / "view.mp4"
    said = program("view", "published", "--seconds", 0.2, "--film", film, "--width", 320)
    assert said.code == 0
    if "outlines" in said.out:
        pytest.skip("no OpenGL works on this machine")
    assert "MuJoCo's renderer" in said.out
    picture = next(iter(VideoReader(film))).image.astype(int)
    assert picture.std() > 10
