"""`compare` as it is used: words in, a folder and tables out, interrupted and gone on with.

The comparisons are of the pendulum, which is quick.
"""

import csv
import json
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from filelock import FileLock
from program import CTRL_C, interrupted, process

from swim2real.comparison.compare import JobReport, run_job
from vlm_server import replies

METHODS = ("random", "least-squares")


def pendulum(folder: Path, out: Path, *more: object) -> list[object]:
    """The words that compare methods on the pendulum."""
    return ["compare", folder / "tracks", "--robot", folder / "pendulum.toml", "--out", out, *more]


def words(folder: Path, out: Path, *more: object) -> list[object]:
    """Two methods with a seed each, three evaluations."""
    return pendulum(folder, out, "--methods", *METHODS, "--seeds", 1, "--budget", 3, *more)


def count(out: Path) -> int:
    return sum(path.read_bytes().count(b"\n") for path in out.rglob("record.jsonl"))


@pytest.fixture(scope="module")
def finished(pendulum_folder, tmp_path_factory) -> tuple[Path, str, str]:
    """A comparison that was left alone, and what was printed. Don't write into it."""
    out = tmp_path_factory.mktemp("finished") / "comparison"
    started = process(*words(pendulum_folder, out, "--workers", 1))
    printed, err = started.communicate(timeout=240)
    assert started.returncode == 0, err
    return out, printed, err


@pytest.mark.slow
def test_it_prints_a_table_and_a_line_a_run(program, finished, pendulum_folder):
    out, printed, err = finished
    assert re.search(r"^ *random +\d+\.\d", printed, re.MULTILINE)
    assert printed.splitlines()[-1].endswith(str(out / "comparison.html"))
    assert (out / "figures" / "convergence-playback.png").is_file()
    _, *lines = err.splitlines()
    told = sorted(re.sub(r"^\d", "N", line) for line in lines)
    for line, method in zip(told, sorted(METHODS), strict=True):
        assert re.fullmatch(rf"N/2 playback/{method}/seed-1: best \d+\.\d mm, \d+\.\d s, \d+:\d\d left", line)
    with (out / "results.csv").open() as file:
        assert [row["method"] for row in csv.DictReader(file)] == list(METHODS)
    program(*words(pendulum_folder, out, "--json")).done()
    assert program.err == ""
    assert [run["method"] for run in program.json["runs"]] == list(METHODS)


@pytest.mark.slow
@CTRL_C
def test_an_interruption_leaves_nothing_at_work_and_the_same_command_goes_on(
    program, finished, pendulum_folder, tmp_path
):
    out = tmp_path / "comparison"
    command = words(pendulum_folder, out, "--workers", 2)
    lines = interrupted(command, lambda: count(out) >= 2, workers=2)
    assert lines[-1] == f"swim2real: interrupted; '{out}' is usable as it is, the same command goes on"
    assert count(out) < 6
    assert not (out / ".session").exists()
    for lock in out.rglob(".lock"):
        with FileLock(lock, timeout=0):
            pass
    program(*words(pendulum_folder, out, "--workers", 1, "--quiet")).done()
    assert program.err == ""
    assert program.out.startswith("Calibration performance over 1 seed")
    assert (out / "results.csv").read_bytes() == (finished[0] / "results.csv").read_bytes()


def test_an_interruption_leaves_the_results_of_runs_that_have_ended(program, pendulum_folder, tmp_path, monkeypatch):
    module, ended = sys.modules["swim2real.comparison.compare"], []

    def one_alone(job, work):
        if ended:
            return JobReport(job.key, job.method, "stopped")
        ended.append(job.key)
        return run_job(job, work)

    def interrupting(future, job):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "ProcessPool", lambda workers: ThreadPoolExecutor(1))
    monkeypatch.setattr(module, "run_job", one_alone)
    monkeypatch.setattr(module, "_report_of", interrupting)
    out = tmp_path / "comparison"
    program(*words(pendulum_folder, out))
    assert program.code == 1
    assert f"1 of 2 runs are in '{out / 'results.json'}' and its pages" in program.err
    with (out / "results.csv").open() as file:
        assert [f"playback/{row['method']}/seed-1" for row in csv.DictReader(file)] == ended
    assert (out / "comparison.html").is_file()


@pytest.mark.slow
def test_runs_that_fail_are_told_together_and_leave_with_1(program, pendulum_folder, tmp_path):
    program(
        *pendulum(pendulum_folder, tmp_path, "--budget", 2, "--workers", 1), "--methods", "line-search@replay:nowhere",
        "random", "--seeds", "0:2",
    )  # fmt: skip
    assert program.code == 1
    _, *lines, last = program.err.splitlines()
    assert len(lines) == 4
    why = "'nowhere' is no run folder: it has no settings.json"
    assert last == f"swim2real: playback/line-search@replay=nowhere/seed-0 and 1 more failed: {why}"
    assert "Calibration performance over 2 seeds" in program.out


@pytest.mark.slow
def test_a_vlm_takes_part_with_what_it_is_shown_and_what_it_costs(program, vlm, pendulum_folder, tmp_path):
    content = {"diagnosis": "loose", "reasoning": "damping", "parameters": {"elbow_damping": 0.005}}
    vlm.script(then=replies(json.dumps(content), tokens=(1000, 50)))
    name = "no-line-search@openai:some-model"
    command = pendulum(pendulum_folder, tmp_path, "--methods", name, "--seeds", 2)
    asked = ["--budget", 3, "--base-url", vlm.url("openai"), "--tries", 1, "--detail", "low", "--workers", 1]
    program(*command, *asked, "--json").done()
    (run,) = program.json["runs"]
    assert (run["method"], run["folder"]) == (name, "runs/playback/no-line-search@openai=some-model/seed-2")
    assert run["calls"] == len(vlm.requests) == len(run["rounds"]) == 2
    assert (run["spent"]["failed"], run["spent"]["input_tokens"], run["spent"]["output_tokens"]) == (0, 2000, 100)
    other = program(*command, *asked[:-3], "high", "--workers", 1, "--quiet").sentence(1)
    assert other.startswith("a comparison that was begun can't go on with another briefing: it was {'show': 'both', ")
