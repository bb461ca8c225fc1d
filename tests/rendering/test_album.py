"""Sheets of trials, how they are laid out; and the album of a comparison."""

import numpy as np
import pytest
from views import arm, found, like, swim

from markertrack.drawing import INK, PAGE
from swim2real.rendering.album import LEAST_TILE, ROW_HEAD, TEXT, TrialPictures, trials_sheet
from swim2real.rendering.trial_frame import COLORS, SIDES, Panel, plane_panel
from swim2real.rendering.trial_view import TrialView, common_limits
from swimbase.errors import ArgumentError

STAMP = 24  # px at the top of a picture, where its time stands


def pictures(view: TrialView, of: TrialView | None = None) -> TrialPictures:
    return TrialPictures(view, 0.01, common_limits([of or view]))


@pytest.mark.parametrize("view", [arm(), arm(travels=True), swim()], ids=["arm", "travels", "swim"])
def test_a_sheet_shows_a_beat_or_the_trial_from_start_to_end(view) -> None:
    limits = common_limits([view])
    sheet = pictures(view).sheet(4, 2, 200)
    panel = Panel(limits.plane, 200)
    samples = view.nearest(view.moments(4)[0]).tolist()
    places = [found(sheet, np.asarray(plane_panel(view, k, panel, TEXT))) for k in samples]
    assert all(len(place) == 1 for place in places)
    rows, columns = zip(*(place[0] for place in places), strict=True)
    assert rows[0] == rows[1] < rows[2] == rows[3]
    assert columns[0] == columns[2] < columns[1] == columns[3]
    below = sheet[rows[2] + panel.height + 30 :].astype(int)
    for side in SIDES:  # the paths at the left, nothing colored beside them
        assert like(below[:, : sheet.shape[1] // 2], side, 60).any() == (view.path_real is not None)
        assert not like(below[:, sheet.shape[1] // 2 + 8 :], side, 60).any()


@pytest.mark.parametrize("made", [arm, swim])
def test_all_trials_are_rows_of_one_sheet(made) -> None:
    names = ("a", "b", "a trial whose name is far too long for a sheet")
    views = [made(name, lost=(k,)) for k, name in enumerate(names)]  # so that no two pictures are alike
    limits = common_limits(views)
    sheet = trials_sheet(views, 3, LEAST_TILE)
    panel = Panel(limits.plane, LEAST_TILE)
    corners = np.zeros((3, 3, 2), int)
    for row, view in enumerate(views):
        for column, sample in enumerate(view.nearest(view.moments(3)[0]).tolist()):
            (corners[row, column],) = found(sheet, np.asarray(plane_panel(view, sample, panel, TEXT))[STAMP:])
    assert (np.diff(corners[..., 0], axis=0) > panel.height).all()
    assert (np.diff(corners[..., 0], axis=1) == 0).all()
    assert (np.diff(corners[..., 1], axis=1) > LEAST_TILE).all()
    assert (np.diff(corners[..., 1], axis=0) == 0).all()
    left = corners[0, 0, 1]
    assert left <= ROW_HEAD + 24  # a long name is cut off
    for top in corners[:, 0, 0] - STAMP:
        head = sheet[top : top + panel.height, :left].astype(int)
        assert np.count_nonzero(np.abs(head - INK).max(axis=-1) < 60) > 20
        assert (head[:, -4:] == PAGE).all()


def test_a_sheet_with_a_diverged_trial_says_so() -> None:
    for sheets in (
        [pictures(view, swim()).sheet(2, 2, 240) for view in (swim(), swim(diverged=True))],
        [trials_sheet([view], 2, 240) for view in (swim(), swim(diverged=True))],
    ):
        blue = [np.abs(sheet.astype(int) - COLORS["simulated"]).max(axis=-1) < 60 for sheet in sheets]
        rows = [int((part.sum(axis=1) > 150).sum()) for part in blue]
        assert rows[0] == 0
        assert rows[1] > 10  # plates with white text


@pytest.mark.parametrize(
    ("call", "words"),
    [(lambda: pictures(swim()).sheet(0, 2, 240), "count is 0"), (lambda: pictures(swim()).sheet(4, 0, 240), "0 col"),
     (lambda: trials_sheet([swim()], 4, 100), "width is 100 px"), (lambda: trials_sheet([], 4, 160), "views is empty")],
)  # fmt: skip
def test_sheets_say_what_they_need(call, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        call()
