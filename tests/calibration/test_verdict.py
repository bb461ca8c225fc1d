"""Verdicts on runs, by what was found, what ended the search and the noise."""

from dataclasses import replace

import numpy as np
import pytest
import small_run

from refused import refusal, says
from swim2real.calibration import RunFolder, conclude, sizes_of
from swim2real.calibration.from_rest import FromRest
from swim2real.calibration.loop import Search
from swim2real.calibration.verdict import error_and_motion, judge
from swim2real.cli.subject import heed
from swimbase.errors import RunError

ROBOT, NOISE = small_run.ROBOT, 7e-4
DONE = Search("done", "3 of 3 starts agree", 400, (0.01, 0.01, 0.0101), None)
CUT = Search("minutes", "", 40, (), 100.0)


@pytest.fixture(scope="module")
def trials(problem):
    """Trials at the hidden values, and at some that swim too slowly."""
    slow = {**small_run.HIDDEN, "fluid_slender_drag": 10.0, "motor_arm_length": 0.03}
    return {name: problem.evaluate(values).trials for name, values in (("hidden", small_run.HIDDEN), ("slow", slow))}


def test_a_fit_near_the_noise_is_good_whatever_evaluations_ended_it(trials):
    for search in (DONE, Search("budget", "", 40), Search("most", "", 2000)):
        verdict = judge(trials["hidden"], ROBOT, search, NOISE)
        assert (verdict.kind, verdict.seconds) == ("good", None)
        assert says(verdict.sentence, "% of the motion is unexplained", "times the noise", "near the noise")
    error, motion = error_and_motion(trials["hidden"], ROBOT)
    assert verdict.unexplained == pytest.approx(error / motion)


def test_a_spent_budget_is_good_only_where_the_error_can_be_all_noise(trials):
    error, _ = error_and_motion(trials["hidden"], ROBOT)
    assert error < 2 * NOISE  # nothing is left to find
    found = {
        (ending, times): judge(trials["hidden"], ROBOT, Search(ending, "", 8), error / times).kind
        for ending in ("budget", "most", "done")
        for times in (1.9, 3.0)
    }
    assert {key for key, kind in found.items() if kind != "good"} == {("budget", 3.0), ("most", 3.0)}


@pytest.mark.parametrize(("search", "said"), [
    (CUT, ("the minutes are over", "--resume searches on, about 2 min more")),
    (replace(CUT, ending="interrupted"), ("it was interrupted", "--resume")),
])  # fmt: skip
def test_what_minutes_or_a_person_ended_isnt_finished_however_near_the_noise(trials, search, said):
    verdict = judge(trials["hidden"], ROBOT, search, NOISE)
    assert (verdict.kind, verdict.seconds) == ("not finished", 100.0)
    assert says(verdict.sentence, *said)


def test_a_fit_that_leaves_much_unexplained_isnt_usable_and_the_worst_is_named(trials):
    verdict = judge(trials["slow"], ROBOT, CUT, NOISE)
    worst = max(trials["slow"], key=lambda one: one.loss)
    assert verdict.kind == "not usable"
    assert verdict.unexplained > 0.25
    assert says(
        verdict.sentence, f"{100 * verdict.unexplained:.0f} % of", f"trial '{worst.name}' by its way", "--resume"
    )
    assert says(judge(trials["slow"], ROBOT, DONE, NOISE).sentence, "3 of 3 starts agree, so look at the film")


def test_far_above_the_noise_a_search_that_is_done_is_good_and_one_whose_budget_is_spent_isnt_finished(trials):
    found = {search.ending: judge(trials["hidden"], ROBOT, search, 1e-5) for search in (DONE, Search("budget", "", 40))}
    assert {ending: one.kind for ending, one in found.items()} == {"done": "good", "budget": "not finished"}
    assert says(found["done"].sentence, "no parameters that were found explain more", "3 of 3 starts agree")
    assert says(found["budget"].sentence, "the budget of 40 evaluations is spent", "--resume without --budget")


def test_what_diverges_or_goes_tail_first_isnt_usable(trials):
    first, second = trials["hidden"]
    diverged = judge((replace(first, divergence="too fast"), second), ROBOT, DONE, NOISE)
    assert (diverged.kind, diverged.unexplained) == ("not usable", None)
    assert says(diverged.sentence, "trial 'f1_30' diverges")
    backward = judge(trials["hidden"], ROBOT, DONE, NOISE, {"f1_30": FromRest(1.3, -0.02, None)})
    assert (backward.kind, says(backward.sentence, "from rest", "tail first at 1.30 Hz")) == ("not usable", True)
    assert judge((), ROBOT, CUT, NOISE).kind == "not finished"


def test_sizes_are_those_of_the_trials(problem, trials):
    found = sizes_of(problem)
    assert found.noise == pytest.approx(NOISE, rel=0.15)
    assert found.motion == pytest.approx(error_and_motion(trials["slow"], ROBOT)[1])
    by_hand = [np.sqrt(np.mean(np.square(t.path_real - t.path_real.mean(axis=0)).sum(axis=2))) for t in trials["slow"]]
    assert found.motion == pytest.approx(np.sqrt(np.mean(np.square(by_hand))), rel=1e-6)


def test_commands_heed_it(problem, tmp_path, capsys):
    folder = RunFolder(tmp_path)
    slow = {**small_run.HIDDEN, "fluid_slender_drag": 10.0, "motor_arm_length": 0.03}
    written = conclude(folder, problem, None, slow, search=CUT)
    assert folder.outcome().verdict == written.verdict
    heed(tmp_path, False, "train in it")  # no run was begun here
    (tmp_path / "settings.json").write_text("{}")
    said = refusal(RunError, heed, tmp_path, False, "train in it")
    assert says(said, f"run '{tmp_path}' is not usable: ", "To train in it all the same, add --anyway")
    heed(tmp_path, True, "train in it")
    conclude(folder, problem, None, small_run.HIDDEN, search=CUT)
    heed(tmp_path, False, "train in it")
    assert says(capsys.readouterr().err, "is not usable", "is not finished: the minutes are over")
    conclude(folder, problem, None, small_run.HIDDEN, search=DONE)
    heed(tmp_path, False, "train in it")
    assert capsys.readouterr().err == ""
