"""The backtracking line search: proposals, measurements before them, and several starts."""

import json

import numpy as np
import pytest
from driving import Watching, feed, notes, points

from refused import refusal, says
from swim2real.optimizers import (
    BacktrackingLineSearch,
    Measurement,
    Proposal,
    ProposalSearch,
    ScriptedAdvisor,
    recorded_advice,
)
from swimbase.errors import AdvisorError, OptimizerError

FIRST = np.array([0.2, 0.8])
TO = np.array([1.0, 0.4])
DIRECTION = TO - FIRST
BESIDE = Measurement(np.array([0.3, 0.8]), {"parameter": "a"})
ABOVE = Measurement(np.array([0.2, 0.9]))


def search_of(*advice, **settings) -> BacktrackingLineSearch:
    return BacktrackingLineSearch(ScriptedAdvisor(list(advice)), FIRST, **settings)


@pytest.mark.parametrize(("settings", "sizes"), [
    ({}, [1, 1 / 2, 1 / 4]), ({"max_steps": 1}, [1]),
    ({"decrease_factor": 0.1, "max_steps": 4}, [1, 0.1, 0.01, 1e-3]),
])  # fmt: skip
def test_steps_along_the_proposal_shrink_until_one_is_better(settings, sizes):
    rejected = search_of(TO, **settings)
    told = feed(rejected, [1.0, *[1.0] * len(sizes)])  # equal is no better
    np.testing.assert_allclose(points(told), [FIRST, *(FIRST + size * DIRECTION for size in sizes)])
    assert not rejected.rounds[0].accepted
    assert [step.step_size for step in rejected.rounds[0].steps] == pytest.approx(sizes)


def test_the_first_improvement_ends_the_round_and_is_where_the_next_begins():
    other = np.array([0.0, 0.0])
    search = search_of(TO, other)
    half = FIRST + DIRECTION / 2
    told = feed(search, [1.0, 2.0, 0.5, 3.0, 3.0])
    np.testing.assert_allclose(points(told), [FIRST, TO, half, other, half / 2])
    (done,) = search.rounds
    assert (done.accepted, [step.step_size for step in done.steps], done.incumbent.loss) == (True, [1.0, 0.5], 1.0)


def test_the_advisor_is_asked_once_per_round_and_shown_all_that_was():
    advisor = Watching([TO, 1 - FIRST, *(np.full(2, x) for x in (0.5, 0.7))])
    search = BacktrackingLineSearch(advisor, FIRST)
    # first point, a rejected round of three, an accepted one of two, an accepted one of one, one that is under way
    feed(search, [1.0, 2, 3, 4, 2, 0.9, 0.8, 2])
    assert [done.accepted for done in search.rounds] == [False, True, True]
    assert [len(done.steps) for done in search.rounds] == [3, 2, 1]
    assert [len(situation.rounds) for situation in advisor.shown] == [0, 1, 2, 3]
    assert [situation.incumbent.loss for situation in advisor.shown] == [1.0, 1.0, 0.9, 0.8]
    assert {situation.first.loss for situation in advisor.shown} == {1.0}
    (rejected,) = advisor.shown[1].rounds
    assert [(step.step_size, step.evaluation.loss) for step in rejected.steps] == [(1.0, 2), (0.5, 3), (0.25, 4)]
    np.testing.assert_array_equal(rejected.proposal.point, TO)
    assert [evaluation.detail["number"] for evaluation in advisor.shown[1].evaluations] == [0, 1, 2, 3]


def test_a_failed_evaluation_is_no_improvement_and_every_other_improves_on_it():
    search = search_of(TO)
    told = feed(search, [1.0, 0.1, 0.5], failed={1})
    np.testing.assert_allclose(points(told)[2], FIRST + DIRECTION / 2)
    assert search.rounds[0].steps[0].evaluation.failed
    search = search_of(TO)
    feed(search, [1.0, 3.0], failed={0})  # a large robot's loss may exceed that of a failure
    assert search.rounds[0].accepted


def test_steps_stay_in_the_cube_whatever_rounding_does():
    rng = np.random.default_rng(0)
    for _ in range(200):
        start, to = rng.choice([0.0, 1.0, 1e-17, 1 - 1e-16, 0.1, 0.3], (2, 6))
        told = points(feed(BacktrackingLineSearch(ScriptedAdvisor([to]), start), [1.0, 2, 2, 2]))
        assert np.all((told >= 0) & (told <= 1))


def test_notes_have_round_step_and_once_the_proposal_to_the_last_bit():
    proposal = Proposal(np.array([1 / 3, 0.1 + 0.2]), "too slow", "more thrust", {"tokens": [12, 3]})
    found = notes(feed(search_of(proposal, FIRST), [1.0, 2.0, 0.5, 0.4]))
    assert found[0] == {"source": "first point"}
    assert found[1] == {"source": "line search", "round": 1, "step_size": 1.0, "proposal": proposal.as_dict()}
    assert found[2] == {"source": "line search", "round": 1, "step_size": 0.5}
    assert (found[3]["round"], found[3]["step_size"]) == (2, 1.0)
    back = json.loads(json.dumps(found, allow_nan=False))
    assert back == [dict(note) for note in found]
    assert Proposal.from_dict(back[1]["proposal"]).as_dict() == proposal.as_dict()


def test_a_script_that_ends_says_so_and_an_advisor_that_gives_up_is_asked_again():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO], then=ScriptedAdvisor([TO, FIRST / 2])), FIRST, max_steps=1)
    np.testing.assert_array_equal(points(feed(search, [1.0, 2.0, 2.0]))[2], FIRST / 2)
    assert says(refusal(AdvisorError, search.ask), "the script has 2 proposals", "proposal 3 is due")

    class Moody(ScriptedAdvisor):
        calls = 0

        def propose(self, situation):
            self.calls += 1
            if self.calls == 1:
                raise AdvisorError("not now")
            return super().propose(situation)

    search = BacktrackingLineSearch(Moody([TO]), FIRST)
    feed(search, [1.0])
    assert refusal(AdvisorError, search.ask) == "not now"
    np.testing.assert_array_equal(search.ask().point, TO)


@pytest.mark.parametrize("advice", [Proposal(np.array([2.0, 0.0])), Measurement(np.array([0.5, 1.5]))])
def test_advice_outside_the_cube_is_refused(advice):
    search = search_of(advice)
    feed(search, [1.0])
    assert says(refusal(OptimizerError, search.ask), "a point must lie in the unit cube")
    assert says(refusal(OptimizerError, ScriptedAdvisor, [[0.5, 1.5]]), "a point must lie in the unit cube")


def test_measurements_are_evaluated_as_they_are_and_no_steps():
    advisor = Watching([BESIDE, ABOVE, TO, BESIDE])
    search = BacktrackingLineSearch(advisor, FIRST)
    told = feed(search, [1.0, 2.0, 3.0, 0.9, 5.0])
    np.testing.assert_array_equal(points(told), [FIRST, BESIDE.point, ABOVE.point, TO, BESIDE.point])
    assert notes(told, "source") == ["first point", *["measurement"] * 2, "line search", "measurement"]
    assert told[1].candidate.note == {"source": "measurement", "parameter": "a"}
    assert [len(shown.measurements) for shown in advisor.shown] == [0, 1, 2, 0]
    assert [e.loss for e in advisor.shown[-1].evaluations] == [1.0, 2.0, 3.0, 0.9]
    (done,) = search.rounds
    assert (len(done.measurements), len(done.steps), done.accepted) == (2, 1, True)


@pytest.mark.parametrize(("failed", "begun"), [(set(), BESIDE.point), ({1}, FIRST)])
def test_a_measurement_that_is_better_is_where_the_steps_begin_unless_it_failed(failed, begun):
    advisor = Watching([BESIDE, TO])
    told = feed(BacktrackingLineSearch(advisor, FIRST), [1.0, 0.5, 1.7, 1.6], failed)
    np.testing.assert_array_equal(advisor.shown[-1].incumbent.candidate.point, begun)
    np.testing.assert_allclose(points(told)[3], begun + (TO - begun) / 2)


@pytest.mark.parametrize("stop", [1, 2, 3, 4])
def test_a_record_replays_what_was_measured(stop):
    losses = [1.0, 0.9, 2.0, 0.8, 0.7, 1.5]
    script = [BESIDE, ABOVE, Proposal(TO, "slow", "more", {"n": 1}), Measurement(TO / 2), Proposal(FIRST)]
    whole = feed(search_of(*script), losses)
    entries = [{"point": e.candidate.point.tolist(), "note": dict(e.candidate.note)} for e in whole]
    recorded = recorded_advice(json.loads(json.dumps(entries))[:stop])
    again = feed(search_of(*recorded, *script[len(recorded) :]), losses)
    np.testing.assert_array_equal(points(again), points(whole))
    assert notes(again) == notes(whole)


class Reader(ScriptedAdvisor):
    """An advisor that reads residuals."""

    def __init__(self, advice):
        super().__init__(advice)
        self.needs_residual = True


def test_residuals_are_asked_for_where_the_advisor_reads_them():
    for advisor, needed in ((ScriptedAdvisor([TO]), False), (Reader([TO]), True)):
        for wrapped in (advisor, ScriptedAdvisor([TO], then=advisor)):
            assert BacktrackingLineSearch(wrapped, FIRST).needs_residual == needed


# several starts

STARTS = [np.array([x, 0.5]) for x in (0.1, 0.3, 0.5, 0.7, 0.9)]
FALSE, TRUE = [9.0, 9.0, 9.0], [0.5]  # losses of the steps of a round that fails, and of one that doesn't
# 1.0: two failures; 2.0: a gain, then two failures; 3.0: two failures; the gain of the second is the lowest
LOSSES = [5.0, 4.0, 1.0, 3.0, 2.0, *FALSE, *FALSE, *TRUE, *FALSE, *FALSE, *FALSE, *FALSE, *FALSE]


def test_a_search_that_fails_twice_gives_way_to_the_next_best_start_and_the_lowest_ends_the_run():
    advisor = Watching([np.array([0.1 * k, 0.5]) for k in range(9)])
    search = BacktrackingLineSearch(advisor, STARTS[0], more_starts=STARTS[1:])
    told = feed(search, LOSSES)
    np.testing.assert_array_equal(points(told[:5]), STARTS)
    assert notes(told[:6], "source") == ["first point", *["start"] * 4, "line search"]
    assert advisor.shown[0].incumbent is advisor.shown[0].first is told[2]
    assert [shown.incumbent.loss for shown in advisor.shown] == [1.0, 1.0, 2.0, 0.5, 0.5, 3.0, 3.0, 0.5]
    assert [len(shown.rounds) for shown in advisor.shown] == [0, 1, 0, 1, 2, 0, 1, 3]
    assert [shown.first.loss for shown in advisor.shown] == [1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 2.0]
    numbers = [note["round"] for note in notes(told) if "round" in note]
    assert numbers == sorted(numbers)
    assert (numbers[-1], len(search.rounds)) == (8, 4)
    # advice on record is taken again in every search, as in a run that goes on
    proposed = [note["proposal"]["point"] for note in notes(told) if "proposal" in note]
    np.testing.assert_allclose(proposed, [[0.1 * k, 0.5] for k in range(8)], atol=0)


def test_a_start_that_failed_is_searched_from_last():
    advisor = Watching([TO])
    feed(BacktrackingLineSearch(advisor, STARTS[0], more_starts=STARTS[1:2]), [0.1, 3.0, 1.0], failed={0})
    np.testing.assert_array_equal(advisor.shown[0].incumbent.candidate.point, STARTS[1])


# the search that asks again


NAMED = Proposal(
    TO, step_sizes=(0.5, 1.0), alternatives=(Proposal(np.zeros(2)), Proposal(np.ones(2), step_sizes=(0.1,)))
)


@pytest.mark.parametrize(
    ("advice", "losses", "tried"),
    [
        ([TO, FIRST / 2], [1.0, 2.0, 2.0], [TO, FIRST / 2]),  # asked again after a step that fails
        ([TO, FIRST / 2], [1.0, 11.0, 2.0, 2.0], [TO, FIRST + DIRECTION / 2, FIRST + DIRECTION / 4]),  # but for a jump
        ([NAMED, TO], [1.0, 2.0, 20.0, 20.0, 3.0], [FIRST + DIRECTION / 2, TO, [0, 0], FIRST / 2]),
        ([NAMED] * 3 + [TO], [1.0, 2.0] + [3.0] * 4, [FIRST + DIRECTION / 2, TO, [0, 0], [0.28, 0.82], TO]),
        ([NAMED, np.ones(2)], [1.0, 0.5, 3.0], [FIRST + DIRECTION / 2, [1, 1]]),  # alternatives of what failed alone
    ],
)
def test_a_step_that_fails_is_followed_by_what_the_advisor_says(advice, losses, tried):
    search = ProposalSearch(ScriptedAdvisor(advice), FIRST)
    np.testing.assert_allclose(points(feed(search, losses))[1:], tried)


@pytest.mark.parametrize("stop", range(1, 7))
def test_named_steps_and_alternatives_go_on_from_a_record(stop):
    def search(advisor):
        return ProposalSearch(advisor, FIRST)

    advice = [NAMED, NAMED, NAMED, TO]  # an alternative counts as advice
    whole = feed(search(ScriptedAdvisor(advice)), [1.0, 2.0, 3.0, 3.0, 3.0, 3.0])
    entries = [{"point": list(one.candidate.point), "note": dict(one.candidate.note)} for one in whole[:stop]]
    recorded = recorded_advice(json.loads(json.dumps(entries)))
    again = feed(search(ScriptedAdvisor(recorded, ScriptedAdvisor(advice))), [1.0, 2.0, 3.0, 3.0, 3.0, 3.0])
    np.testing.assert_array_equal(points(again), points(whole))
    assert notes(again) == notes(whole)
