import numpy as np
import pytest

from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.trials import Actuation, Trial, TrialSet
from swim2real.trials.trial import Perspective
from swimbase.errors import TrialError

TIMES = np.array([0.0, 0.1, 0.2])


def points(frames=3, markers=4):
    return np.arange(frames * markers * 2, dtype=float).reshape(frames, markers, 2)


def trial(name="a", markers=4, frames=3, nominal=None):
    return Trial(name, MarkerTrack(np.arange(frames) / 10, points(frames, markers)), nominal)


@pytest.mark.parametrize(("arguments", "parts"), [
    ((TIMES, points(2)), ("(2, 4, 2)", "(3,)", "(T, M, 2)")),
    ((TIMES, np.zeros((3, 8))), ("(3, 8)", "(T, M, 2)")),
    ((TIMES, np.zeros((3, 4, 3))), ("(3, 4, 3)", "(T, M, 2)")),
    ((TIMES[:, None], points()), ("times (3, 1)", "(T,)")),
    (([0.0], points(1)), ("at least 2 frames", "1")),
    (([0.0, 0.1, 0.1], points()), ("time stamps", "finite and rise")),
    (([0.0, np.nan, 0.1], points()), ("time stamps", "finite and rise")),
    (([0.0, 0.1, np.inf], points()), ("time stamps", "finite and rise")),
    ((TIMES, points(), np.ones((3, 3))), ("confidence", "(3, 3)", "(3, 4)")),
    ((TIMES, points(), np.full((3, 4), -0.1)), ("confidence", "within 0 and 1")),
    ((TIMES, points(), np.full((3, 4), 1.1)), ("confidence", "within 0 and 1")),
])  # fmt: skip
def test_wrong_tracks_are_refused(arguments, parts):
    assert says(refusal(TrialError, MarkerTrack, *arguments), *parts)


def test_a_track_is_a_read_only_copy_and_has_no_confidence_where_nothing_is_seen():
    positions, confidence = points(), np.ones((3, 4))
    positions[1, 2, 0], confidence[0, 1] = np.nan, np.nan
    track = MarkerTrack([1.0, 1.5, 3.0], positions, confidence)
    positions[:] = 0
    assert track.positions[-1, -1, -1] == 23
    for array in (track.times, track.positions, track.confidence):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    assert np.argwhere(track.confidence == 0).tolist() == [[0, 1], [1, 2]]
    assert track.confidence.sum() == 10
    assert (track.frame_count, track.marker_count, track.duration) == (3, 4, 2.0)


def test_a_perspective_is_removed_as_a_camera_makes_it_and_others_are_refused():
    heights, below, camera = np.array([0.1, 0.1, 0.0, 0.3]), np.array([3.0, 1.0]), 2.0
    real = np.random.default_rng(0).uniform(0, 4, (20, 4, 2))
    seen = below + (real - below) * ((camera - 0.1) / (camera - heights))[:, None]  # true to scale at 0.1 m
    nearness = tuple((camera - 0.1) / (camera - heights) - 1)
    perspective = Perspective(tuple(below), nearness, scale=2.0)
    filmed = Trial("a", MarkerTrack(np.arange(20), below + (seen - below) / 2), perspective=perspective)
    np.testing.assert_allclose(filmed.seen_from_afar().track.positions, real)
    assert filmed.seen_from_afar().perspective is None
    few = Perspective((0.0, 0.0), (0.0, 0.1))
    filmed = Trial("a", MarkerTrack(TIMES, points()), perspective=few)
    assert says(refusal(TrialError, filmed.seen_from_afar), "trial 'a'", "nearness has 2 numbers", "4 markers")
    steep = Perspective((0.0, 0.0), (0.0,) * 4, (0.5, 0.0))
    assert says(refusal(TrialError, steep.removed, MarkerTrack(TIMES, points())), "tilt of (0.5, 0.0)", "no picture")


@pytest.mark.parametrize("frequency", [0.0, -1.0, np.nan, np.inf])
def test_a_frequency_that_no_motor_has_is_refused(frequency):
    assert says(refusal(TrialError, Actuation, frequency), "frequency", f"{frequency}", "finite and above 0")


def test_a_cut_keeps_the_frames_within_the_horizon():
    whole = Trial("a", MarkerTrack(5.0 + np.arange(10) / 10, points(10)), 1.0, 0.001, "by hand")
    cut = whole.cut(0.4)
    np.testing.assert_array_equal(cut.track.positions, whole.track.positions[:5])
    assert (cut.name, cut.nominal_frequency, cut.meters_per_pixel, cut.provenance) == ("a", 1.0, 0.001, "by hand")
    assert whole.cut(None) is whole
    assert whole.cut(100.0).track.frame_count == 10
    assert Trial("a", MarkerTrack([0.0, 0.02, 0.04, 0.5], points(4))).fps == pytest.approx(50.0)


@pytest.mark.parametrize(("arguments", "parts"), [
    (((trial("a"), trial("b"), trial("a")),), ("two trials", "'a'", "its own name")),
    (((),), ("at least one trial",)),
    (((trial("a"), trial("b", markers=5)),), ("same markers", "a has 4, b has 5")),
    (((trial("a"),), ("head", "tail")), ("2 marker names for 4 markers",)),
])  # fmt: skip
def test_wrong_sets_are_refused(arguments, parts):
    assert says(refusal(TrialError, TrialSet, *arguments), *parts)


def test_a_set_finds_trials_by_name_and_splits_those_off_that_are_held_out():
    trials = TrialSet((trial("f1_00"), trial("f1_50"), trial("c")), ("head", "neck", "back", "tail"))
    assert trials["f1_50"].name == "f1_50"
    assert says(refusal(TrialError, lambda: trials["f1_05"]), "'f1_05'", "f1_00, f1_50, c", "did you mean 'f1_")
    assert "did you mean" not in refusal(TrialError, lambda: trials["xyz"])
    assert TrialSet(trials.trials).marker_names == ("M0", "M1", "M2", "M3")
    kept, out = trials.split(["f1_50", "f1_50"])
    assert (kept.names, out.names) == (("f1_00", "c"), ("f1_50",))
    assert kept.marker_names == out.marker_names == trials.marker_names
    assert trials.split([])[0].names == trials.names
    assert trials.split([])[1] is None
    assert says(refusal(TrialError, trials.split, trials.names), "all 3 trials", "leave at least one")
    assert says(refusal(TrialError, trials.split, ["d"]), "'d'")
