import json

import numpy as np
import pytest

from markertrack.span import WHOLE, Span, spans
from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.trials import Signals, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.reference import add_trial
from swim2real.trials.signals import MEMORY
from swim2real.trials.timebase import Timebase
from swimbase.errors import ArgumentError, TrialError

NAMES = ("M0", "M1")


def filmed(name: str = "a", **recorded) -> Trial:
    positions = np.round(np.random.default_rng(0).random((3, 2, 2)), 6)
    return Trial(name, MarkerTrack([0.5, 0.6, 0.7], positions), provenance="made", **recorded)


def torques() -> Signals:
    return Signals([0.1, 0.2, 1 / 3], ["left", "right"], [[1.0, np.nan], [2.0, 1 / 3], [3.0, 1e-17]])


@pytest.mark.parametrize(("times", "names", "values", "parts"), [
    ([0, 1], ["a"], [[1.0]], ("(1, 1)", "(2,)", "1 names", "(R, K), (R,) and K")),
    ([0], ["a", "b"], [[1.0]], ("(1, 1)", "(1,)", "2 names")),
    ([], ["a"], np.zeros((0, 1)), ("at least one row",)),
    ([0, 0], ["a"], [[1.0], [2.0]], ("finite and rise",)),
    ([0, np.inf], ["a"], [[1.0], [2.0]], ("finite and rise",)),
    ([0], ["a", "a"], [[1.0, 2.0]], ("'a', 'a'", "its own name")),
    ([0], [""], [[1.0]], ("''", "its own name")),
])  # fmt: skip
def test_wrong_signals_are_refused(times, names, values, parts):
    assert says(refusal(TrialError, Signals, times, names, values), *parts)


def test_signals_cant_be_changed_and_a_value_holds_until_the_next():
    values = np.ones((2, 1))
    signals = Signals([0, 1], ["a"], values)
    values[:] = 2
    assert signals.values.max() == 1
    for array in (signals.values, signals.times):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 3
    times = np.array([-1.0, 0.1, 0.2 - 1e-12, 0.25, 9.0])
    assert torques().at("left", times).tolist() == [1, 1, 2, 2, 3]
    assert torques().at("right", times).tolist() == [1 / 3, 1 / 3, 1 / 3, 1 / 3, 1e-17]  # an empty cell is no value
    assert says(refusal(TrialError, torques().at, "middle", times), "'middle'", "left, right")
    assert says(refusal(TrialError, Signals([0.0], ["a"], [[np.nan]]).at, "a", times), "'a'", "no value")


def test_rows_are_cut_by_the_clock_of_the_track():
    assert torques().between(0.2, 0.3).times.tolist() == [0.2]
    assert torques().between(-1, 9).times.tolist() == torques().times.tolist()
    for cut in (torques().between, torques().cut):
        assert says(refusal(TrialError, cut, 0.21, 0.3), "no row", "0.21 s and 0.3 s")
    torques().check_clock(0.3, 5.0)
    torques().check_clock(0.21, 0.3)  # between two rows the first of them holds
    said = refusal(TrialError, Signals([1.7e9, 1.7e9 + 5], ["a"], [[1.0], [2.0]]).check_clock, 0.0, 5.0)
    assert says(said, "1700000000 s to 1700000005 s", "0 s to 5 s", "clock of the track")
    assert says(refusal(TrialError, torques().check_clock, 0.4, 5.0), "0.1 s to 0.3333333333 s", "0.4 s to 5 s")


def test_recordings_are_read_back_to_the_last_digit(tmp_path):
    trial = filmed(controls=torques(), sensors=torques(), start={"hip": 1 / 3}, start_velocities={"hip": -2.0})
    save_reference(TrialSet((trial, filmed("b")), NAMES), tmp_path)
    back = load_reference(tmp_path)
    for signals in (back["a"].controls, back["a"].sensors):
        assert signals.names == ("left", "right")
        assert np.array_equal(signals.times, torques().times)
        assert np.array_equal(signals.values, torques().values, equal_nan=True)
    assert (back["a"].start, back["a"].start_velocities) == ({"hip": 1 / 3}, {"hip": -2.0})
    assert (back["b"].controls, back["b"].sensors, dict(back["b"].start)) == (None, None, {})
    assert (tmp_path / "a.controls.csv").read_text().splitlines()[:2] == ["time_s,left,right", "0.1,1.0,"]


def test_a_trial_that_is_added_again_keeps_what_was_recorded_beside_it(tmp_path):
    add_trial(tmp_path, filmed(controls=torques(), start={"hip": 0.5}), NAMES)
    add_trial(tmp_path, filmed(start={"hip": 0.6}), NAMES)
    back = load_reference(tmp_path)["a"]
    assert back.controls is not None
    assert back.start == {"hip": 0.6}


def test_two_trials_cant_have_one_table(tmp_path):
    both = TrialSet((filmed("a", controls=torques()), filmed("a.controls")), NAMES)
    add_trial(tmp_path, filmed("a.controls"), NAMES)
    for call in ((save_reference, both, tmp_path), (add_trial, tmp_path, filmed("a", controls=torques()), NAMES)):
        assert says(refusal(TrialError, *call), "'a.controls.csv'", "trial 'a.controls'", "choose another name")


@pytest.mark.parametrize(("table", "parts"), [
    ("time,left\n0,1\n", ("line 1", "time_s,NAME")),
    ("time_s\n0\n", ("the table is empty",)),
    ("time_s,left\n", ("the table is empty",)),
    ("time_s,left\n1,1\n0,1\n", ("finite and rise",)),
    ("time_s,left,left\n1,1,1\n", ("'left', 'left'",)),
    ("time_s,left\n0,1\n1,2e12\n", ("line 3, column 2", "2e+12", "1e+12")),
])  # fmt: skip
def test_a_damaged_table_is_named(tmp_path, table, parts):
    save_reference(TrialSet((filmed(controls=torques()),), NAMES), tmp_path)
    (tmp_path / "a.controls.csv").write_text(table)
    assert says(refusal(TrialError, load_reference, tmp_path), tmp_path / "a.controls.csv", *parts)


@pytest.mark.parametrize(("key", "value", "parts"), [
    ("controls", "../x.csv", ("controls '../x.csv' of trial 'a'",)),
    ("sensors", "none.csv", ("sensors 'none.csv' of trial 'a'",)),
    ("start", [1], ("'trials[0].start' is [1]", "names and values")),
    ("start", {"hip": "far"}, ("'trials[0].start.hip'", '"far"', "number")),
    ("start_velocities", {"hip": True}, ("'trials[0].start_velocities.hip'", "true", "number")),
])  # fmt: skip
def test_a_damaged_index_is_named(tmp_path, key, value, parts):
    save_reference(TrialSet((filmed(controls=torques()),), NAMES), tmp_path)
    index = json.loads((tmp_path / "reference.json").read_text())
    index["trials"][0][key] = value
    (tmp_path / "reference.json").write_text(json.dumps(index))
    assert says(refusal(TrialError, load_reference, tmp_path), tmp_path / "reference.json", *parts)


# stretches of a trial

TIMES = np.arange(101) / 20  # 0 to 5 s
TRACK = MarkerTrack(TIMES, np.stack([TIMES, -TIMES, 1 + TIMES, TIMES], axis=1).reshape(-1, 2, 2))
CONTROLS = Signals([0.0, 0.7, 1.9, 2.5], ["a", "b"], [[1, 5], [2, np.nan], [3, np.nan], [4, 8]])
SENSORS = Signals(TIMES[::2], ["load"], 10 * TIMES[::2, None])
TRIAL = Trial("pull", TRACK, provenance="by hand", controls=CONTROLS, sensors=SENSORS, start={"hip": 0.1},
              timebases={"track": Timebase("first row of pull.csv", 20.0, "stamps")})  # fmt: skip


def test_a_stretch_of_a_trial_counts_its_times_from_its_first_frame():
    cut = TRIAL.within(Span(2.0, 3.0))
    np.testing.assert_allclose(cut.track.times, np.arange(21) / 20)
    np.testing.assert_array_equal(cut.track.positions, TRACK.positions[40:61])
    np.testing.assert_allclose(cut.sensors.times, np.arange(11) / 10)
    np.testing.assert_allclose(cut.sensors.column("load"), 20 + np.arange(11))
    assert (cut.provenance, cut.video_begin) == ("by hand, from 2 s to 3 s", 2.0)
    assert not cut.start  # it was that of another time
    assert str(cut.timebases["track"]) == "20 Hz by its time stamps, from the first row of pull.csv plus 2 s"
    begun = TRIAL.within(Span(until=1.0))
    assert (begun.start, begun.video_begin, begun.track.frame_count) == ({"hip": 0.1}, 0.0, 21)
    assert TRIAL.within(WHOLE) is TRIAL


@pytest.mark.parametrize("begin", [0.0, 1.0, 1.9, 2.2, 2.5])
def test_what_drove_it_is_the_same_at_the_same_moment(begin):
    cut = TRIAL.within(Span(begin))
    for name in ("a", "b"):
        np.testing.assert_array_equal(cut.controls.at(name, TIMES - begin), CONTROLS.at(name, TIMES))
    assert cut.controls.times[0] == pytest.approx(-begin)
    assert cut.controls.times[-1] >= 0  # what holds at the beginning is said there


def test_commands_of_the_last_seconds_stay_and_a_time_as_it_is_shown_means_its_frame():
    """Of a long log, those that actuators may remember; what holds where these begin has a row there."""
    long = Signals(np.arange(100.0), ["a", "b"], [[i, i if i % 8 == 0 else np.nan] for i in range(100)])
    cut = long.cut(60.5, 70.0, before=MEMORY)
    np.testing.assert_allclose(cut.times, [-5.0, *(np.arange(56, 71) - 60.5)])
    np.testing.assert_array_equal(cut.values[0], [55, 48])
    only = Signals([0.0], ["a"], [[0.3]]).cut(60.0, 70.0, before=MEMORY)
    assert (only.times.tolist(), only.column("a").tolist()) == ([-5.0, 0.0], [0.3, 0.3])
    track = MarkerTrack(np.arange(10) / 30, np.zeros((10, 1, 2)))
    np.testing.assert_allclose(Span(0.067, 0.1).of_track(track, "x").times, [2 / 30, 3 / 30])  # 0.0667 s


@pytest.mark.parametrize(("begin", "until", "parts"), [
    (6.0, None, ("'pull' ends at 5.000 s", "--from is 6 s", "before the end")),
    (1.0, 7.0, ("'pull' ends at 5.000 s", "--until is 7 s")),
    (1.01, 1.02, ("'pull' has 0 frames from 1.01 s to 1.02 s", "at least 2")),
])  # fmt: skip
def test_a_stretch_outside_is_refused(begin, until, parts):
    assert says(refusal(TrialError, TRIAL.within, Span(begin, until)), *parts)


@pytest.mark.parametrize(("begins", "untils", "parts"), [
    ((-1.0,), (), ("--from is -1 s", "0 or above")),
    ((2.0,), (1.0,), ("--until is 1 s", "after --from, which is 2 s")),
    ((), (float("nan"),), ("--until is nan s",)),
    ((1.0, 2.0), (), ("--from has 2 values for 3 videos", "one for all or each")),
])  # fmt: skip
def test_what_is_no_stretch_is_refused(begins, untils, parts):
    assert says(refusal(ArgumentError, spans, begins, untils, 3, "videos"), *parts)
    assert spans((1.0,), (2.0, 3.0, 4.0), 3, "videos") == [Span(1.0, 2.0), Span(1.0, 3.0), Span(1.0, 4.0)]


def test_a_reference_remembers_where_in_its_video_a_trial_begins(tmp_path):
    cut = Trial("pull", TRACK, video=tmp_path / "pull.mp4", controls=CONTROLS).within(Span(2.0))
    save_reference(TrialSet((cut,), ("A", "B")), tmp_path)
    (read,) = load_reference(tmp_path)
    assert (read.video_begin, read.video) == (2.0, tmp_path / "pull.mp4")
    add_trial(tmp_path, Trial("pull", TRACK, video=tmp_path / "pull.mp4"), ("A", "B"))
    (again,) = load_reference(tmp_path)
    assert (again.video_begin, again.controls) == (0.0, None)  # the controls were on another clock
