"""Calls for scripts: what the commands do, from the robot file to the next trial.

`swim2real` offers these functions beside those of the rooms, and the command line calls them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from swim2real import comparison, consent
from swim2real.calibration import Outcome, Problem, RunFolder, RunSettings
from swim2real.checks.mistakes import judged
from swim2real.checks.reference import misfits
from swim2real.checks.resting import started
from swim2real.comparison import ComparisonProgress, ComparisonResults, make_plan
from swim2real.identification.finished_run import FinishedRun, reopen
from swim2real.identification.identifiability import Study, StudyProgress
from swim2real.identification.identifiability import identify as studied
from swim2real.identification.next_trial import fitting_sets, judged_trials, write_next
from swim2real.identification.possible_trials import possible_trials
from swim2real.objective import Comparison
from swim2real.parameters import Values, read_parameters
from swim2real.pipeline.drafting import draft_robot, write_draft
from swim2real.robots import recorded_robot
from swim2real.robots.compiled import largest_difference
from swim2real.robots.mjcf_files import outside
from swim2real.robots.robot import Robot
from swim2real.settings import ComparisonSettings, EvaluationSettings, IdentifiabilitySettings, VlmAccess, all_cores
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, TrialSet
from swim2real.viewing.scenery import furnish
from swimbase.errors import ArgumentError, EngineError, RobotError
from swimbase.store import write_text, writing

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
    values: Values, robot: Robot, frequencies: Sequence[float] | TrialSet, *, seconds: float = 4.0, rate: float = 60.0,
    from_rest: bool = False, threads: int | None = None,
) -> TrialSet:  # fmt: skip
    """Simulates swims, steady ones or ones that begin at rest, or plays recordings back.

    Args:
        values: Parameters of the simulator, by name.
        robot: Robot that swims.
        frequencies: Frequency of the motor in each swim [Hz]. Or recordings, whose starts and controls are taken, and
            none of the following.
        seconds: Length of each swim [s], which is rounded to whole samples.
        rate: Samples a second [Hz].
        from_rest: Whether swims begin at rest with the motor turning, or in the steady cycle at motor angle 0.
        threads: Swims simulated at a time; None or 0 for all cores.

    Raises:
        ArgumentError: A number isn't finite and above 0.
        EngineError: A simulation diverged.
    """
    if isinstance(frequencies, TrialSet):
        problem = Problem(robot, frequencies, horizon=None, threads=all_cores(threads))
        trials = problem.simulator.simulate(values, [one.request for one in problem.prepared])
        return _finite(trials)
    if not frequencies:
        raise ArgumentError("give at least one frequency in Hz")
    for name, number in (("seconds", seconds), ("rate", rate), *(("frequency", f) for f in frequencies)):
        if not 0 < number < float("inf"):
            raise ArgumentError(f"{name} is {number:g}; it must be finite and above 0")
    simulator = Simulator(robot, all_cores(threads), sample_interval=1 / rate)
    count = max(1, round(seconds * rate))  # whole intervals, so that samples are exactly 1 / rate apart
    start = None if from_rest else _START_SPEED
    swims = [Swim(f"{f:g} Hz", Actuation(f, 0.0, start), count / rate) for f in frequencies]
    return _finite(simulator.simulate(values, swims))


def _finite(trials: TrialSet) -> TrialSet:
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


def init(model: str | Path, out: str | Path | None = None, *, force: bool = False) -> Path:
    """Writes a robot file for an MJCF model, as the command does: markers, what drives a trial, candidates.

    Args:
        model: MJCF file.
        out: Robot file to write; by default beside the model.
        force: Overwrite an existing file.

    Returns:
        Where the robot file is.

    Raises:
        ArgumentError: The file is there.
        RobotError: The model can't be read, or nothing of it could be calibrated.
    """
    file = Path(model).with_suffix(".toml") if out is None else Path(out)
    if file.exists() and not force:
        raise ArgumentError(f"'{file}' is there; give another place, or force=True to write over it")
    write_draft(draft_robot(Path(model)), Path(model), file)
    return file


def check(robot: Robot, reference: TrialSet) -> tuple[str, ...]:
    """Looks for what keeps trials from being a robot's: another unit, order, axes, clock or sign.

    Args:
        robot: The robot, with its values before a calibration.
        reference: Real trials.

    Returns:
        Sentences; none where nothing seems wrong.
    """
    return tuple(misfits(robot, reference)) or judged(started(robot, reference), reference).doubts


def identify(
    folder: str | Path, reference: TrialSet, settings: IdentifiabilitySettings | None = None, *,
    robot: Robot | None = None, again: bool = False, threads: int | None = None,
    on_progress: Callable[[StudyProgress], None] = lambda progress: None,
) -> Study:  # fmt: skip
    """Studies which parameters the trials determine, with intervals; goes on with a study that is there.

    Args:
        folder: Folder of a run.
        reference: Real trials that the run was made with.
        settings: Settings of the study.
        robot: Robot of the run; by default as the run names it.
        again: Begin anew.
        threads: Simulations at a time; None or 0 for all cores.
        on_progress: Called after every evaluation.

    Raises:
        RunError: No run there, or it was made with another reference, robot or engine.
    """
    return studied(_reopened(folder, reference, robot, threads), settings, again, on_progress)


def next_trial(
    folder: str | Path, reference: TrialSet, out: str | Path | None = None, *, robot: Robot | None = None,
    seed: int = 0, threads: int | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Proposes the trial to film next, into next.json and next.csv.

    Args:
        folder: Folder of a run that `identify` has studied.
        reference: Real trials that the run was made with.
        out: Folder to write; by default `next` in the run's.
        robot: Robot of the run; by default as the run names it.
        seed: Decides which sets are compared.
        threads: Simulations at a time; None or 0 for all cores.

    Returns:
        The content of next.json: `candidates`, the best first, with the `volume` of the sets that each would leave.

    Raises:
        RunError: The run isn't studied, or nothing can be said of any trial.
    """
    run = _reopened(folder, reference, robot, threads)
    sets = fitting_sets(run)
    possible = possible_trials(run.problem, run.space.to_values(sets.lowest))
    return write_next(Path(out or Path(folder) / "next"), run, list(judged_trials(run, sets, possible, seed)))


def _reopened(folder: str | Path, reference: TrialSet, robot: Robot | None, threads: int | None) -> FinishedRun:
    return reopen(folder, reference, robot or run_robot(RunFolder(folder)), all_cores(threads))


def export_model(values: Values, robot: Robot, out: str | Path) -> tuple[str, float]:
    """Writes a calibrated simulator as one MJCF file, with a light, cameras and the water's surface.

    Args:
        values: Parameters of the simulator, by name.
        robot: The robot.
        out: MJCF file to write.

    Returns:
        The number that differs most when the file is read back, by its name, and by how much, relative.

    Raises:
        ArgumentError: The file can't be written.
        RobotError: MuJoCo can't read its own file back.
    """
    path, spec = Path(out), robot.build(values)
    if robot.source is not None:  # assets are found from anywhere
        for folder in ("meshdir", "texturedir"):
            setattr(spec, folder, str((robot.source.parent / spec.modelfiledir / getattr(spec, folder)).resolve()))
    furnish(spec)
    model = spec.compile()
    with writing(path, ArgumentError, what="--out"):
        write_text(path, spec.to_xml())
    named = outside(path)  # where the assets are of a model that has been allowed
    if named is not None:
        consent.require(named, allowed=True)
    try:
        return largest_difference(model, mujoco.MjSpec.from_file(str(path)).compile())
    except ValueError as error:
        raise RobotError(f"MuJoCo can't read its own '{path}' back: {error}") from error
