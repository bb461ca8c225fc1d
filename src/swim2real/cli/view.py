"""`view`: a robot in motion, in MuJoCo's own viewer or as a film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import PUBLISHED
from swim2real.cli.terminal import say, tell
from swim2real.settings import EvaluationSettings
from swimbase.errors import ArgumentError

if TYPE_CHECKING:
    from swim2real.parameters import Values
    from swim2real.robots.robot import Robot
    from swim2real.trials import Trial
    from swim2real.viewing import Motion

FREQUENCY = 1.0  # Hz, where nobody says one
SAME_FREQUENCY = 0.05  # share by which a real trial's beat may differ from the frequency that is asked for


def view(
    subject: Positional[str], *, robot: opt.RobotOfValues = None, reference: Path | None = None,
    trial: str | None = None, frequency: float | None = None, seconds: float = 8.0,
    camera: Literal["above", "side", "ahead"] | None = None, film: Path | None = None, width: int = 960,
) -> int:  # fmt: skip
    """Show a robot in motion, with the real markers as ghosts, in MuJoCo's viewer, or write a film with --film.

    Simulates, then plays the motion repeatedly. Blue markers are simulated, red ones real. Keys: space pauses, up and
    down change the speed, left and right step, [ and ] change the camera, Esc frees it.

    Args:
        subject: Run folder, parameters file, robot (its name or .toml file), MJCF model (.xml), or 'published'.
        reference: Folder with the real trials shown as ghosts; by default the run's own.
        trial: Name of the trial; by default the one that a run fits worst, else the one that moves most, or the one
            whose frequency is nearest to --frequency.
        frequency: Frequency of the motor [Hz]; by default that of the trial, or 1 Hz.
        seconds: Longest duration shown [s].
        camera: Camera at first, by default the one it was filmed with; it follows a robot that travels. ahead: from -x,
            where a swimmer goes; it shows a roll.
        film: Film to write (.mp4) instead of opening a window. Needs no display.
        width: Width of the film [px].
    """
    from swim2real.cli.progress import loading
    from swim2real.viewing import KEYS, check_display, open_window, shown_model, write_film

    if not seconds > 0:
        raise ArgumentError(f"--seconds is {seconds:g}; it must be above 0")
    if frequency is not None and not frequency > 0:
        raise ArgumentError(f"--frequency is {frequency:g}; it must be above 0 Hz")
    if film is None:
        check_display()
    with loading(f"simulating {subject}", quiet=False):
        if subject.endswith((".xml", ".mjcf")):
            shown = shown_model(Path(subject), frequency or FREQUENCY, seconds)
        else:
            shown = _of_robot(subject, robot, reference, trial, frequency, seconds)
    begin = camera or shown.camera
    if film is not None:
        with loading(f"drawing {film}", quiet=False):
            renderer = write_film(shown, film, begin, width)
        say(f"{film}: {shown.title}, {shown.times[-1]:.1f} s, rendered by {renderer}")
    else:
        say(f"{shown.title}. Keys: {KEYS}.")
        open_window(shown, begin)
    return 0


def _of_robot(
    subject: str, given: str | None, reference: Path | None, trial: str | None, frequency: float | None, seconds: float
) -> Motion:
    """A robot's motion, beside a real trial where there is one at this frequency."""
    from swim2real.calibration import Problem
    from swim2real.trials import TrialSet, load_reference
    from swim2real.viewing import shown_swim, shown_trial

    robot, values = _robot_and_values(subject, given)
    swims = robot.trials.steady
    folder = reference or _own_reference(Path(subject))
    if folder is None:
        if trial is not None:
            raise ArgumentError(f"--trial is '{trial}', but there is no --reference to take it from")
        return shown_swim(robot, values, frequency or FREQUENCY, seconds) if swims else shown_trial(
            robot, values, None, seconds
        )  # fmt: skip
    trials = load_reference(folder)
    chosen = _chosen(trials.trials, trial, frequency, Path(subject))
    problem = Problem.with_settings(
        robot, TrialSet((chosen,), trials.marker_names), EvaluationSettings(horizon=seconds)
    )  # fmt: skip
    compared = problem.evaluate(values).trials[0]
    if not swims:
        return shown_trial(robot, values, problem.prepared[0].request, seconds, compared)
    beat = compared.frequency or FREQUENCY
    nominal = chosen.nominal_frequency or beat  # the load slows a motor down
    if frequency is not None and abs(frequency / nominal - 1) > SAME_FREQUENCY:
        tell(f"no real trial beats at {frequency:g} Hz, so none is shown")
        return shown_swim(robot, values, frequency, seconds)
    return shown_swim(robot, values, beat, seconds, compared)


def _robot_and_values(subject: str, given: str | None) -> tuple[Robot, Values]:
    from swim2real.cli.subject import robot_for, values_for
    from swim2real.robots import load_robot

    path = Path(subject)
    if subject == PUBLISHED or path.is_dir() or path.suffix == ".json":
        robot = robot_for(path, given)
        return robot, dict(values_for(path, robot))
    if given is not None:
        raise ArgumentError(f"--robot is '{given}', and '{subject}' is a robot itself; leave one of them out")
    robot = load_robot(subject)
    return robot, dict(robot.space.published)


def _own_reference(path: Path) -> Path | None:
    """The reference that a run was calibrated against, where it still is."""
    from swim2real.calibration import RunFolder

    run = RunFolder(path)
    if not run.exists:
        return None
    source = run.settings().reference
    return next((folder for folder in (path / source, Path(source)) if source and folder.is_dir()), None)


def _chosen(trials: Sequence[Trial], name: str | None, frequency: float | None, subject: Path) -> Trial:
    from swim2real.calibration import RunFolder

    if name is not None:
        for trial in trials:
            if trial.name == name:
                return trial
        raise ArgumentError(f"there is no trial '{name}'; there are {', '.join(trial.name for trial in trials)}")
    if frequency is None:
        outcome = RunFolder(subject).outcome() if subject.is_dir() else None
        fits = () if outcome is None else (outcome.fit, outcome.held_out)
        losses = {name: one.loss or 0.0 for fit in fits if fit is not None for name, one in fit.trials.items()}
        return max(trials, key=lambda trial: (losses.get(trial.name, -1.0), _moving(trial)))
    return min(trials, key=lambda trial: abs((trial.nominal_frequency or float("inf")) - frequency))


def _moving(trial: Trial) -> float:
    """Distance that the marker goes which moves most [m]."""
    import numpy as np

    seen = trial.track.positions[:, np.isfinite(trial.track.positions).all(axis=2).any(axis=0)]
    return float(np.linalg.norm(np.nanmax(seen, axis=0) - np.nanmin(seen, axis=0), axis=1).max(initial=0.0))
