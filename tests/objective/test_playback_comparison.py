"""Figures of a recording against its playback, of motions whose errors are known beforehand."""

import json

import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.objective import (
    FAILED_LOSS,
    Comparison,
    compare_playback,
    evidence,
    playback_target,
)
from swim2real.trials import MarkerTrack, Signals, Trial

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


# markers


def test_a_recording_of_itself_has_no_error():
    for frame, travels in ((None, False), ((0, 1), False), ((0, 1), True)):
        figures = compared(motion(0.1, 0.4), motion(0.1, 0.4), frame, travels).figures()
        assert figures["loss"] == figures["aligned_marker_error"] == pytest.approx(0, abs=1e-12)
        assert ("heading_error" in figures) == ("shape_error" in figures) == (frame is not None)
        assert ("velocity_error" in figures) == travels


def test_in_the_world_everything_counts():
    found = compared(motion(), motion(at=(0.03, 0.04)))
    assert found.figures() == {
        "aligned_marker_error": pytest.approx(0.05), "loss": pytest.approx(0.05), "left_out_share": 0.0,
        "unweighted_error": pytest.approx(0.05), "divergence": None,
    }  # fmt: skip


def test_a_frame_forgets_place_and_heading():
    found = compared(motion(heading=1.0), motion(heading=-0.5, tip=0.06, at=(1.0, 2.0)), (0, 1)).figures()
    assert found["aligned_marker_error"] == found["shape_error"] == pytest.approx(0.06 / 3)
    assert found["heading_error"] == pytest.approx(0, abs=1e-12)  # it is of the turn since the first frame


def test_a_frame_of_other_markers_than_the_first():
    found = compared(motion(heading=1.0), motion(heading=-0.5, tip=0.06), (2, 0)).figures()
    in_frame = []
    for tip in (0.0, 0.06):
        body = BODY + np.array([0, 0, tip])
        along = body[0] - body[2]
        in_frame.append((body - body[2]) * abs(along) / along)
    assert found["aligned_marker_error"] == pytest.approx(np.abs(in_frame[1] - in_frame[0]).mean())


def test_a_robot_that_travels_has_speed_and_progress():
    found = compared(motion(0.1, heading=1.0), motion(0.13), (0, 1), True)
    figures = found.figures()
    assert figures["velocity_real"] == pytest.approx(0.1)
    assert figures["velocity_simulated"] == pytest.approx(0.13)
    assert figures["velocity_error"] == pytest.approx(0.03)
    assert figures["shape_error"] == pytest.approx(0, abs=1e-12)
    assert figures["aligned_marker_error"] == pytest.approx(0.03 * 1.0)  # on average half of 2 s behind
    backward = compared(motion(0.1), motion(-0.1), (0, 1), True).figures()
    assert backward["velocity_simulated"] == pytest.approx(-0.1)
    assert found.residual[-1, :, 0] == pytest.approx(-0.06)  # farther along -x


def test_a_turn_is_an_error_of_heading():
    found = compared(motion(turn=-3.0), motion(turn=-3.2), (0, 1)).figures()
    assert found["heading_error"] == pytest.approx(0.2)  # of 0 to 0.4 rad, past half turns


def test_markers_without_weight_dont_count():
    real, weights = motion(), np.ones((81, 3))
    real[:, 2] += 0.5
    weights[:, 2] = 0
    real[5, 1] = np.nan
    found = compared(real, motion(tip=0.3, at=(0, 0.01)), weights=weights)
    assert found.aligned_marker_error == pytest.approx(0.01)
    assert found.figures()["left_out_share"] == pytest.approx(82 / 243)
    framed = compared(real, motion(at=(0, 0.01)), (0, 1), weights=weights)
    assert framed.weights[5].tolist() == [0, 0, 0]  # without its frame nothing can be compared
    assert framed.loss == pytest.approx(0, abs=1e-12)


# sensors


def table(values, times=None):
    return Signals(np.linspace(1.0, 5.0, 41) if times is None else times, ("force", "load"), values)


def sensed():
    readings = np.ones((41, 2)) * [1.0, 10.0]
    readings[12, 0] = np.nan
    real, simulated = table(readings), table(np.ones((41, 2)) * [1.5, 9.0]).between(2.0, 4.0)
    worths = {"force": 0.02, "load": 0.001}
    return compared(motion(), motion(at=(0.03, 0.04)), worths=worths, beside={"sensors": real}, sensors=simulated)


def test_sensors_add_what_they_are_worth():
    found = sensed()
    assert found.figures()["sensor_errors"] == pytest.approx({"force": 0.5, "load": 1.0})
    assert found.loss == pytest.approx(0.05 + 0.02 * 0.5 + 0.001 * 1.0)
    assert [len(sensor.times) for sensor in found.sensors] == [21, 21]  # as long as the film


def test_squares_of_the_residual_add_up_to_the_mean_squares():
    found = sensed()
    vector = found.residual_vector()
    assert vector.shape == (2 * 81 * 3 + 2 * 21,)
    assert np.sum(vector**2) == pytest.approx(0.05**2 + (0.02 * 0.5) ** 2 + 0.001**2)
    assert np.isfinite(vector).all()
    both = Comparison((found, found), "playback", None).residual_vector()
    assert np.sum(both**2) == pytest.approx(np.sum(vector**2))


def test_what_cant_be_compared_is_named():
    def refusal(**more):
        with pytest.raises(TrialError) as caught:
            compared(motion(), motion(), worths={"force": 1.0}, **more)
        return str(caught.value)

    assert refusal() == "trial 'a' has no sensors; add a table with a column 'force', which is to be compared"
    other = Signals([2.5], ["load"], [[0.0]])
    assert refusal(beside={"sensors": other}) == (
        "trial 'a': sensor 'force' can't be compared: there is no column 'force'; there are load"
    )
    early = Signals([0.5], ["force"], [[0.0]])
    assert refusal(beside={"sensors": early}) == (
        "trial 'a': sensor 'force' can't be compared: its rows are from 0.5 s to 0.5 s, and the frames that are "
        "compared from 2 s to 4 s; give time_s on the clock of the track, which `track` counts in seconds since the "
        "video's first frame"
    )
    beside = {"sensors": table(np.zeros((41, 2)))}
    assert refusal(beside=beside, sensors=table(np.zeros((41, 2)))) == (
        "trial 'a': its sensors weren't simulated at the recording's time stamps"
    )
    target = playback_target(trial(motion()), np.ones((81, 3)))
    with pytest.raises(TrialError, match="it wasn't simulated at the recording's time stamps"):
        compare_playback(target, Trial("a", MarkerTrack(TIMES + 1, motion())))


# evidence


def test_evidence_tells_how_each_marker_moves():
    phases = np.pi * (TIMES - TIMES[0])  # one turn
    real, simulated = motion(), motion()
    real[:, 2] += 0.05 * np.sin(phases)[:, None] * [0.6, 0.8]
    simulated[:, 2] += 0.08 * np.sin(phases)[:, None] * [0.8, -0.6] + [0.01, 0.0]
    simulated[:40, 1] += [0.02, -0.01]
    simulated[40:, 1] -= [0.02, -0.01]
    found = json.loads(json.dumps(evidence(Comparison((compared(real, simulated),), "playback", 4.0))))
    told = found["trials"]["a"]
    rms = np.sqrt(np.mean(np.sin(phases) ** 2))
    assert told["amplitude_real"] == pytest.approx([0, 0, 0.05 * rms], abs=1e-7)
    assert told["amplitude_simulated"] == pytest.approx([0, np.hypot(0.02, 0.01), 0.08 * rms], rel=1e-3, abs=1e-7)
    assert told["offset"][2] == pytest.approx([0.01, 0.0], abs=1e-3)
    assert told["aligned_marker_errors"][1] == pytest.approx(np.hypot(0.02, 0.01))
    windows = told["windows"]
    assert windows["edges"] == pytest.approx(np.linspace(2, 4, 9))
    assert np.array(windows["markers"])[:4, 1] == pytest.approx(np.tile([0.02, -0.01], (4, 1)))
    assert np.array(windows["markers"])[4:, 1] == pytest.approx(np.tile([-0.02, 0.01], (4, 1)))
    assert found["loss"] == pytest.approx(told["loss"])
    assert "sensor_errors" not in found


def test_evidence_has_no_number_where_nothing_counts():
    weights = np.ones((81, 3))
    weights[:, 2] = 0
    weights[:41, 1] = 0
    told = evidence(Comparison((compared(motion(), motion(), weights=weights),), "playback", None))["trials"]["a"]
    assert told["aligned_marker_errors"] == [0, 0, None]
    assert told["amplitude_real"][2] is None
    assert [window[1][0] for window in told["windows"]["markers"]] == [None] * 4 + [0.0] * 4


def test_sensors_are_in_the_evidence():
    told = evidence(Comparison((sensed(),), "playback", None))
    assert told["sensor_errors"] == {"force": 0.5, "load": 1.0}
    assert told["trials"]["a"]["windows"]["sensors"] == {"force": [0.5] * 8, "load": [-1.0] * 8}


# failures


def test_a_diverged_playback_has_failed():
    nowhere = np.full((81, 3, 2), np.nan)
    beside = {"sensors": table(np.zeros((41, 2)))}
    found = compared(
        motion(0.1), nowhere, (0, 1), True, worths={"force": 1.0}, beside=beside, divergence="the simulation diverged"
    )
    good = compared(
        motion(0.1), motion(0.1), (0, 1), True, worths={"force": 1.0}, beside=beside,
        sensors=table(np.zeros((41, 2))).between(2, 4),
    )  # fmt: skip
    assert found.loss == FAILED_LOSS
    assert found.residual_vector().shape == good.residual_vector().shape
    assert np.sum(found.residual_vector() ** 2) == pytest.approx(FAILED_LOSS**2)
    whole = Comparison((good, found), "playback", None)
    assert whole.loss == FAILED_LOSS
    told = json.loads(json.dumps(evidence(whole), allow_nan=False))
    assert told["trials"]["a"]["divergence"] == "the simulation diverged"
    assert told["velocity_error"] is None
    assert told["sensor_errors"] == {"force": None}
