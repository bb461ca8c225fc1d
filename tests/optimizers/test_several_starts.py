"""A line search that may begin at several points."""

import numpy as np
import pytest
from watching import Watching

from swim2real.optimizers import BacktrackingLineSearch, Evaluation, ScriptedAdvisor
from swim2real.pipeline.methods import default_starts

STARTS = [np.array([x, 0.5]) for x in (0.1, 0.3, 0.5, 0.7, 0.9)]
TO = np.array([0.0, 0.0])
FALSE, TRUE = [9.0, 9.0, 9.0], [0.5]  # losses of the steps of a round that fails, and of one that doesn't


def search_of(advisor, losses, starts=STARTS):
    search = BacktrackingLineSearch(advisor, starts[0], more_starts=starts[1:])
    told = []
    for loss in losses:
        told.append(Evaluation(search.ask(), loss))
        search.tell(told[-1])
    return search, told


def test_all_starts_are_evaluated_and_the_best_is_searched_from():
    advisor = Watching([TO])
    _, told = search_of(advisor, [5.0, 4.0, 1.0, 3.0, 2.0, 0.9])
    np.testing.assert_array_equal([one.candidate.point for one in told[:5]], STARTS)
    assert [one.candidate.note["source"] for one in told] == ["first point", *["start"] * 4, "line search"]
    (shown,) = advisor.shown
    assert shown.incumbent is shown.first is told[2]
    np.testing.assert_array_equal(told[5].candidate.point, TO)


def test_a_search_that_fails_twice_gives_way_to_the_next_best_start_and_the_lowest_ends_the_run():
    advisor = Watching([TO] * 9)
    # 1.0: two failures; 2.0: a gain, then two failures; 3.0: two failures; the gain of the second is the lowest
    losses = [5.0, 4.0, 1.0, 3.0, 2.0, *FALSE, *FALSE, *TRUE, *FALSE, *FALSE, *FALSE, *FALSE, *FALSE]
    search, told = search_of(advisor, losses)
    begun = [shown.incumbent.loss for shown in advisor.shown]
    assert begun == [1.0, 1.0, 2.0, 0.5, 0.5, 3.0, 3.0, 0.5]
    assert [len(shown.rounds) for shown in advisor.shown] == [0, 1, 0, 1, 2, 0, 1, 3]
    assert [shown.first.loss for shown in advisor.shown] == [1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 2.0]
    numbers = [one.candidate.note["round"] for one in told if "round" in one.candidate.note]
    assert numbers == sorted(numbers)
    assert numbers[-1] == 8
    assert len(search.rounds) == 4


def test_advice_on_record_is_taken_again_in_every_search():
    """As a run that goes on takes it."""
    script = [np.array([0.1 * k, 0.5]) for k in range(9)]
    losses = [5.0, 4.0, 1.0, 3.0, 2.0, *FALSE, *FALSE, *TRUE, *FALSE, *FALSE, *FALSE, *FALSE, *FALSE]
    _, told = search_of(ScriptedAdvisor(script), losses)
    proposed = [one.candidate.note["proposal"]["point"] for one in told if "proposal" in one.candidate.note]
    np.testing.assert_array_equal(proposed, script[:8])


def test_a_start_that_failed_is_searched_from_last():
    advisor = Watching([TO])
    search = BacktrackingLineSearch(advisor, STARTS[0], more_starts=STARTS[1:2])
    search.tell(Evaluation(search.ask(), 0.1, failed=True))
    search.tell(Evaluation(search.ask(), 3.0))
    search.ask()
    np.testing.assert_array_equal(advisor.shown[0].incumbent.candidate.point, STARTS[1])


@pytest.mark.parametrize(("dimension", "budget", "count"), [(4, 60, 6), (2, 60, 4), (16, 40, 4), (4, 9, 1), (4, 1, 1)])
def test_the_number_of_starts_is_a_tenth_of_the_budget_and_two_a_parameter_at_most(dimension, budget, count):
    assert default_starts(dimension, budget) == count
