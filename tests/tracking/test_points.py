import json
import re

import numpy as np
import pytest

from swim2real.errors import TrackingError
from swim2real.tracking.points import load_points, save_points

NAMES = ("M0", "M1", "M2")
POINTS = np.array([[10.25, 20.0], [110.0, 21.5], [210.0, 30.125]])


@pytest.fixture
def file(tmp_path):
    """Writes a good points file, changed by keywords; None takes an entry away."""

    def write(**changes):
        content = {
            "format": 1, "video": "swim.mp4", "width": 640, "height": 480, "frame": 0,
            "markers": {name: list(point) for name, point in zip(NAMES, POINTS, strict=True)},
        }  # fmt: skip
        content |= changes
        path = tmp_path / "points.json"
        path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))
        return path

    return write


def refusal(path, width=640, height=480):
    with pytest.raises(TrackingError) as caught:
        load_points(path, NAMES, width, height)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_what_was_saved_is_loaded(tmp_path):
    path = tmp_path / "a.json"
    save_points(path, POINTS, NAMES, "swim.mp4", 640, 480)
    np.testing.assert_array_equal(load_points(path, NAMES, 640, 480), POINTS)
    assert json.loads(path.read_text()) == {
        "format": 1, "video": "swim.mp4", "width": 640, "height": 480, "frame": 0,
        "markers": {"M0": [10.25, 20.0], "M1": [110.0, 21.5], "M2": [210.0, 30.125]},
    }  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_plain_list_is_read(tmp_path):
    path = tmp_path / "list.json"
    path.write_text(json.dumps(POINTS.tolist()))
    np.testing.assert_array_equal(load_points(path, NAMES, 640, 480), POINTS)


def test_names_decide_the_order_not_the_file(file):
    markers = {"M2": [1, 2], "M0": [30, 40], "M1": [50, 60]}
    points = load_points(file(markers=markers), NAMES, 640, 480)
    np.testing.assert_array_equal(points, [[30, 40], [50, 60], [1, 2]])


def test_points_may_be_anywhere_in_the_frame_but_not_outside(file):
    corner = {"M0": [-0.5, -0.5], "M1": [639.5, 479.5], "M2": [5, 5]}
    np.testing.assert_array_equal(load_points(file(markers=corner), NAMES, 640, 480)[1], [639.5, 479.5])
    message = refusal(file(markers={**corner, "M1": [700, 20]}))
    assert "M1" in message
    assert "is at (700, 20), outside of the frame of 640 x 480 px" in message
    assert "outside of the frame" in refusal(file(markers={**corner, "M2": [5, -1]}))


def test_missing_file(tmp_path):
    assert "is not there; pick the points again with `swim2real pick`" in refusal(tmp_path / "none.json")
    assert "can't be read" in refusal(tmp_path)


@pytest.mark.parametrize("text", ["", "{", "M0 1 2", '{"markers": '])
def test_not_json(tmp_path, text):
    path = tmp_path / "points.json"
    path.write_text(text)
    assert "can't be read as JSON" in refusal(path)
    path.write_bytes(b"\xff\xfe\x00")
    assert "can't be read as JSON" in refusal(path)


@pytest.mark.parametrize("text", ["3", '"M0"', "null"])
def test_json_of_something_else(tmp_path, text):
    path = tmp_path / "points.json"
    path.write_text(text)
    assert text in refusal(path)


def test_an_empty_table(tmp_path):
    path = tmp_path / "points.json"
    path.write_text("{}")
    assert "hold neither 'markers' nor a plain list of [x, y]" in refusal(path)


def test_wrong_number_of_points(tmp_path):
    path = tmp_path / "points.json"
    path.write_text(json.dumps(POINTS[:2].tolist()))
    assert "hold 2 points; expected are 3, one for each of M0, M1, M2; pick the points again" in refusal(path)


def test_missing_names(file):
    message = refusal(file(markers={"M0": [1, 2]}))
    assert "lack M1, M2; expected are 3 points, one for each of M0, M1, M2" in message


def test_unknown_names(file):
    good = {"M0": [1, 2], "M1": [30, 40]}
    assert "unknown marker 'm2'; did you mean 'M2'?" in refusal(file(markers={**good, "m2": [5, 6]}))
    assert "unknown marker 'tail'; known are M0, M1, M2" in refusal(file(markers={**good, "tail": [5, 6]}))
    everything = {**good, "M2": [5, 6], "M9": [70, 80]}
    assert "unknown marker 'M9'; known are M0, M1, M2" in refusal(file(markers=everything))
    assert "'markers' is [[1, 2]]; it must be a table" in refusal(file(markers=[[1, 2]]))


@pytest.mark.parametrize("pair", [["1", 2], [1], [1, 2, 3], 4, None, [True, 2], [float("nan"), 2], {"x": 1, "y": 2}])
def test_not_numbers(file, pair):
    message = refusal(file(markers={"M0": [1, 2], "M1": pair, "M2": [50, 60]}))
    assert "markers.M1" in message
    assert "it must" in message
    assert "pick the points again" in message


def test_two_points_on_the_same_spot(file):
    message = refusal(file(markers={"M0": [50, 60], "M1": [5, 6], "M2": [51, 61]}))
    assert re.match(r"M0 and M2 of points .* are 1.4 px apart; two markers can't be on the same spot", message)
    load_points(file(markers={"M0": [50, 60], "M1": [5, 6], "M2": [52, 60]}), NAMES, 640, 480)


def test_picked_on_another_video(file):
    message = refusal(file(), width=480, height=640)
    assert "were picked on a frame of 640 x 480 px; the video's is 480 x 640 px; pick the points again" in message
    assert "were picked in frame 7 of the video; tracking begins with frame 0" in refusal(file(frame=7))
    load_points(file(frame=7), NAMES, 640, 480, frame=7)
    assert "'frame' is -1" in refusal(file(frame=-1))
    assert "'format' is 2; it must be 1" in refusal(file(format=2))
    load_points(file(format=None, width=None, height=None, frame=None), NAMES, 640, 480)


def test_what_could_not_be_read_back_is_not_saved(tmp_path):
    path = tmp_path / "a.json"
    with pytest.raises(TrackingError, match=r"shape \(2, 2\); expected is \(3, 2\)"):
        save_points(path, POINTS[:2], NAMES, "swim.mp4", 640, 480)
    with pytest.raises(TrackingError, match=r"M2 of points .* outside of the frame of 200 x 480 px"):
        save_points(path, POINTS, NAMES, "swim.mp4", 200, 480)
    with pytest.raises(TrackingError, match=r"M1 of points .* is at \(nan, 21\.5\)"):
        save_points(path, np.where(POINTS == 110.0, np.nan, POINTS), NAMES, "swim.mp4", 640, 480)
    assert not list(tmp_path.iterdir())
    with pytest.raises(TrackingError, match=r"can't write points .*: No such file or directory"):
        save_points(tmp_path / "no" / "a.json", POINTS, NAMES, "swim.mp4", 640, 480)
