import json
import multiprocessing

import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.robots.fish import FISH
from swim2real.trials import MarkerTrack, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.reference import add_trial
from swimmers import Swimmer

NAMES = FISH.marker_names


def trial(name, seed=0):
    return Trial(name, Swimmer(duration=0.5).track(seed=seed), 1.0, 7e-4, "pool")


def refusal(call, *arguments) -> str:
    with pytest.raises(TrialError) as caught:
        call(*arguments)
    return str(caught.value)


def files(folder):
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))


def test_trials_that_were_added_are_a_reference_as_if_saved_at_once(tmp_path):
    one, other = trial("one", 1), trial("other", 2)
    add_trial(tmp_path / "deep" / "added", one, NAMES)
    add_trial(tmp_path / "deep" / "added", other, NAMES)
    save_reference(TrialSet((one, other), NAMES), tmp_path / "saved")
    assert files(tmp_path / "deep" / "added") == files(tmp_path / "saved")
    for name in files(tmp_path / "saved"):
        assert (tmp_path / "deep" / "added" / name).read_bytes() == (tmp_path / "saved" / name).read_bytes()


def test_a_trial_of_the_same_name_is_replaced_in_its_place(tmp_path):
    for name in ("a", "b", "c"):
        add_trial(tmp_path, trial(name), NAMES)
    before = {name: (tmp_path / f"{name}.csv").read_bytes() for name in "abc"}
    index = json.loads((tmp_path / "reference.json").read_text())
    index["trials"][2]["note"] = "mine"
    (tmp_path / "reference.json").write_text(json.dumps(index))
    add_trial(tmp_path, Trial("b", Swimmer(duration=0.7).track(seed=9)), NAMES)
    loaded = load_reference(tmp_path)
    assert loaded.names == ("a", "b", "c")
    assert loaded["b"].track.duration == pytest.approx(0.7)
    assert loaded["b"].nominal_frequency is None
    assert [(tmp_path / f"{name}.csv").read_bytes() == before[name] for name in "abc"] == [True, False, True]
    assert json.loads((tmp_path / "reference.json").read_text())["trials"][2]["note"] == "mine"


def test_trials_can_be_added_to_a_saved_reference(tmp_path):
    save_reference(TrialSet((trial("a"),), NAMES), tmp_path)
    add_trial(tmp_path, trial("b"), NAMES)
    assert load_reference(tmp_path).names == ("a", "b")


def test_what_couldnt_be_loaded_again_isnt_written(tmp_path):
    still = MarkerTrack(np.arange(10) / 60, np.repeat(FISH.rest_markers[None], 10, axis=0))
    folder = tmp_path / "reference"
    assert refusal(add_trial, folder, Trial("still", still), NAMES) == (
        f"{folder / 'still.csv'}: no marker moves; is this the right file?"
    )
    assert refusal(add_trial, folder, trial("a/b"), NAMES) == (
        "trial name 'a/b' can't be the name of a file: it has the character /; it must have none of "
        '< > : " / \\ | ? *; give it another'
    )
    assert refusal(add_trial, folder, trial("a"), ("M0",)) == "1 marker names for 9 markers"
    assert not folder.exists()


def test_other_folders_are_left_alone(tmp_path):
    (tmp_path / "markers_f1_00.csv").write_text("1,2\n")
    assert refusal(add_trial, tmp_path, trial("a"), NAMES) == (
        f"'{tmp_path}' holds markers_f1_00.csv but no reference.json, so it is no reference folder; choose another"
    )
    assert files(tmp_path) == ["markers_f1_00.csv"]


def test_other_markers_are_refused_and_the_reference_is_kept(tmp_path):
    add_trial(tmp_path, trial("a"), NAMES)
    before = (tmp_path / "reference.json").read_bytes()
    others = tuple(f"P{i}" for i in range(9))
    assert refusal(add_trial, tmp_path, trial("b"), others) == (
        f"reference '{tmp_path}' has the markers {', '.join(NAMES)}; the new trial has {', '.join(others)}; "
        f"choose another folder"
    )
    assert (tmp_path / "reference.json").read_bytes() == before
    assert files(tmp_path) == ["a.csv", "reference.json"]


def test_another_trial_s_table_isnt_overwritten(tmp_path):
    add_trial(tmp_path, trial("a"), NAMES)
    index = json.loads((tmp_path / "reference.json").read_text())
    index["trials"][0]["name"] = "slow"
    (tmp_path / "reference.json").write_text(json.dumps(index))
    assert refusal(add_trial, tmp_path, trial("a"), NAMES) == (
        f"table 'a.csv' in '{tmp_path}' is trial 'slow'; choose another name"
    )


def test_a_folder_that_cant_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    assert refusal(add_trial, tmp_path / "file" / "below", trial("a"), NAMES).startswith("can't write reference folder")


def _add_some(folder, start):
    for i in range(start, start + 4):
        add_trial(folder, trial(f"t{i}", i), NAMES)


def test_processes_that_add_trials_at_the_same_time_lose_none(tmp_path):
    processes = [
        multiprocessing.get_context("fork").Process(target=_add_some, args=(tmp_path, 4 * i)) for i in range(4)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    loaded = load_reference(tmp_path)
    assert sorted(loaded.names) == sorted(f"t{i}" for i in range(16))
    for one in loaded:
        expected = trial(one.name, int(one.name[1:])).track.positions
        np.testing.assert_allclose(one.track.positions, expected, atol=1e-6)
