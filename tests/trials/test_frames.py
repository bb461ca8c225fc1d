import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markertrack import frames
from markertrack.track import MarkerTrack
from swimmers import Swimmer

angles = st.floats(-np.pi, np.pi)
metres = st.floats(-10.0, 10.0)


def turned(positions, angle, shift=(0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    return positions @ np.array([[c, s], [-s, c]]) + np.asarray(shift)


def slow_swim_frame(positions):
    """The swim frame frame by frame, with complex numbers."""
    z = positions[..., 0] + 1j * positions[..., 1]
    out = np.empty_like(z)
    come = 0.0 + 0.0j
    for t in range(len(z)):
        axis = (z[t, 1] - z[t, 0]) / abs(z[t, 1] - z[t, 0])
        head = (z[t, 0] + z[t, 1]) / 2
        if t > 0:
            come += (head - (z[t - 1, 0] + z[t - 1, 1]) / 2) * axis.conjugate()
        out[t] = (z[t] - head) * axis.conjugate() + come
    return np.stack([out.real, out.imag], axis=-1)


@given(angles, metres, metres)
def test_frames_forget_place_and_heading_of_the_world(angle, x, y):
    track = Swimmer(duration=2.0).track()
    moved = MarkerTrack(track.times, turned(track.positions, angle, (x, y)))
    np.testing.assert_allclose(moved.body, track.body, atol=1e-11)
    np.testing.assert_allclose(moved.swim, track.swim, atol=1e-11)
    np.testing.assert_allclose(moved.course, track.course, atol=1e-9)
    heads = frames.heads(track.course)  # from the origin toward -x, and nothing is bent
    np.testing.assert_allclose(heads[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(-heads[:, 0], track.progress, atol=1e-9)
    between = np.linalg.norm(track.course[:, 3] - track.course[:, 0], axis=1)
    np.testing.assert_allclose(between, np.linalg.norm(track.positions[:, 3] - track.positions[:, 0], axis=1))


def test_the_frames_are_their_definitions():
    body = Swimmer(duration=0.5).track().body
    np.testing.assert_allclose(body[:, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(body[:, 1, 1], 0.0, atol=1e-15)
    assert np.all(body[:, 1, 0] > 0.1)
    positions = np.array([[[0.0, 0.0], [0.0, 1.0], [-0.5, 2.0]]] * 2)  # tail up, third marker to the left of it
    np.testing.assert_allclose(frames.to_body(positions)[0, 2], [2.0, 0.5], atol=1e-15)
    track = Swimmer(duration=2.0, heading=2.0).track()
    np.testing.assert_allclose(track.swim, slow_swim_frame(track.positions), atol=1e-12)


def test_frames_without_a_head_are_stepped_over():
    track = Swimmer(duration=1.0, heading=0.0).track(noise=0.0)
    positions = track.positions.copy()
    positions[10:13, 0] = np.nan
    whole, gappy = track.swim, frames.to_swim(positions)
    assert np.isnan(gappy[10:13]).all()
    np.testing.assert_allclose(gappy[:10], whole[:10], atol=1e-15)
    np.testing.assert_allclose(gappy[13:], whole[13:], atol=1e-3)  # but for the yaw during the gap
    positions[0, 1] = np.nan
    late = MarkerTrack(track.times, positions)
    assert np.flatnonzero(np.isnan(late.progress)).tolist() == [0, 10, 11, 12]
    assert late.progress[1] == 0.0
    assert late.speed == pytest.approx(track.speed, abs=1e-3)


@given(angles, st.floats(0.01, 0.5))
def test_speed_and_progress_of_a_straight_swim_in_any_direction(heading, speed):
    track = Swimmer(speed=speed, heading=heading, duration=3.0).track(noise=0.0, by_hand=False)
    # a head that yaws by 0.03 rad, and markers that sway by formulas, move the head's mean by less than 5 mm
    assert track.speed == pytest.approx(speed, abs=2e-3)
    np.testing.assert_allclose(track.progress, speed * track.times, atol=1e-2)
    times = np.linspace(0.0, 2.0, 41)
    forward = -np.array([np.cos(heading), np.sin(heading)])
    rest = turned(np.array([[0.0, 0.0], [0.14, 0.0], [0.5, 0.0]]), heading)
    rigid = MarkerTrack(times, rest + speed * times[:, None, None] * forward)
    assert rigid.speed == pytest.approx(speed, rel=1e-9)
    np.testing.assert_allclose(rigid.progress, speed * times, atol=1e-12)
    np.testing.assert_allclose(frames.swimming_axis(times, rigid.positions), forward, atol=1e-9)


def test_a_fish_that_stays_has_no_speed_and_an_axis_all_the_same():
    positions = np.broadcast_to([[[0.0, 0.0], [0.0, 0.14]]], (3, 2, 2))
    track = MarkerTrack([0.0, 0.1, 0.2], positions)
    assert track.speed == 0.0
    np.testing.assert_allclose(frames.swimming_axis(track.times, track.positions), [0.0, -1.0])
    times = np.array([0.0, 1.0, 2.0, 4.0])
    assert frames.slope(times, np.array([1.0, 3.0, np.nan, 9.0])) == pytest.approx(2.0)
    assert np.isnan(frames.slope(times, np.array([1.0, np.nan, np.nan, np.nan])))
