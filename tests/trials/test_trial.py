import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.trials import Actuation, MarkerTrack, Trial, TrialSet

TIMES = np.array([0.0, 0.1, 0.2])


def points(frames=3, markers=4):
    return np.arange(frames * markers * 2, dtype=float).reshape(frames, markers, 2)


def trial(name="a", markers=4, frames=3, nominal=None):
    return Trial(name, MarkerTrack(np.arange(frames) / 10, points(frames, markers)), nominal)


@pytest.mark.parametrize(
    ("times", "positions", "message"),
    [
        (TIMES, points(2), "positions have shape (2, 4, 2) and times (3,); expected (T, M, 2) and (T,)"),
        (TIMES, np.zeros((3, 8)), "positions have shape (3, 8) and times (3,); expected (T, M, 2) and (T,)"),
        (TIMES, np.zeros((3, 4, 3)), "positions have shape (3, 4, 3) and times (3,); expected (T, M, 2) and (T,)"),
        (TIMES[:, None], points(), "positions have shape (3, 4, 2) and times (3, 1); expected (T, M, 2) and (T,)"),
        ([0.0], points(1), "a track needs at least 2 frames, this one has 1"),
        ([0.0, 0.2, 0.1], points(), "time stamps must be finite and rise from frame to frame"),
        ([0.0, 0.1, 0.1], points(), "time stamps must be finite and rise from frame to frame"),
        ([0.0, np.nan, 0.1], points(), "time stamps must be finite and rise from frame to frame"),
        ([0.0, 0.1, np.inf], points(), "time stamps must be finite and rise from frame to frame"),
    ],
)
def test_tracks_of_wrong_shape_or_time_are_refused(times, positions, message):
    with pytest.raises(TrialError) as caught:
        MarkerTrack(times, positions)
    assert str(caught.value) == message


def test_confidences_are_checked():
    with pytest.raises(TrialError, match=r"confidence has shape \(3, 3\); expected \(T, M\) = \(3, 4\)"):
        MarkerTrack(TIMES, points(), np.ones((3, 3)))
    for wrong in (-0.1, 1.1):
        with pytest.raises(TrialError, match="confidence must lie within 0 and 1"):
            MarkerTrack(TIMES, points(), np.full((3, 4), wrong))


def test_a_marker_that_is_not_seen_is_nan_and_has_no_confidence():
    positions = points()
    positions[1, 2, 0] = np.nan
    track = MarkerTrack(TIMES, positions)
    assert track.confidence[1, 2] == 0
    assert track.confidence.sum() == 11
    assert np.isnan(track.positions[1, 2, 0])


def test_a_confidence_of_nan_counts_as_none():
    confidence = np.ones((3, 4))
    confidence[0, 1] = np.nan
    assert MarkerTrack(TIMES, points(), confidence).confidence[0, 1] == 0


def test_a_track_is_a_read_only_copy():
    positions = points()
    track = MarkerTrack(TIMES, positions)
    positions[:] = 0
    assert track.positions[-1, -1, -1] == 23
    for array in (track.times, track.positions, track.confidence):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_counts_and_duration():
    track = MarkerTrack([1.0, 1.5, 3.0], points())
    assert (track.frame_count, track.marker_count, track.duration) == (3, 4, 2.0)


@pytest.mark.parametrize("frequency", [0.0, -1.0, np.nan, np.inf])
def test_a_frequency_that_no_motor_has_is_refused(frequency):
    with pytest.raises(TrialError, match="it must be finite and above 0"):
        Actuation(frequency)
    assert Actuation(4.0).period == 0.25


def test_a_cut_keeps_the_frames_within_the_horizon():
    whole = Trial("a", MarkerTrack(5.0 + np.arange(10) / 10, points(10)), 1.0, 0.001, "by hand")
    cut = whole.cut(0.4)
    assert cut.track.frame_count == 5
    np.testing.assert_array_equal(cut.track.positions, whole.track.positions[:5])
    assert (cut.name, cut.nominal_frequency, cut.meters_per_pixel, cut.provenance) == ("a", 1.0, 0.001, "by hand")
    assert whole.cut(None) is whole
    assert whole.cut(100.0).track.frame_count == 10


def test_frames_a_second_come_from_the_time_stamps():
    assert Trial("a", MarkerTrack([0.0, 0.02, 0.04, 0.5], points(4))).fps == pytest.approx(50.0)


def test_two_trials_of_one_name_are_refused():
    with pytest.raises(TrialError, match="two trials are named 'a'; give each its own name"):
        TrialSet((trial("a"), trial("b"), trial("a")))


def test_a_set_needs_trials_with_the_same_markers():
    with pytest.raises(TrialError, match="a set of trials needs at least one trial"):
        TrialSet(())
    with pytest.raises(TrialError, match="all trials must have the same markers: a has 4, b has 5"):
        TrialSet((trial("a"), trial("b", markers=5)))
    with pytest.raises(TrialError, match="2 marker names for 4 markers"):
        TrialSet((trial("a"),), ("head", "tail"))


def test_a_set_finds_trials_by_name():
    trials = TrialSet((trial("f1_00"), trial("f1_50")))
    assert trials.names == ("f1_00", "f1_50")
    assert trials["f1_50"].name == "f1_50"
    assert trials.marker_names == ("M0", "M1", "M2", "M3")
    with pytest.raises(TrialError) as caught:
        trials["f1_05"]
    assert str(caught.value).startswith("no trial is named 'f1_05'; there are f1_00, f1_50; did you mean 'f1_")
    with pytest.raises(TrialError, match=r"^no trial is named 'xyz'; there are f1_00, f1_50$"):
        trials["xyz"]


def test_held_out_trials_are_split_off():
    trials = TrialSet((trial("a"), trial("b"), trial("c")), ("head", "neck", "back", "tail"))
    kept, out = trials.split(["b", "b"])
    assert kept.names == ("a", "c")
    assert out is not None
    assert out.names == ("b",)
    assert kept.marker_names == out.marker_names == trials.marker_names
    same, nothing = trials.split([])
    assert same.names == trials.names
    assert nothing is None


def test_a_split_leaves_something_to_fit_and_knows_its_names():
    trials = TrialSet((trial("a"), trial("b")))
    with pytest.raises(TrialError, match="all 2 trials are held out; leave at least one to fit"):
        trials.split(["a", "b"])
    with pytest.raises(TrialError, match="no trial is named 'c'"):
        trials.split(["c"])
