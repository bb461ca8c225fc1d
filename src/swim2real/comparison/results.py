"""The runs of a comparison as plain data: what tables, figures and pages are made of."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import RunError

FORMAT = 1
RESULTS = "results.json"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StepRound:
    """One advisor call of a line search, with its steps.

    Attributes:
        begin: Index of the first step's evaluation.
        sizes: Of the steps that were tried, from the full one on.
        accepted: Whether the last of them improved on the incumbent.
        finished: False for a last round that the budget cut short: neither accepted nor rejected.
    """

    begin: int
    sizes: tuple[float, ...]
    accepted: bool
    finished: bool


@dataclass(frozen=True)
class RunResult:
    """One finished run: a method with a seed under a protocol.

    Attributes:
        method: Its label, which tells the advisor and a scale that isn't the protocol's own, too.
        seed: Of the run.
        protocol: `aligned`, `paper` or `playback`.
        scale: Of the parameters: `log` or `linear`.
        held_out: Name of the trial that was left out of the fit, None when it was made of all.
        losses: Of every evaluation, in order [m].
        failed: Whether each evaluation failed.
        rounds: Of a line search, in order; none for other methods.
        calls: Calls of an advisor, failed ones and repairs of a VLM included.
        spent: `failed_calls`, `input_tokens`, `output_tokens`, `cost` [USD, None where not known] and `seconds` of a
            VLM's calls; None for other advisors.
        fit: Evidence of the best parameters on the trials that were fitted, as `objective.evidence` describes it.
        held_out_fit: The same on the trial that was left out.
        values: The best parameters.
        seconds: That the evaluations took.
        folder: Run folder, relative to the comparison's, with `/`.
    """

    method: str
    seed: int
    protocol: str
    scale: str
    held_out: str | None
    losses: tuple[float, ...]
    failed: tuple[bool, ...]
    rounds: tuple[StepRound, ...]
    calls: int
    spent: Mapping[str, Any] | None
    fit: Mapping[str, Any]
    held_out_fit: Mapping[str, Any] | None
    values: Mapping[str, float]
    seconds: float
    folder: str

    def __post_init__(self) -> None:
        if not self.losses or len(self.losses) != len(self.failed):
            raise RunError(f"run '{self.folder}' has {len(self.losses)} losses and {len(self.failed)} marks of failure")

    @cached_property
    def best(self) -> Array:
        """Lowest loss so far after each evaluation, as the run's incumbent [m]. Shape (B,)."""
        counted = np.where(self.failed, np.inf, self.losses)
        counted[0] = self.losses[0]
        return np.minimum.accumulate(counted)

    @property
    def best_loss(self) -> float:
        """[m]."""
        return float(self.best[-1])

    @property
    def best_evaluation(self) -> int:
        """How many evaluations it took to find the best."""
        return int(np.argmin(self.best)) + 1


@dataclass(frozen=True)
class ComparisonResults:
    """All finished runs of a comparison.

    Attributes:
        runs: Ordered by protocol, method, seed and what was left out, as planned.
        methods: Labels, as planned; those without a finished run too.
        protocols: As planned.
        trials: Names of the real trials.
        markers: Names of the markers.
        budget: Evaluations of a run.
        reference: Fingerprint of the real trials.
        missing: Why each planned run that isn't here isn't, by key.
        engine: That it was simulated with.
        sensors: Units of the sensors that are compared, by name.
    """

    runs: tuple[RunResult, ...]
    methods: tuple[str, ...]
    protocols: tuple[str, ...]
    trials: tuple[str, ...]
    markers: tuple[str, ...]
    budget: int
    reference: str
    missing: Mapping[str, str] = field(default_factory=dict[str, str])
    engine: Mapping[str, Any] = field(default_factory=dict[str, Any])
    sensors: Mapping[str, str] = field(default_factory=dict[str, str])

    def of(self, method: str, protocol: str, held_out: str | None = None) -> tuple[RunResult, ...]:
        """The runs of a method under a protocol, one a seed; by default those that were made of all trials."""
        return tuple(
            run for run in self.runs if (run.method, run.protocol, run.held_out) == (method, protocol, held_out)
        )

    def left_out(self, method: str, protocol: str) -> tuple[RunResult, ...]:
        """The runs of a method under a protocol that left a trial out."""
        return tuple(
            run for run in self.runs if (run.method, run.protocol) == (method, protocol) and run.held_out is not None
        )

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON; `from_dict` reads it back. Each run has its curve of the best loss in it, too."""
        runs = [{**asdict(run), "best": [float(loss) for loss in run.best]} for run in self.runs]
        return {"format": FORMAT, **{**asdict(self), "runs": runs}}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ComparisonResults:
        """What `as_dict` gave.

        Raises:
            RunError: It is of another format.
        """
        if content.get("format") != FORMAT:
            raise RunError(
                f"the results have format {content.get('format')!r}; this version of swim2real reads {FORMAT}"
            )
        return cls(
            runs=tuple(_run(one) for one in content["runs"]),
            methods=tuple(content["methods"]),
            protocols=tuple(content["protocols"]),
            trials=tuple(content["trials"]),
            markers=tuple(content["markers"]),
            budget=content["budget"],
            reference=content["reference"],
            missing=content["missing"],
            engine=content["engine"],
            sensors=content.get("sensors", {}),
        )


def load_results(folder: str | Path) -> ComparisonResults:
    """Reads results.json of a comparison.

    Raises:
        RunError: It isn't there, or damaged.
    """
    path = Path(folder) / RESULTS
    try:
        return ComparisonResults.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise RunError(f"'{folder}' has no {RESULTS}; `swim2real compare` writes it") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise RunError(f"{path} can't be read: {error!r}; run the comparison again to write it anew") from error


def step_rounds(record: Sequence[Mapping[str, Any]], max_steps: int) -> tuple[StepRound, ...]:
    """The rounds of a line search, from its record."""
    rounds: list[StepRound] = []
    best, number, begin = np.inf, None, 0
    sizes: list[float] = []
    for index, entry in enumerate(record):
        note = entry["note"]
        improved = not entry["failed"] and entry["loss"] < best
        if improved or index == 0:
            best = entry["loss"]
        if "step_size" not in note:
            continue
        if note["round"] != number:
            number, begin, sizes = note["round"], index, []
            rounds.append(StepRound(begin, (), False, False))
        sizes.append(float(note["step_size"]))
        rounds[-1] = StepRound(begin, tuple(sizes), improved, improved or len(sizes) == max_steps)
    return tuple(rounds)


def _run(content: Mapping[str, Any]) -> RunResult:
    kept = {key: value for key, value in content.items() if key != "best"}
    rounds = tuple(StepRound(r["begin"], tuple(r["sizes"]), r["accepted"], r["finished"]) for r in kept["rounds"])
    return RunResult(
        **{**kept, "losses": tuple(kept["losses"]), "failed": tuple(kept["failed"]), "rounds": rounds}  # pyright: ignore[reportArgumentType]
    )
