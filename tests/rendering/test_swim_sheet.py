"""Sheets of swims and films: how they are laid out, and pictures as files."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE
from swim2real.rendering.encoding import to_jpeg, to_png
from swim2real.rendering.panel import COLORS, Panel
from swim2real.rendering.sheet import ROW_HEAD, TEXT, film_sheet
from swim2real.rendering.swim_panel import body_panel
from swim2real.rendering.swim_sheet import beat_sheet, clip_sheet
from swim2real.rendering.swim_view import SwimView, common_limits
from swim2real.video import VideoWriter

STAMP = 24  # px at the top of a picture, where its time stands
NAMES = ("M0", "M1", "M2", "M3")


def swim(frequency: float = 2.0, swing: float = 0.1) -> SwimView:
    times = np.arange(181) / 60
    side = np.cos(2 * np.pi * frequency * times[:, None]) * np.array([0, 0, 0.4, 1.0])
    real, simulated = (
        np.stack([np.broadcast_to([0, 0.1, 0.3, 0.5], side.shape), size * side], axis=-1) for size in (0.06, swing)
    )
    shift = np.stack([0.05 + 0.1 * times, 0 * times], axis=-1)[:, None]
    seen = np.ones(side.shape, bool)
    return SwimView("trial", times, seen, real, simulated, NAMES, frequency, real - shift, simulated - shift)


def found(sheet: np.ndarray, tile: np.ndarray) -> list[tuple[int, int]]:
    """Where a tile stands in a sheet: rows and columns of its top left pixel."""
    height, width = tile.shape[:2]
    y, x = np.unravel_index(np.argmin(tile.sum(axis=-1)), (height, width))  # its darkest pixel
    starts = np.argwhere((sheet == tile[y, x]).all(axis=-1)) - (y, x)
    starts = starts[(starts >= 0).all(axis=1)].tolist()
    return [(r, c) for r, c in starts if np.array_equal(sheet[r : r + height, c : c + width], tile)]


def test_a_clip_sheet_shows_the_beat_and_the_courses():
    view = swim()
    limits = common_limits([view])
    sheet = clip_sheet(view, 4, 2, 240, limits)
    panel = Panel(limits.body, 240)
    tiles = [np.asarray(body_panel(view, k, panel, TEXT)) for k in view.nearest(view.beat(4)[0]).tolist()]
    places = [found(sheet, tile) for tile in tiles]
    assert all(len(place) == 1 for place in places)
    rows, columns = zip(*(place[0] for place in places), strict=True)
    assert rows[0] == rows[1] < rows[2] == rows[3]
    assert columns[0] == columns[2] < columns[1] == columns[3]
    below = sheet[rows[2] + panel.height :].astype(int)
    half = sheet.shape[1] // 2
    courses = below[60:]
    for side, part in (("real", courses[:, :half]), ("simulated", courses[:, half:])):
        assert np.count_nonzero(np.abs(part - COLORS[side]).max(axis=-1) < 90) > 100
    np.testing.assert_array_equal(sheet, clip_sheet(swim(), 4, 2, 240, limits))
    np.testing.assert_array_equal(sheet, clip_sheet(view, 4, 2, 240))
    assert clip_sheet(view, 4, 4, 240).shape[1] > sheet.shape[1]


def test_a_beat_sheet_has_a_row_for_each_trial_and_a_column_for_each_share():
    views = [swim(1.0), swim(2.0, 0.15), replace(swim(1.5), name="a trial whose name is far too long for a sheet")]
    limits = common_limits(views)
    sheet = beat_sheet(views, 4, 160)
    panel = Panel(limits.body, 160)
    corners = np.zeros((3, 4, 2), int)
    for row, view in enumerate(views):
        for column, sample in enumerate(view.nearest(view.beat(4)[0]).tolist()):
            tile = np.asarray(body_panel(view, sample, panel, TEXT))
            (corners[row, column],) = found(sheet, tile[STAMP:])
    left, across = corners[0, 0, 1], np.diff(corners[..., 1], axis=1)
    assert (across == across[0, 0]).all()
    assert across[0, 0] > 160
    assert (np.diff(corners[..., 0], axis=0) > panel.height).all()
    assert (np.diff(corners[..., 0], axis=1) == 0).all()
    assert (np.diff(corners[..., 1], axis=0) == 0).all()
    assert left <= ROW_HEAD + 24  # a long name is cut off
    for top in corners[:, 0, 0] - STAMP:
        head = sheet[top : top + panel.height, :left].astype(int)
        assert np.count_nonzero(np.abs(head - INK).max(axis=-1) < 60) > 20
        assert (head[:, -4:] == PAGE).all()
    np.testing.assert_array_equal(sheet, beat_sheet(views, 4, 160))


def test_columns_of_a_beat_sheet_are_the_same_part_of_the_beat():
    views = [swim(1.0), swim(1.7), swim(0.5)]
    for view in views:
        samples = view.nearest(view.beat(4)[0])
        last = view.real[samples, -1, 1]
        assert last[0] > 0.055
        assert abs(last[1]) < 0.012
        assert last[2] < -0.055


def test_a_sheet_with_a_diverged_swim_says_so():
    good = swim()
    nothing = np.full_like(good.real, np.nan)
    bad = replace(good, simulated=nothing, course_simulated=nothing)
    limits = common_limits([good])
    for sheets in (
        [clip_sheet(view, 2, 2, 240, limits) for view in (good, bad)],
        [beat_sheet([view], 2, 240, limits) for view in (good, bad)],
    ):
        blue = [np.abs(sheet.astype(int) - COLORS["simulated"]).max(axis=-1) < 60 for sheet in sheets]
        rows = [int((part.sum(axis=1) > 150).sum()) for part in blue]
        assert rows[0] == 0
        assert rows[1] > 10  # plates with white text


def test_a_film_sheet_shows_frames_at_times(tmp_path):
    path = tmp_path / "real.mp4"
    with VideoWriter(path, 64, 48, 10, crf=5) as writer:
        for k in range(6):
            writer.write(np.full((48, 64, 3), 40 + 30 * k, np.uint8))
    sheet = film_sheet(path, [0.0, 0.19, 0.52], 2, 160).astype(int)
    places = []
    for level in (40, 100, 190):
        where = np.argwhere(np.abs(sheet - level).max(axis=-1) < 3)
        (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0)
        assert (bottom - top + 1, right - left + 1) == (120, 160)
        places.append((top, left))
    assert places[0][0] == places[1][0] < places[2][0]
    assert places[0][1] == places[2][1] < places[1][1]
    with pytest.raises(ArgumentError, match=re.escape(f"none of the 2 times lies within '{path}'; give times within")):
        film_sheet(path, [7.0, 8.0], 2, 160)
    with pytest.raises(ArgumentError, match="none of the 0 times lies within"):
        film_sheet(path, [], 2, 160)


def test_sheets_say_what_they_need():
    view = swim()
    for call, message in (
        (lambda: clip_sheet(view, 0, 2, 240), "count is 0; it must be 1 picture of the beat or more"),
        (lambda: clip_sheet(view, 4, 0, 240), "0 columns of 240 px; it must be 1 column or more"),
        (lambda: clip_sheet(view, 4, 2, 159), "width is 159 px; a picture of a sheet must be at least 160 px wide"),
        (lambda: beat_sheet([view], 4, 100), "width is 100 px; a picture of a sheet must be at least 160 px wide"),
        (lambda: beat_sheet([view], 0, 160), "count is 0; it must be 1 picture of the beat or more"),
        (lambda: beat_sheet([], 4, 160), "views is empty"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(message)):
            call()


def test_pictures_as_files():
    sheet = clip_sheet(swim(), 2, 2, 240)
    png, jpeg = to_png(sheet), to_jpeg(sheet, 80)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png)).convert("RGB")), sheet)
    opened = Image.open(io.BytesIO(jpeg))
    assert (opened.format, opened.mode) == ("JPEG", "RGB")
    assert np.abs(np.asarray(opened).astype(int) - sheet).mean() < 3
    assert (png, jpeg) == (to_png(sheet.copy()), to_jpeg(sheet.copy(), 80))
    assert len(to_jpeg(sheet, 40)) < len(jpeg) < len(to_jpeg(sheet, 95))
    for quality in (0, 96):
        with pytest.raises(ArgumentError, match=f"quality is {quality}; it must lie within 1 and 95"):
            to_jpeg(sheet, quality)
    with pytest.raises(ArgumentError, match="it must be"):
        to_png(sheet[..., 0])
