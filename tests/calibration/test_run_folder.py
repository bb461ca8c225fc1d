import json
import os
from dataclasses import asdict, replace
from functools import partial

import pytest

import refused
from run_settings import record_of, run_settings
from swim2real.calibration import RunFolder
from swim2real.settings import BriefingSettings
from swimbase.errors import RunError

SETTINGS = run_settings(method="random", budget=6, threads=2, hold_out=("f1_00",))


refusal = partial(refused.refusal, RunError)


def line(index: int, **more) -> dict:
    """An evaluation as it is recorded."""
    content = {"index": index, "loss": 0.1, "failed": False, "point": [0.5], "values": {"a": 1.0}, "note": {}}
    return {**content, "evidence": {"trials": {}}, **more}


def lock(folder: RunFolder) -> None:
    with folder.locked():
        pass


@pytest.fixture
def folder(tmp_path) -> RunFolder:
    found = RunFolder(tmp_path / "deep" / "run")
    with found.locked():
        found.begin(SETTINGS)
    return found


def test_settings_are_read_back_and_what_may_differ_does(folder):
    assert folder.exists
    assert folder.settings() == SETTINGS
    assert f"'{folder.path}' holds a run already" in refusal(folder.begin, SETTINGS)
    before = folder.settings_path.read_bytes()
    folder.resume(replace(SETTINGS, threads=8, briefing=BriefingSettings("numbers"), created="later"))
    assert folder.settings_path.read_bytes() == before
    folder.resume(replace(SETTINGS, budget=20))
    folder.resume(replace(SETTINGS, budget=3))
    assert folder.settings() == replace(SETTINGS, budget=20)


@pytest.mark.parametrize(("change", "words"), [
    ({"method": "cma-es"}, 'method was "random" and is now "cma-es"'),
    ({"seed": 1}, "seed was 0 and is now 1"),
    ({"hold_out": ()}, 'hold_out was ["f1_00"] and is now []'),
    ({"horizon": None}, "horizon was 4.0 and is now null"),
    ({"robot": "x" * 100}, f'robot was "fish" and is now "{"x" * 58}…'),
])  # fmt: skip
def test_other_settings_are_refused_by_name(folder, change, words):
    assert f"'{folder.path}' can't go on: {words}; use the same" in refusal(folder.resume, replace(SETTINGS, **change))
    assert folder.settings() == SETTINGS
    changed = refusal(folder.resume, replace(SETTINGS, robot_fingerprint="another"))
    assert f"robot file or model has changed since; begin a new run from its values: --first {folder.path}" in changed


def test_a_folder_without_a_run_is_named(tmp_path):
    folder = RunFolder(tmp_path)
    assert not folder.exists
    assert record_of(folder) == []
    assert folder.outcome() is None
    assert refusal(folder.settings) == f"'{tmp_path}' is no run folder: it has no settings.json"


@pytest.mark.parametrize(("text", "words"), [
    ("{", "can't be read: "), ("[]", "must hold a JSON object"),
    ('{"format": 2}', "is of another format than 1"),
    ('{"format": 1}', "'robot' is missing"),
    (json.dumps({"format": 1, **asdict(SETTINGS), "max_steps": 0}), "max_steps is 0; it must be at least 1"),
])  # fmt: skip
def test_damaged_settings_are_named(folder, text, words):
    folder.settings_path.write_text(text)
    assert words in refusal(folder.settings)


def test_what_is_appended_is_read_back_and_nan_never_gets_on_record(folder):
    entries = [line(0, loss=0.1 + 0.2), line(1, loss=1 / 3, note={"source": "é\n"})]
    for entry in entries:
        folder.append(entry)
    assert record_of(folder) == entries
    assert (folder.path / "record.jsonl").read_bytes().count(b"\n") == 2
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.append({"loss": float("nan")})
    assert record_of(folder) == entries


@pytest.mark.parametrize("kept", [0, 1])
def test_a_cut_line_is_not_read_and_can_be_dropped(folder, kept):
    for index in range(kept):
        folder.append(line(index))
    path = folder.path / "record.jsonl"
    whole = path.read_bytes() if kept else b""
    path.write_bytes(whole + b'{"index": 1, "lo')
    assert len(record_of(folder)) == kept
    folder.drop_cut_line()
    assert path.read_bytes() == whole
    folder.append(line(kept))
    assert record_of(folder) == [line(index) for index in range(kept + 1)]


@pytest.mark.parametrize(("text", "words"), [
    ('{"index": 1, "lo\n', "line 2 is damaged ("),
    ("[]\n", "line 2"),
    (json.dumps(line(3)) + "\n", "line 2 has index 3; expected 1"),
    (json.dumps(line(1, loss=True)) + "\n", "line 2: 'loss' is true"),
])  # fmt: skip
def test_a_line_that_isnt_the_next_evaluation_is_named(folder, text, words):
    folder.append(line(0))
    with (folder.path / "record.jsonl").open("a") as file:
        file.write(text + json.dumps(line(2)) + "\n")
    sentence = refusal(folder.record)
    assert words in sentence
    assert sentence.endswith("restore it or begin a new run")


def test_a_second_lock_is_refused(folder):
    message = f"another process is working on run folder '{folder.path}'; wait for it or use another"
    with folder.locked():
        assert refusal(lock, RunFolder(folder.path)) == message
    lock(RunFolder(folder.path))


def test_json_is_written_whole_or_not_at_all(folder, monkeypatch):
    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", no_space)
    assert "No space left on device" in refusal(folder.resume, replace(SETTINGS, budget=20))
    assert folder.settings().budget == 6
