import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

import swim2real
from swim2real.calibration import RunFolder
from swim2real.errors import RunError

BEGUN = {"format": 1, "chained": True}
SETTINGS = {"method": "random", "seed": 0, "budget": 6, "briefing": {"a": [1, 2]}, "threads": 2}


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


def test_settings_are_read_back(folder):
    assert folder.exists
    assert folder.settings() == {**BEGUN, **SETTINGS}


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
        ({"briefing": {"a": [1, 3]}}, 'briefing was {"a": [1, 2]} and is now {"a": [1, 3]}'),
        ({"added": True}, "added was null and is now true"),
        ({"method": "x" * 100}, f'method was "random" and is now "{"x" * 58}…'),
    ],
)
def test_other_settings_are_refused_by_name(folder, change, words):
    assert refusal(folder.resume, {**SETTINGS, **change}) == (
        f"run '{folder.path}' can't go on: {words}; use the same settings and reference, or begin a new run"
    )
    assert folder.settings() == {**BEGUN, **SETTINGS}


def test_another_budget_is_taken_over(folder):
    folder.resume({**SETTINGS, "budget": 20})
    assert folder.settings() == {**BEGUN, **SETTINGS, "budget": 20}


def test_a_tuple_and_a_list_are_the_same_setting(folder):
    folder.resume({**SETTINGS, "briefing": {"a": (1, 2)}})


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
    entries = [line(0, loss=0.1 + 0.2), line(1, loss=1 / 3, note={"source": "é\n"})]
    for entry in entries:
        folder.append(entry)
    assert folder.record() == entries
    assert (folder.path / "record.jsonl").read_bytes().count(b"\n") == 2


def test_nan_never_gets_on_record(folder):
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.append({"loss": float("nan")})
    assert folder.record() == []


def test_a_cut_line_is_not_read_and_can_be_dropped(folder):
    folder.append(line(0))
    whole = (folder.path / "record.jsonl").read_bytes()
    (folder.path / "record.jsonl").write_bytes(whole + b'{"index": 1, "lo')
    assert folder.record() == [line(0)]
    folder.drop_cut_line()
    assert (folder.path / "record.jsonl").read_bytes() == whole
    folder.append(line(1))
    assert folder.record() == [line(0), line(1)]


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
    assert "No space left on device" in refusal(folder.resume, {**SETTINGS, "budget": 20})
    assert folder.settings()["budget"] == 6


# records that were edited or cut

RECORDED = [line(i, loss=0.1 / (i + 1), values={"a": i / 7}, seconds=i) for i in range(4)]


@pytest.fixture
def recorded(folder) -> RunFolder:
    """A run with four lines on record, of which the last one is the best."""
    for entry in RECORDED:
        folder.append(entry)
    folder.write_json("best.json", {"evaluation": 3})
    return folder


def rewritten(folder: RunFolder, change) -> None:
    """Changes the lines of a record as an editor or a script would."""
    path = folder.path / "record.jsonl"
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    change(entries)
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))


def without_hashes(folder: RunFolder) -> None:
    """Makes the run one of an earlier version."""
    rewritten(folder, lambda lines: [line.pop("chain") for line in lines])
    settings = folder.settings()
    del settings["chained"]
    folder.write_json("settings.json", settings)


@pytest.mark.parametrize(
    ("change", "says"),
    {
        "loss of the last line": (lambda lines: lines[3].update(loss=1e-9), "line 4 isn't as it was written"),
        "negative loss": (lambda lines: lines[1].update(loss=-1), "line 2 isn't as it was written"),
        "last digit": (lambda lines: lines[0].update(loss=0.1 + 2e-17), "line 1 isn't as it was written"),
        "values": (lambda lines: lines[2]["values"].update(a=1e30), "line 3 isn't as it was written"),
        "a key more": (lambda lines: lines[2].update(more=1), "line 3 isn't as it was written"),
        "hash of the last": (lambda lines: lines[3].update(chain="0" * 64), "line 4 isn't as it was written"),
        "last without hash": (lambda lines: lines[3].pop("chain"), "line 4 isn't as it was written"),
        "all without hash": (lambda lines: [line.pop("chain") for line in lines], "line 1 isn't as it was written"),
        "a line gone": (lambda lines: lines.pop(1), "line 2 isn't as it was written, or a line above it is gone"),
        "first line gone": (lambda lines: lines.pop(0), "line 1 isn't as it was written"),
        "two exchanged": (lambda lines: lines.insert(1, lines.pop(2)), "line 2 isn't as it was written"),
        "last line gone": (lambda lines: lines.pop(), "was cut after line 3: best.json tells of evaluation 4"),
        "no line left": (lambda lines: lines.clear(), "was cut after line 0: best.json tells of evaluation 4"),
    }.values(),
)  # fmt: skip
def test_an_edited_record_is_told_with_its_line(recorded, change, says):
    rewritten(recorded, change)
    before = (recorded.path / "record.jsonl").read_bytes()
    sentence = refusal(recorded.record)
    assert says in sentence
    assert str(recorded.path / "record.jsonl") in sentence
    assert sentence.endswith(
        "begin a new run, or go on with it as it is: calibrate --resume and compare take --accept-edited"
    )
    assert (recorded.path / "record.jsonl").read_bytes() == before


@pytest.mark.slow
def test_a_thousand_damaged_bytes_are_told_or_change_nothing(recorded):
    path = recorded.path / "record.jsonl"
    whole, rng, sentences = path.read_bytes(), random.Random(0), list[str]()
    for _ in range(1000):
        place = rng.randrange(len(whole))
        before, after = whole[:place], whole[place + rng.randrange(2) :]  # a byte in another's place, or one more
        path.write_bytes(before + bytes([rng.randrange(256)]) + after)
        try:
            entries = recorded.record()
        except RunError as error:
            sentences.append(str(error))
        else:
            for entry, written in zip(entries, RECORDED, strict=True):
                assert {**entry, "seconds": 0} == {**written, "seconds": 0}
    assert len(sentences) > 900
    assert all("line " in sentence for sentence in sentences)


def test_how_long_an_evaluation_took_is_no_part_of_its_hash(recorded):
    rewritten(recorded, lambda lines: [line.update(seconds=9.9) for line in lines])
    assert [entry["loss"] for entry in recorded.record()] == [entry["loss"] for entry in RECORDED]


def test_an_outcome_tells_that_lines_are_gone(recorded):
    (recorded.path / "best.json").unlink()
    recorded.write_json("outcome.json", {"evaluations": 4})
    rewritten(recorded, lambda lines: lines.pop())
    assert "was cut after line 3: outcome.json tells of evaluation 4" in refusal(recorded.record)


def test_an_edited_record_is_accepted_and_says_so(recorded):
    rewritten(recorded, lambda lines: lines[1].update(loss=1e-9))
    before = (recorded.path / "record.jsonl").read_bytes()
    recorded.accept_edited()
    entries = recorded.record()
    assert [entry.get("edited") for entry in entries] == [None, True, None, None]
    assert [entry["loss"] for entry in entries] == [0.1, 1e-9, RECORDED[2]["loss"], RECORDED[3]["loss"]]
    assert (recorded.path / "record-edited-1.jsonl").read_bytes() == before
    recorded.append(line(4))
    assert len(RunFolder(recorded.path).record()) == 5
    rewritten(recorded, lambda lines: lines[1].pop("edited"))
    assert "line 2 isn't as it was written" in refusal(recorded.record)


@pytest.mark.parametrize(
    "change", [lambda lines: lines.pop(2), lambda lines: lines.insert(2, []), lambda lines: lines.pop()]
)
def test_of_a_cut_record_what_is_before_the_gap_is_kept(recorded, change):
    rewritten(recorded, change)
    recorded.accept_edited()
    kept = recorded.record()
    assert kept == RECORDED[: len(kept)]
    assert len(kept) in (2, 3)
    assert not recorded.best_path.exists()


def test_a_record_that_was_not_edited_stays_as_it_is(recorded):
    before = (recorded.path / "record.jsonl").read_bytes()
    recorded.accept_edited()
    assert (recorded.path / "record.jsonl").read_bytes() == before
    assert not list(recorded.path.glob("record-edited-*"))


def test_a_record_of_an_earlier_version_is_read_gone_on_with_and_then_guarded(recorded):
    without_hashes(recorded)
    assert recorded.record() == RECORDED
    before = (recorded.path / "record.jsonl").read_bytes()
    RunFolder(recorded.path).append(line(4))
    assert (recorded.path / "record.jsonl").read_bytes().startswith(before)
    assert recorded.record() == [*RECORDED, line(4)]
    rewritten(recorded, lambda lines: lines[1].update(loss=1e-9))
    assert "line 5 isn't as it was written, or a line above it is" in refusal(recorded.record)
