"""`evaluate`, `overlay`, `simulate` and `report`: what parameters do, in figures, pictures, paths and pages."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import From
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import EvaluationSettings
from swimbase.errors import ArgumentError

if TYPE_CHECKING:
    from swim2real.parameters import Values


def evaluate(
    parameters: Positional[Path], settings: EvaluationSettings, *, reference: opt.Reference,
    robot: opt.RobotOfValues = None, sensitivity: bool = False, begin: float | None = None, json: opt.Json = False,
) -> int:  # fmt: skip
    """Compare parameters with real trials: every figure, per trial and per marker.

    Reads a run folder or parameters file and a reference; writes nothing. Takes one evaluation, under a second. With
    what `export-commands` expects of a table of commands, it compares each trial, a real run under that table, with it.

    Args:
        parameters: Run folder or parameters file; 'published' for the prior work's values. Or COMMANDS.expected.json.
        settings: How they are compared.
        sensitivity: Also print each parameter's effect on the loss: about 30 more evaluations.
        begin: For an expected run: time of the first command on the trial's clock [s]; by default that of the first row
            of its controls, or of its first frame.
    """
    if parameters.name.endswith(".expected.json"):
        return _evaluate_run(parameters, reference, begin, json)
    if begin is not None:
        raise ArgumentError(f"--begin is for an expected run, and '{parameters}' is none; leave it out")
    from swim2real.calibration import sensitivities
    from swim2real.cli import tables
    from swim2real.cli.subject import problem_of
    from swim2real.objective import evidence
    from swim2real.objective.figures import FitFigures

    problem, values = problem_of(parameters, reference, settings, robot)
    content = evidence(problem.evaluate(values))
    effects = sensitivities(problem, problem.robot.space, values) if sensitivity else None
    if json:
        told = None if effects is None else [asdict(effect) for effect in effects]
        say_json({**content, "engine": problem.engine.as_dict(), "sensitivity": told})
        return 0
    fit, simulated = FitFigures.model_validate(content), problem.robot
    title = f"{parameters} on {reference}, protocol {problem.protocol.name}, {problem.engine.name}"
    tables.figures(fit, title, simulated.trials.sensors)
    tables.marker_errors(fit, simulated.marker_names)
    if effects is not None:
        tables.sensitivities(effects)
    return 0


def _evaluate_run(path: Path, reference: Path, begin: float | None, json: bool) -> int:
    """Compares real runs with what was expected of their commands."""
    from swim2real.cli import tables
    from swim2real.objective.expected_run import compare_run, read_expected_run
    from swim2real.trials import load_reference

    expected, trials = read_expected_run(path), load_reference(reference)
    runs = [compare_run(expected, trials, trial, begin) for trial in trials]
    if json:
        say_json({"expected": str(path), "runs": [asdict(run) for run in runs]})
        return 0
    for run in runs:
        rows = [
            (name, *("–" if figure is None else f"{figure:.3f}" for figure in figures))
            for name, figures in run.figures.items()
        ]
        within = "" if run.within is None else f", {100 * run.within:.0f} % of the time within the spread"
        title = f"{run.trial}, {run.seconds:.1f} s: {run.path_error:.3f} m from the expected path{within}"
        tables.table(title, ("in m, rad, s", "expected", "least", "most", "measured"), rows)
    for run in runs:
        say(run.sentence)
    return 0


def overlay(
    parameters: Positional[opt.ValuesPath], settings: EvaluationSettings, *, reference: opt.Reference, out: Path,
    robot: opt.RobotOfValues = None, fps: float = 30.0, width: int = 960, video: tuple[Path, ...] = (),
    camera: Path | None = None, begin: From = (), until: opt.Until = (),
) -> int:  # fmt: skip
    """Draw simulated trials over real ones, as films and pictures.

    Reads a run folder or parameters file and a reference; writes NAME.mp4 and NAME.png per trial, and all.png. Blue is
    simulated, red is real. Takes about 2 s per trial. With --video it draws the simulated markers on your own films
    instead and writes NAME.on-film.mp4: on the real path, in phase and registered, as in the loss.

    Args:
        settings: How they are compared.
        out: Folder to write.
        fps: Frames per second of the films.
        width: Width of the films [px].
        video: Your own films of the trials, each named like its trial.
        camera: Camera file that the films were tracked with.
        begin: Time of the film at which the trial begins [s], one for all films or one for each; by default as it was
            tracked.
    """
    from swim2real.cli.subject import problem_of
    from swim2real.pipeline.overlays import write_overlays

    if video:
        _draw_on_films(parameters, robot, settings, reference, out, video, camera, begin, until)
        return 0
    for option, given in (("camera", camera), ("from", begin), ("until", until)):
        if given:
            raise ArgumentError(f"--{option} is of your own films; give them too, with --video")
    problem, values = problem_of(parameters, reference, settings, robot)
    problem.robot.check_markers("draw")
    write_overlays(problem.evaluate(values), problem.robot, out, fps, width, lambda path: say(str(path)))
    return 0


def _draw_on_films(
    parameters: Path, given: str | None, settings: EvaluationSettings, reference: Path, out: Path,
    videos: tuple[Path, ...], camera: Path | None, begins: tuple[float, ...], untils: tuple[float, ...],
) -> None:  # fmt: skip
    from markertrack.camera_file import read_camera
    from markertrack.span import Span, spans
    from swim2real.calibration import Problem
    from swim2real.cli.subject import robot_for, values_of
    from swim2real.pipeline.overlays import chosen_trials, draw_on_film
    from swim2real.trials import TrialSet, load_reference

    if settings.pieces is not None:
        raise ArgumentError("--pieces cuts trials into pieces, which can't be drawn on a film; leave it out")
    stretches = spans(begins, untils, len(videos), "films")
    robot = robot_for(parameters, given)
    robot.check_markers("draw")
    trials = chosen_trials(videos, load_reference(reference))
    known = None if camera is None else read_camera(camera)
    problem = Problem.with_settings(robot, trials, settings)
    values = values_of(parameters, problem)
    for video, trial, stretch in zip(videos, trials, stretches, strict=True):
        span = stretch if begins else Span(trial.video_begin + float(trial.track.times[0]), stretch.until)
        alone = problem.of(TrialSet((trial,), trials.marker_names))
        drawn = draw_on_film(video, alone, values, known, span, reference, out)
        say(f"{drawn.path}: {drawn.frames} frames")
        for note in drawn.notes:
            tell(f"warning: {trial.name}: {note}")


def simulate(
    parameters: Positional[opt.ValuesPath], *, frequency: tuple[float, ...], out: Path, robot: opt.RobotOfValues = None,
    seconds: float = 4.0, rate: float = 60.0, from_rest: bool = False, threads: opt.Threads = 0,
) -> int:  # fmt: skip
    """Simulate swims and write the markers' paths.

    Writes an .npz with times (T,) s, frequencies (F,) Hz, markers (F, T, M, 2) m in the world frame and marker_names.
    For a run that `identify` studied, speeds and markers of some of the sets that fit as well: markers_of_sets
    (K, F, T, M, 2) m.

    Args:
        frequency: Motor frequencies [Hz].
        out: File to write.
        seconds: Length of each swim [s].
        rate: Samples per second [Hz].
        from_rest: Start from rest with the motor turning; by default a steady cycle from motor angle 0.
    """
    import numpy as np

    from swim2real import api
    from swim2real.calibration import RunFolder
    from swim2real.cli import tables
    from swim2real.cli.subject import robot_for, values_for
    from swim2real.identification.identifiability import sets_that_fit
    from swim2real.trials import TrialSet
    from swimbase.errors import EngineError
    from swimbase.store import write_arrays, writing

    body = robot_for(parameters, robot)

    def swims(values: Values) -> TrialSet:
        return api.simulate(values, body, frequency, seconds=seconds, rate=rate, from_rest=from_rest, threads=threads)

    trials, others = swims(values_for(parameters, body)), list[TrialSet]()
    for values in sets_that_fit(RunFolder(parameters), body) if parameters.is_dir() else ():
        with suppress(EngineError):  # one of them diverged
            others.append(swims(values))
    arrays = {
        "times": trials.trials[0].track.times, "frequencies": np.array(frequency),
        "markers": np.stack([trial.track.positions for trial in trials]),
        "marker_names": np.array(body.marker_names),
    }  # fmt: skip
    if others:
        arrays["markers_of_sets"] = np.stack([[trial.track.positions for trial in made] for made in others])
    with writing(out, ArgumentError, what="--out"):
        write_arrays(out, arrays)
    headings, rows = ["swim", "speed mm/s"], [[t.name, tables.millimeters(t.track.speed)] for t in trials]
    if others:
        headings.append("90 % of the sets that fit")
        speeds = 1e3 * np.array([[trial.track.speed for trial in made] for made in others])
        for row, (low, high) in zip(rows, np.percentile(speeds, (5, 95), axis=0).T, strict=True):
            row.append(f"{low:.0f} to {high:.0f}")
    tables.table("Simulated", headings, rows)
    say(f"{out}: {len(trials)} swims of {trials.trials[0].track.frame_count} samples")
    return 0


def report(runs: Positional[tuple[Path, ...]], *, robot: opt.RobotOfRun = None) -> int:
    """Write the report page of runs and comparisons: one self-contained HTML file that opens without a network.

    For a comparison it also writes tables.md and the figures for papers (PDF, SVG and PNG).

    Args:
        runs: Folders of runs and comparisons; each page is written into its folder.
    """
    from swim2real.api import run_robot
    from swim2real.calibration import RunFolder
    from swim2real.cli.comparison_files import write_files
    from swim2real.comparison.plan import PLAN
    from swim2real.report import write_report

    if not runs:
        raise ArgumentError("no run was given; give the folder of a run or a comparison")
    for run in runs:
        compared = (run / PLAN).is_file()
        say(str(write_files(run)[-1] if compared else write_report(run, run_robot(RunFolder(run), robot))))
    return 0
