"""From a reference to a calibrated run with its report: composes the rooms, for the command line and for scripts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from swim2real.advisor import ADVISORS, make_advisor
from swim2real.calibration import (
    HORIZON,
    Problem,
    Progress,
    RunFolder,
    calibrate,
    commit,
    conclude,
    examine,
    reference_fingerprint,
    sensitivities,
    versions,
)
from swim2real.errors import ArgumentError, OptimizerError, RunError
from swim2real.objective import Protocol
from swim2real.optimizers import (
    Advisor,
    BacktrackingLineSearch,
    Optimizer,
    Proposal,
    RandomSearch,
    ScriptedAdvisor,
    WarmStart,
    first_point,
    streams,
)
from swim2real.parameters import ParameterSpace, Scale
from swim2real.robots.robot import Robot
from swim2real.simulation import Simulator
from swim2real.trials import TrialSet

Method = Literal["line-search", "random", "warm-start"]


@dataclass(frozen=True)
class Settings:
    """What decides the result of a run. `threads` and a raised budget are the only ones that may change on resume.

    Attributes:
        method: How candidates are found.
        advisor: Who proposes.
        protocol: What is compared.
        budget: Simulation evaluations.
        seed: Of the first point and every random choice.
        scale: Of the parameters; None takes the protocol's.
        max_steps: Of the line search.
        early_stop: Whether a step's evaluation stops once it is certain to be rejected.
        horizon: Seconds that are compared, None for all.
        hold_out: Names of trials to leave out.
        threads: Swims simulated at a time, None for all cores.
    """

    method: Method = "line-search"
    advisor: str = "physics"
    protocol: Protocol = "aligned"
    budget: int = 40
    seed: int = 0
    scale: Scale | None = None
    max_steps: int = 3
    early_stop: bool = False
    horizon: float | None = HORIZON
    hold_out: tuple[str, ...] = field(default=())
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.budget < 1:
            raise ArgumentError(f"budget is {self.budget}; it must be at least 1")
        if self.method not in ("line-search", "random", "warm-start"):
            raise ArgumentError(f"method is '{self.method}'; there are line-search, random and warm-start")
        if self.advisor not in ADVISORS:
            raise ArgumentError(f"advisor is '{self.advisor}'; this version has {', '.join(ADVISORS)}")
        if self.protocol not in ("aligned", "paper"):
            raise ArgumentError(f"protocol is '{self.protocol}'; there are aligned and paper")
        if self.scale not in (None, "log", "linear"):
            raise ArgumentError(f"scale is '{self.scale}'; there are log and linear")
        if self.max_steps < 1:
            raise ArgumentError(f"max_steps is {self.max_steps}; it must be at least 1")
        if self.early_stop and self.method != "line-search":
            raise ArgumentError(f"early_stop is for method line-search; method {self.method} needs every loss in full")
        if self.horizon is not None and not 0 < self.horizon < float("inf"):
            raise ArgumentError(f"horizon is {self.horizon} s; it must be finite and above 0")
        if self.threads is not None and self.threads < 1:
            raise ArgumentError(f"threads is {self.threads}; it must be at least 1")
        try:
            streams(self.seed)
        except OptimizerError as error:
            raise ArgumentError(str(error)) from None

    @property
    def resolved_scale(self) -> Scale:
        """The paper's protocol searches the linear box, as the paper did."""
        return self.scale or ("linear" if self.protocol == "paper" else "log")


def run(
    reference: TrialSet, robot: Robot, settings: Settings, out: str | Path, *, source: str = "", resume: bool = False,
    sensitivity: bool = False, on_progress: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, Any]:  # fmt: skip
    """Calibrates a robot's simulator against a reference, into a run folder.

    Args:
        reference: Real trials.
        robot: What is calibrated.
        settings: Of the run.
        out: Run folder.
        source: Where the reference came from, for the record.
        resume: Go on with the run that is there.
        sensitivity: Also measure each parameter's effect on the loss, outside the budget.
        on_progress: Called after every evaluation.

    Returns:
        The outcome, as `conclude` describes it. On KeyboardInterrupt the folder holds a usable, resumable run.

    Raises:
        Swim2RealError: With a sentence that names what is wrong.
    """
    space = replace(robot.space, scale=settings.resolved_scale)
    folder = RunFolder(out)
    fitted, unseen = reference.split(settings.hold_out)
    simulator = Simulator(robot, settings.threads)
    problem = Problem(robot, examine(fitted, robot), simulator, settings.protocol, settings.horizon)
    held_out = None
    if unseen is not None:
        held_out = Problem(robot, examine(unseen, robot), simulator, settings.protocol, settings.horizon)
    resolved = {
        "robot": robot.name,
        **asdict(settings),
        "scale": settings.resolved_scale,
        "hold_out": sorted(out.name for out in unseen or ()),
        "reference_fingerprint": reference_fingerprint(reference),
        "engine": simulator.engine.as_dict(),
    }
    about = {
        "reference": source, "versions": versions(), "commit": commit(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip
    with folder.locked():
        if resume:
            folder.resume(resolved)
        else:
            folder.begin({**resolved, **about})
        optimizer = make_optimizer(settings, robot, space, _recorded_proposals(folder))
        best = calibrate(problem, space, optimizer, settings.budget, folder, on_progress)
        effects = sensitivities(problem, space, best["values"]) if sensitivity else None
        return conclude(folder, problem, held_out, best["values"], effects)


def make_optimizer(
    settings: Settings, robot: Robot, space: ParameterSpace, proposals: list[Proposal] | None = None
) -> Optimizer:
    """The optimizer that the settings name, fresh.

    Args:
        settings: Of the run.
        robot: Whose simulator is calibrated.
        space: With the scale of the run.
        proposals: Of the rounds on record, which aren't asked again.
    """
    first = first_point(len(space), settings.seed)
    _, rng, _ = streams(settings.seed)
    if settings.method == "random":
        return RandomSearch(len(space), rng, first)
    advisor: Advisor = make_advisor(settings.advisor, robot, space, settings.seed)
    if proposals:
        advisor = ScriptedAdvisor(proposals, then=advisor)
    if settings.method == "warm-start":
        return WarmStart(advisor, first, RandomSearch(len(space), rng))
    return BacktrackingLineSearch(advisor, first, max_steps=settings.max_steps, early_stop=settings.early_stop)


def _recorded_proposals(folder: RunFolder) -> list[Proposal]:
    try:
        notes = [entry["note"] for entry in folder.record()]
        return [Proposal.from_dict(note["proposal"]) for note in notes if "proposal" in note]
    except (KeyError, TypeError) as error:
        raise RunError(f"the record of '{folder.path}' is damaged: {error!r}; begin a new run") from error
