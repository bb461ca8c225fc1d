import json

import numpy as np
import pytest
from watching import Watching

from swim2real.errors import AdvisorError, OptimizerError
from swim2real.optimizers import (
    BacktrackingLineSearch,
    Evaluation,
    Proposal,
    RandomSearch,
    ScriptedAdvisor,
)

FIRST = np.array([0.2, 0.8])
TO = np.array([1.0, 0.4])
DIRECTION = TO - FIRST


def feed(optimizer, losses, failed=()):
    """Tells losses in turn, and gives the candidates that were asked."""
    candidates = []
    for i, loss in enumerate(losses):
        candidate = optimizer.ask()
        candidates.append(candidate)
        optimizer.tell(Evaluation(candidate, loss, i in failed, {"number": i}))
    return candidates


def points(candidates):
    return np.array([candidate.point for candidate in candidates])


def test_the_steps_are_one_half_a_quarter_along_the_proposal():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO]), FIRST)
    asked = feed(search, [1.0, 2.0, 2.0, 2.0])
    np.testing.assert_allclose(points(asked), [FIRST, TO, FIRST + DIRECTION / 2, FIRST + DIRECTION / 4])


def test_the_first_improvement_ends_the_round_and_is_where_the_next_begins():
    other = np.array([0.0, 0.0])
    search = BacktrackingLineSearch(ScriptedAdvisor([TO, other]), FIRST)
    asked = feed(search, [1.0, 2.0, 0.5, 3.0, 3.0])
    half = FIRST + DIRECTION / 2
    np.testing.assert_allclose(points(asked), [FIRST, TO, half, other, half / 2])
    (done,) = search.rounds
    assert done.accepted
    assert [step.step_size for step in done.steps] == [1.0, 0.5]
    assert done.incumbent.loss == 1.0


def test_a_rejected_round_is_in_the_history_and_the_incumbent_stays():
    advisor = Watching([TO, 1 - FIRST])
    search = BacktrackingLineSearch(advisor, FIRST)
    feed(search, [1.0, 2.0, 3.0, 4.0, 0.5])
    assert [done.accepted for done in search.rounds] == [False, True]
    second = advisor.shown[1]
    assert second.incumbent.loss == 1.0
    np.testing.assert_array_equal(second.incumbent.candidate.point, FIRST)
    (rejected,) = second.rounds
    assert [(step.step_size, step.evaluation.loss) for step in rejected.steps] == [(1.0, 2.0), (0.5, 3.0), (0.25, 4.0)]
    np.testing.assert_array_equal(rejected.proposal.point, TO)
    assert [evaluation.loss for evaluation in second.evaluations] == [1.0, 2.0, 3.0, 4.0]
    assert second.evaluations[2].detail == {"number": 2}


def test_an_equal_loss_is_no_improvement():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO]), FIRST)
    asked = feed(search, [1.0, 1.0, 1.0, 1.0])
    assert len(asked) == 4
    assert not search.rounds[0].accepted


def test_a_failed_evaluation_is_no_improvement_however_low_its_loss():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO]), FIRST)
    asked = feed(search, [1.0, 0.1, 0.5], failed={1})
    np.testing.assert_allclose(points(asked)[2], FIRST + DIRECTION / 2)
    assert search.rounds[0].accepted
    assert search.rounds[0].steps[0].evaluation.failed


def test_a_failed_first_point_is_improved_upon():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO]), FIRST)
    feed(search, [1.0, 0.9], failed={0})
    assert search.rounds[0].accepted


def test_every_step_is_an_evaluation_and_the_advisor_is_asked_once_a_round():
    advisor = Watching([np.full(2, x) for x in (0.1, 0.3, 0.5, 0.7)])
    search = BacktrackingLineSearch(advisor, FIRST)
    # first point, a rejected round of three, an accepted one of two, an accepted one of one, one that is under way
    feed(search, [1.0, 2, 2, 2, 2, 0.9, 0.8, 2])
    assert len(advisor.shown) == 4
    assert [len(done.steps) for done in search.rounds] == [3, 2, 1]
    assert [len(situation.rounds) for situation in advisor.shown] == [0, 1, 2, 3]
    assert advisor.shown[3].incumbent.loss == 0.8
    assert advisor.shown[3].first.loss == 1.0


def test_max_steps_one_is_the_ablation_without_line_search():
    proposals = [TO, np.array([0.5, 0.5]), np.array([0.9, 0.9])]
    search = BacktrackingLineSearch(ScriptedAdvisor(proposals), FIRST, max_steps=1)
    asked = feed(search, [1.0, 2.0, 0.5, 0.7])
    np.testing.assert_array_equal(points(asked), [FIRST, *proposals])
    assert [done.accepted for done in search.rounds] == [False, True, False]


def test_another_decrease_factor_shrinks_by_its_powers():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO]), FIRST, decrease_factor=0.1, max_steps=4)
    asked = feed(search, [1.0, 2, 2, 2, 2])
    np.testing.assert_allclose(points(asked)[1:], [FIRST + DIRECTION * 0.1**k for k in range(4)])


def test_steps_stay_in_the_cube_whatever_rounding_does():
    rng = np.random.default_rng(0)
    for _ in range(200):
        start, to = rng.choice([0.0, 1.0, 1e-17, 1 - 1e-16, 0.1, 0.3], (2, 6))
        search = BacktrackingLineSearch(ScriptedAdvisor([to]), start)
        for candidate in feed(search, [1.0, 2, 2, 2]):
            assert np.all((candidate.point >= 0) & (candidate.point <= 1))


def test_notes_tell_round_step_and_once_the_proposal():
    proposal = Proposal(TO, "too slow", "more thrust", {"tokens": 12})
    search = BacktrackingLineSearch(ScriptedAdvisor([proposal, FIRST]), FIRST)
    notes = [candidate.note for candidate in feed(search, [1.0, 2.0, 0.5, 0.4])]
    assert notes[0] == {"source": "first point"}
    assert notes[1] == {"source": "line search", "round": 1, "step_size": 1.0, "proposal": proposal.as_dict()}
    assert notes[2] == {"source": "line search", "round": 1, "step_size": 0.5}
    assert (notes[3]["round"], notes[3]["step_size"]) == (2, 1.0)
    assert json.loads(json.dumps(notes, allow_nan=False)) == [dict(note) for note in notes]


def test_a_proposal_survives_json_to_the_last_bit():
    proposal = Proposal(np.array([1 / 3, 0.1 + 0.2]), "a", "b", {"n": [1, 2]})
    back = Proposal.from_dict(json.loads(json.dumps(proposal.as_dict())))
    np.testing.assert_array_equal(back.point, proposal.point)
    assert (back.diagnosis, back.reasoning, back.notes) == ("a", "b", {"n": [1, 2]})


def test_a_script_that_ends_says_so_or_passes_on():
    search = BacktrackingLineSearch(ScriptedAdvisor([TO], then=ScriptedAdvisor([TO, FIRST / 2])), FIRST, max_steps=1)
    np.testing.assert_array_equal(points(feed(search, [1.0, 2.0, 2.0]))[2], FIRST / 2)
    with pytest.raises(AdvisorError, match="the script has 2 proposals; proposal 3 is due"):
        search.ask()


def test_an_advisor_that_gives_up_can_be_asked_again():
    class Moody(ScriptedAdvisor):
        calls = 0

        def propose(self, situation):
            self.calls += 1
            if self.calls == 1:
                raise AdvisorError("not now")
            return super().propose(situation)

    search = BacktrackingLineSearch(Moody([TO]), FIRST)
    feed(search, [1.0])
    with pytest.raises(AdvisorError, match="not now"):
        search.ask()
    np.testing.assert_array_equal(search.ask().point, TO)


def test_a_proposal_outside_the_cube_is_refused():
    with pytest.raises(OptimizerError, match="a point must lie in the unit cube"):
        ScriptedAdvisor([[0.5, 1.5]])
    search = BacktrackingLineSearch(ScriptedAdvisor([Proposal(np.array([2.0, 0.0]))]), FIRST)
    feed(search, [1.0])
    with pytest.raises(OptimizerError, match="a point must lie in the unit cube"):
        search.ask()


@pytest.mark.parametrize("factor", [0.0, 1.0, -0.5, 2.0, np.nan])
def test_a_decrease_factor_out_of_range_is_refused(factor):
    with pytest.raises(OptimizerError, match=f"decrease_factor is {factor}; it must lie between 0 and 1"):
        BacktrackingLineSearch(ScriptedAdvisor([]), FIRST, decrease_factor=factor)


def test_no_steps_are_refused():
    with pytest.raises(OptimizerError, match="max_steps is 0; it must be at least 1"):
        BacktrackingLineSearch(ScriptedAdvisor([]), FIRST, max_steps=0)


# the other two


def test_random_search_samples_the_whole_cube_evenly():
    search = RandomSearch(3, np.random.default_rng(0))
    sampled = points(feed(search, np.ones(600)))
    assert np.all((sampled >= 0) & (sampled < 1))
    np.testing.assert_allclose(sampled.mean(axis=0), 0.5, atol=0.05)
    np.testing.assert_allclose(sampled.std(axis=0), np.sqrt(1 / 12), atol=0.02)
