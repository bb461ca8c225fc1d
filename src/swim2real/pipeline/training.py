"""A policy in the simulator of a fit: whether the fit goes forward, where it comes from, and the training itself."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from swim2real.calibration.from_rest import backward_from_rest, from_rest
from swim2real.calibration.provenance import made_by
from swim2real.parameters import Values
from swim2real.rl import training
from swim2real.rl.body import policy_setup
from swim2real.rl.conditions import UNDISTURBED, Disturbances
from swim2real.rl.training import TrainingProgress
from swim2real.rl.training_run import TrainingOutcome
from swim2real.robots.robot import Robot
from swim2real.settings import TrainingSettings
from swim2real.simulation import Engine, Simulator
from swimbase.errors import ArgumentError
from swimbase.store import source_from

_LIBRARIES = ("gymnasium", "stable-baselines3", "torch")
_log = logging.getLogger(__name__)


def train(
    settings: TrainingSettings, parameters: Sequence[Values], robot: Robot, out: str | Path, *, reference: str = "",
    disturbances: Disturbances = UNDISTURBED, anyway: bool = False, threads: int = 1, resume: bool = False,
    on_progress: Callable[[TrainingProgress], None] = lambda progress: None, stop: Callable[[], bool] = lambda: False,
) -> TrainingOutcome:  # fmt: skip
    """Trains a policy into a folder, as `rl.training.train`, and records versions and where the parameters are from.

    Args:
        settings: Settings of the run.
        parameters: Parameters of the simulator. One set is refused where it swims tail first from rest; of several, an
            ensemble, one is drawn for each episode.
        robot: Robot whose parameters they are.
        out: Folder to write.
        reference: Where the parameters are from: a path, or words.
        disturbances: Disturbances of the simulator while it learns.
        anyway: Only warn about a simulator that swims tail first from rest.
        threads: Threads that step the environments. Results don't depend on it.
        resume: Whether to go on with the run that is in the folder.
        on_progress: Called every two seconds, and after every evaluation.
        stop: Called after every 200 transitions; when it returns true, a checkpoint is written and the run ends.

    Raises:
        ArgumentError: The simulator swims tail first.
        RunError: The folder holds another run, or a damaged one.
    """
    if len(parameters) == 1 and (warning := _backward(robot, parameters[0])):
        where = f"'{reference or 'parameters'}': {warning}"
        if not (anyway or resume):
            raise ArgumentError(f"{where}; --anyway trains all the same")
        _log.warning("%s", where)
    about = {
        "reference": source_from(Path(out), reference),
        "engine": Engine.of(robot).as_dict(),
        **made_by(*_LIBRARIES),
    }
    return training.train(
        settings, parameters, robot, out, about=about, disturbances=disturbances, threads=threads, resume=resume,
        on_progress=on_progress, stop=stop,
    )  # fmt: skip


def _backward(robot: Robot, values: Values) -> str | None:
    """Simulates a steady swimmer's greatest motor speed from rest; a warning if it swims tail first or diverges."""
    if robot.motor_joint is None:
        return None
    fastest = next(iter(policy_setup(robot).actuators.values())).upper
    return backward_from_rest(from_rest(Simulator(robot, 1), values, {"fastest": fastest / math.tau}))
