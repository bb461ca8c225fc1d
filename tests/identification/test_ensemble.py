import json
import shutil

import numpy as np
import pytest
import toy

from swim2real.errors import ArgumentError, ParameterError, RunError
from swim2real.identification.ensemble import Member, make_ensemble, read_ensemble, spread_out, write_ensemble
from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import identify
from swim2real.settings import EnsembleSettings, IdentifiabilitySettings

SETTINGS = EnsembleSettings(within=1.2, count=8, evaluations=40, seed=3)


@pytest.fixture(scope="module")
def reference():
    return toy.make_reference()


@pytest.fixture(scope="module")
def run(tmp_path_factory, reference):
    """With a study of its fit, profiles of two parameters."""
    folder = toy.make_run(reference, tmp_path_factory.mktemp("toy") / "run")
    run = reopen(folder.path, reference, toy.ROBOT, 2)

    def stop(progress):
        if progress.finished and progress.finished["name"] == "damping_a":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        identify(run, IdentifiabilitySettings(rise=0.1, steps=1, polish=3), on_progress=stop)
    return run


@pytest.fixture(scope="module")
def made(run):
    return make_ensemble([run], SETTINGS)


@pytest.fixture
def written(made, tmp_path):
    write_ensemble(tmp_path / "ensemble.json", made)
    return tmp_path / "ensemble.json"


def test_every_member_is_within_the_loss_that_is_stated(run, made):
    members = made["members"]
    assert len(members) == SETTINGS.count
    again = run.problem.evaluate_many([member["parameters"] for member in members])
    losses = [comparison.loss for comparison in again]
    assert losses == pytest.approx([member["loss"] for member in members], rel=1e-9)
    assert max(losses) <= made["limit"] == 1.2 * made["best_loss"]
    assert losses[0] == pytest.approx(made["best_loss"])
    assert losses == sorted(losses)


@pytest.mark.slow
def test_it_is_the_same_for_the_same_seed_and_another_for_another(run, made):
    again = make_ensemble([run], SETTINGS)
    assert again["members"] == made["members"]
    other = make_ensemble([run], EnsembleSettings(within=1.2, count=8, evaluations=40, seed=4))
    assert other["members"] != made["members"]


def test_what_nothing_tells_spreads_and_what_counts_does_not(made):
    ranges = made["ranges"]
    assert ranges["nothing"]["max"] - ranges["nothing"]["min"] > 0.4
    assert ranges["damping_a"]["max"] - ranges["damping_a"]["min"] > 0.3 * 0.005
    assert ranges["mass"]["max"] - ranges["mass"]["min"] < 0.25 * 0.12
    sums = [m["parameters"]["damping_a"] + m["parameters"]["damping_b"] for m in made["members"]]
    assert sums == pytest.approx([toy.HIDDEN["damping_a"] + toy.HIDDEN["damping_b"]] * len(sums), rel=0.1)


def test_ranges_are_those_of_the_members(made):
    for name, one in made["ranges"].items():
        values = [member["parameters"][name] for member in made["members"]]
        assert one["unit"] == toy.SPACE[name].unit
        assert (one["min"], one["max"]) == pytest.approx((min(values), max(values)))
        assert (one["p5"], one["p95"]) == pytest.approx(tuple(np.percentile(values, (5, 95))))


def test_members_come_from_study_and_walk(made):
    assert {member["source"] for member in made["members"]} >= {"profile", "walk"}


def test_without_evaluations_the_runs_alone_are_read(run):
    found = make_ensemble([run], EnsembleSettings(within=1.2, count=50, evaluations=0))
    assert found["evaluations"] == 0
    assert {member["source"] for member in found["members"]} <= {"profile", "record"}


def test_provenance(made, run):
    assert made["robot"] == "toy"
    assert made["reference_fingerprint"] == run.settings.reference_fingerprint
    assert made["engine"]["name"] == run.problem.simulator.engine.name
    assert made["evaluations"] == 40 + 8 + 1
    assert made["runs"] == [str(run.folder.path)]


def test_runs_that_differ_are_not_put_together(run, reference, tmp_path):
    shutil.copytree(run.folder.path, tmp_path / "other")
    settings = json.loads((tmp_path / "other" / "settings.json").read_text())
    settings["horizon"] = 1.0
    (tmp_path / "other" / "settings.json").write_text(json.dumps(settings))
    other = reopen(tmp_path / "other", reference, toy.ROBOT, 2)
    with pytest.raises(RunError, match=r"can't be put together: horizon is 4\.0 and 1\.0"):
        make_ensemble([run, other], SETTINGS)
    with pytest.raises(ArgumentError, match="needs at least one run"):
        make_ensemble([], SETTINGS)


def test_spread_out_takes_the_best_and_then_the_farthest():
    places = [(0.0, 3.0), (0.1, 1.0), (0.2, 2.0), (1.0, 4.0), (0.5, 5.0), (0.5, 6.0)]
    members = [Member(np.array([place]), loss, "record") for place, loss in places]
    assert [m.loss for m in spread_out(members, 3)] == [1.0, 4.0, 5.0]
    assert len(spread_out(members, 9)) == 5  # a double is no spread


def test_the_reader_gives_checked_values(written, made):
    found = read_ensemble(written, toy.ROBOT)
    assert found == [member["parameters"] for member in made["members"]]


def changed(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(kind="other"), r"ensemble\.json': 'kind' is \"other\"; .*; swim2real ensemble writes one"),
        (lambda c: c.update(format=9), "'format' is 9; it must be 1"),
        (lambda c: c.update(robot="eel"), "is for robot 'eel', not 'toy'"),
        (lambda c: c.update(members=[]), "'members' is .*; it must have at least 1"),
        (lambda c: c["members"].insert(1, 3), r"'members\[1\]' is 3; it must be a table"),
        (lambda c: c["members"][0]["parameters"].update(mass=9.0), r"'mass' in '.*', member 1 is 9, out of bounds"),
        (lambda c: c["members"][1]["parameters"].pop("mass"), r"missing parameter in '.*', member 2: mass"),
        (
            lambda c: c["members"][0]["parameters"].update(masses=1.0),
            r"unknown parameter 'masses'; did you mean 'mass'\?",
        ),
    ],
)
def test_the_reader_says_what_is_wrong(written, change, message):
    changed(written, change)
    with pytest.raises(ParameterError, match=message):
        read_ensemble(written, toy.ROBOT)


def test_the_reader_needs_a_file_of_json(tmp_path):
    with pytest.raises(ParameterError, match=r"ensemble '.*none\.json' is not there; swim2real ensemble writes one"):
        read_ensemble(tmp_path / "none.json", toy.ROBOT)
    (tmp_path / "bad.json").write_text("[")
    with pytest.raises(ParameterError, match="can't be read as JSON"):
        read_ensemble(tmp_path / "bad.json", toy.ROBOT)


def test_writing_where_nothing_can_be_written_is_a_sentence(made, tmp_path):
    with pytest.raises(RunError, match=r"can't write ensemble '.*': No such file or directory"):
        write_ensemble(tmp_path / "none" / "ensemble.json", made)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"within": 1.0}, "within is 1; it is a multiple of the lowest loss, above 1 and up to 10"),
        ({"count": 1}, "count is 1; an ensemble has at least 2 members"),
        ({"evaluations": -1}, "evaluations is -1; it must be at least 0"),
        ({"seed": -1}, "seed is -1; it must be at least 0"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ArgumentError, match=message):
        EnsembleSettings(**settings)
