"""Evidence that a search is done."""

import itertools

import numpy as np
import pytest

from swim2real.optimizers.enough import Sizes, agreeing, conclusion, expected_gain


@pytest.mark.parametrize("count", [2, 3, 5, 6])
def test_the_expected_gain_is_that_of_all_ways_to_halve_the_starts(count):
    ends = np.random.default_rng(count).random(count)
    halves = list(itertools.combinations(ends, (count + 1) // 2))
    missed = np.mean([min(half) for half in halves]) - min(ends)
    assert expected_gain(ends) == pytest.approx(missed / (count - (count + 1) // 2))


def test_no_start_gains_more_on_average_than_is_expected():
    """Of ends that are drawn from one distribution, whatever it is."""
    rng = np.random.default_rng(0)
    for draw in (rng.random, rng.exponential, lambda size: np.round(rng.normal(3, 1, size=size), 1)):
        drawn = draw(size=(4000, 7))
        lowest = drawn[:, :6].min(axis=1)
        gains = np.maximum(lowest - drawn[:, 6], 0)
        assert (
            gains.mean() <= np.mean([expected_gain(list(ends)) for ends in drawn[:, :6]]) + 3 * gains.std() / 4000**0.5
        )


@pytest.mark.parametrize(("ends", "sizes", "said"), [
    ([], Sizes(), ""),
    ([0.003], Sizes(0.0002, 0.2), ""),
    ([0.0021], Sizes(0.0002, 0.2), "too little is left unexplained for another start"),
    ([0.0024, 0.03], Sizes(0.0002, 0.2), "too little is left unexplained for another start"),
    ([0.0028, 0.03], Sizes(0.0002, 0.2), ""),
    ([0.002, 0.03], Sizes(0.0002, 0.4), "too little is left unexplained for another start"),
    ([0.0038, 0.0039], Sizes(0.0002, 0.2), "2 of 2 starts agree"),
    ([0.03, 0.031], Sizes(0.0002, 0.2), ""),
    ([0.03, 0.031, 0.05], Sizes(0.0002, 0.2), ""),
    ([0.03, 0.0305, 0.031, 0.032, 0.05], Sizes(0.0002, 0.2), "4 of 5 starts agree"),
    ([0.03, 0.031, 0.04, 0.05, 0.06], Sizes(0.0002, 0.2), ""),
    ([0.03, *np.linspace(0.0334, 0.06, 9)], Sizes(0.0002, 0.2), "would hardly lower the loss, by the 10 that"),
], ids=["none", "one", "one that explains", "two that nearly do", "two that don't", "two, of large motion",
        "two that explain agree", "two far off agree", "two of three agree", "five", "apart", "many"])  # fmt: skip
def test_another_start_is_worth_its_evaluations_or_not(ends, sizes, said):
    assert said in conclusion(ends, sizes)
    assert bool(said) == bool(conclusion(ends, sizes))


def test_ends_agree_within_a_tenth():
    assert agreeing([0.010, 0.0109, 0.02]) == 2
