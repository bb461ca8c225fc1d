from pathlib import Path

import pytest
import small_run

from swim2real.calibration import Problem
from swim2real.trials import TrialSet

BUDGET = 6


@pytest.fixture(scope="session")
def reference_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("small") / "reference"
    small_run.make_reference(folder)
    return folder


@pytest.fixture(scope="session")
def reference(reference_folder) -> TrialSet:
    return small_run.load_reference(reference_folder)


@pytest.fixture(scope="session")
def problem(reference) -> Problem:
    return small_run.make_problem(reference)


@pytest.fixture(scope="session")
def uninterrupted(tmp_path_factory, problem, reference) -> dict[str, Path]:
    """A finished run of each method."""
    runs = {}
    for method in ("random", "line-search"):
        runs[method] = tmp_path_factory.mktemp("whole") / method
        small_run.run(problem, reference, runs[method], method, BUDGET)
    return runs
