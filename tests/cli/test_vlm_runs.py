"""Whole runs with a VLM, from the command line to the report: a server on this machine answers in its place.

They are runs of the pendulum, which is quick.
"""

import json
from pathlib import Path

import pytest
from program import CTRL_C, interrupted, pendulum_words, process

from recorded import PENDULUM_SPACE
from refused import says
from run_settings import record_of
from vlm_server import PROVIDERS, hangs, refuses, replies, sends

MOVED = PENDULUM_SPACE.parameters[:2]  # those of the robot file
KEY = "sk-this-must-never-be-seen-0123456789"


def thoughtful(asked) -> object:
    """Answers each question with other values: the n-th reply moves the n-th parameter, then the first again."""
    thoughtful.count += 1
    moved = MOVED[thoughtful.count % 2]
    value = moved.lower + (moved.upper - moved.lower) * thoughtful.count / 10
    content = {"diagnosis": f"seen {thoughtful.count}", "reasoning": moved.name, "parameters": {moved.name: value}}
    return replies(json.dumps(content), tokens=(1000, 50))(asked)


@pytest.fixture(autouse=True)
def from_the_start():
    thoughtful.count = 0


@pytest.fixture
def words(vlm, pendulum_folder, tmp_path):
    """The words of a calibration with the server as its VLM."""

    def make(out: str = "run", *more: object, provider: str = "openai") -> list[object]:
        return [
            *pendulum_words(pendulum_folder), "--out", tmp_path / out, "--advisor", f"{provider}:some-model",
            "--base-url", vlm.url(provider), "--budget", 5, "--tries", 1, "--detail", "low", *more,
        ]  # fmt: skip

    return make


def record(path: Path) -> list[dict]:
    return [{k: v for k, v in entry.items() if k != "seconds"} for entry in record_of(path)]


def kept(path: Path) -> list[dict]:
    return [json.loads(one.read_text()) for one in sorted((path / "advisor").glob("call_*.json"))]


@pytest.mark.slow
def test_a_replay_is_the_same_to_the_last_bit_without_a_network(program, words, vlm, pendulum_folder, tmp_path):
    vlm.script(then=thoughtful)
    program(*words()).done()
    asked = len(vlm.requests)
    replay = ["--advisor", f"replay:{tmp_path / 'run'}"]
    again = [*pendulum_words(pendulum_folder), *replay, "--out", tmp_path / "again"]
    program(*again).done()
    assert record(tmp_path / "again") == record(tmp_path / "run")
    assert len(vlm.requests) == asked
    said = program(*again[:-1], tmp_path / "other", "--seed", 1).sentence(2)
    assert said == f"a replay needs what '{tmp_path / 'run'}' was run with: seed was 0 and is now 1"
    said = program(*again[:-1], tmp_path / "longer", "--budget", 9, "--quiet").sentence(1)
    assert "a budget up to that run's replays without it" in said


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_and_ends_like_one_that_was_not(program, words, vlm, tmp_path):
    vlm.script(then=thoughtful)
    program(*words("whole")).done()
    thoughtful.count = 0
    stopped = program(*words("parts", "--max-calls", 1, "--quiet"))
    assert stopped.code == 1
    assert stopped.err.endswith(": 1 calls were made and --max-calls is 1; --resume with a higher one goes on\n")
    before = record(tmp_path / "parts")
    assert 2 <= len(before) < 5
    program(*words("parts", "--max-calls", 9, "--resume")).done()
    assert record(tmp_path / "parts")[: len(before)] == before
    assert [e["point"] for e in record(tmp_path / "parts")] == [e["point"] for e in record(tmp_path / "whole")]
    assert [e["loss"] for e in record(tmp_path / "parts")] == [e["loss"] for e in record(tmp_path / "whole")]


@pytest.mark.slow
def test_a_reply_that_came_before_a_crash_is_not_paid_for_again(program, words, vlm, tmp_path):
    vlm.script(then=thoughtful)
    program(*words()).done()
    whole = record(tmp_path / "run")
    path = tmp_path / "run" / "record.jsonl"
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])  # killed before the reply's first evaluation
    for name in ("best.json", "outcome.json"):
        (tmp_path / "run" / name).unlink()
    asked = len(vlm.requests)
    program(*words("run", "--resume")).done()
    assert len(vlm.requests) == asked
    assert record(tmp_path / "run") == whole


def test_the_key_is_never_seen(program, words, vlm, tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("MY_KEY", KEY)
    monkeypatch.setenv("OPENAI_API_KEY", KEY + "-own")
    echo = refuses(401, f"Incorrect API key provided: {KEY}", "invalid_api_key")
    vlm.script(replies("no"), echo)
    with caplog.at_level("DEBUG"):
        assert program(*words("run", "--key-variable", "MY_KEY", "--budget", 2)).code == 1
    assert vlm.requests
    assert all(asked.headers["authorization"] == f"Bearer {KEY}" for asked in vlm.requests)
    everything = program.out + program.err + caplog.text
    everything += "".join(path.read_text("latin-1") for path in (tmp_path / "run").rglob("*") if path.is_file())
    assert "Incorrect API key" in everything
    assert KEY not in everything


@pytest.mark.slow
@pytest.mark.parametrize("provider", PROVIDERS)
def test_a_server_that_echoes_all_it_was_sent_leaves_no_key_anywhere(words, vlm, tmp_path, monkeypatch, provider):
    monkeypatch.setenv("MY_KEY", KEY)
    for name in ("OPENAI_LOG", "ANTHROPIC_LOG"):
        monkeypatch.setenv(name, "debug")
    listed = []

    def echo(asked):
        listed.append(b"".join(read_bytes(path) for path in Path("/proc").glob("[0-9]*/cmdline")))
        headers = json.dumps(dict(asked.headers))
        diagnosis = {"diagnosis": headers, "reasoning": KEY, "parameters": {MOVED[0].name: MOVED[0].lower}}
        answers = (
            refuses(503, headers, KEY, {"x-echo": KEY, "retry-after": "0"}), sends({"headers": headers}),
            sends(f"<html>{headers}</html>", 502), replies(headers), replies(json.dumps(diagnosis), model=KEY),
            refuses(401, headers, KEY, {"www-authenticate": KEY}),
        )  # fmt: skip
        return answers[min(len(listed), len(answers)) - 1](asked)

    vlm.script(then=echo)
    run = process("--debug", *words("run", "--key-variable", "MY_KEY", "--tries", 4, provider=provider))
    out, err = run.communicate(timeout=400)
    assert run.returncode == 1
    assert "Traceback" in err
    assert "access was refused" in err
    assert len(listed) >= 6
    assert all(KEY in "".join(asked.headers.values()) for asked in vlm.requests)
    assert any(b"MY_KEY" in processes for processes in listed)  # the list has the program's words
    files = [path for path in (tmp_path / "run").rglob("*") if path.is_file()]
    assert any("[MY_KEY]" in path.read_text("latin-1") for path in files)
    everything = [out, err, *(path.read_text("latin-1") for path in files), *map(repr, listed)]
    pieces = [KEY[i : i + 12] for i in range(len(KEY) - 11)]
    assert [piece for piece in pieces if any(piece in text for text in everything)] == []


def read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:  # it has ended
        return b""


@pytest.mark.slow
@CTRL_C
def test_ctrl_c_while_a_vlm_thinks_leaves_a_run_that_goes_on(words, vlm, tmp_path, program):
    vlm.script(hangs, then=thoughtful)
    lines = interrupted(words("run", "--timeout", 60), lambda: vlm.requests)
    assert "--resume goes on with it" in lines[-1]
    assert [call["problem"] for call in kept(tmp_path / "run")] == ["interrupted"]
    program(*words("run", "--timeout", 60, "--resume")).done()
    assert len(record(tmp_path / "run")) == 5


@pytest.mark.slow
def test_files_step_by_step_on_different_days(program, pendulum_folder, tmp_path):
    run = tmp_path / "run"
    start = pendulum_words(pendulum_folder)
    words = [*start, "--out", run, "--advisor", "files", "--once", "--budget", 6, "--detail", "low"]
    program(*words)
    assert program.code == 0
    first = run / "advisor" / "round_001"
    assert says(program.err, "round 1 waits", str(first / "briefing.md"), str(first / "reply.json"), "--resume")
    assert (first / "1.png").read_bytes().startswith(b"\x89PNG")
    (first / "reply.json").write_text("I think it needs a heavier arm")
    program(*words, "--resume")
    assert program.code == 0
    assert "the reply holds no JSON object" in (first / "reply.problem.txt").read_text()
    number = 0
    while not (run / "outcome.json").is_file():
        number += 1
        moved = MOVED[number % 2]
        value = moved.lower + (moved.upper - moved.lower) * number / 10
        reply = run / "advisor" / f"round_{number:03d}" / "reply.json"
        reply.write_text(json.dumps({"diagnosis": "seen", "parameters": {moved.name: value}}))
        program(*words, "--resume")
        assert program.code == 0
    assert len(record(run)) == 6
    program(*start, "--out", tmp_path / "again", "--budget", 6, "--advisor", f"replay:{run}").done()
    assert record(tmp_path / "again") == record(run)
