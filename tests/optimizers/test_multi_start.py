"""Least squares in stages from several starts: their order, groups and stages, and the end."""

import numpy as np
import pytest
from driving import answered, drive, lowest, notes, points, staged

from swim2real.optimizers import Evaluation, MultiStart, streams
from swim2real.optimizers.enough import Sizes
from swimbase.errors import OptimizerError

D = 3
GOAL = np.array([0.3, 0.8, 0.55])
MIDDLE = np.full(D, 0.5)


def linear(point: np.ndarray) -> np.ndarray:
    return (np.eye(D) + 0.3 * np.ones((D, D))) @ (point - GOAL)


def searched(count, stages, starts=(MIDDLE,), failed=lambda i: False) -> list[Evaluation]:
    """Evaluations by stages of the residual as a function of the point; the loss is the last stage's length."""

    def answer(i, candidate):
        if failed(i):
            return Evaluation(candidate, 1.0, True)
        vectors = tuple(stages(candidate.point))
        return Evaluation(candidate, float(np.linalg.norm(vectors[-1])), stages=staged(*vectors))

    return answered(MultiStart(starts, streams(0)[1]), count, answer)


def walled(point):
    """Body, body with a bounded way, whole, loss: beyond a border all but the body gets worse."""
    body, way = linear(point)[:1], linear(point)[1:] + (2.0 if point[2] > 0.75 else 0.0)
    whole = np.concatenate([body, way, [0.001]])
    return body, np.concatenate([body, np.clip(way, -0.1, 0.1)]), whole, whole


def test_a_linear_residual_is_solved_within_a_few_steps():
    told = drive(MultiStart([MIDDLE], streams(0)[1]), 30, linear)
    assert notes(told[: 2 + D], "source") == ["first point", "start"] + ["spread"] * D
    assert lowest(told) < 0.02 * told[0].loss


def test_starts_that_swim_best_go_first_then_the_nearest_bodies_half_of_them_closer_one_of_them_to_the_end():
    starts = [np.full(D, share) for share in (0.1, 0.9, 0.4, 0.6, 0.25, 0.7, 0.95, 0.05)]
    told = searched(900, walled, starts)
    np.testing.assert_array_equal(points(told[:8]), starts)
    lengths = np.array([[np.linalg.norm(one.stages[stage][0]) for stage in (0, 1)] for one in told[:8]])
    eased = list(np.argsort(lengths[:, 1])[:2] + 1)
    bodies = [number for number in np.argsort(lengths[:, 0]) + 1 if number not in eased][:4]
    begun = notes(told)[8:]
    assert {note["start"] for note in begun[: 2 * D]} == set(eased)
    formed = next(k for k, note in enumerate(begun) if note["start"] in bodies)
    assert {note.get("stage", 2) for note in begun[:formed]} == {2, 3, 4}
    assert {note["start"] for note in begun[formed : formed + 4 * D]} == set(bodies)
    first = next(k for k, note in enumerate(begun) if note["source"] == "alike")
    closer = begun[first]["start"]
    spread = [note["start"] for note in begun[formed:first] if note["source"] == "spread" and "stage" not in note]
    assert sorted(spread.count(number) for number in bodies) == [D, D, 2 * D, 2 * D]
    assert spread.count(closer) == 2 * D
    steps = [(note["start"], note["stage"]) for note in begun if note["source"] == "step"]
    assert {start for start, stage in steps if stage == 1} >= set(bodies)
    assert {start for start, _ in steps[: next(k for k, (_, stage) in enumerate(steps) if stage == 3)]} == set(eased)
    later = dict.fromkeys(start for start, _ in steps[steps.index((closer, 2)) :] if start not in {closer, *eased})
    assert set(list(later)[:2]) == set(range(1, 9)) - {*eased, *bodies}
    assert {note["stage"] for note in notes(told) if note.get("last")} == {4}
    assert lowest(told) < 0.01


def test_a_descent_on_what_is_smooth_ends_after_fewer_vain_steps():
    lasts = []
    for smooth in (False, True):
        told = drive(MultiStart([MIDDLE], streams(0)[1], smooth), 200, lambda p: np.append(linear(p), 0.5))
        lasts.append(next(k for k, note in enumerate(notes(told)) if note.get("last")))
    assert lasts[1] < 0.95 * lasts[0]


def test_starts_that_failed_are_passed_over_and_random_ones_follow_the_last():
    told = searched(60, lambda p: (linear(p),) * 2, [MIDDLE, np.full(D, 0.2)], failed=lambda i: i < 4)
    assert notes(told[:7], "start") == [None, 2, 3, 4, 5, 6, 5]
    assert not np.array_equal(points(told)[3], points(told)[2])


def test_a_simulator_that_fails_nine_times_in_ten_and_forty_parameters_are_searched():
    told = searched(400, lambda p: (linear(p),) * 2, failed=lambda i: i % 10 != 0)
    assert lowest(told) < 0.3 * float(np.linalg.norm(linear(MIDDLE)))
    wide = drive(MultiStart([np.full(40, 0.5)], streams(0)[1]), 120, lambda p: p - np.linspace(0.1, 0.9, 40))
    assert lowest(wide) < 0.02 * wide[0].loss


def test_what_comes_next_whatever_the_evaluations_are_is_known():
    optimizer = MultiStart([MIDDLE, np.full(D, 0.2)], streams(0)[1])
    answered(optimizer, 2, lambda i, one: Evaluation(one, 1.0, stages=staged(linear(one.point))))
    assert optimizer.upcoming() == ()
    first = optimizer.ask()
    ahead = optimizer.upcoming()
    assert [one.note["start"] for one in (first, *ahead)] == [1, 1, 1, 2, 2, 2]  # two starts at the same time
    optimizer.tell(Evaluation(first, 1.0, True))
    assert optimizer.ask() is ahead[0]


def test_a_start_and_stages_are_needed():
    with pytest.raises(OptimizerError, match="starts is empty; give one point at least"):
        MultiStart([], streams(0)[1])
    with pytest.raises(OptimizerError, match="without stages of its residual, which multi-start needs"):
        answered(MultiStart([MIDDLE], streams(0)[1]), 1, lambda i, one: Evaluation(one, 1.0))


def driven_until_done(optimizer, loss):
    """Evaluations that it made."""
    asked = 0
    while not optimizer.done:
        one = optimizer.ask()
        residual = np.append(linear(one.point), loss(one))
        optimizer.tell(Evaluation(one, float(np.linalg.norm(residual)), stages=staged(residual)))
        asked += 1
        assert asked < 2000
    return asked


def test_it_is_done_when_ends_agree_or_another_start_would_hardly_pay():
    agreed = MultiStart([MIDDLE, np.full(D, 0.2)], streams(0)[1])
    assert agreed.left > 1
    driven_until_done(agreed, lambda one: 0.01)
    assert (agreed.conclusion, agreed.gave_up) == ("5 of 5 starts agree", False)
    apart = MultiStart([MIDDLE], streams(0)[1])
    driven_until_done(apart, lambda one: 0.01 + 0.005 * (7 * one.note.get("start", 1) % 11))
    assert 4 <= len(apart.ends) <= 12
    alone = MultiStart([MIDDLE], streams(0)[1], sizes=Sizes(0.0, 3.0))
    driven_until_done(alone, lambda one: 0.01)
    assert len(alone.ends) == 1


def test_it_gives_up_after_many_evaluations():
    endless = MultiStart([MIDDLE], streams(0)[1])
    made = driven_until_done(endless, lambda one: 10.0 * 0.9 ** one.note.get("start", 1))
    assert (endless.gave_up, endless.conclusion) == (True, f"{made} evaluations are the most of a search")


def test_a_start_that_is_known_to_be_good_is_followed_before_the_others_are_evaluated():
    starts = [MIDDLE, *np.random.default_rng(0).random((5, D))]
    optimizer = MultiStart(starts, streams(0)[1], led=True)
    told = answered(optimizer, 200, lambda i, one: Evaluation(one, 1.0 + i, stages=staged(linear(one.point))))
    begun = [note["source"] for note in notes(told)].index("start")
    assert {note.get("start", 1) for note in notes(told[:begun])} == {1}
    assert any(note.get("last") for note in notes(told[:begun]))
    np.testing.assert_array_equal(points(told[begun : begun + 5]), starts[1:])


def decoyed(point, leads):
    """Stages of two trials; the second one's residual is least far from the goal, but for a narrow space around it."""
    first = 0.1 * linear(point)
    near = np.abs(point - GOAL).max() < 0.03
    second = (point - GOAL) if near else 0.3 + np.abs(point - np.array([0.9, 0.2, 0.1]))
    whole = np.concatenate([first, second])
    lengths = np.maximum([np.linalg.norm(first), np.linalg.norm(second)], 1e-3)
    weights = [np.repeat(one, D) for one in ((1.0, 1e-3), np.sqrt(np.sqrt(np.prod(lengths))) / lengths)]
    led = [(whole, weights[0])] * 3 + [(whole, weights[1])]
    return (*(led if leads else []), *staged(*[whole] * 4))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("leads", [False, True])
def test_trials_that_are_explained_lead_to_where_others_are_explained_as_well(leads, seed):
    def answer(i, candidate):
        stages = decoyed(candidate.point, leads)
        return Evaluation(candidate, float(np.linalg.norm(stages[-1][0])), stages=stages)

    told = answered(MultiStart([MIDDLE, np.full(D, 0.2)], streams(seed)[1]), 550, answer)
    assert (lowest(told) < 0.01) == leads
