"""Whether a run was still getting better when its budget was spent."""

from types import SimpleNamespace

import pytest

from swim2real.calibration.convergence import best_losses, never_beaten, still_falling
from swim2real.settings import CalibrationSettings

FAILED = None


def entries(*losses):
    return [SimpleNamespace(failed=loss is FAILED, loss=1.0 if loss is FAILED else loss) for loss in losses]


def settings(budget, method="line-search"):
    return CalibrationSettings(budget=max(budget, 1), method=method)


def test_a_lower_loss_in_the_last_quarter_is_told_with_what_to_do():
    fell = entries(9, 5, 4, 6, 4, 5, 4.5, 3)
    says = "the loss was still falling: 25 % lower in the last quarter of the budget; raise --budget and add --resume"
    assert (still_falling(fell, settings(8)) or "").startswith(says)
    assert best_losses(entries(FAILED, 2.0, FAILED, 0.5)) == [1.0, 2.0, 2.0, 0.5]
    assert "90 % lower" in (still_falling(entries(FAILED, FAILED, FAILED, 0.1), settings(4)) or "")


@pytest.mark.parametrize(("found", "budget"), [
    (entries(9, 5, 4, 6, 4, 3, 4.5, 3), 8),
    (entries(9, 5, 4, 6, 4, 5, 4.5, 3.81), 8),
    (entries(9, 5, 4, 6, 4, 5, 4.5, 3), 12),
    (entries(9, 5, 1), 3),
    (entries(FAILED, FAILED, FAILED, FAILED), 4),
    ([], 0),
], ids=["fell before", "fell by less than 5 %", "budget not spent", "too short", "all failed", "nothing"])  # fmt: skip
def test_nothing_is_told_of_any_other_run(found, budget):
    assert still_falling(found, settings(budget)) is None


def by(source, count, lowest):
    """Evaluations whose best is a point of a source."""
    losses = [5.0] * count
    losses[lowest] = 1.0
    sources = ["first point", *["start"] * 3, *["line search"] * count]
    sources[lowest] = source
    return [
        SimpleNamespace(index=i, failed=False, loss=loss, at_most=loss, note=SimpleNamespace(source=sources[i]))
        for i, loss in enumerate(losses)
    ]


def test_a_search_that_hasnt_beaten_its_own_first_points_is_told_with_what_to_do():
    told = never_beaten(by("start", 12, 2), settings(12))
    assert told.startswith("the search hasn't beaten its own first points: the best of 12 is evaluation 3, which no ")
    assert "--seeds 0:3" in told
    assert never_beaten(by("line search", 12, 8), settings(12)) is None
    assert never_beaten(by("start", 12, 2), settings(13)) is None  # it goes on
    assert never_beaten(by("start", 9, 2), settings(9)) is None  # too short
    assert never_beaten(by("start", 12, 2), settings(12, "random")) is None  # it doesn't search
