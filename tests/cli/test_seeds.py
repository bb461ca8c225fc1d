"""`calibrate --seeds`: several runs, and the best of them."""

import json

import pytest

from run_settings import record_of
from swim2real.calibration import RunFolder


def words(folder, out, *more):
    return ["calibrate", folder / "tracks", "--robot", folder / "pendulum.toml", "--out", out, "--budget", 2,
            "--horizon", 0.3, "--method", "random", "--first", "random", *more]  # fmt: skip


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
    assert (
        program(*words(pendulum_folder, out, "--seeds", "0:2")).sentence(1).startswith(f"'{out}' holds a run already")
    )
    program(*words(pendulum_folder, out, "--seeds", "3:6", "--resume", "--quiet")).done()
    assert RunFolder(tmp_path / "run-seed-5").outcome() is not None
    reference = json.loads((out / "settings.json").read_text())["reference"]
    assert (out / reference / "reference.json").is_file()  # found from where the copy lies
