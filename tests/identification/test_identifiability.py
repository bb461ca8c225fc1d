import json
import re
import shutil
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import toy

from refused import refusal, says
from swim2real.errors import RunError
from swim2real.identification.finished_run import reopen
from swim2real.identification.gauss_newton import EvaluatedPoint, Evaluator, jacobian, refit
from swim2real.identification.identifiability import IDENTIFIABILITY, IDENTIFIED, identify, read_study
from swim2real.identification.neighborhood import autocorrelation, neighborhood
from swim2real.identification.profile import ProfilePoint, profile, summarize
from swim2real.parameters import read_parameters
from swim2real.robots.fish import FISH
from swim2real.settings import IdentifiabilitySettings

SETTINGS = IdentifiabilitySettings(rise=0.1, steps=2, polish=3)
QUICK = IdentifiabilitySettings(rise=0.1, steps=0, polish=1)
NAMES = toy.SPACE.names
HIDDEN_DAMPING = toy.HIDDEN["damping_a"] + toy.HIDDEN["damping_b"]


@pytest.fixture(scope="module")
def reference():
    return toy.make_reference()


@pytest.fixture(scope="module")
def run_path(tmp_path_factory, reference):
    return toy.make_run(reference, tmp_path_factory.mktemp("toy") / "run").path


@pytest.fixture
def run(run_path, reference, tmp_path):
    """The run in a folder of its own."""
    shutil.copytree(run_path, tmp_path / "run")
    return reopen(tmp_path / "run", reference, toy.ROBOT, 2)


@pytest.fixture(scope="module")
def studied(run_path, reference, tmp_path_factory):
    folder = tmp_path_factory.mktemp("studied") / "run"
    shutil.copytree(run_path, folder)
    told = []
    found = identify(reopen(folder, reference, toy.ROBOT, 2), SETTINGS, on_progress=told.append)
    return found, told, folder


def test_the_polish_finds_what_the_run_missed(studied):
    found, _, _ = studied
    assert found["fit"]["loss"] < 0.9 * found["start"]["loss"]
    values = toy.SPACE.to_values(found["lowest"]["point"])
    assert values["mass"] == pytest.approx(toy.HIDDEN["mass"], rel=0.05)
    assert values["damping_a"] + values["damping_b"] == pytest.approx(HIDDEN_DAMPING, rel=0.05)


def test_a_parameter_that_counts_is_identified_with_an_interval_around_the_truth(studied):
    one = studied[0]["profiles"]["mass"]
    assert one["verdict"] == "identified"
    low, high = one["values"]
    assert low < toy.HIDDEN["mass"] < high
    assert high - low < 0.25 * 0.12
    assert one["largest_rise"] > 3 * studied[0]["local"]["rise"]


@pytest.mark.parametrize(("one", "other"), [("damping_a", "damping_b"), ("damping_b", "damping_a")])
def test_two_that_make_up_for_one_another_have_flat_profiles_and_say_who(studied, one, other):
    found = studied[0]["profiles"][one]
    assert found["verdict"] == "not identified"
    assert found["interval"] == [0.0, 1.0]
    assert next(iter(found["made_up_by"])) == other
    moved = max(point["fixed_loss"] for point in found["points"])
    assert moved > 3 * max(point["loss"] for point in found["points"])  # alone it counts


def test_a_parameter_without_effect_is_not_identified(studied):
    one = studied[0]["profiles"]["nothing"]
    assert one["verdict"] == "not identified"
    assert one["largest_rise"] < 0.3 * studied[0]["local"]["rise"]
    assert not one["made_up_by"]
    assert studied[0]["local"]["standard_errors"]["nothing"]["cube"] is None


def test_the_neighborhood_names_the_sloppy_pair_and_its_errors(studied):
    found = studied[0]["local"]
    errors = {name: one["cube"] for name, one in found["standard_errors"].items()}
    assert errors["mass"] < 0.1
    for name in ("damping_a", "damping_b"):
        assert errors[name] is None or errors[name] > 5 * errors["mass"]
    pair = next(one for one in found["directions"] if set(one["parameters"]) == {"damping_a", "damping_b"})
    assert pair["parameters"]["damping_a"] * pair["parameters"]["damping_b"] < 0
    assert found["directions"][0]["slope"] < 1e-6
    assert found["directions"][-1]["slope"] > 1e-2


def test_the_lowest_point_is_a_parameters_file(studied):
    found, _, folder = studied
    kept = read_parameters(folder / IDENTIFIED, "toy", toy.SPACE)
    lowest = min((found["fit"], found["lowest"]), key=lambda one: one["loss"])
    assert kept.values == toy.SPACE.to_values(lowest["point"])
    best = json.loads((folder / "best.json").read_text())
    written = json.loads((folder / IDENTIFIED).read_text())
    assert best.pop("evaluation") >= 0
    assert written == {**best, "parameters": kept.values, "loss": lowest["loss"]}
    assert written["loss"] < best["loss"]


@pytest.mark.slow
def test_a_study_that_is_cut_anywhere_is_the_same_file(run_path, reference, tmp_path):
    """Every write is a place to be killed at, and so is every batch between two: what wasn't written is done again."""

    def study(folder, stop_at=()):
        told = 0

        def count(progress):
            nonlocal told
            told += 1
            if told in stop_at:
                raise KeyboardInterrupt

        shutil.copytree(run_path, folder, dirs_exist_ok=True)
        for _ in range(len(stop_at) + 1):
            with suppress(KeyboardInterrupt):
                identify(reopen(folder, reference, toy.ROBOT, 2), QUICK, on_progress=count)
        content = (folder / IDENTIFIABILITY).read_text(encoding="utf-8")
        return told, re.sub(r'"created": "[^"]*"', "", content), (folder / IDENTIFIED).read_bytes()

    batches, *whole = study(tmp_path / "whole")
    stops = (2, batches // 3, batches // 2 + 2, batches - 1, batches + 3)
    _, *cut = study(tmp_path / "cut", stops)
    assert cut == whole


def test_a_finished_study_is_read_and_not_made_again(studied, reference):
    told = []
    again = identify(reopen(studied[2], reference, toy.ROBOT, 2), SETTINGS, on_progress=told.append)
    assert again == studied[0] == read_study(studied[2] / IDENTIFIABILITY)
    assert not told


def test_another_setting_and_a_damaged_study_are_refused(studied, reference, run):
    finished = reopen(studied[2], reference, toy.ROBOT, 2)
    said = refusal(RunError, identify, finished, IdentifiabilitySettings(rise=0.2))
    assert says(said, "a study with another settings", "it was ", "0.1", "is now", "0.2", "--again")
    (run.folder.path / IDENTIFIABILITY).write_text("{")
    assert says(refusal(RunError, identify, run, SETTINGS), IDENTIFIABILITY, "can't be read", "--again")


def test_a_run_is_reopened_only_with_what_it_was_made_with(run, reference):
    with pytest.raises(RunError, match="is of robot 'toy', not 'fish'"):
        reopen(run.folder.path, reference, FISH)
    with pytest.raises(RunError, match=r"another reference than this one of 1 trials; .*, the toy's reference"):
        reopen(run.folder.path, toy.make_reference(noise=2e-3), toy.ROBOT)
    settings = json.loads(run.folder.settings_path.read_text())
    settings["engine"]["timestep"] = 0.5
    run.folder.settings_path.write_text(json.dumps(settings))
    with pytest.raises(RunError, match=r"was made with integrator .* at 0\.5 s; .*; losses can't be compared"):
        reopen(run.folder.path, reference, toy.ROBOT)


def test_a_run_without_a_result_is_refused(run, reference):
    for name in ("record.jsonl", "best.json"):
        (run.folder.path / name).unlink()
    with pytest.raises(RunError, match="has no evaluation that went well; calibrate first"):
        reopen(run.folder.path, reference, toy.ROBOT)


def test_the_slopes_are_central_and_one_sided_at_a_bound(run):
    evaluate = Evaluator(run.problem, run.space)
    at = evaluate([np.array([0.5, 1.0, 0.0, 0.0])])[0]
    slopes, jumps = jacobian(evaluate, at)
    assert not jumps
    left, right, below, above = evaluate(
        [at.point + np.array(move) for move in ([-0.02, 0, 0, 0], [0.02, 0, 0, 0], [0, -0.02, 0, 0], [0, 0, 0.02, 0])]
    )
    assert slopes[:, 0] == pytest.approx((right.residual - left.residual) / 0.04)
    assert slopes[:, 1] == pytest.approx((at.residual - below.residual) / 0.02)
    assert slopes[:, 2] == pytest.approx((above.residual - at.residual) / 0.02)
    assert np.all(slopes[:, 3] == 0)


def test_a_slope_does_not_cross_a_jump():
    class Stairs(Evaluator):
        """A residual that is straight but for a step."""

        def __init__(self):
            pass

        def __call__(self, points):
            return [self.at(point) for point in points]

        @staticmethod
        def at(point):
            jump = 0.5 if point[0] > 0.51 else 0.0
            return EvaluatedPoint(point, 0.1, np.array([0.1 + 0.2 * point[0] + jump, 0.3 * point[1]]), False)

    at = Stairs.at(np.array([0.5, 0.5]))
    slopes, jumps = jacobian(Stairs(), at)
    assert jumps == [0]
    assert slopes == pytest.approx(np.diag([0.2, 0.3]))


def test_a_refit_moves_only_what_is_free(run):
    evaluate = Evaluator(run.problem, run.space)
    at = evaluate([np.array([0.3, 0.5, 0.5, 0.5])])[0]
    best, _ = refit(evaluate, at, jacobian(evaluate, at)[0], np.array([True, False, False, False]), 3)
    assert best.misfit < at.misfit
    assert np.array_equal(best.point[1:], at.point[1:])


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_noise():
    """Noise that is correlated in time and between markers: the spread of repeated fits is what is foretold."""
    rng = np.random.default_rng(0)
    frames, markers = 200, 3
    slopes = rng.standard_normal((frames, 1, 2)).cumsum(axis=0) * 0.1 + np.ones((1, 2 * markers, 2)) * [1.0, -1.0]
    slopes = slopes.reshape(-1, 2)
    mixing = rng.standard_normal((2 * markers, 2 * markers))

    def noise():
        white = rng.standard_normal((frames + 50, 2 * markers))
        smooth = np.array([white[i : i + 50].mean(axis=0) for i in range(frames)])
        return (smooth @ mixing).ravel()

    fits, foretold, naive = [], [], []
    for _ in range(200):
        residual = noise()
        shift = np.linalg.lstsq(slopes, residual, rcond=None)[0]
        fits.append(shift)
        left = residual - slopes @ shift
        found = neighborhood(slopes, left, [(frames, 2 * markers)])
        foretold.append(found.standard_errors)
        naive.append(np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)) * left.var()))
        assert 2 < found.effective_count < 0.1 * len(residual)
    spread = np.std(fits, axis=0)
    assert np.median(foretold, axis=0) == pytest.approx(spread, rel=0.5)
    assert np.all(np.median(naive, axis=0) < 0.4 * spread)


def test_autocorrelation_of_what_is_known():
    times = np.arange(400)
    sine = np.sin(2 * np.pi * times / 40)[:, None]
    found = autocorrelation(sine)
    assert found[0] == 1
    assert found[20] == pytest.approx(-(1 - 20 / 400), abs=0.01)
    assert np.array_equal(autocorrelation(np.zeros((5, 2))), [1, 0, 0, 0, 0])


def _points(losses, places=(0.0, 0.2, 0.5, 0.8, 1.0)):
    return [ProfilePoint(at, loss, loss, np.array([at, 1 - at])) for at, loss in zip(places, losses, strict=True)]


@pytest.mark.parametrize(
    ("losses", "verdict", "interval"),
    [
        ((50.0, 19.0, 10.0, 19.0, 50.0), "identified", (0.4, 0.6)),
        ((10.5, 10.1, 10.0, 10.1, 10.4), "not identified", (0.0, 1.0)),
        ((10.5, 10.1, 10.0, 14.0, 50.0), "weak", (0.0, 0.65)),
        ((10.0, 14.0, 50.0, 60.0, 70.0), "identified", (0.0, 0.1)),
    ],
)
def test_verdicts(losses, verdict, interval):
    found = summarize(_points(losses), 0, ("one", "other"), 1.0)
    assert found["verdict"] == verdict
    assert found["interval"] == pytest.approx(interval)
    assert found["largest_rise"] == max(losses) - 10.0
    if losses == (10.5, 10.1, 10.0, 10.1, 10.4):
        assert found["made_up_by"] == {"other": pytest.approx(0.5)}


def test_a_profile_keeps_the_lowest_loss_where_a_refit_lowers_the_misfit_alone(reference, run_path):
    run = reopen(run_path, reference, toy.ROBOT, 2)
    (best,) = Evaluator(run.problem, run.space)([np.array(run.best.point)])
    slopes, _ = jacobian(Evaluator(run.problem, run.space), best)

    class Elsewhere(Evaluator):
        """The misfit is lowest where `mass` is another, the loss where it is."""

        def __call__(self, points):
            away = 0.1 * slopes[:, NAMES.index("mass")]
            return [replace(one, residual=one.residual - best.residual + away) for one in super().__call__(points)]

    evaluate = Elsewhere(run.problem, run.space)
    flat = profile(evaluate, evaluate([best.point])[0], slopes, NAMES.index("nothing"), 1e-4, 2)
    assert (flat[0].at, flat[-1].at) == (0.0, 1.0)
    assert max(point.loss for point in flat) == pytest.approx(best.loss, rel=1e-6)
