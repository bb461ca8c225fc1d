import json
from functools import partial

import numpy as np
import pytest

from markertrack.points import load_anchors, load_points, save_points
from refused import says
from swimbase.errors import TrackingError

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


def refusal(path, width=640, height=480, load=load_points):
    with pytest.raises(TrackingError) as caught:
        load(path, NAMES, width, height)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_what_was_saved_is_loaded(tmp_path):
    path = tmp_path / "a.json"
    save_points(path, POINTS, NAMES, "swim.mp4", 640, 480)
    np.testing.assert_array_equal(load_points(path, NAMES, 640, 480).points, POINTS)
    assert json.loads(path.read_text()) == {
        "format": 1, "video": "swim.mp4", "width": 640, "height": 480, "frame": 0,
        "markers": {"M0": [10.25, 20.0], "M1": [110.0, 21.5], "M2": [210.0, 30.125]},
    }  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_plain_list_is_read_and_names_decide_the_order(file, tmp_path):
    path = tmp_path / "list.json"
    path.write_text(json.dumps(POINTS.tolist()))
    np.testing.assert_array_equal(load_points(path, NAMES, 640, 480).points, POINTS)
    markers = {"M2": [1, 2], "M0": [30, 40], "M1": [50, 60]}
    points = load_points(file(markers=markers), NAMES, 640, 480).points
    np.testing.assert_array_equal(points, [[30, 40], [50, 60], [1, 2]])
    load_points(file(format=None, width=None, height=None, frame=None), NAMES, 640, 480)


@pytest.mark.parametrize(
    ("content", "part"),
    [('{"markers": ', "can't be read as JSON"), (b"\xff\xfe\x00", "read as JSON"), ("null", "null"),
     ("{}", "hold neither 'markers' nor"), (json.dumps(POINTS[:2].tolist()), "hold 2 points; expected are 3")],
)  # fmt: skip
def test_what_is_no_points_file_is_refused(tmp_path, content, part):
    path = tmp_path / "points.json"
    assert "is not there" in refusal(path)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert part in refusal(path)


GOOD = {"M0": [1, 2], "M1": [30, 40], "M2": [50, 60]}


@pytest.mark.parametrize(
    ("markers", "part"),
    [
        ({"M0": [1, 2]}, "lack M1, M2"), ({"M0": [1, 2], "M1": [30, 40], "m2": [5, 6]}, "'m2'; did you mean 'M2'?"),
        (GOOD | {"M9": [70, 80]}, "unknown marker 'M9'; known are M0, M1, M2"), ([[1, 2]], "it must be a table"),
        (GOOD | {"M1": [700, 20]}, "at (700, 20), outside of the frame of 640 x 480 px"),
        (GOOD | {"M2": [2, 3]}, "are 1.4 px apart"),
        *((GOOD | {"M1": pair}, "markers.M1")
          for pair in (["1", 2], [1], [1, 2, 3], None, [True, 2], [float("nan"), 2], {"x": 1, "y": 2})),
    ],
)  # fmt: skip
def test_markers_that_are_refused(file, markers, part):
    assert part in refusal(file(markers=markers))


def test_picked_on_another_video(file):
    assert says(refusal(file(), width=480, height=640), "640 x 480 px", "480 x 640 px", "pick the points again")
    early = refusal(file(frame=7), load=partial(load_points, first=9))
    assert says(early, "frame 7 of the video", "frame 9")
    assert load_points(file(frame=7), NAMES, 640, 480, first=5).frame == 7
    for changes, part in (
        ({"frame": -1}, "'frame' is -1"),
        ({"format": 2}, "'format' is 2"),
        ({"fram": 7}, "'frame'?"),
    ):
        assert part in refusal(file(**changes))


@pytest.mark.parametrize(("points", "width", "says"), [
    (POINTS[:2], 640, r"shape \(2, 2\); expected is \(3, 2\)"),
    (POINTS, 200, "M2 of .* outside of the frame"),
    (np.where(POINTS == 110.0, np.nan, POINTS), 640, r"M1 of points .* is at \(nan, 21\.5\)"),
])  # fmt: skip
def test_what_could_not_be_read_back_is_not_saved(tmp_path, points, width, says):
    with pytest.raises(TrackingError, match=says):
        save_points(tmp_path / "a.json", points, NAMES, "swim.mp4", width, 480)
    assert not list(tmp_path.iterdir())
    with pytest.raises(TrackingError, match=r"can't write points .*: No such file or directory"):
        save_points(tmp_path / "no" / "a.json", POINTS, NAMES, "swim.mp4", 640, 480)


def anchors(path, width=640, height=480, video="swim.mp4"):
    return load_anchors(path, NAMES, width, height, video)


def anchors_refused(path, *size):
    return refusal(path, *size, load=lambda path, names, *size: anchors(path, *size))


@pytest.fixture
def corrections(tmp_path):
    """Writes a corrections file: pairs of a frame and what is said of its markers."""

    def write(*frames, **changes):
        content = {"format": 1, "video": "swim.mp4", "width": 640, "height": 480}
        content["frames"] = [{"frame": frame, "markers": markers} for frame, markers in frames]
        path = tmp_path / "swim.corrections.json"
        path.write_text(json.dumps({key: value for key, value in (content | changes).items() if value is not None}))
        return path

    return write


def said(anchor):
    """What an anchor says, as the file has it."""
    places = zip(NAMES, anchor.points.tolist(), anchor.hidden.tolist(), strict=True)
    return {name: None if hidden else place for name, place, hidden in places if hidden or place[0] == place[0]}


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ([], []),
        ([(120, {"M1": [1.5, 2], "M2": None})], [(120, {"M1": [1.5, 2], "M2": None})]),
        ([(7, {"M0": [1, 2]}), (3, {"M1": None}), (5, {})], [(3, {"M1": None}), (7, {"M0": [1, 2]})]),  # in order
        ([(7, {"M0": [1, 2]}), (7, {"M1": None, "M0": [1, 2]})], [(7, {"M0": [1, 2], "M1": None})]),  # merged
        ([(0, {"M2": [-0.5, 479.5], "M0": [0, 0]})], [(0, {"M0": [0, 0], "M2": [-0.5, 479.5]})]),
    ],
)
def test_corrections(corrections, frames, expected):
    for changes in ({}, {"video": None, "width": None, "height": None, "format": None}):
        found = anchors(corrections(*frames, **changes))
        assert [(anchor.frame, said(anchor)) for anchor in found] == expected
        for anchor in found:
            assert (anchor.points.shape, anchor.hidden.shape) == ((3, 2), (3,))
            assert np.isnan(anchor.points[anchor.hidden]).all()


@pytest.mark.parametrize("frame", [None, 0, 9])
def test_a_points_file_is_the_corrections_of_one_frame(file, tmp_path, frame):
    everything = dict(zip(NAMES, POINTS.tolist(), strict=True))
    (anchor,) = anchors(file(frame=frame), video="another name.mp4")
    assert (anchor.frame, said(anchor)) == (frame or 0, everything)
    (anchor,) = anchors(file(frame=frame, markers={**everything, "M1": None}))
    assert said(anchor) == {**everything, "M1": None}
    (tmp_path / "points.json").write_text(json.dumps(POINTS.tolist()))
    (anchor,) = anchors(tmp_path / "points.json")
    assert said(anchor) == everything
    assert "lack M2; expected are 3" in anchors_refused(file(markers={"M0": [1, 2], "M1": None}))


@pytest.mark.parametrize(("frames", "parts"), [
    ([(5, {"m2": [1, 2]})], ("frame 5 of corrections", "'m2'; did you mean 'M2'?")),
    ([(-1, {"M0": [1, 2]})], ("'frames[0].frame' is -1", "at least 0")),
    ([(1, {}), (1, {"M0": "hidden"})], ("'frames[1].markers.M0' is \"hidden\"", "list")),
    ([(1, {"M0": [1, 2]}), (1, {"M0": [1, 2.5]})], ("frame 1 comes twice", "M0", "(1, 2)", "(1, 2.5)")),
    ([(1, {"M0": None}), (1, {"M0": [1, 2.5]})], ("M0 is hidden", "(1, 2.5)")),
    ([(4, {"M1": [640, 20]})], ("M1 of frame 4 of corrections", "(640, 20), outside of the frame")),
    ([(4, {"M1": [5, 5]}), (4, {"M2": [6, 5]})], ("M1 and M2 of frame 4 of corrections", "1.0 px apart")),
])  # fmt: skip
def test_corrections_that_are_refused(corrections, frames, parts):
    assert says(anchors_refused(corrections(*frames)), *parts)


def test_corrections_of_another_film(corrections):
    path = corrections((5, {"M0": [1, 2]}))
    assert says(anchors_refused(path, 320, 240), "640 x 480 px", "320 x 240 px")
    with pytest.raises(TrackingError, match=r"of 'swim\.mp4'; the video is 'b\.mp4'"):
        anchors(path, video="b.mp4")
    for written, named in (("a\\u202eb.mp4", "a\u202eb.mp4"), ("u\u0308.mp4", "\u00fc.mp4")):
        assert len(anchors(corrections((5, {"M0": [1, 2]}), video=written), video=named)) == 1
    assert "is not there" in anchors_refused(path.with_name("none.json"))
    assert "both 'frames' and 'markers'" in anchors_refused(corrections(markers={}))
    markers = dict(zip(NAMES, POINTS.tolist(), strict=True))
    assert "give them with --corrections" in refusal(corrections((0, markers), (5, {"M0": None})))
