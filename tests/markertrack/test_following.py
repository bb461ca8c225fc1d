"""What a person reads before the rest of a film is tracked, and frames that aren't in it."""

import cv2
import numpy as np
import pytest

from markertrack.following import Film, follow, within
from markertrack.points import Anchor
from markertrack.span import WHOLE
from markertrack.tracking.markers import MarkerTracker
from markertrack.video import VideoReader, VideoWriter
from swimbase.errors import TrackingError

FPS, FRAMES, SIZE = 20, 48, (160, 240)
PLACES = np.array([[60.0, 80.0], [120.0, 80.0], [180.0, 80.0]])


def written(path, blurred=0, hidden=()):
    """Three dots that drift, the first frames out of focus, and some dots hidden after the first one."""
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    with VideoWriter(path, SIZE[1], SIZE[0], FPS, crf=10) as video:
        for frame in range(FRAMES):
            image = np.full((*SIZE, 3), 200.0)
            for m, (x, y) in enumerate(PLACES + np.array([0.3 * frame, 0])):
                if not (frame and m in hidden):
                    image[np.hypot(columns - x, rows - y) < 8] = 40
            if frame < blurred:
                image = cv2.GaussianBlur(image, (0, 0), 6)
            noise = np.random.default_rng(frame).normal(0, 3, image.shape)
            video.write(np.clip(image + noise, 0, 255).astype(np.uint8))
    return path


def notes(path, frame=0):
    """Sentences that are reported while the film is tracked."""
    film, said = Film("swim", path, WHOLE, ("M0", "M1", "M2"), (0, 1, 2), 1, None), []
    with VideoReader(path) as reader:
        frames = within(reader, WHOLE)
        start = Anchor(frame, PLACES + np.array([0.3 * frame, 0]), np.zeros(3, dtype=bool))
        follow(film, reader, next(frames), frames, start, (), lambda: MarkerTracker(range(3)), lambda p: said.append(p))
    return [progress.note for progress in said if progress.note], len(said)


def test_what_is_lost_is_reported_after_two_seconds(tmp_path):
    (note,), count = notes(written(tmp_path / "film.mp4", hidden=[1]))
    assert "M1 in 98 % of frames (nothing like it is found)" in note
    assert "M0" not in note
    assert count == FRAMES
    assert notes(written(tmp_path / "good.mp4"))[0] == []


def test_a_film_that_begins_blurred_is_named_as_such(tmp_path):
    (note,), _ = notes(written(tmp_path / "film.mp4", blurred=12, hidden=[1]))
    assert "is blurred" in note
    assert "M1" in note


def test_points_of_a_frame_that_the_film_doesnt_have_are_refused_at_once(tmp_path):
    with pytest.raises(TrackingError, match=r"picked in frame 500 of video .*, of which frames 0 to \d+ are tracked"):
        notes(written(tmp_path / "film.mp4"), frame=500)
