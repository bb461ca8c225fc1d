"""Swimming kinematics of bodies whose kinematics are known."""

import numpy as np
import pytest

from drawn_swimmers import Swimmer
from markertrack import Layout, MarkerTrack
from markertrack.kinematics import swimming_kinematics
from swimbase.errors import TrackingError

COUNT = 21
LAYOUT = Layout.of([f"S{m}" for m in range(COUNT)], np.linspace([0, 0], [0.3, 0], COUNT))


def tracked(swimmer: Swimmer, seconds: float = 3.0, fps: float = 60.0) -> MarkerTrack:
    times = np.arange(round(seconds * fps)) / fps
    places = np.array([swimmer.midline(time)[:: 200 // (COUNT - 1)] for time in times])
    noise = np.random.default_rng(0).normal(0, 0.002, places.shape)
    return MarkerTrack(times, 0.3 * (places / swimmer.length + noise))


@pytest.mark.parametrize(
    "swimmer",
    [Swimmer(), Swimmer(heading=2.0, wavelength=0.7, frequency=3.1, speed=1.2), Swimmer(speed=0.0, amplitude=0.05)],
    ids=["straight", "askew", "station"],
)
def test_what_was_put_in_comes_out(swimmer):
    found = swimming_kinematics(tracked(swimmer), LAYOUT)
    middles = np.array([swimmer.midline(k / 60 / swimmer.frequency) for k in range(60)]) / swimmer.length
    turn = np.array([-np.sin(swimmer.heading), np.cos(swimmer.heading)])
    amplitudes = np.ptp(middles[:, :: 200 // (COUNT - 1)] @ turn, axis=0) / 2
    tip = np.linspace(0, 1, 801)
    y = swimmer.amplitude * (0.2 + 0.8 * tip**2) * np.sin(2 * np.pi * tip / swimmer.wavelength)
    along = np.hypot(np.diff(tip), np.diff(y)).sum()  # a wavelength is measured along the bent body
    assert found.beats == int(swimmer.frequency * (3.0 - 1 / 60))
    assert found.frequency.value == pytest.approx(swimmer.frequency, abs=4 * found.frequency.error)
    assert found.frequency.value == pytest.approx(swimmer.frequency, rel=0.01)
    assert found.speed.value == pytest.approx(swimmer.speed, abs=0.01)
    assert found.wavelength.value == pytest.approx(swimmer.wavelength * along, rel=0.03)
    assert found.wave_speed.value == pytest.approx(found.wavelength.value * found.frequency.value)
    np.testing.assert_allclose([one.value for one in found.amplitudes], amplitudes, atol=0.005)
    if swimmer.speed:
        strouhal = swimmer.frequency * 2 * amplitudes[-1] / swimmer.speed
        assert found.strouhal.value == pytest.approx(strouhal, rel=0.05)
    else:
        assert np.isnan(found.strouhal.value)


def test_a_course_that_turns_is_no_beat():
    straight = tracked(Swimmer(amplitude=0.05), seconds=1.6)
    turns = 0.8 * straight.times
    axes = np.stack([np.cos(turns), np.sin(turns), -np.sin(turns), np.cos(turns)], axis=1).reshape(-1, 1, 2, 2)
    turning = MarkerTrack(straight.times, (straight.positions[:, :, None] @ axes)[:, :, 0])
    assert swimming_kinematics(turning, LAYOUT).frequency.value == pytest.approx(2.0, rel=0.03)


def test_doubtful_places_are_left_out_and_the_table_says_what_is_known():
    track = tracked(Swimmer())
    positions, confidence = track.positions.copy(), np.ones(track.positions.shape[:2])
    positions[40:44], confidence[40:44] = 1e3, 0.3
    doubtful = swimming_kinematics(MarkerTrack(track.times, positions, confidence), LAYOUT)
    known = swimming_kinematics(track, LAYOUT)
    assert doubtful.amplitudes[-1].value == pytest.approx(known.amplitudes[-1].value, rel=0.02)
    lines = doubtful.to_csv("swim", LAYOUT.names).splitlines()
    assert lines[0] == "trial,quantity,unit,value,standard_error"
    assert lines[1].startswith("swim,beat frequency,Hz,2.0")
    assert len(lines) == 1 + 5 + COUNT


@pytest.mark.parametrize(
    ("track", "message"),
    [
        (tracked(Swimmer(), seconds=0.7), "1.4 beats"),
        (tracked(Swimmer(amplitude=0.0)), "no regular beat"),
        (tracked(Swimmer()).frames(slice(0, 6)), "seen in 6 frames"),
    ],
)
def test_too_little_is_refused(track, message):
    with pytest.raises(TrackingError, match=message):
        swimming_kinematics(track, LAYOUT)
