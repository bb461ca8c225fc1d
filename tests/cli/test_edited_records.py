"""Records that somebody edited or cut: refused by `calibrate`, `compare` and `report`, and accepted when asked."""

import json
import shutil
from pathlib import Path

import pytest

from swim2real.calibration import RunFolder
from swim2real.cli import main


def words(command: str, folder: Path, out: Path, *more: object) -> list[str]:
    start = [command, folder / "tracks", "--robot", folder / "pendulum.toml", "--out", out, "--horizon", 0.5, "--quiet"]
    return [str(word) for word in (*start, *more)]


@pytest.fixture(scope="module")
def begun(pendulum_folder, tmp_path_factory) -> Path:
    """A run of four evaluations by line search. Copy it before changing it."""
    run = tmp_path_factory.mktemp("begun") / "run"
    with pytest.raises(SystemExit) as leaving:
        main(words("calibrate", pendulum_folder, run, "--budget", 4))
    assert leaving.value.code == 0
    return run


@pytest.fixture
def run(begun, tmp_path) -> Path:
    return Path(shutil.copytree(begun, tmp_path / "run"))


def rewrite(run: Path, change) -> list[dict]:
    path = run / "record.jsonl"
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    change(entries)
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    return entries


def timeless(entries: list[dict]) -> list[dict]:
    return [{key: value for key, value in entry.items() if key != "seconds"} for entry in entries]


@pytest.mark.slow
def test_an_edited_last_loss_is_told_and_goes_on_when_it_is_accepted(program, pendulum_folder, run):
    rewrite(run, lambda entries: entries[-1].update(loss=1e-9))
    again = words("calibrate", pendulum_folder, run, "--budget", 4, "--resume")
    said = program(*again).sentence(1)
    assert said.startswith(f"{run / 'record.jsonl'}, line 4 isn't as it was written")
    assert said.endswith("calibrate --resume and compare take --accept-edited")
    assert program("report", run).sentence(1) == said
    program(*again, "--accept-edited").done()
    accepted = RunFolder(run).record()[-1]
    assert (accepted["loss"], accepted["edited"]) == (1e-9, True)
    assert json.loads((run / "best.json").read_text())["evaluation"] == 3
    program(*again).done()


@pytest.mark.slow
def test_of_a_search_that_an_edit_leads_elsewhere_the_rest_is_evaluated_anew(program, pendulum_folder, run):
    """The first step was accepted or not by its loss: what follows belongs to another search."""

    def other(entries):
        entries[1]["loss"] = 1e-9 if entries[1]["loss"] > entries[0]["loss"] else 0.9
        entries[2]["values"]["elbow_damping"] = 1e30

    before = rewrite(run, other)
    again = words("calibrate", pendulum_folder, run, "--budget", 4, "--resume")
    assert "line 2 isn't as it was written" in program(*again).sentence(1)
    program(*again, "--accept-edited").done()
    entries = RunFolder(run).record()
    assert len(entries) == 4
    assert entries[1]["loss"] == before[1]["loss"]
    assert entries[2]["values"]["elbow_damping"] < 1
    assert len(list(run.glob("record-edited-*.jsonl"))) == 2
    program(*again).done()


@pytest.mark.slow
def test_a_record_whose_end_is_gone_is_told_and_done_again(program, pendulum_folder, run, begun):
    rewrite(run, lambda entries: entries.pop())
    again = words("calibrate", pendulum_folder, run, "--budget", 4, "--resume")
    assert "was cut after line 3: outcome.json tells of evaluation 4" in program(*again).sentence(1)
    program(*again, "--accept-edited").done()
    assert timeless(RunFolder(run).record()) == timeless(RunFolder(begun).record())


def test_accepting_is_for_runs_that_go_on(program, pendulum_folder, tmp_path):
    said = program(*words("calibrate", pendulum_folder, tmp_path / "new", "--accept-edited")).sentence(2)
    assert said == "--accept-edited is for a run that goes on; add --resume"


@pytest.mark.slow
def test_a_run_of_a_comparison_is_told_and_accepted(program, pendulum_folder, tmp_path):
    out = tmp_path / "comparison"
    command = words("compare", pendulum_folder, out, "--methods", "random", "--seeds", 1, "--budget", 2, "--workers", 1)
    program(*command).done()
    (run,) = (path.parent for path in out.rglob("record.jsonl"))
    rewrite(run, lambda entries: entries[0].update(loss=1e-9))
    program(*command)
    assert program.code == 1
    assert "failed: " in program.err
    assert "record.jsonl, line 1 isn't as it was written" in program.err
    program(*command, "--accept-edited").done()
    assert RunFolder(run).record()[0]["edited"]
