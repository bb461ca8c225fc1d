import json
import os
import random
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

import swim2real
from run_settings import run_settings
from swim2real.calibration import RunFolder
from swim2real.errors import RunError
from swim2real.settings import BriefingSettings

SETTINGS = run_settings(method="random", budget=6, threads=2, hold_out=("f1_00",))


def line(index: int, **more) -> dict:
    """An evaluation as it is recorded."""
    content = {"index": index, "loss": 0.1, "failed": False, "point": [0.5], "values": {"a": 1.0}, "note": {}}
    return {**content, "evidence": {"trials": {}}, **more}


def refusal(call, *arguments) -> str:
    with pytest.raises(RunError) as caught:
        call(*arguments)
    assert caught.value.exit_code == 1
    return str(caught.value)


def lock(folder: RunFolder) -> None:
    with folder.locked():
        pass


@pytest.fixture
def folder(tmp_path) -> RunFolder:
    found = RunFolder(tmp_path / "deep" / "run")
    with found.locked():
        found.begin(SETTINGS)
    return found


def test_settings_are_read_back_and_never_written_twice(folder):
    assert folder.exists
    assert folder.settings() == SETTINGS
    assert f"'{folder.path}' holds a run already" in refusal(folder.begin, SETTINGS)


def test_threads_and_what_nobody_is_shown_may_differ_and_a_higher_budget_is_taken_over(folder):
    before = folder.settings_path.read_bytes()
    folder.resume(replace(SETTINGS, threads=8, briefing=BriefingSettings("numbers"), created="later"))
    assert folder.settings_path.read_bytes() == before
    folder.resume(replace(SETTINGS, budget=20))
    folder.resume(replace(SETTINGS, budget=3))
    assert folder.settings() == replace(SETTINGS, budget=20)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"method": "cma-es"}, 'method was "random" and is now "cma-es"'),
        ({"seed": 1}, "seed was 0 and is now 1"),
        ({"robot": "x" * 100}, f'robot was "fish" and is now "{"x" * 58}…'),
    ],
)
def test_other_settings_are_refused_by_name(folder, change, words):
    assert f"run '{folder.path}' can't go on: {words}; use the same" in refusal(
        folder.resume, replace(SETTINGS, **change)
    )
    assert folder.settings() == SETTINGS


def test_a_briefing_decides_where_a_vlm_is_asked(tmp_path):
    asked = run_settings(advisor="openai:any")
    assert asked.difference(replace(asked, briefing=BriefingSettings("numbers")))[0] == "briefing"


def test_a_folder_without_a_run_is_named(tmp_path):
    folder = RunFolder(tmp_path)
    assert not folder.exists
    assert folder.record() == []
    assert folder.outcome() is None
    assert refusal(folder.settings) == f"'{tmp_path}' is no run folder: it has no settings.json"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "can't be read: "),
        ("[]", "must hold a JSON object"),
        ('{"format": 2}', "is of another format than 1"),
        ('{"format": 1}', "'robot' is missing"),
    ],
)
def test_damaged_settings_are_named(folder, text, words):
    folder.settings_path.write_text(text)
    assert words in refusal(folder.settings)


def test_settings_that_cant_be_are_named(folder):
    content = json.loads(folder.settings_path.read_text())
    folder.settings_path.write_text(json.dumps({**content, "max_steps": 0}))
    assert "max_steps is 0; it must be at least 1" in refusal(folder.settings)


def test_what_is_appended_is_read_back(folder):
    entries = [line(0, loss=0.1 + 0.2), line(1, loss=1 / 3, note={"source": "é\n"})]
    for entry in entries:
        folder.append(entry)
    assert folder.record() == entries
    assert (folder.path / "record.jsonl").read_bytes().count(b"\n") == 2


def test_nan_never_gets_on_record(folder):
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.append({"loss": float("nan")})
    assert folder.record() == []


@pytest.mark.parametrize("kept", [0, 1])
def test_a_cut_line_is_not_read_and_can_be_dropped(folder, kept):
    for index in range(kept):
        folder.append(line(index))
    path = folder.path / "record.jsonl"
    whole = path.read_bytes() if kept else b""
    path.write_bytes(whole + b'{"index": 1, "lo')
    assert len(folder.record()) == kept
    folder.drop_cut_line()
    assert path.read_bytes() == whole
    folder.append(line(kept))
    assert folder.record() == [line(index) for index in range(kept + 1)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"index": 1, "lo\n', "line 2 is damaged ("),
        ("[]\n", "line 2"),
        (json.dumps(line(3)) + "\n", "line 2 has index 3; expected 1"),
        (json.dumps(line(1, loss=True)) + "\n", "line 2: 'loss' is true"),
    ],
)
def test_a_line_that_isnt_the_next_evaluation_is_named(folder, text, words):
    folder.append(line(0))
    with (folder.path / "record.jsonl").open("a") as file:
        file.write(text + json.dumps(line(2)) + "\n")
    sentence = refusal(folder.record)
    assert words in sentence
    assert sentence.endswith("restore it or begin a new run")


@pytest.mark.slow
def test_damaged_bytes_are_named_or_read_as_they_stand(folder):
    for index in range(4):
        folder.append(line(index))
    path = folder.path / "record.jsonl"
    whole, rng = path.read_bytes(), random.Random(0)
    for _ in range(1000):
        place = rng.randrange(len(whole))
        before, after = whole[:place], whole[place + rng.randrange(2) :]  # a byte in another's place, or one more
        path.write_bytes(before + bytes([rng.randrange(256)]) + after)
        with suppress(RunError):
            assert [entry["index"] for entry in folder.record()] in ([0, 1, 2, 3], [0, 1, 2])


def test_a_second_lock_is_refused(folder):
    message = f"another process is working on run folder '{folder.path}'; wait for it or use another"
    with folder.locked():
        assert refusal(lock, RunFolder(folder.path)) == message
    lock(RunFolder(folder.path))


@pytest.mark.slow
def test_another_process_keeps_a_run_to_itself_until_it_dies(folder):
    code = (
        "import sys, time\nfrom swim2real.calibration import RunFolder\n"
        "with RunFolder(sys.argv[1]).locked():\n    print('locked', flush=True)\n    time.sleep(60)\n"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(folder.path)],
        env={**os.environ, "PYTHONPATH": str(Path(swim2real.__file__).parents[1])},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "locked\n"
        assert "another process is working on run folder" in refusal(lock, folder)
    finally:
        holder.kill()
        holder.communicate()
    lock(folder)


def test_a_folder_that_cant_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    below = RunFolder(tmp_path / "file" / "run")
    assert refusal(lock, below).startswith(f"can't write run folder '{below.path}': ")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only to root")
def test_a_read_only_folder_is_named(folder):
    folder.append(line(0))
    folder.path.chmod(0o500)
    (folder.path / ".lock").chmod(0o400)
    try:
        assert refusal(lock, folder).startswith("can't write run folder")
        assert folder.record() == [line(0)]
    finally:
        folder.path.chmod(0o700)


def test_json_is_written_whole_or_not_at_all(folder, monkeypatch):
    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", no_space)
    assert "No space left on device" in refusal(folder.resume, replace(SETTINGS, budget=20))
    assert folder.settings().budget == 6
