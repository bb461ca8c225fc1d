"""Advisors that have points measured before they propose."""

import json

import numpy as np
import pytest
from watching import Watching

from swim2real.errors import OptimizerError
from swim2real.optimizers import (
    BacktrackingLineSearch,
    Evaluation,
    Measurement,
    Proposal,
    ScriptedAdvisor,
    recorded_advice,
)

FIRST = np.array([0.2, 0.8])
BESIDE = Measurement(np.array([0.3, 0.8]), {"parameter": "a"})
ABOVE = Measurement(np.array([0.2, 0.9]))
TO = np.array([1.0, 0.4])


def feed(optimizer, losses, failed=()):
    evaluations = []
    for i, loss in enumerate(losses):
        evaluations.append(Evaluation(optimizer.ask(), loss, i in failed))
        optimizer.tell(evaluations[-1])
    return evaluations


def points(evaluations):
    return np.array([evaluation.candidate.point for evaluation in evaluations])


def test_measurements_are_evaluated_as_they_are_and_no_steps():
    advisor = Watching([BESIDE, ABOVE, TO])
    search = BacktrackingLineSearch(advisor, FIRST)
    told = feed(search, [1.0, 2.0, 3.0, 0.9])
    np.testing.assert_array_equal(points(told), [FIRST, BESIDE.point, ABOVE.point, TO])
    assert [e.candidate.note["source"] for e in told] == ["first point", "measurement", "measurement", "line search"]
    assert told[1].candidate.note == {"source": "measurement", "parameter": "a"}
    assert [len(shown.measurements) for shown in advisor.shown] == [0, 1, 2]
    assert [e.loss for e in advisor.shown[-1].evaluations] == [1.0, 2.0, 3.0]
    (done,) = search.rounds
    assert (len(done.measurements), len(done.steps), done.accepted) == (2, 1, True)


def test_a_step_along_one_parameter_is_a_measurement_of_it():
    step = Measurement.of_one(FIRST, 1, "b", -0.1)
    np.testing.assert_allclose(step.point, [0.2, 0.7])
    assert step.candidate.note == {"source": "measurement", "parameter": "b"}


def test_evaluations_stay_in_order_over_rounds():
    advisor = Watching([BESIDE, TO, ABOVE, TO])
    search = BacktrackingLineSearch(advisor, FIRST, max_steps=2)
    told = feed(search, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert [e.loss for e in advisor.shown[-1].evaluations] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert [e.loss for e in advisor.shown[-1].measurements] == [5.0]
    assert [e.candidate.note.get("round") for e in told] == [None, None, 1, 1, None, 2]


def test_a_measurement_that_is_better_is_where_the_steps_begin():
    advisor = Watching([BESIDE, TO])
    search = BacktrackingLineSearch(advisor, FIRST)
    told = feed(search, [1.0, 0.5, 0.7, 0.6])
    assert advisor.shown[-1].incumbent.loss == 0.5
    np.testing.assert_allclose(points(told)[3], BESIDE.point + (TO - BESIDE.point) / 2)


def test_a_measurement_that_failed_is_none():
    advisor = Watching([BESIDE, TO])
    feed(BacktrackingLineSearch(advisor, FIRST), [1.0, 0.5, 0.7], failed={1})
    assert advisor.shown[-1].incumbent.loss == 1.0
    assert advisor.shown[-1].measurements[0].failed


def test_a_measurement_outside_the_cube_is_refused():
    search = BacktrackingLineSearch(ScriptedAdvisor([Measurement(np.array([0.5, 1.5]))]), FIRST)
    feed(search, [1.0])
    with pytest.raises(OptimizerError, match="a point must lie in the unit cube"):
        search.ask()


@pytest.mark.parametrize("stop", [1, 2, 3, 4])
def test_a_record_replays_what_was_measured(stop):
    losses = [1.0, 0.9, 2.0, 0.8, 0.7, 1.5]
    script = [BESIDE, ABOVE, Proposal(TO, "slow", "more", {"n": 1}), Measurement(TO / 2), Proposal(FIRST)]

    def make(advice):
        return BacktrackingLineSearch(ScriptedAdvisor(advice), FIRST)

    whole = feed(make(script), losses)
    entries = [{"point": e.candidate.point.tolist(), "note": dict(e.candidate.note)} for e in whole]
    recorded = recorded_advice(json.loads(json.dumps(entries))[:stop])
    again = feed(make([*recorded, *script[len(recorded) :]]), losses)
    np.testing.assert_array_equal(points(again), points(whole))
    assert [e.candidate.note for e in again] == [e.candidate.note for e in whole]


class Reader(ScriptedAdvisor):
    """An advisor that reads residuals."""

    def __init__(self, advice):
        super().__init__(advice)
        self.needs_residual = True


def test_residuals_are_asked_for_where_the_advisor_reads_them():
    for advisor, needed in ((ScriptedAdvisor([TO]), False), (Reader([TO]), True)):
        for wrapped in (advisor, ScriptedAdvisor([TO], then=advisor)):
            assert BacktrackingLineSearch(wrapped, FIRST).needs_residual == needed


def test_anything_that_didnt_fail_is_better_than_a_first_point_that_did():
    advisor = Watching([BESIDE, TO])
    search = BacktrackingLineSearch(advisor, FIRST)
    feed(search, [1.0, 3.0, 2.0], failed={0})  # a large robot's loss may exceed that of a failure
    assert advisor.shown[-1].incumbent.loss == 3.0
    assert search.rounds[0].accepted
