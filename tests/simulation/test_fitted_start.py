"""Starts that are fitted with the model, of whole recordings and of pieces."""

from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import (
    FLOATER,
    FLOATER_HIDDEN,
    PENDULUM,
    PENDULUM_HIDDEN,
    RINGING,
    RINGING_HIDDEN,
    blank,
    floater_reference,
    pendulum_reference,
    recorded,
    ringing_reference,
    telling,
    torque_table,
    with_markers,
)
from refused import refusal, says
from swim2real.calibration import Problem
from swim2real.checks.resting import other_start
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Trials
from swim2real.settings import EvaluationSettings
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import cut
from swim2real.trials import Signals, TrialSet
from swimbase.errors import ArgumentError, TrialError

NOISE = 3e-4
TIED_XML = """
<mujoco>
  <worldbody>
    <body name="l"><joint name="left" axis="0 0 1" stiffness="0.5"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01"/><site name="tip" pos="0.2 0 0"/></body>
    <body name="r"><joint name="right" axis="0 0 1"/><geom size="0.01" pos="0.1 0 0"/></body>
  </worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="0 -1 0 0 0"/></equality>
</mujoco>
"""


def loss(robot, reference, values, **options):
    return Problem(robot, reference, threads=2, **options).evaluate(values).loss


@pytest.fixture(scope="module")
def ringing():
    return ringing_reference(20.0, NOISE)


def test_a_slow_camera_shows_how_a_fast_motion_starts(ringing):
    """Of 6 Hz at 20 frames per second, lines through the first frames tell nothing; the fit is as good as the noise."""
    floor = NOISE * np.sqrt(np.pi / 2)
    assert loss(RINGING, ringing, RINGING_HIDDEN) < 1.1 * floor
    assert loss(telling(RINGING, start="markers"), ringing, RINGING_HIDDEN) > 2 * floor


@pytest.mark.parametrize(
    ("robot", "make", "hidden"),
    [(PENDULUM, pendulum_reference, PENDULUM_HIDDEN), (FLOATER, floater_reference, FLOATER_HIDDEN)],
)
def test_it_is_at_least_as_good_as_lines_through_the_first_frames(robot, make, hidden):
    reference = make(5e-4)
    fitted, lines = (loss(telling(robot, start=start), reference, hidden) for start in ("fitted", "markers"))
    assert fitted < 1.05 * lines


def test_a_start_stays_near_the_first_frames(ringing):
    """Of a far too stiff frame no start fits; the one that is taken isn't thrown about."""
    player = PlaybackSimulator(RINGING, 1)
    stiff = {**RINGING_HIDDEN, "low_stiffness": 4000.0, "high_stiffness": 4000.0}
    for trial in ringing:
        found = player.simulate(stiff, [player.request(trial)])[trial.name]
        ways = np.linalg.norm(np.diff(trial.track.positions[:8], axis=0), axis=2).max()
        off = np.linalg.norm(found.track.positions - trial.track.positions, axis=2)[:2]
        assert off.max() <= 2 * ways + 1e-9


def test_joints_that_are_tied_stay_tied():
    robot = replace(
        FLOATER, build=lambda values: with_markers(TIED_XML, ("tip",)), marker_names=("tip",),
        trials=Trials({}, (), "fitted"),
    )  # fmt: skip
    times = np.arange(31) / 60
    angles = 0.5 * np.cos(6 * times)
    track = MarkerTrack(times, 0.2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None])
    trial = replace(blank(robot, "a", 0.5), track=track)
    player = PlaybackSimulator(robot, 1)
    model = robot.build({}).compile()
    data, _ = player.begin(model, player.request(trial))
    assert data.qpos[1] == pytest.approx(-data.qpos[0], abs=1e-3)
    assert data.qvel[1] == pytest.approx(-data.qvel[0], abs=1e-3)
    assert abs(data.qpos[0]) > 0.4
    guess = PlaybackSimulator(telling(robot, start="markers"), 1).request(trial).guess
    assert guess == pytest.approx([0.5, -0.5], abs=2e-2)


@pytest.fixture(scope="module")
def chaotic():
    """A double pendulum that is let go of from far up, without a motor's help."""
    still = Signals([0.0], ["torque"], [[0.0]])
    blanks = [blank(PENDULUM, "a", 4.0, controls=still, start={"shoulder": 2.6, "elbow": 1.0})]
    free = recorded(PENDULUM, PENDULUM_HIDDEN, blanks, NOISE)
    return TrialSet(tuple(replace(trial, start={}) for trial in free), free.marker_names)


def test_pieces_share_the_frames_at_which_a_recording_is_cut():
    trial = blank(PENDULUM, "a", 1.0, controls=torque_table(1.0))
    parts = cut(trial, 0.3)
    assert [part.start for part in parts[1:]] == [part.stop - 1 for part in parts[:-1]]
    assert (parts[0].start, parts[-1].stop, len(parts)) == (0, trial.track.frame_count, 4)
    assert cut(trial, 5.0) == [slice(0, trial.track.frame_count)]
    assert says(refusal(TrialError, cut, trial, 0.01), "'a'", "0.01 s", "fewer than three")
    said = refusal(ArgumentError, Problem, FISH, pendulum_reference(), pieces=0.5)
    assert says(said, "0.5 s", "for recordings", "'fish'")
    assert "pieces is 0" in refusal(ArgumentError, EvaluationSettings, pieces=0.0)


def test_pieces_of_a_chaotic_recording_are_as_good_as_the_noise_near_the_truth(chaotic):
    near = {**PENDULUM_HIDDEN, "lower_mass": 1.02 * PENDULUM_HIDDEN["lower_mass"]}
    whole, pieces = (loss(PENDULUM, chaotic, near, pieces=length) for length in (None, 0.5))
    assert whole > 3 * pieces
    assert pieces < 1e-3
    assert loss(PENDULUM, chaotic, PENDULUM_HIDDEN, pieces=0.5) < pieces


def test_sensors_and_controls_go_on_over_the_pieces():
    trial = floater_reference()["fast"]
    player = PlaybackSimulator(FLOATER, 1)
    pieces = player.simulate(FLOATER_HIDDEN, [player.request(trial, pieces=0.4)])["fast"]
    assert np.abs(pieces.track.positions - trial.track.positions).max() < 2e-4  # the sines keep their phase
    driven = pendulum_reference()["a"]
    player = PlaybackSimulator(PENDULUM, 1)
    found = player.simulate(PENDULUM_HIDDEN, [player.request(driven, pieces=0.4)])["a"]
    within = driven.sensors.between(driven.track.times[0], driven.track.times[-1])
    assert np.array_equal(found.sensors.times, within.times)
    assert np.abs(found.sensors.values - within.values).max() < 0.05 * np.ptp(within.values)


def test_a_motion_too_fast_for_its_frames_is_reported(ringing):
    lines = telling(RINGING, start="markers")
    said = other_start(lines, ringing)
    assert says(said, "trial 'pulled' moves too fast for straight lines", "mm off", 'say start = "fitted"')
    assert other_start(lines, ringing_reference(200.0, NOISE)) is not None  # 0.1 s are more than half a period, too
    assert other_start(RINGING, ringing) is None
    assert "too fast" not in other_start(telling(FLOATER, start="markers"), floater_reference(NOISE))
