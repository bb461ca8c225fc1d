"""Steps that a local model solves, beside those of the advisor of recorded runs: replays rounds, one evaluation each.

    python benchmarks/solved_steps.py TRACKS RUN [RUN …]

Every recorded point is simulated again, for its residual. Before each round that began with a forward swim the local
model is made of all evaluations so far, and proposes a step along all parameters and along those that the advisor
changed. A step is better when its loss is lower than that of the advisor's own next evaluation, or than the lowest of
the whole round.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from swim2real.advisor.physics.model import expected_slopes
from swim2real.calibration import Problem, RunFolder
from swim2real.objective import evidence
from swim2real.objective.trial import TAIL_FIRST_LOSS
from swim2real.optimizers import Candidate, Evaluation
from swim2real.optimizers.contract import cube_point
from swim2real.optimizers.local_model import LocalModel, Slopes
from swim2real.parameters import ParameterSpace
from swim2real.robots import load_robot
from swim2real.trials import load_reference
from swimbase.errors import OptimizerError

_FEWEST = 8  # evaluations before the first step


@dataclass(frozen=True)
class Solved:
    """A round of a run, and the steps that the local model proposes in its place [m].

    Attributes:
        number: Evaluations before the round.
        before: Lowest loss before it.
        own: Loss of the advisor's full step.
        lowest: Lowest loss of its round.
        expected: Loss that the model expects of its steps: along all names, along the advisor's.
        found: Loss of these steps.
    """

    number: int
    before: float
    own: float
    lowest: float
    expected: tuple[float, ...]
    found: tuple[float, ...]


def evaluate(problem: Problem, space: ParameterSpace, point: np.ndarray, note: Mapping[str, object]) -> Evaluation:
    """Simulates a point of the unit cube."""
    made = problem.evaluate(space.to_values(point))
    failed = made.divergence is not None
    return Evaluation(
        Candidate(cube_point(point), note), made.loss, failed, evidence(made), None,
        () if failed else made.residual_stages(), made.first_beats, made.residual_parts, made.residual_widths,
    )  # fmt: skip


def rounds(record: list[Evaluation]) -> list[tuple[int, int]]:
    """First and last evaluation of each round with a proposal, from the notes of a run's record."""
    begins = [k for k, one in enumerate(record) if "proposal" in one.candidate.note]
    found: list[tuple[int, int]] = []
    for k in begins:
        end = k + 1
        while end < len(record) and record[end].candidate.note.get("round") == record[k].candidate.note.get("round"):
            end += 1
        found.append((k, end))
    return found


def solved(
    problem: Problem, space: ParameterSpace, record: list[Evaluation], slopes: Slopes | None
) -> list[Solved]:  # fmt: skip
    """The rounds of a record in which there is a local model, with its steps."""
    rows: list[Solved] = []
    for begin, end in rounds(record):
        known = record[:begin]
        before = min((one.loss for one in known), default=1.0)
        if begin < _FEWEST or before >= TAIL_FIRST_LOSS:
            continue
        try:
            model = LocalModel(known, slopes)
        except OptimizerError:  # too few others go forward
            continue
        proposed = np.array(record[begin].candidate.note["proposal"]["point"])
        changed = np.abs(proposed - model.base.candidate.point) > 1e-9
        steps = [model.solve(), model.solve(free=changed)]
        expected = tuple(model.predict(one).loss for one in steps)
        found = tuple(evaluate(problem, space, one, {}).loss for one in steps)
        lowest = min(one.loss for one in record[begin:end])
        rows.append(Solved(begin, before, record[begin].loss, lowest, expected, found))
    return rows


def summary(rows: list[Solved], which: int) -> str:
    """Shares of rounds in which a kind of step is better, and how many turned a trial around."""
    found = np.array([row.found[which] for row in rows])
    own, lowest, before = (np.array([getattr(row, name) for row in rows]) for name in ("own", "lowest", "before"))
    turned = int((found >= TAIL_FIRST_LOSS).sum())
    return (
        f"better than its next step {np.mean(found < own):.0%}, than its round {np.mean(found < lowest):.0%}, "
        f"than before {np.mean(found < before):.0%} (its rounds {np.mean(lowest < before):.0%}); turned {turned} of "
        f"{len(rows)} (its next steps {int((own >= TAIL_FIRST_LOSS).sum())})"
    )


def main(tracks: str, *runs: str) -> None:
    """Prints a table for each run and sums over all."""
    reference, every = load_reference(tracks), list[Solved]()
    for run in runs:
        folder = RunFolder(run)
        settings = folder.settings()
        robot = load_robot(settings.robot)
        problem = Problem.with_settings(robot, reference, settings)
        space = replace(robot.space, scale=settings.resolved_scale)
        record = [
            evaluate(problem, space, np.array(one.point), one.note.model_dump(exclude_unset=True))
            for one in folder.record()
        ]
        rows = solved(problem, space, record, expected_slopes(robot, space))
        print(f"{run}\n  after  before  own next  own round  along all (expected)  along its own (expected)  [mm]")
        for row in rows:
            known = f"{row.number:7d} {1e3 * row.before:7.1f} {1e3 * row.own:9.1f} {1e3 * row.lowest:10.1f}"
            pairs = zip(row.found, row.expected, strict=True)
            print(known, *(f"{1e3 * found:9.1f} ({1e3 * expected:5.1f})" for found, expected in pairs))
        every += rows
    for which, name in enumerate(("along all names", "along the names that the advisor changed")):
        print(f"{name}: {summary(every, which)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
