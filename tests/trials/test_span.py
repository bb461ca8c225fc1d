from pathlib import Path

import numpy as np
import pytest

from swim2real.errors import ArgumentError, TrialError
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.reference import add_trial
from swim2real.trials.span import WHOLE, Span, spans

TIMES = np.arange(101) / 20  # 0 to 5 s
TRACK = MarkerTrack(TIMES, np.stack([TIMES, -TIMES, 1 + TIMES, TIMES], axis=1).reshape(-1, 2, 2))
CONTROLS = Signals([0.0, 0.7, 1.9, 2.5], ["a", "b"], [[1, 5], [2, np.nan], [3, np.nan], [4, 8]])
SENSORS = Signals(TIMES[::2], ["load"], 10 * TIMES[::2, None])
TRIAL = Trial("pull", TRACK, provenance="by hand", controls=CONTROLS, sensors=SENSORS, start={"hip": 0.1})


def test_a_stretch_of_a_trial_counts_its_times_from_its_first_frame():
    cut = Span(2.0, 3.0).of_trial(TRIAL)
    np.testing.assert_allclose(cut.track.times, np.arange(21) / 20)
    np.testing.assert_array_equal(cut.track.positions, TRACK.positions[40:61])
    np.testing.assert_allclose(cut.sensors.times, np.arange(11) / 10)
    np.testing.assert_allclose(cut.sensors.column("load"), 20 + np.arange(11))
    assert cut.provenance == "by hand, from 2 s to 3 s"
    assert cut.video_begin == 2.0
    assert not cut.start  # it was that of another time


@pytest.mark.parametrize("begin", [0.0, 1.0, 1.9, 2.2, 2.5])
def test_what_drove_it_is_the_same_at_the_same_moment(begin):
    cut = Span(begin).of_trial(TRIAL)
    for name in ("a", "b"):
        whole = CONTROLS.held(name, TIMES[begin - 1e-9 <= TIMES])
        np.testing.assert_array_equal(cut.controls.held(name, cut.track.times), whole)
    assert cut.controls.times[0] == pytest.approx(0.0)


def test_the_end_alone_may_be_cut_off_and_the_start_stays():
    cut = Span(until=1.0).of_trial(TRIAL)
    assert (cut.start, cut.video_begin, cut.track.frame_count) == ({"hip": 0.1}, 0.0, 21)
    assert WHOLE.of_trial(TRIAL) is TRIAL


def test_a_time_as_it_is_shown_means_its_frame():
    track = MarkerTrack(np.arange(10) / 30, np.zeros((10, 1, 2)))
    kept = Span(0.067, 0.1).of_track(track, "x")  # 0.0667 s
    np.testing.assert_allclose(kept.times, [2 / 30, 3 / 30])


@pytest.mark.parametrize(
    ("begin", "until", "says"),
    [
        (6.0, None, "trial 'pull' ends at 5.000 s; --from is 6 s, so give a time before the end"),
        (1.0, 7.0, "trial 'pull' ends at 5.000 s; --until is 7 s, so give a time before the end"),
        (1.01, 1.02, "trial 'pull' has 0 frames from 1.01 s to 1.02 s; a trial needs at least 2, so cut off less"),
    ],
)
def test_a_stretch_outside_is_refused(begin, until, says):
    with pytest.raises(TrialError) as caught:
        Span(begin, until).of_trial(TRIAL)
    assert str(caught.value) == says


def test_a_table_without_a_row_in_the_stretch_is_refused():
    with pytest.raises(TrialError, match=r"there is no row between 0\.2 s and 0\.5 s"):
        Signals([0.0, 1.0], ["x"], [[1], [2]]).cut(0.2, 0.5)


@pytest.mark.parametrize(
    ("begins", "untils", "says"),
    [
        ((-1.0,), (), "--from is -1 s; it must be finite and 0 or above"),
        ((2.0,), (1.0,), "--until is 1 s; it must be finite and after --from, which is 2 s"),
        ((), (float("nan"),), "--until is nan s"),
        ((1.0, 2.0), (), "--from has 2 values for 3 videos; give one for all or each"),
    ],
)
def test_what_is_no_stretch_is_refused(begins, untils, says):
    with pytest.raises(ArgumentError) as caught:
        spans(begins, untils, 3, "videos")
    assert str(caught.value).startswith(says)
    assert spans((1.0,), (2.0, 3.0, 4.0), 3, "videos") == [Span(1.0, 2.0), Span(1.0, 3.0), Span(1.0, 4.0)]


def test_a_reference_remembers_where_in_its_video_a_trial_begins(tmp_path):
    cut = Span(2.0).of_trial(Trial("pull", TRACK, video=tmp_path / "pull.mp4", controls=CONTROLS))
    save_reference(TrialSet((cut,), ("A", "B")), tmp_path)
    (read,) = load_reference(tmp_path)
    assert (read.video_begin, read.video) == (2.0, tmp_path / "pull.mp4")
    plain = Trial("pull", TRACK, video=Path(tmp_path / "pull.mp4"))
    add_trial(tmp_path, plain, ("A", "B"))
    (again,) = load_reference(tmp_path)
    assert (again.video_begin, again.controls) == (0.0, None)  # the controls were on another clock


def test_a_recording_without_markers_is_cut_likewise(tmp_path):
    unfilmed = Trial("pull", MarkerTrack(TIMES, np.empty((101, 0, 2))), controls=CONTROLS, sensors=SENSORS)
    add_trial(tmp_path, Span(2.0, 3.0).of_trial(unfilmed), ())
    (read,) = load_reference(tmp_path)
    np.testing.assert_allclose(read.sensors.times, np.arange(11) / 10)
    assert read.controls.held("b", np.array([0.0, 0.6])).tolist() == [5.0, 8.0]
