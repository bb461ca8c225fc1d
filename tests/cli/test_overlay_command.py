import json
from pathlib import Path

import pytest

from swim2real.video import VideoReader


def test_overlays_of_recordings_are_written(program, pendulum_folder, tmp_path):
    values, out = tmp_path / "parameters.json", tmp_path / "out"
    robot = {"robot": "pendulum", "robot_file": str(pendulum_folder / "pendulum.toml")}
    dampings = {"shoulder_damping": 0.004, "elbow_damping": 0.001}
    values.write_text(json.dumps({"format": 1, **robot, "parameters": dampings}))
    words = ["overlay", values, "--reference", pendulum_folder / "tracks", "--out", out]
    program(*words, "--fps", 10, "--width", 320, "--horizon", 0.5).done()
    assert sorted(path.name for path in out.iterdir()) == ["a.mp4", "a.png", "all.png", "b.mp4", "b.png"]
    with VideoReader(out / "a.mp4") as film:
        assert film.info.width == 320
        assert sum(1 for _ in film) == 6


@pytest.mark.slow
def test_overlays_of_every_trial_are_written(program, pool_folder, tmp_path):
    program("overlay", "published", "--reference", pool_folder, "--out", tmp_path, "--fps", 10, "--width", 480).done()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["all.png", "f1_20.mp4", "f1_20.png", "f1_60.mp4", "f1_60.png"]
    assert [Path(line).name for line in program.out.split()][-1] == "all.png"
    with VideoReader(tmp_path / "f1_20.mp4") as film:
        assert film.info.width == 480
        assert sum(1 for _ in film) == 21
    assert (tmp_path / "all.png").read_bytes().startswith(b"\x89PNG")
