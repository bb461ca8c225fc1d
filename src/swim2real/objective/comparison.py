"""What is compared of a candidate's trials, whatever a trial is: a loss, figures, residuals and evidence."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Protocol = Literal["aligned", "paper", "playback"]

FAILED_LOSS = 1.0  # m, of a simulation that diverged: finite and of physical size


class ComparedTrial(typing.Protocol):
    """One simulated trial against its real one. Figures are in SI; what a kind of trial hasn't is absent."""

    @property
    def name(self) -> str: ...

    @property
    def divergence(self) -> str | None:
        """Why and when the simulation failed; None when it didn't."""
        ...

    @property
    def means(self) -> tuple[str, ...]:
        """Names of the figures that have a mean over trials."""
        ...

    def loss(self, protocol: Protocol) -> float:
        """What the trial adds to the loss, before the mean [m]; never negative."""
        ...

    def residual_vector(self, protocol: Protocol) -> Array:
        """Residuals whose squares add up to a mean square [m²]. Shape (n,), the same for every candidate."""
        ...

    def figures(self) -> dict[str, Any]:
        """Every figure of the trial."""
        ...

    def evidence(self) -> dict[str, Any]:
        """What tells more than figures do: errors of each marker, and how real and simulated markers move."""
        ...


@dataclass(frozen=True)
class Comparison:
    """All trials of a candidate. Overall figures are means over trials.

    Attributes:
        trials: In the order of the targets.
        protocol: Which figure is the loss.
        horizon: Seconds that are compared, None for all of each trial.
        skipped: Trials that an early stop left out; the other figures are means over the rest.
    """

    trials: tuple[ComparedTrial, ...]
    protocol: Protocol
    horizon: float | None
    skipped: int = 0

    @property
    def divergence(self) -> str | None:
        """The first simulation that failed, in a sentence."""
        return next((f"trial '{t.name}': {t.divergence}" for t in self.trials if t.divergence), None)

    @property
    def loss(self) -> float:
        """What is minimized [m]; `FAILED_LOSS` when any simulation diverged."""
        if self.divergence is not None:
            return FAILED_LOSS
        losses = [trial.loss(self.protocol) for trial in self.trials]
        return float(np.mean(losses + [0.0] * self.skipped))

    def residual_vector(self) -> Array:
        """Residuals of all trials in a row; the squares add up to the mean over trials [m]. Shape (n,)."""
        parts = [trial.residual_vector(self.protocol) for trial in self.trials]
        return np.concatenate(parts) / np.sqrt(len(parts))

    @property
    def lower_bound(self) -> bool:
        """Whether the loss is only known to be at least what it says, as after an early stop."""
        return self.skipped > 0 and self.divergence is None

    def figure(self, name: str) -> float:
        """One overall figure."""
        return float(np.mean([trial.figures()[name] for trial in self.trials]))

    def figures(self) -> dict[str, Any]:
        """Every figure overall and per trial, in SI, ready for JSON."""
        per_trial = {trial.name: trial.figures() for trial in self.trials}
        overall: dict[str, Any] = {
            name: _mean([figures[name] for figures in per_trial.values()]) for name in self.trials[0].means
        }
        early = {"skipped": self.skipped} if self.skipped else {}
        about = {"loss": self.loss, **early, "protocol": self.protocol, "horizon": self.horizon}
        return {**overall, **about, "trials": per_trial}


def _mean(values: Sequence[Any]) -> Any:
    """Over trials; by name, where a figure has several numbers."""
    if isinstance(values[0], dict):
        return {name: _mean([value[name] for value in values]) for name in values[0]}
    return float(np.mean(values))
