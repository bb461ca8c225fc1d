import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import swim2real
from swim2real.calibration import RunFolder
from swim2real.errors import RunError

SETTINGS = {"method": "random", "seed": 0, "budget": 6, "scale": {"a": [1, 2]}, "threads": 2}


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


def test_settings_are_read_back(folder):
    assert folder.exists
    assert folder.settings() == {"format": 1, **SETTINGS}


def test_a_run_that_exists_is_not_begun_again(folder):
    message = f"'{folder.path}' holds a run already; go on with --resume or choose another folder"
    assert refusal(folder.begin, SETTINGS) == message


def test_the_same_settings_go_on(folder):
    before = folder.settings_path.read_bytes()
    folder.resume(SETTINGS)
    folder.resume({**SETTINGS, "threads": 8})
    assert folder.settings_path.read_bytes() == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"method": "line-search"}, 'method was "random" and is now "line-search"'),
        ({"seed": 1}, "seed was 0 and is now 1"),
        ({"scale": {"a": [1, 3]}}, 'scale was {"a": [1, 2]} and is now {"a": [1, 3]}'),
        ({"added": True}, "added was null and is now true"),
        ({"method": "x" * 100}, f'method was "random" and is now "{"x" * 58}…'),
    ],
)
def test_other_settings_are_refused_by_name(folder, change, words):
    assert refusal(folder.resume, {**SETTINGS, **change}) == (
        f"run '{folder.path}' can't go on: {words}; use the same settings and reference, or begin a new run"
    )
    assert folder.settings() == {"format": 1, **SETTINGS}


def test_another_budget_is_taken_over(folder):
    folder.resume({**SETTINGS, "budget": 20})
    assert folder.settings() == {"format": 1, **SETTINGS, "budget": 20}


def test_a_tuple_and_a_list_are_the_same_setting(folder):
    folder.resume({**SETTINGS, "scale": {"a": (1, 2)}})


def test_a_folder_without_a_run_is_told(tmp_path):
    folder = RunFolder(tmp_path)
    assert not folder.exists
    assert folder.record() == []
    assert folder.outcome() is None
    assert refusal(folder.settings) == f"'{tmp_path}' is no run folder: it has no settings.json"


@pytest.mark.parametrize(("text", "words"), [("{", "can't be read: "), ("[]", "must hold a JSON object")])
def test_damaged_settings_are_told(folder, text, words):
    folder.settings_path.write_text(text)
    assert words in refusal(folder.settings)


def test_settings_of_another_format_are_refused(folder):
    folder.settings_path.write_text(json.dumps({"format": 2}))
    assert refusal(folder.settings) == f"run '{folder.path}' has format 2; this version of swim2real reads 1"


def test_what_is_appended_is_read_back(folder):
    entries = [{"index": 0, "loss": 0.1 + 0.2}, {"index": 1, "loss": 1 / 3, "note": "é\n"}]
    for entry in entries:
        folder.append(entry)
    assert folder.record() == entries
    assert (folder.path / "record.jsonl").read_bytes().count(b"\n") == 2


def test_nan_never_gets_on_record(folder):
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.append({"loss": float("nan")})
    assert folder.record() == []


def test_a_cut_line_is_not_read_and_can_be_dropped(folder):
    folder.append({"index": 0})
    whole = (folder.path / "record.jsonl").read_bytes()
    (folder.path / "record.jsonl").write_bytes(whole + b'{"index": 1, "lo')
    assert folder.record() == [{"index": 0}]
    folder.drop_cut_line()
    assert (folder.path / "record.jsonl").read_bytes() == whole
    folder.append({"index": 1})
    assert folder.record() == [{"index": 0}, {"index": 1}]


def test_a_cut_first_line_leaves_an_empty_record(folder):
    (folder.path / "record.jsonl").write_bytes(b'{"ind')
    folder.drop_cut_line()
    assert (folder.path / "record.jsonl").read_bytes() == b""
    assert folder.record() == []


def test_a_second_lock_is_refused(folder):
    message = f"another process is working on run folder '{folder.path}'; wait for it or use another"
    with folder.locked():
        assert refusal(lock, RunFolder(folder.path)) == message
    lock(RunFolder(folder.path))


@pytest.mark.slow
def test_another_process_keeps_a_run_to_itself_until_it_dies(folder):
    holder = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys, time\n"
            "from swim2real.calibration import RunFolder\n"
            "with RunFolder(sys.argv[1]).locked():\n"
            "    print('locked', flush=True)\n"
            "    time.sleep(60)\n",
            str(folder.path),
        ],
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


def test_a_folder_that_cant_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    below = RunFolder(tmp_path / "file" / "run")
    assert refusal(lock, below).startswith(f"can't write run folder '{below.path}': ")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only to root")
def test_a_read_only_folder_is_told(folder):
    folder.append({"index": 0})
    folder.path.chmod(0o500)
    (folder.path / ".lock").chmod(0o400)
    try:
        assert refusal(lock, folder).startswith("can't write run folder")
        assert folder.record() == [{"index": 0}]
    finally:
        folder.path.chmod(0o700)


def test_json_is_written_whole_or_not_at_all(folder, monkeypatch):
    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", no_space)
    assert "No space left on device" in refusal(folder.resume, {**SETTINGS, "budget": 20})
    assert folder.settings()["budget"] == 6
