"""A run of the toy and its study, which several files share; copy its folder before changing it."""

import shutil
from pathlib import Path

import pytest
import toy

from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import identify
from swim2real.trials import TrialSet


@pytest.fixture(scope="session")
def reference() -> TrialSet:
    return toy.make_reference()


@pytest.fixture(scope="session")
def run_path(tmp_path_factory, reference) -> Path:
    return toy.make_run(reference, tmp_path_factory.mktemp("toy") / "run").path


@pytest.fixture(scope="session")
def studied(run_path, reference, tmp_path_factory):
    """The study, what was told on the way, and the folder of the run."""
    folder, told = tmp_path_factory.mktemp("studied") / "run", []
    shutil.copytree(run_path, folder)
    return identify(reopen(folder, reference, toy.ROBOT, 2), toy.STUDY, on_progress=told.append), told, folder
