"""The page of a run shows what `identify` found."""

import html
import json

import pytest
import toy

from swim2real.calibration import RunFolder
from swim2real.identification.identifiability import IDENTIFIABILITY, sets_that_fit
from swim2real.report import write_report


@pytest.fixture
def run(studied):
    return RunFolder(studied[2])


def test_intervals_combinations_and_pairs_are_on_the_page(run):
    page = write_report(run.path, toy.ROBOT).read_text(encoding="utf-8")
    study = json.loads((run.path / IDENTIFIABILITY).read_text())
    low, high = study["intervals"]["mass"]["interval_95"]
    assert f"{low:.4g} to {high:.4g}" in page
    assert page.count('class="interval"') == len(toy.SPACE)
    assert f"{study['determined']:.1f} of 4 directions are determined" in page
    assert "damping_a against damping_b: 100.0 %" in page or "damping_b against damping_a: 100.0 %" in page
    assert "Sets that fit, two parameters that compensate for one another" in page


@pytest.mark.parametrize(("change", "sentence"), [
    ({"complete": False}, ""),
    ({"format": 1}, "isn't shown: study '"),
    ({"start": {"point": [0.5] * 4, "loss": 1.0}}, "is from before the run had its best values; begin anew"),
])  # fmt: skip
def test_a_study_that_is_not_complete_damaged_or_older_is_left_out(run, change, sentence):
    path = run.path / IDENTIFIABILITY
    whole = path.read_text()
    path.write_text(json.dumps({**json.loads(whole), **change}))
    page = html.unescape(write_report(run.path, toy.ROBOT).read_text(encoding="utf-8"))
    assert "95 % interval" not in page
    assert sentence in page
    assert ("begin anew" in page or "isn't shown" in page) == bool(sentence)
    path.write_text(whole)


def test_sets_that_fit_are_within_bounds_and_none_without_a_study(run, tmp_path):
    sets = sets_that_fit(run, toy.ROBOT)
    assert len(sets) == 25
    for values in sets:
        toy.SPACE.check(values)
    assert sets_that_fit(type(run)(tmp_path), toy.ROBOT) == []
