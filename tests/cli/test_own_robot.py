"""A robot file and its recordings, from `calibrate` on."""

import shutil
from pathlib import Path

import pytest
from program import process

from swim2real.calibration import RunFolder
from swim2real.calibration.convergence import still_falling


@pytest.fixture(scope="module")
def calibrated(pendulum_folder, tmp_path_factory) -> tuple[Path, str]:
    """A run that ends while its loss is falling, in a folder beside the robot file's, and what was said of it."""
    folder = tmp_path_factory.mktemp("own")
    shutil.copytree(pendulum_folder, folder, dirs_exist_ok=True)
    done = process(
        "calibrate", folder / "tracks", "--robot", folder / "pendulum.toml", "--out", folder / "run",
        "--method", "least-squares", "--budget", 4, "--horizon", 0.5, "--quiet",
    )  # fmt: skip
    _, err = done.communicate(timeout=60)
    assert done.returncode == 0, err
    return folder / "run", err


def test_a_run_that_has_not_converged_is_told_and_so_is_its_page(calibrated):
    run, err = calibrated
    warning = still_falling(RunFolder(run).record(), RunFolder(run).settings())
    assert warning
    assert err == f"swim2real: warning: {warning}\n"
    assert f"Warning: {warning}." in (run / "report.html").read_text(encoding="utf-8")
