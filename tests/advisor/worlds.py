"""A world without a simulator: swims by formula, and the evidence that an evaluation would leave of them.

The real fish follows the fish's learned response at a hidden point, 20 % faster than that has it; the simulated one
follows it at the candidate's. So what the advisor believes at first is wrong in size and right in sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from swim2real.optimizers import (
    Advisor,
    BacktrackingLineSearch,
    Candidate,
    Evaluation,
    Proposal,
    ScriptedAdvisor,
    Situation,
)
from swim2real.parameters import ParameterSpace
from swim2real.robots.fish import FISH

SPACE = replace(FISH.space, scale="log")
HORIZON = 4.0  # s
FASTER = 1.2
FLOOR = 3e-3  # m, of the shape that no parameter explains


def hidden_point() -> np.ndarray:
    """Near the published fish, but surer to swim, and elsewhere by some parameters that hardly matter to that."""
    point = 0.9 * SPACE.to_cube(FISH.space.published) + 0.05
    point[0] -= 0.15  # blunt drag
    point[6:] = np.tile([0.35, 0.6], 5)
    return point


@dataclass
class World:
    """Gives evidence of candidates."""

    frequencies: Sequence[float] = (0.6, 0.9, 1.2, 1.5)  # Hz, one per trial
    sign: float = 1.0  # -1 for a fish that swims tail first wherever it is simulated
    lost: Sequence[tuple[int, int]] = ()  # trial number and marker of each marker that was never seen
    space: ParameterSpace = SPACE  # of candidates

    def evaluate(self, point: np.ndarray, failed: bool = False) -> Evaluation:
        point = np.asarray(point, dtype=float)
        if failed:
            return Evaluation(Candidate(point), 1.0, True, self.evidence(point, diverged=True))
        found = self.evidence(point)
        return Evaluation(Candidate(point), found["loss"], False, found)

    def evidence(self, point: np.ndarray, diverged: bool = False) -> dict[str, Any]:
        values = np.array(list(self.space.to_values(point).values()))
        speeds, beats = swim(values, self.frequencies)
        speeds = self.sign * np.abs(speeds) if self.sign < 0 else speeds
        hidden = np.array(list(SPACE.to_values(hidden_point()).values()))
        real_speeds, real_beats = swim(hidden, self.frequencies)
        trials = {}
        for i, frequency in enumerate(self.frequencies):
            known = np.array([(i, marker) not in self.lost for marker in range(9)])
            trials[f"f{i}"] = trial(
                frequency, FASTER * real_speeds[i], 0.0 if diverged else speeds[i], real_beats[i], beats[i], known
            )
        loss = float(np.mean([one["aligned_marker_error"] for one in trials.values()]))
        return {"loss": 1.0 if diverged else loss, "protocol": "aligned", "horizon": HORIZON, "trials": trials}


def swim(values: np.ndarray, frequencies: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (F,) [m/s] and complex beats (F, 9) [m] of the learned response."""
    point, driven = SPACE.to_cube(dict(zip(SPACE.names, map(float, values), strict=True))), np.array(frequencies)
    speeds = FISH.swims.response.speeds(point[None], driven)[0][0]
    parts = FISH.swims.response.beats(point[None], driven)[0]
    return speeds, parts[:, :9] + 1j * parts[:, 9:]


def trial(frequency, real_speed, speed, real_beat, beat, known) -> dict[str, Any]:
    squared = np.abs(beat - real_beat)[known] ** 2 / 2
    shape = float(np.hypot(np.sqrt(squared.mean()) if known.any() else 0.0, FLOOR))
    error = float(np.hypot(shape, abs(speed - real_speed) * HORIZON / 2))
    return {
        "loss": error, "frequency": frequency, "velocity_real": float(real_speed), "velocity_simulated": float(speed),
        "shape_error": shape, "aligned_marker_error": error, "beat_real": written(real_beat, known),
        "beat_simulated": written(beat, known),
    }  # fmt: skip


def written(beat: np.ndarray, known: np.ndarray) -> dict[str, list[float | None]]:
    """As the record has it: null for a marker that was never seen."""
    return {
        key: [float(value) if seen else None for value, seen in zip(part, known, strict=True)]
        for key, part in {"amplitude": np.abs(beat), "phase": np.angle(beat), "mean": 0 * beat.real}.items()
    }


class Watched:
    """Passes on to an advisor and keeps the situations it was shown."""

    def __init__(self, advisor: Advisor) -> None:
        self.advisor, self.situations = advisor, []

    def propose(self, situation: Situation) -> Proposal:
        self.situations.append(situation)
        return self.advisor.propose(situation)


def search(world: World, advisor: Advisor, first: np.ndarray, budget: int) -> tuple[list[Evaluation], Watched]:
    """A line search in a world."""
    watched = Watched(advisor)
    optimizer = BacktrackingLineSearch(watched, first)
    seen = []
    for _ in range(budget):
        candidate = optimizer.ask()
        evaluation = replace(world.evaluate(candidate.point), candidate=candidate)
        optimizer.tell(evaluation)
        seen.append(evaluation)
    return seen, watched


def situation(world: World, rounds: int = 0, seed: int = 0) -> Situation:
    """What an advisor is shown after so many rounds with random proposals, in an advisor's words."""
    rng = np.random.default_rng(seed)
    points = 0.5 + 0.3 * (rng.random((3 * rounds + 2, 16)) - 0.5)  # a round may take one step only
    script = ScriptedAdvisor([Proposal(point, "It is 27.31 mm too slow. " * 20) for point in points])
    return search(world, script, np.full(16, 0.5), 3 * rounds + 2)[1].situations[rounds]
