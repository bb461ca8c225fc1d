"""Whether a run has found what it could: what a record tells of it, in a sentence with what to do."""

from __future__ import annotations

from collections.abc import Sequence

from swim2real.calibration.file_models import RecordedEvaluation
from swim2real.settings import CalibrationSettings

_FALLING = 0.05  # of the loss, by which the last quarter of the budget may lower it in a run that has converged
_FEW = 10  # evaluations of which nothing is said
_SPREAD = ("first point", "start", "initial")  # sources of points that no search has proposed


def best_losses(entries: Sequence[RecordedEvaluation]) -> list[float]:
    """Loss of the incumbent after each evaluation [m]; that of a failure as long as all failed."""
    losses: list[float] = []
    best: float | None = None
    for entry in entries:
        if not entry.failed:
            best = entry.loss if best is None else min(best, entry.loss)
        losses.append(entry.loss if best is None else best)
    return losses


def still_falling(entries: Sequence[RecordedEvaluation], settings: CalibrationSettings) -> str | None:
    """A warning that a run hadn't converged: its last quarter lowered the loss by more than 5 %.

    Args:
        entries: Evaluations on record.
        settings: Settings of the run.

    Returns:
        None for a run that converged, hasn't spent its budget, or is shorter than four evaluations.
    """
    budget = settings.budget
    if budget < 4 or len(entries) < budget:
        return None
    losses = best_losses(entries)
    before, end = losses[len(losses) - len(losses) // 4 - 1], losses[-1]
    if end >= (1 - _FALLING) * before:
        return None
    return (
        f"the loss was still falling: {100 * (1 - end / before):.0f} % lower in the last quarter of the budget; raise "
        f"--budget and add --resume (with method staged: begin a new run)"
    )


def never_beaten(entries: Sequence[RecordedEvaluation], settings: CalibrationSettings) -> str | None:
    """A warning that a search has found nothing better than the points that it began with.

    Args:
        entries: Evaluations on record.
        settings: Settings of the run.

    Returns:
        None for a run that did, hasn't spent its budget, or is shorter than ten evaluations.
    """
    budget = settings.budget
    if settings.method == "random" or budget < _FEW or len(entries) < budget:
        return None
    best = min((entry for entry in entries if not entry.failed), key=lambda entry: entry.loss, default=None)
    if best is None or best.note.source not in _SPREAD:
        return None
    return (
        f"the search hasn't beaten its own first points: the best of {len(entries)} is evaluation {best.index + 1}, "
        f"which no search proposed; run several seeds (--seeds 0:3) or another method (--method bayesopt), and look "
        f"whether the bounds are as wide as they must be"
    )
