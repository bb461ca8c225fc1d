"""What a table of commands is expected to do, and real runs beside it."""

import json

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from swim2real.objective.expected_run import (
    Band,
    ExpectedRun,
    compare_run,
    motion_of,
    read_expected_run,
)
from swim2real.trials import Signals, Trial, TrialSet
from swimbase.errors import ArgumentError, TrialError

RATE, ORIGIN = 50.0, (0.03, 0.0)
PAIR = np.array([[-0.07, 0.0], [0.07, 0.0]]) - ORIGIN  # from the point that stands for the robot


def swim(speed=0.1, beat=1.0, turn=0.05, seconds=6.0):
    """Places and headings of a robot that begins at rest and swings about a slow turn."""
    t = np.arange(round(seconds * RATE) + 1) / RATE
    t += 0.2 * (np.exp(-5 * t) - 1)
    heading = turn * t + 0.1 * np.sin(2 * np.pi * beat * t)
    return np.column_stack([-speed * t, 0.05 * (1 - np.cos(0.5 * t))]), heading


def expected(*swims, goal=None):
    x, y, headings = (np.array(rows) for rows in zip(*((p[:, 0], p[:, 1], h) for p, h in swims), strict=True))
    ahead = None if goal is None else 0.05
    return ExpectedRun(
        robot="fish", task="target", frame=("M0", "M1"), origin=ORIGIN, goal=goal, threshold=ahead, rate=RATE,
        sets=len(swims), x=Band.of(x), y=Band.of(y), heading=Band.of(headings), roll=None, arrivals=[4.0, 5.0],
    )  # fmt: skip


def filmed(places, headings, begin=0.0, **options):
    """The trial of a film of such a swim, in a pool that knows nothing of its start, turned by 40 degrees."""
    spin = lambda angle: np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])  # noqa: E731
    markers = np.array([place + PAIR @ spin(heading) for place, heading in zip(places, headings, strict=True)])
    track = MarkerTrack(begin + np.arange(len(places)) / RATE, markers @ spin(0.7) + [1.3, -0.4])
    return Trial("run", track, **options)


def compared(run, trial, begin=None):
    return compare_run(run, TrialSet((trial,), ("M0", "M1")), trial, begin)


def test_a_film_of_what_was_expected_shows_it_wherever_the_pool_is():
    told = swim()
    run = compared(expected(told, swim(0.12)), filmed(*told, begin=7.0))
    assert run.path_error < 3e-3  # since it moves a little within 0.1 s of its start
    assert (run.came, run.within) == (True, 1.0)
    assert compared(expected(told, swim(0.12)), filmed(*swim(0.08))).came is False
    assert run.figures["forward"] == pytest.approx((0.58, 0.58, 0.696, 0.58), abs=3e-3)
    told, *_, measured = run.figures["heading"]
    assert measured == pytest.approx(told, abs=0.03)
    assert run.beats == (6, 6)
    assert run.sentence.startswith("run: 0.579 m forward in 6.0 s, expected 0.580, 0.58 to 0.70")


def test_the_point_that_stands_for_the_robot_is_not_the_middle_of_its_markers():
    places, headings = swim()
    trial = filmed(places, headings)
    found, turned = motion_of(trial.track.positions, (0, 1), np.array(ORIGIN))
    np.testing.assert_allclose(np.linalg.norm(np.diff(found, axis=0), axis=1),
                               np.linalg.norm(np.diff(places, axis=0), axis=1), atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(np.diff(turned), np.diff(headings), atol=1e-12)


def test_a_goal_is_reached_or_not_and_a_film_may_end_too_early_to_say():
    run, ahead = expected(swim(), swim(0.12), goal=(-0.4, 0.05)), (0.1, 1.0, 0.0)
    came = compared(run, filmed(*swim(*ahead)))
    assert came.came is True
    assert came.figures["arrival"][3] == pytest.approx(3.6, abs=0.2)
    assert "it came: goal reached after 3.7 s, expected after 4.0 s, 4.00 to 5.00" in came.sentence
    slow = compared(run, filmed(*swim(0.04)))
    assert slow.came is False
    assert "it did not come: 0.1" in slow.sentence
    short = compared(run, filmed(*swim(*ahead, seconds=2.0)))
    assert short.came is None
    assert "isn't in the film" in short.sentence
    assert "the film ends at 2.0 s, the commands at 6.0 s: give all of it" in short.sentence
    assert short.seconds == 2.0
    coasting = compared(expected(swim(seconds=3.4), goal=(-0.4, 0.05)), filmed(*swim(*ahead)))
    assert coasting.came is True  # after the last command


def test_fewer_beats_than_expected_are_counted():
    run = compared(expected(swim(beat=1.5)), filmed(*swim(beat=0.5)))
    assert run.beats == (9, 3)
    assert "it shows 3 of 9 beats: look at the motor's log" in run.sentence


def test_the_clock_begins_with_the_first_command():
    waiting = [np.concatenate([np.repeat(part[:1], 100, axis=0), part]) for part in swim()]  # 2 s at rest
    late = filmed(*waiting)
    run = expected(swim())
    assert compared(run, late, begin=2.0).path_error < 1e-3
    assert compared(run, late).path_error > 0.05
    logged = filmed(*waiting, controls=Signals([2.0, 3.0], ("motor",), [[1.0], [2.0]]))
    assert compared(run, logged).path_error < 1e-3
    with pytest.raises(TrialError, match=r"'run': M0 and M1 must be seen within 0\.1 s of the first command, at 20 s"):
        compared(run, late, begin=20.0)


def test_what_does_not_fit_is_a_sentence(tmp_path):
    run, trial = expected(swim()), filmed(*swim())
    with pytest.raises(ArgumentError, match="has the markers M0 and M1; the trials have A, B: track M0, too"):
        compare_run(run, TrialSet((trial,), ("A", "B")), trial)
    path = tmp_path / "commands.expected.json"
    path.write_text(json.dumps(run.model_dump()))
    assert read_expected_run(path) == run
    path.write_text(json.dumps({**run.model_dump(), "x": {"expected": [0, 1], "low": [0, 1], "high": [0, 1]}}))
    with pytest.raises(ArgumentError, match="its series differ in length; write it anew"):
        read_expected_run(path)
    path.write_text(json.dumps({**run.model_dump(), "rate": 0}))
    with pytest.raises(ArgumentError, match=r"'rate' is 0"):
        read_expected_run(path)
