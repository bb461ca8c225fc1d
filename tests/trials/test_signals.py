import json
from dataclasses import replace

import numpy as np
import pytest

from swim2real.calibration import reference_fingerprint
from swim2real.errors import TrialError
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.reference import add_trial

NAMES = ("M0", "M1")
EXPECTED = "expected (R, K), (R,) and K"


def refusal(call, *arguments) -> str:
    with pytest.raises(TrialError) as caught:
        call(*arguments)
    return str(caught.value)


def filmed(name: str = "a", **recorded) -> Trial:
    positions = np.round(np.random.default_rng(0).random((3, 2, 2)), 6)
    return Trial(name, MarkerTrack([0.5, 0.6, 0.7], positions), provenance="made", **recorded)


def torques() -> Signals:
    return Signals([0.1, 0.2, 1 / 3], ["left", "right"], [[1.0, np.nan], [2.0, 1 / 3], [3.0, 1e-17]])


# the class


@pytest.mark.parametrize(
    ("times", "names", "values", "message"),
    [
        ([0, 1], ["a"], [[1.0]], "values have shape (1, 1), times (2,) and there are 1 names; " + EXPECTED),
        ([0], ["a", "b"], [[1.0]], "values have shape (1, 1), times (1,) and there are 2 names; " + EXPECTED),
        ([], ["a"], np.zeros((0, 1)), "a table of signals needs at least one row"),
        ([0, 0], ["a"], [[1.0], [2.0]], "time stamps must be finite and rise from row to row"),
        ([0, np.inf], ["a"], [[1.0], [2.0]], "time stamps must be finite and rise from row to row"),
        ([0], ["a", "a"], [[1.0, 2.0]], "columns are named 'a', 'a'; give each its own name"),
        ([0], [""], [[1.0]], "columns are named ''; give each its own name"),
    ],
)  # fmt: skip
def test_wrong_signals_are_refused(times, names, values, message):
    assert refusal(Signals, times, names, values) == message


def test_signals_cant_be_changed():
    values = np.ones((2, 1))
    signals = Signals([0, 1], ["a"], values)
    values[:] = 2
    assert signals.values.max() == 1
    with pytest.raises(ValueError, match="read-only"):
        signals.values[0, 0] = 3
    with pytest.raises(ValueError, match="read-only"):
        signals.times[0] = 3


def test_a_value_holds_until_the_next_and_the_first_before_it():
    times = np.array([-1.0, 0.1, 0.2 - 1e-12, 0.25, 9.0])
    assert torques().held("left", times).tolist() == [1, 1, 2, 2, 3]
    assert torques().held("right", times).tolist() == [1 / 3, 1 / 3, 1 / 3, 1 / 3, 1e-17]  # an empty cell is no value
    assert refusal(torques().held, "middle", times) == "there is no column 'middle'; there are left, right"
    empty = Signals([0.0], ["a"], [[np.nan]])
    assert refusal(empty.held, "a", times) == "column 'a' has no value"


def test_rows_between_two_times():
    assert torques().between(0.2, 0.3).times.tolist() == [0.2]
    assert torques().between(-1, 9).times.tolist() == torques().times.tolist()
    assert refusal(torques().between, 0.21, 0.3) == (
        "there is no row between 0.21 s and 0.3 s; the rows are from 0.1 s to 0.333333 s"
    )


def test_a_table_on_another_clock_is_refused_with_both_spans():
    assert refusal(Signals([1.7e9, 1.7e9 + 5], ["a"], [[1.0], [2.0]]).check_clock, 0.0, 5.0) == (
        "its rows are from 1700000000 s to 1700000005 s, and the frames that are compared from 0 s to 5 s; give time_s "
        "on the clock of the track, which `track` counts in seconds since the video's first frame"
    )
    assert refusal(torques().check_clock, 0.4, 5.0) == refusal(torques().between, 0.4, 5.0)
    torques().check_clock(0.3, 5.0)
    torques().check_clock(0.21, 0.3)  # between two rows the first of them holds


def test_a_cut_trial_keeps_what_was_recorded():
    trial = filmed(controls=torques(), start={"hip": 0.1})
    cut = trial.cut(0.1)
    assert cut.track.frame_count == 2
    assert cut.controls is trial.controls
    assert cut.start == {"hip": 0.1}


# reference folders


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
    message = f"table 'a.controls.csv' in '{tmp_path}' is trial 'a.controls'; choose another name"
    assert refusal(save_reference, both, tmp_path) == message
    add_trial(tmp_path, filmed("a.controls"), NAMES)
    assert refusal(add_trial, tmp_path, filmed("a", controls=torques()), NAMES) == message


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("time,left\n0,1\n", ", line 1: the header must be time_s,NAME,…, with a name for each column"),
        ("time_s\n0\n", ", line 1: the header must be time_s,NAME,…, with a name for each column"),
        ("", ", line 1: the header must be time_s,NAME,…, with a name for each column"),
        ("time_s,left\n0,1\n1,x\n", ", line 3, column 2: 'x' is not a number"),
        ("time_s,left\n0,1\n1,2,3\n", ", line 3: 3 columns, the rows above have 2"),
        ("time_s,left\n0,1,3\n", ": 3 columns of numbers; expected 2 columns, as the header"),
        ("time_s,left\n", ": 0 columns of numbers; expected 2 columns, as the header"),
        ("time_s,left\n1,1\n0,1\n", ": time stamps must be finite and rise from row to row"),
        ("time_s,left,left\n1,1,1\n", ": columns are named 'left', 'left'; give each its own name"),
    ],
)
def test_a_damaged_table_is_named(tmp_path, table, message):
    save_reference(TrialSet((filmed(controls=torques()),), NAMES), tmp_path)
    (tmp_path / "a.controls.csv").write_text(table)
    assert refusal(load_reference, tmp_path) == f"{tmp_path / 'a.controls.csv'}{message}"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("controls", "../x.csv", "controls '../x.csv' of trial 'a' is not in {folder}"),
        ("sensors", "none.csv", "sensors 'none.csv' of trial 'a' is not in {folder}"),
        ("start", [1], "'trials[0].start' is [1]; it must be a table of names and values"),
        ("start", {"hip": "far"}, "'trials[0].start.hip' is \"far\"; it must be a number"),
        ("start_velocities", {"hip": True}, "'trials[0].start_velocities.hip' is true; it must be a number"),
    ],
)  # fmt: skip
def test_a_damaged_index_is_named(tmp_path, key, value, message):
    save_reference(TrialSet((filmed(controls=torques()),), NAMES), tmp_path)
    index = json.loads((tmp_path / "reference.json").read_text())
    index["trials"][0][key] = value
    (tmp_path / "reference.json").write_text(json.dumps(index))
    text = refusal(load_reference, tmp_path)
    assert str(tmp_path / "reference.json") in text
    assert message.format(folder=tmp_path) in text


def test_the_fingerprint_sees_what_was_recorded():
    trial = filmed()
    others = [
        replace(trial, controls=torques()), replace(trial, sensors=torques()), replace(trial, start={"hip": 0.0}),
        replace(trial, start_velocities={"hip": 0.0}),
    ]  # fmt: skip
    fingerprints = [reference_fingerprint(TrialSet((one,), NAMES)) for one in (trial, *others)]
    assert len(set(fingerprints)) == 5
