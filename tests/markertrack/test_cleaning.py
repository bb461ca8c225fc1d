import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markertrack.cleaning import beat_gain, beat_window, fill_gaps, smooth
from markertrack.quality import check_track
from markertrack.track import MarkerTrack
from swimbase.errors import ArgumentError
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


def test_filled_samples_are_never_scored():
    holes = hidden(swim(noise=1e-4), (0, slice(50, 54)), (8, slice(100, 106)), (5, slice(200, 201)))
    before, after = check_track(holes, REST), check_track(fill_gaps(holes), REST)
    np.testing.assert_array_equal(after.lost, before.lost)
    np.testing.assert_array_equal(after.weights, before.weights)
    assert after.weights[50:54].sum() == after.weights[100:106, 8].sum() == after.weights[200, 5] == 0


@pytest.mark.parametrize(("fps", "longest"), [(60, 6), (120, 12)])
@pytest.mark.parametrize("junk", [False, True])
def test_only_gaps_up_to_a_tenth_of_a_second_are_filled(fps, longest, junk):
    whole = Swimmer(fps=fps).track(noise=0)
    holes = hidden(whole, (4, slice(100, 100 + longest)), (5, slice(100, 101 + longest)), junk=junk)
    filled = fill_gaps(holes)
    assert np.isfinite(filled.positions[:, 4]).all()
    assert np.isnan(filled.positions[100 : 101 + longest, 5]).all()
    assert np.isfinite(fill_gaps(holes, longest=0.11).positions).all() == (fps == 120)
    assert np.isnan(fill_gaps(holes, longest=0).positions[100:104, 4]).all()


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
    clean, noisy = jittered(clean), jittered(noisy)
    assert (smooth(noisy, 7).positions - clean.positions)[3:-3].std() < 0.7e-3
    slow = Swimmer(fps=30).track()
    assert smooth(slow) is slow


@pytest.mark.parametrize("window", [5, 7, 9])
@pytest.mark.parametrize("frequency", [1.0, 2.25, 4.5, 6.75])
def test_the_stated_gain_is_what_smoothing_does(window, frequency):
    times = np.arange(241) / 60
    wave = np.exp(2j * np.pi * frequency * times)
    track = MarkerTrack(times, np.stack([wave.real, wave.imag], axis=1)[:, None])
    left = smooth(track, window).positions[20:-20, 0]
    np.testing.assert_allclose(np.linalg.norm(left, axis=1), beat_gain(window, 60, frequency), atol=1e-9)


@pytest.mark.parametrize(("fps", "window"), [(25, 1), (30, 1), (50, 5), (60, 7), (120, 13)])
def test_the_window_is_the_longest_that_leaves_the_beat(fps, window):
    assert beat_window(fps) == window
    assert min(beat_gain(window, fps, 2.25), beat_gain(window, fps, 4.5)) >= 0.98
    longer = max(window + 2, 5)
    assert min(beat_gain(longer, fps, 2.25), beat_gain(longer, fps, 4.5)) < 0.98


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


@pytest.mark.parametrize(("call", "says"), [
    *((lambda w=window: smooth(swim(), w), f"window is {window} frames") for window in (-1, 3, 6)),
    (lambda: beat_gain(7, 0, 2.25), "fps is 0"),
    (lambda: fill_gaps(swim(), np.nan), "longest is nan s"),
])  # fmt: skip
def test_what_is_no_window_rate_or_time_is_refused(call, says):
    with pytest.raises(ArgumentError, match=says):
        call()
