"""A simulated VLM for science: it knows the hidden parameters, and answers as wrongly as a VLM does.

It measures what an optimizer makes of advice of a known quality, without a network, a key or a cost. The kinds of
errors are those that the paper reports of its VLM ("Backtracking Line Search" and "Design Rationale"); the paper gives
no sizes for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.optimizers import Proposal, Situation
from swim2real.parameters import ParameterSpace, Values

Array = NDArray[np.float64]

_ADVISOR_STREAM = 2  # the child of a run's seed that `optimizers.streams` sets aside for the advisor
_NAMED = 4  # parameters that the words name


@dataclass(frozen=True)
class VlmErrors:
    """How wrong a simulated VLM is. Lengths are in the unit cube.

    With D the root mean square over the parameters of what truly differs, the VLM sees of each parameter the true
    difference plus an error, and proposes `overestimate` times what it sees.

    Attributes:
        overestimate: Mean of the step along the true difference over that difference. 1 is a VLM that judges
            magnitudes rightly; the paper says that its VLM consistently overestimates them.
        size_spread: Standard deviation of the logarithm of the step's length from round to round.
        noise: Standard deviation of each parameter's error over D. At 1 the error is as long as the difference, 45
            degrees off.
        floor: The least that standard deviation can be: what a VLM can't see in an overlay, however near it is. 0.02
            is 2 % of a parameter's range.
        conflation: Share of a parameter's difference that the VLM takes for the mean difference of all parameters that
            look alike. Those that differ in opposite ways cancel.
        unseen_noise: By how much `noise` and `floor` are larger for parameters that can't be seen; at 3, the sign is
            right in 5 of 8 rounds where the difference is D and the noise 1.
        wrong: Probability of a round that looks in a random direction instead, as long as what truly differs.
        habit: Share of the errors' variance that is the same in all rounds. At 0 a second try is as good as a new
            VLM, at 1 only the size, and whether it is plainly wrong, differ between rounds from the same incumbent.
    """

    overestimate: float = 2.0
    size_spread: float = 0.3
    noise: float = 1.0
    floor: float = 0.02
    conflation: float = 0.5
    unseen_noise: float = 3.0
    wrong: float = 0.1
    habit: float = 0.0

    def __post_init__(self) -> None:
        for name in ("size_spread", "noise", "floor"):
            value = getattr(self, name)
            if not 0 <= value < np.inf:
                raise ArgumentError(f"{name} is {value}; it must be finite and at least 0")
        for name in ("conflation", "wrong", "habit"):
            value = getattr(self, name)
            if not 0 <= value <= 1:
                raise ArgumentError(f"{name} is {value}; it must lie between 0 and 1")
        if not 0 < self.overestimate < np.inf:
            raise ArgumentError(f"overestimate is {self.overestimate}; it must be finite and above 0")
        if not 1 <= self.unseen_noise < np.inf:
            raise ArgumentError(f"unseen_noise is {self.unseen_noise}; it must be finite and at least 1")


class SimulatedVlm:
    """Proposes a step toward hidden parameters, with a VLM's errors.

    What is random in a round depends on the seed and the number of the round alone, so a resumed run gets the same
    proposals. Errors of different size draw the same numbers: settings can be compared seed by seed. It learns nothing
    from rejected rounds.
    """

    def __init__(
        self, space: ParameterSpace, hidden: Values, seed: int, errors: VlmErrors | None = None,
        alike: Sequence[Sequence[str]] = (), unseen: Sequence[str] = (),
    ) -> None:  # fmt: skip
        """Prepares the advisor.

        Args:
            space: As the optimizer uses it; the errors are made on its scale.
            hidden: The values that it knows.
            seed: Of the run.
            errors: How wrong it is.
            alike: Groups of parameters that it takes for one another, by name.
            unseen: Parameters that have no visible effect of their own, by name.

        Raises:
            ArgumentError: A group has fewer than two members, a parameter is in two groups, or the seed is negative.
            ParameterError: A name isn't in the space, or a hidden value is out of bounds.
        """
        if seed < 0:
            raise ArgumentError(f"seed is {seed}; it must be a whole number from 0 on")
        names = [name for group in alike for name in group]
        for name in (*names, *unseen):
            _ = space[name]  # an unknown name is explained there
        for group in alike:
            if len(group) < 2:
                raise ArgumentError(f"a group that looks alike has the parameters {list(group)}; it needs two or more")
        for name in names:
            if names.count(name) > 1:
                raise ArgumentError(
                    f"parameter '{name}' is in groups that look alike {names.count(name)} times, not once"
                )
        self._space, self._seed, self._errors = space, seed, errors or VlmErrors()
        self._hidden = space.to_cube(space.check(hidden, "the hidden values"))
        self._alike = [np.array([space.names.index(name) for name in group]) for group in alike]
        self._unseen = np.isin(space.names, unseen)
        self._habit = self._stream().normal(size=len(space))

    def propose(self, situation: Situation) -> Proposal:
        """The point that it believes to be best, clipped to the unit cube as a VLM's reply is."""
        errors = self._errors
        rng = self._stream(len(situation.rounds))
        chance, size = rng.random(), np.exp(errors.size_spread * rng.normal())
        fresh, elsewhere = rng.normal(size=(2, len(self._space)))
        error = np.sqrt(errors.habit) * self._habit + np.sqrt(1 - errors.habit) * fresh
        here = situation.incumbent.candidate.point
        difference = self._hidden - here
        rms = float(np.sqrt(np.mean(difference**2)))
        spread = max(errors.noise * rms, errors.floor) * np.where(self._unseen, errors.unseen_noise, 1.0)
        wrong = bool(chance < errors.wrong)
        seen = rms * elsewhere if wrong else self._conflated(difference)
        step = errors.overestimate * size * (seen + spread * error)
        point = np.clip(here + step, 0.0, 1.0)
        notes = {
            "distance": float(np.linalg.norm(difference)), "step": float(np.linalg.norm(point - here)),
            "cosine": _cosine(point - here, difference), "wrong": wrong,
        }  # fmt: skip
        diagnosis, reasoning = self._words(here, point)
        return Proposal(point, diagnosis, reasoning, notes)

    def _stream(self, *key: int) -> np.random.Generator:
        """Of a round, by its number, or of the whole run."""
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(_ADVISOR_STREAM, *key)))

    def _conflated(self, difference: Array) -> Array:
        seen = difference.copy()
        for group in self._alike:
            seen[group] += self._errors.conflation * (difference[group].mean() - difference[group])
        return seen

    def _words(self, here: Array, point: Array) -> tuple[str, str]:
        old, new = self._space.to_values(here), self._space.to_values(point)
        largest = np.argsort(-np.abs(point - here), kind="stable")[:_NAMED]
        names = [self._space.names[i] for i in largest]
        changes = [f"{'raise' if new[n] > old[n] else 'lower'} {n} from {old[n]:.3g} to {new[n]:.3g}" for n in names]
        return (
            f"A simulated VLM, which is told the hidden values, sees the effects of {', '.join(names)} most.",
            f"It would {', '.join(changes)}, and change the others less.",
        )


def _cosine(step: Array, difference: Array) -> float:
    """Of the angle between two steps; 0 where one has no length."""
    length = float(np.linalg.norm(step) * np.linalg.norm(difference))
    return float(step @ difference) / length if length else 0.0
