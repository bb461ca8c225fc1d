"""The simulated VLM: as wrong as its settings say, repeatable, and better off with a line search."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated_vlm import SimulatedVlm, VlmErrors

from swim2real.errors import ArgumentError, ParameterError
from swim2real.optimizers import (
    BacktrackingLineSearch,
    Candidate,
    Evaluation,
    Proposal,
    Round,
    Situation,
    Step,
    first_point,
)
from swim2real.parameters import Parameter, ParameterSpace

EXACT = VlmErrors(overestimate=1.0, size_spread=0.0, noise=0.0, floor=0.0, conflation=0.0, wrong=0.0)


def space(dimension: int) -> ParameterSpace:
    return ParameterSpace(
        tuple(Parameter(f"p{i}", "-", 0.0, 10.0, "A number.", 5.0) for i in range(dimension)), "linear"
    )


def vlm(hidden, seed=0, errors=EXACT, alike=(), unseen=()) -> SimulatedVlm:
    room = space(len(hidden))
    return SimulatedVlm(room, room.to_values(hidden), seed, errors, alike, unseen)


def situation(point, rounds: int = 0) -> Situation:
    evaluation = Evaluation(Candidate(np.asarray(point, dtype=float)), 1.0)
    done = Round(Proposal(np.asarray(point, dtype=float)), evaluation, (Step(1.0, evaluation),), False)
    return Situation(evaluation, (done,) * rounds, evaluation)


def steps(advisors, here, rounds: int = 1) -> np.ndarray:
    """Proposed steps of several advisors in several rounds."""
    here = np.asarray(here, dtype=float)
    return np.array([a.propose(situation(here, n)).point - here for a in advisors for n in range(rounds)])


def test_without_errors_it_proposes_the_hidden_values():
    np.testing.assert_allclose(vlm([0.2, 0.9, 0.5]).propose(situation([0.7, 0.1, 0.5])).point, [0.2, 0.9, 0.5])


def test_the_seed_and_the_round_decide_all_that_is_random():
    here, hidden = np.full(4, 0.3), np.full(4, 0.6)
    again = [vlm(hidden, 3, VlmErrors()).propose(situation(here, 2)).as_dict() for _ in range(2)]
    assert again[0] == again[1]
    one = vlm(hidden, 3, VlmErrors())
    later, earlier = (one.propose(situation(here, n)).as_dict() for n in (2, 0))  # asked in another order
    assert later == again[0]
    assert earlier != later
    assert vlm(hidden, 4, VlmErrors()).propose(situation(here, 2)).as_dict() != again[0]


@given(
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=2, max_size=20), st.integers(0, 2**32),
    st.floats(0.1, 10), st.floats(0, 5), st.floats(0, 1),
)  # fmt: skip
def test_it_stays_within_the_cube_and_its_words_can_be_read(points, seed, overestimate, noise, share):
    here, hidden = np.array(points).T
    errors = VlmErrors(overestimate, 0.5, noise, 0.05, share, 3.0, share)
    proposal = vlm(hidden, seed, errors, [("p0", "p1")], ["p0"]).propose(situation(here))
    assert np.all((proposal.point >= 0) & (proposal.point <= 1))
    json.dumps(proposal.as_dict(), allow_nan=False)
    for text in (proposal.diagnosis, proposal.reasoning):
        assert text[0].isupper()
        assert text.endswith(".")


@pytest.mark.parametrize("overestimate", [0.5, 1.0, 2.0, 4.0])
def test_the_mean_step_along_the_true_difference_is_the_overestimate(overestimate):
    rng = np.random.default_rng(1)
    difference = rng.uniform(-0.02, 0.02, 16)  # so short that nothing is clipped
    here = np.full(16, 0.5)
    errors = VlmErrors(overestimate, noise=1.0, floor=0.0, conflation=0.0, wrong=0.0, size_spread=0.3)
    taken = steps([vlm(here + difference, seed, errors) for seed in range(100)], here, rounds=10)
    along = taken @ difference / (difference @ difference)
    # the mean of the size is exp(0.3² / 2)
    assert np.mean(along) == pytest.approx(overestimate * np.exp(0.045), rel=0.05)
    lengths = np.linalg.norm(taken, axis=1) / np.linalg.norm(difference)
    assert np.mean(lengths) == pytest.approx(overestimate * np.exp(0.045) * np.sqrt(2), rel=0.05)


def toy(advisor, max_steps: int, seed: int, hidden, budget: int = 40) -> tuple[float, float]:
    """Rate of accepted rounds, and the distance that is left, with a quadratic loss."""
    first = first_point(2, seed)
    search = BacktrackingLineSearch(advisor, first, max_steps=max_steps)
    losses = []
    for _ in range(budget):
        candidate = search.ask()
        losses.append(float(np.sum((candidate.point - hidden) ** 2)))
        search.tell(Evaluation(candidate, losses[-1]))
    return float(np.mean([r.accepted for r in search.rounds])), float(np.sqrt(min(losses)))


def test_with_a_line_search_more_rounds_are_accepted():
    hidden, errors = np.array([0.4, 0.7]), VlmErrors(overestimate=2.5, noise=0.5, floor=1e-4)
    found = {
        steps: np.array([toy(vlm(hidden, seed, errors), steps, seed, hidden) for seed in range(20)]) for steps in (1, 3)
    }
    without, with_search = found[1].mean(axis=0), found[3].mean(axis=0)
    assert with_search[0] > 2 * without[0]
    assert with_search[1] < 0.01


def test_names_and_groups_are_checked():
    with pytest.raises(ParameterError, match="px"):
        vlm([0.5, 0.5], alike=[("p0", "px")])
    with pytest.raises(ParameterError, match="px"):
        vlm([0.5, 0.5], unseen=["px"])
    with pytest.raises(ArgumentError, match=r"has the parameters \['p0'\]; it needs two or more"):
        vlm([0.5, 0.5], alike=[("p0",)])
    with pytest.raises(ArgumentError, match="'p0' is in groups that look alike 2 times, not once"):
        vlm([0.5, 0.5, 0.5], alike=[("p0", "p1"), ("p0", "p2")])
    with pytest.raises(ArgumentError, match="seed is -1; it must be a whole number from 0 on"):
        vlm([0.5, 0.5], seed=-1)
