"""`evaluate`, `overlay`, `simulate` and `report`: what parameters do, in figures, pictures, paths and pages."""

from __future__ import annotations

from pathlib import Path

from swim2real.cli.options import Positional
from swim2real.cli.terminal import say, say_json
from swim2real.errors import ArgumentError
from swim2real.settings import EvaluationSettings


def evaluate(
    parameters: Positional[Path], settings: EvaluationSettings, *, reference: Path, sensitivity: bool = False,
    json: bool = False,
) -> int:  # fmt: skip
    """Compare parameters with real trials: every figure, per trial and per marker.

    Reads a run folder or parameters file and a reference; writes nothing. Costs one evaluation, under a second.

    Args:
        parameters: Run folder or parameters file; 'published' for the prior work's values.
        settings: How they are compared.
        reference: Folder with the real trials.
        sensitivity: Also print each parameter's effect on the loss: about 30 more evaluations.
        json: Print JSON in SI units.
    """
    from swim2real.calibration import sensitivities
    from swim2real.cli import tables
    from swim2real.cli.subject import problem_of
    from swim2real.objective import evidence

    problem, values = problem_of(parameters, reference, settings)
    content = evidence(problem.evaluate(values))
    effects = None
    if sensitivity:
        effects = [effect.as_dict() for effect in sensitivities(problem, problem.robot.space, values)]
    if json:
        say_json({**content, "engine": problem.engine.as_dict(), "sensitivity": effects})
        return 0
    tables.figures(content, f"{parameters} on {reference}, protocol {problem.protocol.name}, {problem.engine.name}")
    tables.marker_errors(content, problem.robot.marker_names)
    if effects is not None:
        tables.sensitivities(effects)
    return 0


def overlay(
    parameters: Positional[Path], settings: EvaluationSettings, *, reference: Path, out: Path, fps: float = 30.0,
    width: int = 960,
) -> int:  # fmt: skip
    """Draw simulated trials over real ones: films and pictures to see what differs.

    Reads a run folder or parameters file and a reference; writes NAME.mp4 and NAME.png a trial, and all.png. Blue is
    simulated, red is real. Costs about 2 s a trial.

    Args:
        parameters: Run folder or parameters file; 'published' for the prior work's values.
        settings: How they are compared.
        reference: Folder with the real trials.
        out: Folder to write.
        fps: Frames a second of the films.
        width: Width of the films [px].
    """
    from swim2real.cli.subject import problem_of
    from swim2real.pipeline.overlays import write_overlays

    problem, values = problem_of(parameters, reference, settings)
    problem.robot.check_markers("draw")
    write_overlays(problem.evaluate(values), problem.robot, out, fps, width, lambda path: say(str(path)))
    return 0


def simulate(
    parameters: Positional[Path], *, frequency: tuple[float, ...], out: Path, seconds: float = 4.0, rate: float = 60.0,
    from_rest: bool = False, threads: int = 0,
) -> int:  # fmt: skip
    """Simulate swims and write the markers' paths.

    Writes an .npz with times (T,) s, frequencies (F,) Hz, markers (F, T, M, 2) m in the world frame and marker_names.

    Args:
        parameters: Run folder or parameters file; 'published' for the prior work's values.
        frequency: Motor frequencies [Hz].
        out: File to write.
        seconds: Length of each swim [s].
        rate: Samples a second [Hz].
        from_rest: Start from rest with the motor turning; otherwise a steady cycle, from motor angle 0.
        threads: Swims simulated at a time; 0 for all cores.
    """
    import numpy as np

    from swim2real import api
    from swim2real.cli import tables
    from swim2real.cli.subject import robot_for, values_for
    from swim2real.store import write_arrays

    robot = robot_for(parameters)
    values = values_for(parameters, robot)
    trials = api.simulate(
        values, robot, frequency, seconds=seconds, rate=rate, from_rest=from_rest, threads=threads
    )  # fmt: skip
    arrays = {
        "times": trials.trials[0].track.times, "frequencies": np.array(frequency),
        "markers": np.stack([trial.track.positions for trial in trials]),
        "marker_names": np.array(robot.marker_names),
    }  # fmt: skip
    try:
        write_arrays(out, arrays)
    except OSError as error:
        raise ArgumentError(f"--out '{out}' can't be written: {error.strerror or error}") from error
    tables.table("Simulated", ("swim", "speed mm/s"), [(t.name, tables.millimeters(t.track.speed)) for t in trials])
    say(f"{out}: {len(trials)} swims of {trials.trials[0].track.frame_count} samples")
    return 0


def report(run: Positional[Path]) -> int:
    """Write the report page of a run or a comparison: one self-contained HTML file that opens without a network.

    For a comparison also tables.md and the figures for papers (PDF and PNG).

    Args:
        run: Folder of a run or a comparison.
    """
    from swim2real.api import recorded_robot
    from swim2real.calibration import RunFolder
    from swim2real.cli.comparison_files import write_files
    from swim2real.comparison.plan import PLAN
    from swim2real.report import write_report

    page = write_files(run)[-1] if (run / PLAN).is_file() else write_report(run, recorded_robot(RunFolder(run)))
    say(str(page))
    return 0
