import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import toy

from refused import refusal, says
from swim2real.calibration.convergence import standing
from swim2real.identification.evaluated import EvaluatedPoint, independent_numbers
from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import (
    EVALUATED,
    IDENTIFIABILITY,
    IDENTIFIED,
    directions,
    doubted,
    identify,
    interval,
    known_so_far,
    read_study,
)
from swim2real.identification.posterior import SHARPNESS, draw, first_points
from swim2real.parameters import read_parameters
from swim2real.robots.fish import FISH
from swim2real.settings import IdentifiabilitySettings
from swimbase.errors import RunError

QUICK = IdentifiabilitySettings(rounds=1)
NAMES = toy.SPACE.names


@pytest.fixture
def run(run_path, reference, tmp_path):
    """The run in a folder of its own."""
    shutil.copytree(run_path, tmp_path / "run")
    return reopen(tmp_path / "run", reference, toy.ROBOT, 2)


def test_a_lower_loss_than_the_runs_is_taken_over_as_a_parameters_file(studied):
    found, told, folder = studied
    assert found.lowest.loss < 0.9 * found.start.loss
    assert (told[-1].evaluations, told[-1].lowest) == (found.evaluations, found.lowest.loss)
    kept = read_parameters(folder / IDENTIFIED, "toy", toy.SPACE)
    assert kept.values == toy.SPACE.to_values(found.lowest.point)
    assert kept.values["mass"] == pytest.approx(toy.HIDDEN["mass"], rel=0.05)
    assert sorted(path.name for path in folder.glob("identif*")) == [IDENTIFIABILITY, IDENTIFIED]


def test_intervals_hold_the_truth_and_are_narrow_where_the_trials_tell(studied):
    found = studied[0].intervals
    for name, hidden in toy.HIDDEN.items():
        low, high = found[name].interval_95
        assert low < hidden < high
        inner = found[name].interval_50
        assert low < inner[0] < found[name].median < inner[1] < high
    assert [found[name].known for name in NAMES] == ["roughly", *["undetermined"] * 3]
    assert found["mass"].width < 0.1
    assert "followed 0 of its starts" in studied[0].doubt


@pytest.mark.slow
def test_a_parameter_is_identified_only_by_several_descents_to_one_minimum_at_the_noise(reference, tmp_path):
    folder = toy.make_run(reference, tmp_path / "run", budget=None)
    whole = (folder.path / "record.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    last = [json.loads(line)["note"].get("last", False) for line in whole]
    ended = next(i for i in range(1, len(last)) if last[i - 1] and not last[i])

    def study(lines):
        (folder.path / "record.jsonl").write_text("".join(lines), encoding="utf-8")
        found = identify(reopen(folder.path, reference, toy.ROBOT, 2), QUICK, again=True)
        return found.intervals["mass"].known, found.doubt

    assert study(whole) == ("determined", "")
    known, doubt = study(whole[: ended + 1])
    assert known == "roughly"
    assert says(doubt, "followed 1 of its starts", "one minimum", "--resume")


def test_far_above_the_noise_or_where_descents_end_apart_nothing_is_identified():
    for misfit, ends, part in (
        (0.02, [0.02] * 3, "20 times the noise"), (0.004, [0.004, 0.012, 0.02], "1 ended within 10 %"),
        (0.004, [0.004], "1 of its starts"), (0.004, [0.004, 0.0041], ""), (0.0015, [0.0015, 0.3], ""),
    ):  # fmt: skip
        doubt = doubted(misfit, 1e-3, min(ends), ends)
        assert part in doubt if part else not doubt


def test_of_two_that_make_up_for_one_another_the_sum_is_determined(studied):
    found = studied[0]
    draws = np.array(found.draws)
    damping = [sum(toy.SPACE.to_values(point)[name] for name in ("damping_a", "damping_b")) for point in draws]
    assert np.std(damping) < 0.1 * toy.HIDDEN["damping_a"]
    assert np.mean(damping) == pytest.approx(toy.HIDDEN["damping_a"] + toy.HIDDEN["damping_b"], rel=0.05)
    pair = found.directions[1]  # the best determined one is the mass
    assert pair.parameters["damping_a"] * pair.parameters["damping_b"] > 0
    assert pair.spread < 0.3
    assert 1.5 < found.determined < 2.5


@pytest.mark.slow
def test_a_study_that_is_killed_between_two_files_is_the_same(run_path, reference, tmp_path, monkeypatch):
    class Killed(BaseException):
        pass

    def study(folder, method="", file="", before=0):
        """What is there in the end; killed when a method of a path comes to a file and has done so often before."""
        shutil.copytree(run_path, folder)
        original, left = getattr(Path, method, None), iter(range(before))

        def killed(path, *args, **kwargs):
            if path.name == file and next(left, None) is None:
                raise Killed
            return original(path, *args, **kwargs)

        if method:
            with monkeypatch.context() as patch:
                patch.setattr(Path, method, killed)
                with pytest.raises(Killed):
                    identify(reopen(folder, reference, toy.ROBOT, 2), QUICK)
        identify(reopen(folder, reference, toy.ROBOT, 2), QUICK)
        tables = {path.name: {} for path in folder.glob("identif*.npz")}
        files = {path.name: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("identif*.json")}
        files[IDENTIFIABILITY].pop("created")
        return tables | files

    whole = study(tmp_path / "whole")
    # the second batch, with the lowest loss, is in the table and not yet in the file that says which it is
    assert study(tmp_path / "batch", "replace", f"{IDENTIFIABILITY}.part", 1) == whole
    assert study(tmp_path / "end", "unlink", EVALUATED) == whole


def test_a_study_that_is_cut_within_a_batch_keeps_it_and_tells_what_is_known(run, reference):
    left = iter(range(10))

    def check():
        if next(left, None) is None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        identify(run, QUICK, check=check)
    assert read_study(run.folder.path / IDENTIFIABILITY).evaluations == 11
    lowest, ranges = known_so_far(run)
    assert lowest <= min(entry.loss for entry in run.record)
    for name, (low, high) in ranges.items():
        assert toy.SPACE[name].lower <= low < high <= toy.SPACE[name].upper
    left = iter(range(10**9))
    identify(reopen(run.folder.path, reference, toy.ROBOT, 2), QUICK, check=check)
    assert read_study(run.folder.path / IDENTIFIABILITY).complete


def test_a_finished_study_is_read_and_another_setting_or_damage_refused(studied, reference, run):
    told = []
    again = identify(reopen(studied[2], reference, toy.ROBOT, 2), toy.STUDY, on_progress=told.append)
    assert again == studied[0] == read_study(studied[2] / IDENTIFIABILITY)
    assert not told
    finished = reopen(studied[2], reference, toy.ROBOT, 2)
    said = refusal(RunError, identify, finished, IdentifiabilitySettings(rounds=9))
    assert says(said, "a study with another settings", "it was ", "3", "is now", "9", "--again")
    (run.folder.path / IDENTIFIABILITY).write_text("{")
    assert says(refusal(RunError, identify, run, toy.STUDY), IDENTIFIABILITY, "can't be read", "--again")


def test_a_run_is_reopened_only_with_what_it_was_made_with_and_a_result(run, reference):
    with pytest.raises(RunError, match="is of robot 'toy', not 'fish'"):
        reopen(run.folder.path, reference, FISH)
    with pytest.raises(RunError, match=r"another reference than this one of 1 trials; .*, the toy's"):
        reopen(run.folder.path, toy.make_reference(noise=2e-3), toy.ROBOT)
    for name in ("record.jsonl", "best.json"):
        (run.folder.path / name).unlink()
    with pytest.raises(RunError, match="has no evaluation that went well; calibrate first"):
        reopen(run.folder.path, reference, toy.ROBOT)
    settings = json.loads(run.folder.settings_path.read_text())
    settings["engine"]["timestep"] = 0.5
    run.folder.settings_path.write_text(json.dumps(settings))
    with pytest.raises(RunError, match=r"was made with integrator .* at 0\.5 s; .*; losses can't be compared"):
        reopen(run.folder.path, reference, toy.ROBOT)


def linear(noise):
    """A residual that is linear in two of three parameters, with noise of 60 independent numbers."""
    slopes = np.random.default_rng(3).normal(size=(60, 3)) * [2.0, 0.4, 0.0]

    def evaluate(points):
        residuals = [slopes @ (point - 0.5) + noise for point in points]
        return [
            EvaluatedPoint(np.asarray(p), float(np.abs(r).mean()), r, False)
            for p, r in zip(points, residuals, strict=True)
        ]

    return slopes, evaluate


def test_draws_of_a_linear_problem_have_the_covariance_of_least_squares():
    noise = np.random.default_rng(4).normal(size=60) * 0.1
    slopes, evaluate = linear(noise)
    found = draw(evaluate, first_points([(np.array([0.4, 0.6, 0.5]), 1.0)]), lambda residual: 60.0, 2, 0)
    told = slopes[:, :2]
    fit = 0.5 - np.linalg.lstsq(told, noise, rcond=None)[0]
    left = noise + told @ (fit - 0.5)
    covariance = np.linalg.inv(told.T @ told) * (left @ left) / 58 / SHARPNESS
    np.testing.assert_allclose(found.draws[:, :2].mean(axis=0), fit, atol=0.3 * np.sqrt(np.diag(covariance)).max())
    np.testing.assert_allclose(found.draws[:, :2].std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.25)
    assert found.draws[:, 2].std() == pytest.approx(12**-0.5, rel=0.15)


def test_directions_name_what_holds_most_of_them_and_numbers_that_hang_together_count_as_few():
    rng = np.random.default_rng(0)
    both, alone = rng.uniform(size=(2, 4000))
    found = directions(np.column_stack([both, 1 - both + 0.01 * alone, alone]), ("one", "other", "third"))
    assert set(found[0].parameters) == {"one", "other"}
    assert found[0].parameters["one"] == pytest.approx(found[0].parameters["other"], rel=0.05)
    assert found[0].spread < 0.02
    assert found[1].parameters.keys() == {"third"}
    assert found[1].spread == pytest.approx(1.0, rel=0.05)
    rng = np.random.default_rng(0)
    white = rng.standard_normal((250, 6))
    smooth = np.array([white[i : i + 50].mean(axis=0) for i in range(200)]) @ rng.standard_normal((6, 6))
    assert 2 < independent_numbers(smooth.ravel(), [(200, 6)]) < 120
    assert independent_numbers(white.ravel(), [(250, 6)]) > 0.8 * white.size


@pytest.mark.parametrize(("size", "noise"), [(1, 0.0), (2, 1e-3)])
def test_one_parameter_and_a_loss_of_0_are_studied_like_any_others(size, noise):
    hidden, scatter = np.full(size, 0.4), noise * np.random.default_rng(0).standard_normal(20 * size) / 20

    def evaluate(points):
        residuals = [0.05 * np.repeat(point - hidden, 20) + scatter for point in points]
        return [
            EvaluatedPoint(np.array(p), float(np.abs(r).sum()), r, False)
            for p, r in zip(points, residuals, strict=True)
        ]

    first = first_points([(hidden, 0.0), (hidden + 0.1, 0.1)])
    found = draw(evaluate, first, lambda r: independent_numbers(r, [(20 * size, 1)]), 2, 0)
    low, high = interval(found.draws, "95")
    assert ((low <= hidden) & (hidden <= high) & (high - low < 0.4)).all()
    assert len(directions(found.draws, NAMES[:size])) == size


def test_a_run_that_ends_at_a_loss_of_0_has_its_record_and_says_where_it_stands(tmp_path):
    reference = toy.make_reference(noise=0.0)
    folder = toy.make_run(reference, tmp_path / "run", budget=3, start=toy.HIDDEN)
    assert [entry.loss == 0 for entry in folder.record()] == [True, False, False]
    told = standing(folder.record(), replace(folder.settings(), finish=True), None, toy.SPACE)
    assert ("0.00 mm" in told[0], told[2]) == (True, "the last quarter of the evaluations gained nothing")
