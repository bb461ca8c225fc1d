"""Calls for scripts: compare parameters, simulate swims, compare methods, read a run.

`swim2real` offers these functions beside those of the rooms, and the command line calls them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swim2real import comparison
from swim2real.calibration import Outcome, Problem, RunFolder, RunSettings
from swim2real.comparison import ComparisonProgress, ComparisonResults, make_plan
from swim2real.objective import Comparison
from swim2real.parameters import Values, read_parameters
from swim2real.robots import recorded_robot
from swim2real.robots.robot import Robot
from swim2real.settings import ComparisonSettings, EvaluationSettings, VlmAccess, all_cores
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, TrialSet
from swimbase.errors import ArgumentError, EngineError

_START_SPEED = 0.1  # m/s, a first guess from which the steady cycle is found


@dataclass(frozen=True)
class Run:
    """A run that was read from its folder.

    Attributes:
        path: Folder of the run.
        robot: Robot whose parameters were calibrated.
        settings: Settings of the run.
        values: Best parameters so far, by name.
        losses: Loss of every evaluation, in order [m]. Shape (N,).
        outcome: What the run found; None while it hasn't ended.
    """

    path: Path
    robot: Robot
    settings: RunSettings
    values: dict[str, float]
    losses: tuple[float, ...]
    outcome: Outcome | None


def open_run(folder: str | Path, *, allow_code: bool = False) -> Run:
    """Reads a run, whether it has ended or not.

    Args:
        folder: Folder of the run.
        allow_code: Run the Python code that its robot file names, and remember that.

    Raises:
        RunError: It is no run folder, or it is damaged.
        ParameterError: It has no parameters yet.
        ConsentError: Its robot file names Python code that wasn't allowed.
    """
    run = RunFolder(folder)
    settings = run.settings()
    robot = run_robot(run, allow_code=allow_code)
    values = read_parameters(run.path, robot.name, robot.space).values
    losses = tuple(entry.loss for entry in run.record())
    return Run(run.path, robot, settings, values, losses, run.outcome())


def run_robot(run: RunFolder, given: str | Path | None = None, *, allow_code: bool = False) -> Robot:
    """The robot of a run folder, as `recorded_robot` finds it."""
    settings = run.settings()
    return recorded_robot(run.path, settings.robot, settings.robot_file, given, allow_code=allow_code)


def evaluate(
    values: Values, reference: TrialSet, robot: Robot, settings: EvaluationSettings | None = None
) -> Comparison:
    """Compares simulated trials of a robot with real ones.

    Args:
        values: Parameters of the simulator, by name.
        reference: Real trials.
        robot: Robot that is simulated.
        settings: How they are compared; the defaults of `EvaluationSettings` where there are none.
    """
    return Problem.with_settings(robot, reference, settings or EvaluationSettings()).evaluate(values)


def simulate(
    values: Values, robot: Robot, frequencies: Sequence[float], *, seconds: float = 4.0, rate: float = 60.0,
    from_rest: bool = False, threads: int | None = None,
) -> TrialSet:  # fmt: skip
    """Simulates swims, steady ones or ones that begin at rest.

    Args:
        values: Parameters of the simulator, by name.
        robot: Robot that swims.
        frequencies: Frequency of the motor in each swim [Hz].
        seconds: Length of each swim [s], which is rounded to whole samples.
        rate: Samples a second [Hz].
        from_rest: Whether swims begin at rest with the motor turning, or in the steady cycle at motor angle 0.
        threads: Swims simulated at a time; None or 0 for all cores.

    Raises:
        ArgumentError: A number isn't finite and above 0.
        EngineError: A simulation diverged.
    """
    if not frequencies:
        raise ArgumentError("give at least one frequency in Hz")
    for name, number in (("seconds", seconds), ("rate", rate), *(("frequency", f) for f in frequencies)):
        if not 0 < number < float("inf"):
            raise ArgumentError(f"{name} is {number:g}; it must be finite and above 0")
    simulator = Simulator(robot, all_cores(threads), sample_interval=1 / rate)
    count = max(1, round(seconds * rate))  # whole intervals, so that samples are exactly 1 / rate apart
    start = None if from_rest else _START_SPEED
    swims = [Swim(f"{f:g} Hz", Actuation(f, 0.0, start), count / rate) for f in frequencies]
    trials = simulator.simulate(values, swims)
    for trial in trials:
        if trial.divergence:
            raise EngineError(f"{trial.name}: {trial.divergence}")
    return trials


def compare(
    reference: TrialSet, robot: Robot, settings: ComparisonSettings, out: str | Path, *, source: str = "",
    access: VlmAccess | None = None,
    on_progress: Callable[[ComparisonProgress], None] = lambda progress: None,
) -> ComparisonResults:  # fmt: skip
    """Compares methods of calibration: each with every seed, under every protocol, with one budget.

    Called again it goes on with what isn't finished; with more methods, seeds or protocols it adds to what is there.

    Args:
        reference: Real trials.
        robot: Robot that is calibrated.
        settings: What is compared.
        out: Folder of the comparison.
        source: Where the reference came from, for the record.
        access: How VLMs are reached.
        on_progress: Called as jobs go on and end.
    """
    plan = make_plan(settings, reference, robot, source)
    return comparison.compare(
        plan, reference, robot, out, workers=settings.workers or None, cluster=settings.cluster, access=access,
        on_progress=on_progress,
    )  # fmt: skip
