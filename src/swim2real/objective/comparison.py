"""All trials of a candidate: the loss, overall figures, and the evidence that a person or an advisor judges it by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from swim2real.objective.figures import AVERAGED
from swim2real.objective.trial import FAILED_LOSS, LEAST_DISTANCE, TAIL_FIRST_LOSS, ComparedTrial
from swimbase.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

_DIGITS = 9  # significant digits of a number in JSON


@dataclass(frozen=True)
class UnfilmedSwim:
    """A swim from rest that no trial shows, at a frequency at which the robot is known to swim head first.

    Attributes:
        behind: How far it stays behind the required share of the trials' speed at such frequencies [m].
        near_turning: How near it is to turning, smoothly before it turns; not part of the loss [m].
        tail_first: Whether it ends up tail first.
    """

    behind: float
    near_turning: float
    tail_first: bool


@dataclass(frozen=True)
class Comparison:
    """All trials of a candidate, compared with the real ones. Overall figures are means over trials.

    Attributes:
        trials: Compared trials, in the order of the real ones.
        protocol: Name of the protocol by which they were compared.
        horizon: Seconds that are compared, None for all of each trial.
        unfilmed: Simulated swims from rest that no trial shows.
    """

    trials: tuple[ComparedTrial, ...]
    protocol: str
    horizon: float | None
    unfilmed: tuple[UnfilmedSwim, ...] = ()

    @property
    def divergence(self) -> str | None:
        """The first simulation that failed, in a sentence."""
        return next((f"trial '{t.name}': {t.divergence}" for t in self.trials if t.divergence), None)

    @property
    def tail_first(self) -> bool:
        """True if any trial whose whole motion is compared is simulated tail first, or a swim that no trial shows."""
        return any(swim.tail_first for swim in (*self.trials, *self.unfilmed))

    @property
    def loss(self) -> float:
        """Quantity that is minimized [m]; `FAILED_LOSS` when any simulation diverged.

        Where any trial goes tail first `TAIL_FIRST_LOSS` is added, so that no such candidate is better than one that
        goes forward. Among them the loss falls the nearer they are to forward, as each trial's own does.
        """
        if self.divergence is not None:
            return FAILED_LOSS
        behind = sum(swim.behind for swim in self.unfilmed) / len(self.trials)
        loss = float(np.mean([trial.loss for trial in self.trials]) + behind)
        return loss + TAIL_FIRST_LOSS if self.tail_first else loss

    def residual_vector(self) -> Array:
        """Residuals of all trials in a row; the squares add up to the mean over trials [m]. Shape (n,)."""
        parts = [trial.residual_vector() for trial in self.trials]
        return np.concatenate(parts) / np.sqrt(len(parts))

    def residual_stages(self) -> tuple[tuple[Array, Array], ...]:
        """Residuals and weights in the order in which they are lowered best, as each trial gives them.

        The last two are the residual vector, as it is and weighted such that its squares add up to the loss. In all but
        the first of several follow how far swims that no trial shows stay behind and how near they are to turning, so
        that a search sees where trials turn before they do. Shapes (n_k,) twice.

        Where there are four, four more precede them, in which some trials lead: the first three with less weight of
        those that turn by themselves, as a model does within narrow bounds only; and the residual vector, weighted such
        that its squares add up to the geometric mean of the trials' errors, which gives up no trial that is explained
        for others that aren't.
        """
        by_trial = [trial.residual_stages() for trial in self.trials]
        led = len(by_trial[0]) > 2
        if led:
            errors = np.maximum([np.linalg.norm(one[-2][0]) for one in by_trial], LEAST_DISTANCE)
            agreed = np.sqrt(np.exp(np.log(errors).mean())) / errors
            by_trial = [
                (*((r, trial.straightness * w) for r, w in one[:-1]), (one[-2][0], share * one[-2][1]), *one)
                for trial, one, share in zip(self.trials, by_trial, agreed, strict=True)
            ]
        stages: list[tuple[Array, Array]] = []
        for parts in zip(*by_trial, strict=True):
            residuals, weights = zip(*parts, strict=True)
            stages.append((np.concatenate(residuals) / np.sqrt(len(parts)), np.concatenate(weights)))
        if self.unfilmed:
            added = np.array([*(swim.behind for swim in self.unfilmed), *(swim.near_turning for swim in self.unfilmed)])
            mean = 1 / np.sqrt(np.maximum(np.abs(added), LEAST_DISTANCE))
            added = added / np.sqrt(len(self.trials))
            flat = [np.ones_like(added)] * (len(stages) - 1) + [mean]
            bodies = (0, 4) if led else (0,)
            stages = [
                one if k in bodies else (np.append(one[0], added), np.append(one[1], more))
                for k, (one, more) in enumerate(zip(stages, flat, strict=True))
            ]
        return tuple(stages)

    @property
    def residual_parts(self) -> tuple[tuple[str, str, int], ...]:
        """Trial, part and number of entries of what follows one another in the stage before the last two."""
        parts = [(trial.name, part, count) for trial in self.trials for part, count in trial.residual_parts()]
        return (*parts, *([("", "unfilmed", 2 * len(self.unfilmed))] if self.unfilmed else []))

    @property
    def residual_widths(self) -> Array:
        """Numbers of entries of the residual vector that make a distance each: two of a marker, one of others. (G,)."""
        counts = [(trial.weights.size, sum(len(one.times) for one in trial.sensors)) for trial in self.trials]
        return np.concatenate(
            [*(np.repeat([2, 1], both) for both in counts), np.ones(2 * len(self.unfilmed), dtype=int)]
        )

    @property
    def first_beats(self) -> Array:
        """Simulated speed over the first two beats from rest of each trial that has one [m/s]. Shape (F,)."""
        ways = [trial.progress.first_beats for trial in self.trials if trial.progress is not None]
        return np.array([speed for speed in ways if speed is not None])

    def figure(self, name: str) -> float:
        """One overall figure."""
        return float(np.mean([trial.figures()[name] for trial in self.trials]))

    def to_dataframe(self) -> pd.DataFrame:
        """The figures of each trial [SI], a row for each, without those that are several numbers."""
        import pandas as pd

        rows = {trial.name: trial.figures() for trial in self.trials}
        table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("trial")
        return table.loc[:, [not table[name].map(lambda cell: np.iterable(cell)).any() for name in table]]

    def figures(self) -> dict[str, Any]:
        """Every figure overall and per trial, in SI."""
        by_trial = {trial.name: trial.figures() for trial in self.trials}
        figures = list(by_trial.values())
        overall = {name: _mean([one[name] for one in figures]) for name in AVERAGED if name in figures[0]}
        settings = {"loss": self.loss, "protocol": self.protocol, "horizon": self.horizon}
        return {**overall, **settings, "trials": by_trial}


def evidence(comparison: Comparison) -> dict[str, Any]:
    """All figures of a candidate and each trial's own evidence, ready for JSON.

    Numbers are rounded to nine digits, so that a record that is read back gives exactly the same.
    """
    content = comparison.figures()
    for trial in comparison.trials:
        content["trials"][trial.name].update(trial.evidence())
    return rounded(content)


def rounded(value: Any) -> Any:
    """Plain lists and numbers for JSON, None for NaN."""
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in cast("dict[str, object]", value).items()}
    if isinstance(value, np.ndarray | np.generic):
        return rounded(value.tolist())
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in cast("Sequence[Any]", value)]
    return value


def _mean(values: Sequence[Any]) -> Any:
    """Mean over trials; by name, where a figure has several numbers."""
    if isinstance(values[0], Mapping):
        return {name: _mean([value[name] for value in values]) for name in values[0]}
    return float(np.mean(values))
