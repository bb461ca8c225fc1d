"""The midline of a swimmer without markers: where it is, which end is the head, and where it is in doubt."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drawn_swimmers import FPS, Swimmer, film
from markertrack import HowToTrack, Layout, TrackedFilm, track_film
from markertrack.camera_file import CameraFile
from markertrack.corrections import find_stretches
from markertrack.quality import DOUBTFUL
from swimbase.errors import TrackingError

COUNT = 9
LAYOUT = replace(
    Layout.of([f"S{m}" for m in range(COUNT)], np.linspace([0, 0], [0.2, 0], COUNT)), bodies=(0,) * COUNT, body="an eel"
)
SWIMMER = Swimmer(length=150.0, begin=(250.0, 160.0), speed=1.0)


@dataclass(frozen=True)
class Resting(Swimmer):
    """A swimmer that rests, but for some time from its beginning, or to its end."""

    begins: float = 0.0
    ends: float = np.inf

    def midline(self, time: float, count: int = 201) -> np.ndarray:
        return super().midline(float(np.clip(time, self.begins, self.ends)) - self.begins, count)


@dataclass(frozen=True)
class Curling(Swimmer):
    """A swimmer that curls to nearly a ring and straightens again in 1.5 s."""

    def midline(self, time: float, count: int = 201) -> np.ndarray:
        angles = 2 * np.pi * 0.95 * np.sin(np.pi * min(time / 1.5, 1)) ** 2 * np.linspace(0, 1, count)
        steps = np.stack([np.cos(angles), np.sin(angles)], axis=1) * self.length / (count - 1)
        return np.cumsum(steps, axis=0) + self.begin


def track(video: Path, ends: np.ndarray, frame: int = 0, **how) -> TrackedFilm:
    points = video.with_suffix(".json")
    markers = ", ".join(f'"{name}": [{x}, {y}]' for name, (x, y) in zip(("S0", "S8"), ends.tolist(), strict=True))
    points.write_text(f'{{"format": 1, "frame": {frame}, "markers": {{{markers}}}}}')
    return track_film(video, points, LAYOUT, HowToTrack(midline=True, **how))


def followed(folder: Path, swimmers: list[Swimmer], frame: int = 0, **options) -> tuple[TrackedFilm, np.ndarray]:
    """A film of a first swimmer, and distances of its places that aren't doubted from the truth [lengths]. (T, M)."""
    video = film(folder / "swim.mp4", swimmers, **options)
    found = track(video, swimmers[0].midline(frame / FPS)[[0, -1]], frame)
    return found, off(found, swimmers[0])


def off(found: TrackedFilm, swimmer: Swimmer) -> np.ndarray:
    true = np.array([swimmer.midline(k / FPS)[:: 200 // (COUNT - 1)] for k in range(found.seen.frame_count)])
    away = np.linalg.norm(found.seen.positions - true, axis=2) / swimmer.length
    return np.where(found.seen.confidence >= DOUBTFUL, away, np.nan)


def bar(image: np.ndarray, time: float) -> None:
    image[:, 150:158] = 100


def fin(image: np.ndarray, time: float) -> None:
    """A fin that spreads beside the head, now and then."""
    if time % 0.4 < 0.13:
        root, other = SWIMMER.midline(time)[[40, 60]]
        tip = root + 1.5 * (other - root)[::-1] * [-1, 1] * 2
        cv2.fillPoly(image, [np.round([root, other, tip]).astype(np.int32)], 40)


def two_tones(image: np.ndarray, time: float) -> None:
    cv2.polylines(image, [np.round(SWIMMER.midline(time)[70:]).astype(np.int32)], False, 235, 9)


@pytest.mark.parametrize(
    ("swimmer", "frame", "options"),
    [
        (SWIMMER, 0, {}),
        (SWIMMER, 30, {}),
        (replace(SWIMMER, level=250), 0, {"ground": 90}),
        (replace(SWIMMER, speed=0.0), 0, {}),
        (replace(SWIMMER, heading=0.7, begin=(180.0, 200.0), level=165), 0, {}),
        (replace(SWIMMER, length=80.0, speed=4.0, begin=(390.0, 160.0), frequency=6.0), 0, {"count": 28}),
        (Resting(150.0, begin=(250.0, 160.0), speed=1.5, begins=1.38), 0, {}),
        (Resting(150.0, begin=(250.0, 160.0), speed=1.5, ends=0.1), 1, {}),
        (Curling(150.0, width=0.03, begin=(220.0, 130.0)), 0, {}),
        (SWIMMER, 0, {"add": fin}),
    ],
    ids=["dark", "later click", "bright", "station", "faint", "fast", "rests first", "rests then", "ring", "fin"],
)
def test_places_along_the_midline_are_found_from_two_clicks(swimmer, frame, options, tmp_path):
    found, away = followed(tmp_path, [swimmer], frame, **options)
    assert np.isfinite(away).mean() > 0.97
    assert np.sqrt(np.nanmean(away**2)) < 0.012
    assert np.nanmax(away) < 0.05
    assert found.track.confidence.shape == (found.seen.frame_count, COUNT)
    np.testing.assert_allclose(found.camera.scale.meters_per_pixel, 0.2 / swimmer.length, rtol=0.06)


@pytest.mark.parametrize(
    ("others", "options"),
    [
        ([replace(SWIMMER, begin=(70.0, 165.0), heading=np.pi, speed=1.2)], {}),  # it comes the other way
        ([], {"add": bar}),  # behind a bar it goes in two parts
    ],
)
def test_what_may_be_mistaken_is_in_doubt_and_not_silent(others, options, tmp_path):
    found, away = followed(tmp_path, [SWIMMER, *others], **options)
    silent = (away > 0.05).any(axis=1)
    assert not silent.any()
    assert 0.2 < np.isfinite(away[:, 0]).mean() < 0.9
    assert any("in doubt" in note for note in found.notes)
    assert find_stretches(found.seen)


def test_others_that_stay_apart_do_no_harm(tmp_path):
    others = [replace(SWIMMER, begin=(300.0, 60.0)), replace(SWIMMER, begin=(200.0, 260.0), heading=0.3)]
    _, away = followed(tmp_path, [SWIMMER, *others])
    assert np.nanmax(away) < 0.05
    assert np.isfinite(away).mean() > 0.97


def test_a_tail_that_fades_is_lost_and_nothing_shifts(tmp_path):
    def faded(image: np.ndarray, time: float) -> None:
        if time > 0.7:
            x = SWIMMER.midline(time)[165, 0]
            image[:, int(x) :] = np.median(image)

    _, away = followed(tmp_path, [SWIMMER], add=faded)
    early, late = away[:20], away[24:]
    assert np.isfinite(early).all()
    assert not np.isfinite(late[:, 7:]).any()
    assert np.nanmax(away[:, :5]) < 0.03


def test_swapped_clicks_are_reported(tmp_path):
    video = film(tmp_path / "swim.mp4", [SWIMMER])
    found = track(video, SWIMMER.midline(0)[[-1, 0]])
    assert "tail first for 1.5 of its lengths" in " ".join(found.notes)


@pytest.mark.parametrize(
    ("shift", "options", "message"),
    [
        ((60, 70), {}, "stands out of the ground in"),
        ((0, 12), {}, "ends 12 px from a click"),
        ((0, 0), {"add": two_tones, "ground": 130}, "two tones"),
    ],
)
def test_what_is_no_swimmer_of_one_tone_is_refused(shift, options, message, tmp_path):
    video = film(tmp_path / "swim.mp4", [SWIMMER], count=20, **options)
    with pytest.raises(TrackingError, match=message):
        track(video, SWIMMER.midline(0)[[0, -1]] + shift)


def test_a_correction_decides_between_head_and_tail(tmp_path):
    video = film(tmp_path / "swim.mp4", [SWIMMER], count=30)
    place = SWIMMER.midline(20 / FPS)[[0, 25]] + 1
    corrections = tmp_path / "fixed.json"
    markers = f'{{"S0": {place[0].tolist()}, "S1": {place[1].tolist()}, "S8": null}}'
    corrections.write_text(f'{{"format": 1, "frames": [{{"frame": 20, "markers": {markers}}}]}}')
    found = track(video, SWIMMER.midline(0)[[0, -1]], corrections=corrections)
    np.testing.assert_allclose(found.seen.positions[20, :2], place)
    assert np.isnan(found.seen.positions[20, 8]).all()
    assert np.nanmax(off(found, SWIMMER)[:20]) < 0.05


def test_sites_must_stand_in_a_row(tmp_path):
    layout = replace(LAYOUT, rest=LAYOUT.rest[[0, 2, 1, 3, 4, 5, 6, 7, 8]])
    with pytest.raises(TrackingError, match=r"an eel .* don't stand in a row"):
        _ = layout.places_along


def test_the_clicks_tell_the_length_to_a_part_of_a_pixel(tmp_path):
    video = film(tmp_path / "swim.mp4", [SWIMMER], 4)
    for first, last in ((13, 187), (14, 186), (15, 184), (16, 183)):
        found = track(video, SWIMMER.midline(0.0)[[first, last]])
        length = np.hypot(*np.diff(found.seen.positions[0], axis=0).T).sum()
        assert length == pytest.approx(SWIMMER.length * (last - first) / 200, rel=0.005)


def test_a_midline_is_seen_in_one_plane_however_high_sites_stand(tmp_path):
    video, ends = film(tmp_path / "swim.mp4", [SWIMMER], 4), SWIMMER.midline(0.0)[[0, -1]]
    level = track(video, ends).track.positions
    raised = replace(LAYOUT, heights=np.linspace(0.0, 0.05, COUNT))
    camera = CameraFile(camera_height=1.0)
    found = track_film(video, video.with_suffix(".json"), raised, HowToTrack(midline=True, camera=camera))
    np.testing.assert_array_equal(found.track.positions, level)
