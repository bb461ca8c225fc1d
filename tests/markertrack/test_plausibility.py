"""Tracks that can't be the robot's are named as what they probably are."""

import pytest

from markertrack.quality import check_plausible, doubled_rate
from markertrack.track import MarkerTrack
from swimbase.errors import TrialError
from swimmers import REST, Swimmer

NAMES = tuple(f"M{m}" for m in range(len(REST)))


def check(change, markers=9):
    track = Swimmer().track(seed=0)
    changed = MarkerTrack(track.times, change(track.positions)[:, :markers])
    check_plausible(changed, REST[:markers], NAMES[:markers], "one")


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda p: 1e3 * p, ("millimeters", "tracks are in meters")), (lambda p: 1e2 * p, ("centimeters",)),
        (lambda p: 39.37 * p, ("inches",)), (lambda p: 1e-3 * p, ("kilometers",)),
        (lambda p: 8.1 * p, ("7.99 times as far apart", "check the camera file's lengths, or the robot file's model")),
        (lambda p: p[:, ::-1], ("in the other order, from M8 to M0; click, or name, M0 first",)),
    ],
)  # fmt: skip
def test_what_cant_be_the_robot_s_is_named(change, parts):
    with pytest.raises(TrialError) as refused:
        check(change)
    for part in ("trial 'one': its markers ", *parts):
        assert part in str(refused.value)


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
def test_what_a_camera_may_be_off_by_passes(factor):
    check(lambda positions: factor * positions)


@pytest.mark.parametrize(("frequency", "told"), [(2.0, True), (1.5, True), (1.0, False), (0.75, False), (0.5, True)])
def test_a_beat_that_no_motor_makes_is_told(frequency, told):
    sentence = doubled_rate(frequency, 1.0)
    assert (sentence is not None) == told
    if told:
        assert "times its nominal 1 Hz: that looks like a frame rate that is off" in sentence
    assert doubled_rate(frequency, None) is None
