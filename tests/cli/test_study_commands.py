"""`identify`, `ensemble` and `next` on a run of the fish, `calibrate --seeds`, and `report` of several runs."""

import json
import signal

import pytest
from program import pendulum_words, process

from run_settings import record_of
from swim2real.calibration import RunFolder
from swim2real.identification.ensemble import read_ensemble
from swim2real.robots.fish import FISH


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, pool_folder):
    """Two evaluations, from rest so that they are quick."""
    out = tmp_path_factory.mktemp("studied") / "run"
    words = ("calibrate", pool_folder, "--out", out, "--budget", 2, "--horizon", 0.5, "--protocol", "paper", "--quiet")
    done = process(*words)
    _, err = done.communicate(timeout=120)
    assert done.returncode == 0, err
    return out


@pytest.mark.slow
def test_an_ensemble_of_the_record_alone(program, run_folder, pool_folder, tmp_path):
    out = tmp_path / "ensemble.json"
    words = ("ensemble", run_folder, "--reference", pool_folder, "--out", out, "--within", 9)
    program(*words).done()
    assert "only " in program.err
    assert "sets are within 9 times the lowest loss; raise --within, run swim2real identify" in program.err
    assert "fluid_kutta_lift" in program.text
    assert len(read_ensemble(out, FISH)) == len(json.loads(out.read_text())["members"])
    assert program(*words, "--json").done().json["kind"] == "ensemble"


@pytest.mark.slow
def test_ctrl_c_leaves_a_study_that_goes_on(run_folder, pool_folder):
    words = ("identify", run_folder, "--reference", pool_folder, "--rounds", 1, "--anyway")
    begun = process(*words)
    line = next(line for line in begun.stderr if "lowest" in line)
    assert " s left" in line
    begun.send_signal(signal.SIGINT)
    out, err = begun.communicate(timeout=60)
    assert begun.returncode == 1
    assert "interrupted; what is done is kept in" in err
    assert "So far, lowest" in out
    kept = json.loads((run_folder / "identifiability.json").read_text())
    assert not kept["complete"]
    out, err = process(*words).communicate(timeout=300)
    assert json.loads((run_folder / "identifiability.json").read_text())["complete"]
    assert "Sets that fit" in out
    assert "Combinations, the best determined first" in out


def words(folder, out, *more):
    return [
        *pendulum_words(folder), "--out", out, "--budget", 2, "--horizon", 0.3, "--method", "random",
        "--first", "random", *more,
    ]  # fmt: skip


@pytest.mark.slow
def test_the_best_of_several_seeds_is_copied_and_goes_on(program, pendulum_folder, tmp_path):
    out = tmp_path / "run"
    program(*words(pendulum_folder, out, "--seeds", "3:5")).done()
    runs = [RunFolder(tmp_path / f"run-seed-{seed}") for seed in (3, 4)]
    losses = [min(entry["loss"] for entry in record_of(run)) for run in runs]
    best = runs[losses.index(min(losses))]
    assert RunFolder(out).settings() == best.settings()
    assert f"the best is a copy of '{best.path}'" in program.err
    assert f"seed 3: {1e3 * losses[0]:.2f} mm in '{runs[0].path}'" in program.err
    assert (out / "report.html").is_file()
    assert f"'{out}' holds a run already" in program(*words(pendulum_folder, out, "--seeds", "0:2")).sentence(1)
    program(*words(pendulum_folder, out, "--seeds", "3:6", "--resume", "--quiet")).done()
    assert RunFolder(tmp_path / "run-seed-5").outcome() is not None
    reference = json.loads((out / "settings.json").read_text())["reference"]
    assert (out / reference / "reference.json").is_file()  # found from where the copy lies


@pytest.mark.slow
def test_a_studied_run_gets_commands_a_chart_and_a_table_of_trials(program, pendulum_folder, tmp_path):
    run, about = tmp_path / "run", ("--reference", pendulum_folder / "tracks", "--quiet")
    program(*words(pendulum_folder, run, "--quiet")).done()
    assert program("next", tmp_path, *about).sentence(2).startswith(f"'{tmp_path}' is no run folder")
    assert f"run swim2real identify {run} first" in program("next", run, *about).sentence(1)
    program("identify", run, "--rounds", 1, *about).done()
    program("next", run, *about).done()
    assert "What would be left" in program.out
    assert f"swim2real deploy {run / 'next' / 'next.csv'} --motors" in program.out
    assert sorted(path.name for path in (run / "next").iterdir()) == ["next.csv", "next.json", "next.png"]
    assert program("next", run, "--json", "--out", tmp_path / "o", *about).done().json["candidates"][0]["volume"] < 1
    begun = process("next", run, *about[:2])
    next(line for line in begun.stderr if " s left" in line)
    begun.send_signal(signal.SIGINT)
    out, err = begun.communicate(timeout=60)
    assert begun.returncode == 1
    assert "trials; nothing is written" in err
    assert "What would be left" in out


@pytest.mark.slow
def test_the_pages_of_two_runs_are_written_and_said(program, pendulum_folder, tmp_path) -> None:
    runs = [tmp_path / name for name in ("one", "two")]
    for seed, run in enumerate(runs):
        program(*words(pendulum_folder, run, "--seed", seed)).done()
    for run in runs:
        (run / "report.html").unlink()
    program("report", *runs).done()
    assert program.out.split() == [str(run / "report.html") for run in runs]
    assert all((run / "report.html").is_file() for run in runs)
