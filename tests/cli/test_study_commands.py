"""`identify` and `ensemble`, on a run of the fish."""

import json
import signal
import time

import pytest
from program import process

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
    words = ("ensemble", run_folder, "--reference", pool_folder, "--out", out, "--within", 9, "--evaluations", 0)
    program(*words).done()
    assert "only " in program.err
    assert "sets are within 9 times the lowest loss; raise --evaluations or --within" in program.err
    assert "fluid_kutta_lift" in program.text
    assert len(read_ensemble(out, FISH)) == len(json.loads(out.read_text())["members"])
    assert program(*words, "--json").done().json["kind"] == "ensemble"


@pytest.mark.slow
def test_ctrl_c_leaves_a_study_that_goes_on(run_folder, pool_folder):
    words = ("identify", run_folder, "--reference", pool_folder, "--steps", 0, "--polish", 0)
    begun = process(*words)
    line = next(line for line in begun.stderr if "slopes" in line)
    assert "of at most" in line
    begun.send_signal(signal.SIGINT)
    _, err = begun.communicate(timeout=60)
    assert begun.returncode == 1
    assert "interrupted; what is done is kept in" in err
    kept = json.loads((run_folder / "identifiability.json").read_text())
    assert not kept["complete"]
    again = process(*words)
    deadline = time.monotonic() + 60
    stages = []
    for line in again.stderr:
        stages.append(line)
        if "fluid_blunt_drag" in line or time.monotonic() > deadline:
            break
    again.send_signal(signal.SIGINT)
    again.communicate(timeout=60)
    assert not any("improving the fit" in line for line in stages)
