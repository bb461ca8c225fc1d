"""Whether a run was still getting better when its budget was spent."""

import pytest

from swim2real.calibration.run_folder import best_losses, still_falling

FAILED = None


def entries(*losses):
    return [{"failed": loss is FAILED, "loss": 1.0 if loss is FAILED else loss} for loss in losses]


def settings(budget, method="line-search"):
    return {"budget": budget, "method": method}


def test_a_lower_loss_in_the_last_quarter_is_told_with_what_to_do():
    fell = entries(9, 5, 4, 6, 4, 5, 4.5, 3)
    says = "the loss was still falling: 25 % lower in the last quarter of the budget; raise --budget and add --resume"
    assert still_falling(fell, settings(8)) == says
    anew = "; begin a new run with a higher --budget"
    assert (still_falling(fell, settings(8, "staged")) or "").endswith(anew)


@pytest.mark.parametrize(
    ("found", "budget"),
    [
        (entries(9, 5, 4, 6, 4, 3, 4.5, 3), 8),
        (entries(9, 5, 4, 6, 4, 5, 4.5, 3.81), 8),
        (entries(9, 5, 4, 6, 4, 5, 4.5, 3), 12),
        (entries(9, 5, 1), 3),
        (entries(FAILED, FAILED, FAILED, FAILED), 4),
        ([], 0),
    ],
    ids=["fell before", "fell by less than 5 %", "budget not spent", "too short", "all failed", "nothing"],
)
def test_nothing_is_told_of_any_other_run(found, budget):
    assert still_falling(found, settings(budget)) is None


def test_the_first_that_doesnt_fail_late_counts_as_falling():
    assert best_losses(entries(FAILED, 2.0, FAILED, 0.5)) == [1.0, 2.0, 2.0, 0.5]
    assert "90 % lower" in (still_falling(entries(FAILED, FAILED, FAILED, 0.1), settings(4)) or "")
