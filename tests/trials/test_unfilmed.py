"""Reference folders of robots that weren't filmed: tables of sensors and controls alone."""

import json

import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.signals import write_signals

TIMES = np.arange(50) / 100


def tables(folder, names=("a", "b"), controls=True):
    for name in names:
        write_signals(Signals(TIMES, ["angle"], np.sin(TIMES)[:, None]), folder / f"{name}.sensors.csv")
        if controls:
            write_signals(Signals([0.0], ["motor"], [[0.5]]), folder / f"{name}.controls.csv")


def test_tables_alone_are_trials(tmp_path):
    tables(tmp_path)
    found = load_reference(tmp_path)
    assert (found.names, found.marker_names) == (("a", "b"), ())
    assert found["a"].track.positions.shape == (50, 0, 2)
    assert np.array_equal(found["a"].track.times, TIMES)
    assert found["a"].controls.names == ("motor",)
    assert found["a"].cut(0.2).track.frame_count == 21


def test_a_robot_that_nothing_commands(tmp_path):
    tables(tmp_path, controls=False)
    assert load_reference(tmp_path)["b"].controls is None


def test_what_is_written_is_read_back(tmp_path):
    tables(tmp_path)
    found = load_reference(tmp_path)
    save_reference(found, tmp_path / "again")
    assert sorted(path.name for path in (tmp_path / "again").iterdir()) == [
        "a.controls.csv", "a.sensors.csv", "b.controls.csv", "b.sensors.csv", "reference.json"
    ]  # fmt: skip
    again = load_reference(tmp_path / "again")
    assert np.array_equal(again["a"].sensors.values, found["a"].sensors.values)
    assert json.loads((tmp_path / "again" / "reference.json").read_text())["markers"] == []


def test_what_cant_be_a_trial_is_named(tmp_path):
    still = Trial("a", MarkerTrack(TIMES, np.zeros((50, 0, 2))), sensors=Signals(TIMES, ["angle"], np.ones((50, 1))))
    save_reference(TrialSet((still,)), tmp_path / "still")
    with pytest.raises(TrialError, match=r"a.sensors.csv: no reading changes; is this the right file\?"):
        load_reference(tmp_path / "still")
    index = {"format": 1, "markers": [], "trials": [{"name": "a"}]}
    (tmp_path / "reference.json").write_text(json.dumps(index))
    with pytest.raises(TrialError, match=r"sensors 'a.sensors.csv' of trial 'a' is not in"):
        load_reference(tmp_path)
