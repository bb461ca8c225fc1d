"""Figures of a recording against its playback, of motions whose errors are known beforehand."""

import json
from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from swim2real.objective import (
    FAILED_LOSS,
    Comparison,
    compare_playback,
    evidence,
    playback_target,
)
from swim2real.trials import Signals, Trial
from swimbase.errors import TrialError

TIMES = 2.0 + np.arange(81) / 40
BODY = np.array([0.0, 0.2 + 0.1j, 0.3j])  # of three markers


def motion(speed=0.0, turn=0.0, tip=0.0, heading=0.0, at=(0.0, 0.0)):
    """A body that goes along its -x and turns [rad/s] about its first marker, the third one shifted along its own x."""
    body = BODY + np.array([0, 0, tip])
    axis = np.exp(1j * np.angle(BODY[1]))
    angle = heading + turn * (TIMES - TIMES[0])
    way = -speed * axis * np.exp(1j * heading) * (TIMES - TIMES[0])
    found = way[:, None] + np.exp(1j * angle)[:, None] * body
    return np.stack([found.real, found.imag], axis=2) + np.array(at)


def trial(positions, confidence=None, **more):
    return Trial("a", MarkerTrack(TIMES, positions, confidence), **more)


def compared(real, simulated, frame=None, travels=False, weights=None, worths=None, beside=None, **more):
    weights = np.ones(real.shape[:2]) if weights is None else weights
    target = playback_target(trial(real, **(beside or {})), weights, frame, travels, worths)
    return compare_playback(target, trial(simulated, **more))


def told(*trials, horizon=None):
    """Evidence, through JSON."""
    return json.loads(json.dumps(evidence(Comparison(trials, "playback", horizon)), allow_nan=False))


def test_a_recording_of_itself_has_no_error():
    for frame, travels in ((None, False), ((0, 1), False), ((0, 1), True)):
        figures = compared(motion(0.1, 0.4), motion(0.1, 0.4), frame, travels).figures()
        assert figures["loss"] == figures["aligned_marker_error"] == pytest.approx(0, abs=1e-12)
        assert ("heading_error" in figures) == ("shape_error" in figures) == (frame is not None)
        assert ("velocity_error" in figures) == travels


def test_in_the_world_everything_counts():
    expected = {"aligned_marker_error": 0.05, "loss": 0.05, "left_out_share": 0.0, "unweighted_error": 0.05}
    found = compared(motion(), motion(at=(0.03, 0.04))).figures()
    assert found == pytest.approx({**expected, "divergence": None})


@pytest.mark.parametrize("frame", [(0, 1), (2, 0)])
def test_a_frame_forgets_place_and_heading(frame):
    found = compared(motion(heading=1.0), motion(heading=-0.5, tip=0.06, at=(1.0, 2.0)), frame).figures()
    origin, ahead = frame
    in_frame = []
    for tip in (0.0, 0.06):
        body = BODY + np.array([0, 0, tip])
        along = body[ahead] - body[origin]
        in_frame.append((body - body[origin]) * abs(along) / along)
    expected = np.abs(in_frame[1] - in_frame[0]).mean()
    assert found["aligned_marker_error"] == found["shape_error"] == pytest.approx(expected)
    assert found["heading_error"] == pytest.approx(0, abs=1e-12)  # it is of the turn since the first frame


def test_a_robot_that_travels_has_speed_and_progress():
    found = compared(motion(0.1, heading=1.0), motion(0.13), (0, 1), True)
    expected = {
        "velocity_real": 0.1, "velocity_simulated": 0.13, "velocity_error": 0.03, "shape_error": 0,
        "aligned_marker_error": 0.03 * 1.0,  # on average half of 2 s behind
    }  # fmt: skip
    assert {name: found.figures()[name] for name in expected} == pytest.approx(expected, abs=1e-12)
    assert compared(motion(0.1), motion(-0.1), (0, 1), True).progress.velocity_simulated == pytest.approx(-0.1)
    assert found.residual[-1, :, 0] == pytest.approx(-0.06)  # farther along -x
    turned = compared(motion(turn=-3.0), motion(turn=-3.2), (0, 1))
    assert turned.heading_error == pytest.approx(0.2)  # of 0 to 0.4 rad, past half turns


def test_markers_without_weight_dont_count():
    real, weights = motion(), np.ones((81, 3))
    real[:, 2] += 0.5
    weights[:, 2] = 0
    real[5, 1] = np.nan
    found = compared(real, motion(tip=0.3, at=(0, 0.01)), weights=weights)
    assert found.aligned_marker_error == pytest.approx(0.01)
    assert found.left_out_share == pytest.approx(82 / 243)
    framed = compared(real, motion(at=(0, 0.01)), (0, 1), weights=weights)
    assert framed.weights[5].tolist() == [0, 0, 0]  # without its frame nothing can be compared
    assert framed.loss == pytest.approx(0, abs=1e-12)


def table(values, times=None):
    return Signals(np.linspace(1.0, 5.0, 41) if times is None else times, ("force", "load"), values)


@pytest.fixture
def sensed():
    readings = np.ones((41, 2)) * [1.0, 10.0]
    readings[12, 0] = np.nan
    real, simulated = table(readings), table(np.ones((41, 2)) * [1.5, 9.0]).between(2.0, 4.0)
    worths = {"force": 0.02, "load": 0.001}
    return compared(motion(), motion(at=(0.03, 0.04)), worths=worths, beside={"sensors": real}, sensors=simulated)


def test_sensors_add_what_they_count_as(sensed):
    assert sensed.figures()["sensor_errors"] == pytest.approx({"force": 0.5, "load": 1.0})
    assert sensed.loss == pytest.approx(0.05 + 0.02 * 0.5 + 0.001 * 1.0)
    assert [len(sensor.times) for sensor in sensed.sensors] == [21, 21]  # as long as the film
    found = told(sensed)
    assert found["sensor_errors"] == {"force": 0.5, "load": 1.0}
    assert found["trials"]["a"]["windows"]["sensors"] == {"force": [0.5] * 8, "load": [-1.0] * 8}


def test_squares_of_the_residual_add_up_to_the_mean_squares(sensed):
    vector = sensed.residual_vector()
    assert vector.shape == (2 * 81 * 3 + 2 * 21,)
    assert np.sum(vector**2) == pytest.approx(0.05**2 + (0.02 * 0.5) ** 2 + 0.001**2)


@pytest.mark.parametrize(("more", "says"), [
    ({}, "has no sensors"),
    ({"beside": {"sensors": Signals([2.5], ["load"], [[0.0]])}}, "no column 'force'; there are load"),
    ({"beside": {"sensors": Signals([0.5], ["force"], [[0.0]])}}, "rows are from 0.5 s to 0.5 s, .* 2 s to 4 s"),
    ({"beside": {"sensors": table(np.zeros((41, 2)))}, "sensors": table(np.zeros((41, 2)))}, "weren't simulated"),
], ids=["none", "other", "early", "late"])  # fmt: skip
def test_sensors_that_cant_be_compared_are_named(more, says):
    with pytest.raises(TrialError, match=rf"^trial 'a'.*{says}"):
        compared(motion(), motion(), worths={"force": 1.0}, **more)


def test_evidence_tells_how_each_marker_moves():
    phases = np.pi * (TIMES - TIMES[0])  # one turn
    real, simulated = motion(), motion()
    real[:, 2] += 0.05 * np.sin(phases)[:, None] * [0.6, 0.8]
    simulated[:, 2] += 0.08 * np.sin(phases)[:, None] * [0.8, -0.6] + [0.01, 0.0]
    simulated[:40, 1] += [0.02, -0.01]
    simulated[40:, 1] -= [0.02, -0.01]
    found = told(compared(real, simulated), horizon=4.0)["trials"]["a"]
    rms = np.sqrt(np.mean(np.sin(phases) ** 2))
    assert found["amplitude_real"] == pytest.approx([0, 0, 0.05 * rms], abs=1e-7)
    assert found["amplitude_simulated"] == pytest.approx([0, np.hypot(0.02, 0.01), 0.08 * rms], rel=1e-3, abs=1e-7)
    assert found["offset"][2] == pytest.approx([0.01, 0.0], abs=1e-3)
    assert found["aligned_marker_errors"][1] == pytest.approx(np.hypot(0.02, 0.01))
    assert found["windows"]["edges"] == pytest.approx(np.linspace(2, 4, 9))
    means = np.array(found["windows"]["markers"])[:, 1]
    assert means == pytest.approx(np.repeat([[0.02, -0.01], [-0.02, 0.01]], 4, axis=0))


def test_evidence_has_no_number_where_nothing_counts():
    weights = np.ones((81, 3))
    weights[:, 2] = 0
    weights[:41, 1] = 0
    found = told(compared(motion(), motion(), weights=weights))["trials"]["a"]
    assert found["aligned_marker_errors"] == [0, 0, None]
    assert found["amplitude_real"][2] is None
    assert [window[1][0] for window in found["windows"]["markers"]] == [None] * 4 + [0.0] * 4


def test_a_diverged_playback_has_failed():
    scored = ((0, 1), True, None, {"force": 1.0}, {"sensors": table(np.zeros((41, 2)))})
    found = compared(motion(0.1), np.full((81, 3, 2), np.nan), *scored, divergence="the simulation diverged")
    good = compared(motion(0.1), motion(0.1), *scored, sensors=table(np.zeros((41, 2))).between(2, 4))
    assert found.residual_vector().shape == good.residual_vector().shape
    assert np.sum(found.residual_vector() ** 2) == pytest.approx(FAILED_LOSS**2)
    both = told(good, found)
    assert both["loss"] == FAILED_LOSS
    assert both["trials"]["a"]["divergence"] == "the simulation diverged"
    assert (both["velocity_error"], both["sensor_errors"]) == (None, {"force": None})


def test_places_on_a_midline_count_across_the_body_and_the_head_along_it():
    s, times = np.linspace(0, 0.5, 9), np.linspace(0, 1, 20)[:, None]

    def wave(s: np.ndarray) -> np.ndarray:
        return np.stack([s + 0 * times, 0.05 * np.sin(8 * s - 6 * times)], axis=2)

    real = wave(s)
    track = MarkerTrack(times[:, 0], real)
    target = playback_target(Trial("eel", track, midline=True), np.ones(real.shape[:2]))
    slips = np.r_[0.0, np.random.default_rng(0).uniform(-0.005, 0.005, 8)]

    def error(positions: np.ndarray, midline: bool = True) -> float:
        one = target if midline else replace(target, trial=replace(target.trial, midline=False))
        return compare_playback(one, Trial("eel", MarkerTrack(track.times, positions))).aligned_marker_error

    slipped = wave(s + slips)
    assert error(slipped, midline=False) > 2e-3
    assert error(slipped) < 1e-4
    assert error(real + np.array([0, 0.01])) == pytest.approx(0.0095, rel=0.08)  # across
    assert error(real + np.array([0.01, 0])) == pytest.approx(0.01, rel=0.08)  # the whole swimmer is ahead
