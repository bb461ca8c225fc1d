import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swim2real.errors import ArgumentError
from swim2real.robots.fish import FISH
from swim2real.tracking import check_track, identify_beat
from swim2real.tracking.cleaning import beat_gain, beat_window, fill_gaps, smooth
from swim2real.trials import MarkerTrack
from swimmers import REST, Swimmer


def swim(noise=0.0, **options):
    return Swimmer(**{"frequency": 2.25, **options}).track(noise=noise, seed=3)


def hidden(track, *gaps, junk=False):
    """The track without the samples of (marker, frames); with junk in their place if wanted."""
    positions, confidence = track.positions.copy(), track.confidence.copy()
    for marker, frames in gaps:
        positions[frames, marker] = 7.0 if junk else np.nan
        confidence[frames, marker] = 0.0
    return MarkerTrack(track.times, positions, confidence)


def jittered(track, seed=0):
    """The same motion at uneven time stamps."""
    rng = np.random.default_rng(seed)
    keep = np.sort(rng.choice(track.frame_count, track.frame_count * 4 // 5, replace=False))
    return MarkerTrack(track.times[keep], track.positions[keep])


# gaps


@pytest.mark.parametrize("junk", [False, True])
@pytest.mark.parametrize("marker", range(9))
def test_a_short_gap_is_filled_to_millimeters_and_marked(marker, junk):
    track = swim()
    gap = slice(100, 106)
    filled = fill_gaps(hidden(track, (marker, gap), junk=junk))
    off = np.linalg.norm(filled.positions - track.positions, axis=2)
    assert off[gap, marker].max() < 3e-3
    assert np.delete(off, np.arange(100, 106), axis=0).max() == 0
    expected = np.ones((track.frame_count, 9))
    expected[gap, marker] = 0
    np.testing.assert_array_equal(filled.confidence, expected)


def test_filled_samples_are_never_scored():
    holes = hidden(swim(noise=1e-4), (0, slice(50, 54)), (8, slice(100, 106)), (5, slice(200, 201)))
    before, after = check_track(holes, REST), check_track(fill_gaps(holes), REST)
    np.testing.assert_array_equal(after.lost, before.lost)
    np.testing.assert_array_equal(after.weights, before.weights)
    assert after.weights[50:54].sum() == after.weights[100:106, 8].sum() == after.weights[200, 5] == 0


@pytest.mark.parametrize(("frames", "filled"), [(1, True), (6, True), (7, False), (60, False)])
def test_only_gaps_up_to_a_tenth_of_a_second_are_filled(frames, filled):
    track = fill_gaps(hidden(swim(), (4, slice(100, 100 + frames)), junk=True))
    assert np.isfinite(track.positions[100 : 100 + frames, 4]).all() == filled
    assert np.isnan(track.positions[100 : 100 + frames, 4]).all() != filled


def test_gaps_are_counted_in_seconds_not_in_frames():
    holes = hidden(Swimmer(fps=120).track(noise=0), (4, slice(100, 112)), (5, slice(100, 113)))
    filled = fill_gaps(holes)
    assert np.isfinite(filled.positions[100:112, 4]).all()
    assert np.isnan(filled.positions[100:113, 5]).all()
    assert np.isfinite(fill_gaps(holes, longest=0.11).positions).all()
    assert np.isnan(fill_gaps(holes, longest=0).positions[100:112, 4]).all()


def test_gaps_at_the_ends_and_markers_never_seen_stay_open():
    holes = hidden(swim(), (3, slice(0, 4)), (5, slice(-4, None)), (7, slice(None)))
    filled = fill_gaps(holes)
    np.testing.assert_array_equal(np.isnan(filled.positions), np.isnan(holes.positions))


def test_a_lonely_sample_between_gaps_is_enough():
    track = swim()
    filled = fill_gaps(hidden(track, (6, slice(100, 104)), (6, slice(105, 109))))
    assert np.linalg.norm(filled.positions[100:109, 6] - track.positions[100:109, 6], axis=1).max() < 5e-3


def test_a_whole_body_missing_for_a_moment_is_filled():
    track = swim()
    filled = fill_gaps(hidden(track, *((m, slice(80, 85)) for m in range(9))))
    assert np.linalg.norm(filled.positions - track.positions, axis=2).max() < 3e-3
    assert filled.confidence[80:85].sum() == 0


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 8), st.integers(0, 59), st.integers(1, 9)), max_size=6))
def test_filling_touches_gaps_alone_and_has_nothing_left_to_do(gaps):
    track = swim(duration=1.0)
    holes = hidden(track, *((m, slice(start, start + n)) for m, start, n in gaps))
    filled = fill_gaps(holes)
    np.testing.assert_array_equal(filled.positions[holes.confidence > 0], track.positions[holes.confidence > 0])
    np.testing.assert_array_equal(filled.confidence, holes.confidence)
    np.testing.assert_array_equal(fill_gaps(filled).positions, filled.positions)
    assert np.nanmax(np.abs(filled.positions - track.positions)) < 0.02


@pytest.mark.parametrize("longest", [-0.1, np.nan, np.inf])
def test_the_longest_gap_must_be_a_time(longest):
    with pytest.raises(ArgumentError) as caught:
        fill_gaps(swim(), longest)
    assert str(caught.value) == f"longest is {longest} s; the longest gap to fill must be finite and at least 0"


# smoothing


@pytest.mark.parametrize("even", [True, False])
def test_a_cubic_passes_unchanged(even):
    times = np.arange(60) / 60 if even else np.cumsum(np.random.default_rng(0).uniform(0.005, 0.03, 60))
    curve = np.polynomial.polynomial.polyval(times, [0.3, -1.0, 2.0, 1.5])
    track = MarkerTrack(times, np.stack([curve, -curve], axis=1)[:, None])
    np.testing.assert_allclose(smooth(track, 9).positions, track.positions, atol=1e-9)


def test_noise_is_halved_nearly_and_the_beat_stays():
    clean, noisy = swim(), swim(noise=1e-3)
    off = smooth(noisy).positions - clean.positions
    assert 0.52e-3 < off[3:-3].std() < 0.62e-3
    assert smooth(clean).positions == pytest.approx(clean.positions, abs=0.5e-3)


def test_noise_is_smoothed_over_uneven_time_stamps_too():
    clean, noisy = jittered(swim()), jittered(swim(noise=1e-3))
    assert (smooth(noisy, 7).positions - clean.positions)[3:-3].std() < 0.7e-3


@pytest.mark.parametrize("window", [5, 7, 9])
@pytest.mark.parametrize("frequency", [1.0, 2.25, 4.5, 6.75])
def test_the_stated_gain_is_what_smoothing_does(window, frequency):
    times = np.arange(241) / 60
    wave = np.exp(2j * np.pi * frequency * times)
    track = MarkerTrack(times, np.stack([wave.real, wave.imag], axis=1)[:, None])
    left = smooth(track, window).positions[20:-20, 0]
    np.testing.assert_allclose(np.linalg.norm(left, axis=1), beat_gain(window, 60, frequency), atol=1e-9)


@pytest.mark.parametrize(
    ("window", "gains"), [(7, (0.999, 0.981, 0.912)), (9, (0.996, 0.946, 0.773)), (11, (0.991, 0.883, 0.564))]
)
def test_gains_at_a_beat_and_its_harmonics(window, gains):
    found = [beat_gain(window, 60, f) for f in (2.25, 4.5, 6.75)]
    assert found == pytest.approx(gains, abs=6e-4)
    assert beat_gain(window, 60, 0.0) == pytest.approx(1.0)
    assert beat_gain(1, 60, 4.5) == 1.0


@pytest.mark.parametrize(("fps", "window"), [(25, 1), (30, 1), (50, 5), (60, 7), (120, 13)])
def test_the_window_is_the_longest_that_leaves_the_beat(fps, window):
    assert beat_window(fps) == window
    assert min(beat_gain(window, fps, 2.25), beat_gain(window, fps, 4.5)) >= 0.98
    longer = max(window + 2, 5)
    assert min(beat_gain(longer, fps, 2.25), beat_gain(longer, fps, 4.5)) < 0.98


def test_a_slow_video_isnt_smoothed():
    track = Swimmer(fps=30).track()
    assert smooth(track) is track


def test_gaps_stay_gaps_and_what_lies_beyond_doesnt_matter():
    noisy = swim(noise=1e-3)
    holes = hidden(noisy, (4, slice(100, 110)), junk=True)
    moved = holes.positions.copy()
    moved[110:, 4] += 0.5
    one, other = smooth(holes), smooth(MarkerTrack(holes.times, moved, holes.confidence))
    np.testing.assert_array_equal(one.positions[:110, 4], other.positions[:110, 4])
    np.testing.assert_array_equal(one.positions[100:110, 4], holes.positions[100:110, 4])
    np.testing.assert_array_equal(one.confidence, holes.confidence)
    np.testing.assert_array_equal(np.delete(one.positions, 4, axis=1), np.delete(smooth(noisy).positions, 4, axis=1))


def test_a_stretch_shorter_than_the_window_stays_as_it_is():
    noisy = swim(noise=1e-3)
    holes = hidden(noisy, (4, slice(0, 100)), (4, slice(106, None)))
    np.testing.assert_array_equal(smooth(holes, 7).positions[100:106, 4], noisy.positions[100:106, 4])


@pytest.mark.parametrize("window", [0, -1, 2, 3, 6])
def test_a_window_that_is_none_is_refused(window):
    message = f"window is {window} frames; it must be odd and at least 5, or 1 for none"
    for call in (lambda: smooth(swim(), window), lambda: beat_gain(window, 60, 2.25)):
        with pytest.raises(ArgumentError) as caught:
            call()
        assert str(caught.value) == message


def test_a_gain_needs_a_frame_rate():
    with pytest.raises(ArgumentError, match=r"^fps is 0; it must be finite and above 0$"):
        beat_gain(7, 0, 2.25)


@pytest.mark.slow
def test_published_beats_survive_smoothing(tracks):
    for trial in tracks:
        quality = check_track(trial.track, REST)
        before, after = (
            identify_beat(track, FISH.swims.tail_markers, quality) for track in (trial.track, smooth(trial.track))
        )
        assert after.amplitude == pytest.approx(before.amplitude, rel=3e-3), trial.name
        assert after.frequency == pytest.approx(before.frequency, abs=1e-3), trial.name
