import json
import shutil

import numpy as np
import pytest
import toy

from refused import refusal, says
from swim2real.identification.ensemble import Member, make_ensemble, read_ensemble, spread_out, write_ensemble
from swim2real.identification.finished_run import reopen
from swim2real.settings import EnsembleSettings, IdentifiabilitySettings
from swimbase.errors import ArgumentError, ParameterError, RunError

SETTINGS = EnsembleSettings(within=1.2, count=8)


@pytest.fixture(scope="module")
def run(studied, reference):
    return reopen(studied[2], reference, toy.ROBOT, 2)


@pytest.fixture(scope="module")
def made(run):
    return make_ensemble([run], SETTINGS)


def test_members_are_within_the_loss_and_spread_where_nothing_tells(run, made):
    members = made["members"]
    assert len(members) == SETTINGS.count
    again = run.problem.evaluate_many([member["parameters"] for member in members])
    losses = [comparison.loss for comparison in again]
    assert losses == pytest.approx([member["loss"] for member in members], rel=1e-9)
    assert max(losses) <= made["limit"] == 1.2 * made["best_loss"]
    assert losses[0] == pytest.approx(made["best_loss"])
    assert losses == sorted(losses)
    ranges = made["ranges"]
    assert ranges["nothing"]["max"] - ranges["nothing"]["min"] > 0.4
    assert ranges["damping_a"]["max"] - ranges["damping_a"]["min"] > 0.3 * 0.005
    assert ranges["mass"]["max"] - ranges["mass"]["min"] < 0.25 * 0.12
    sums = [m["parameters"]["damping_a"] + m["parameters"]["damping_b"] for m in made["members"]]
    assert sums == pytest.approx([toy.HIDDEN["damping_a"] + toy.HIDDEN["damping_b"]] * len(sums), rel=0.1)


def test_spread_out_takes_the_best_and_then_the_farthest():
    places = [(0.0, 3.0), (0.1, 1.0), (0.2, 2.0), (1.0, 4.0), (0.5, 5.0), (0.5, 6.0)]
    members = [Member(np.array([place]), loss, "record") for place, loss in places]
    assert [m.loss for m in spread_out(members, 3)] == [1.0, 4.0, 5.0]
    assert len(spread_out(members, 9)) == 5  # a double is no spread


def test_it_is_written_and_read_with_its_provenance(made, run, tmp_path):
    write_ensemble(tmp_path / "ensemble.json", made)
    assert read_ensemble(tmp_path / "ensemble.json", toy.ROBOT) == [one["parameters"] for one in made["members"]]
    assert (made["robot"], made["runs"]) == ("toy", [str(run.folder.path)])
    assert made["reference_fingerprint"] == run.settings.reference_fingerprint
    assert made["engine"]["name"] == run.problem.simulator.engine.name
    assert {member["source"] for member in made["members"]} == {"identify"}
    values = [member["parameters"]["mass"] for member in made["members"]]
    one = made["ranges"]["mass"]
    assert one["unit"] == "kg"
    assert (one["min"], one["max"]) == pytest.approx((min(values), max(values)))
    assert (one["p5"], one["p95"]) == pytest.approx(tuple(np.percentile(values, (5, 95))))


def test_runs_that_differ_are_not_put_together(run, reference, tmp_path):
    shutil.copytree(run.folder.path, tmp_path / "other")
    settings = json.loads((tmp_path / "other" / "settings.json").read_text())
    (tmp_path / "other" / "settings.json").write_text(json.dumps({**settings, "horizon": 1.0}))
    other = reopen(tmp_path / "other", reference, toy.ROBOT, 2)
    assert says(refusal(RunError, make_ensemble, [run, other], SETTINGS), "put together", "horizon is 4.0 and 1.0")
    assert says(refusal(ArgumentError, make_ensemble, [], SETTINGS), "at least one run")
    said = refusal(RunError, write_ensemble, tmp_path / "none" / "ensemble.json", {})
    assert says(said, "can't write ensemble", "No such file")


@pytest.mark.parametrize(("change", "parts"), [
    (lambda c: "[", ("can't be read as JSON",)),
    (lambda c: {**c, "kind": "other"}, ("'kind' is \"other\"", "swim2real ensemble writes one")),
    (lambda c: {**c, "format": 9}, ("'format' is 9", "1")),
    (lambda c: {**c, "robot": "eel"}, ("robot 'eel'", "'toy'")),
    (lambda c: {**c, "members": []}, ("'members'", "at least 1")),
    (lambda c: {**c, "members": [c["members"][0], 3]}, ("'members[1]' is 3", "a table")),
    (lambda c: moved(c, mass=9.0), ("'mass'", "member 1 is 9", "out of bounds")),
    (lambda c: moved(c, masses=1.0), ("unknown parameter 'masses'", "did you mean 'mass'?")),
])  # fmt: skip
def test_the_reader_says_what_is_wrong(made, tmp_path, change, parts):
    path, content = tmp_path / "ensemble.json", change(made)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    assert says(refusal(ParameterError, read_ensemble, path, toy.ROBOT), *parts)
    said = refusal(ParameterError, read_ensemble, tmp_path / "none.json", toy.ROBOT)
    assert says(said, "none.json' is not there", "swim2real ensemble writes one")


def moved(content, **values):
    first, *others = content["members"]
    return {**content, "members": [{**first, "parameters": {**first["parameters"], **values}}, *others]}


@pytest.mark.parametrize(
    ("settings", "given", "part"),
    [(EnsembleSettings, {"within": 1.0}, "within is 1"), (EnsembleSettings, {"count": 1}, "count is 1"),
     (IdentifiabilitySettings, {"rounds": 0}, "rounds is 0"), (IdentifiabilitySettings, {"seed": -1}, "seed is -1")],
)  # fmt: skip
def test_settings_are_checked(settings, given, part):
    assert part in refusal(ArgumentError, settings, **given)
