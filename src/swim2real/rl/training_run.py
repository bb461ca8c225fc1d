"""A training folder: its settings, a line for every episode and every evaluation, its outcome, and their files."""

from __future__ import annotations

import json
import shlex
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, Field

from swim2real.rl.actor import Actor
from swim2real.rl.conditions import Disturbances
from swim2real.rl.tasks import check_allowed
from swim2real.robots import recorded_robot
from swim2real.robots.robot import Robot
from swim2real.robots.schema import hook_file
from swimbase import store
from swimbase.checking import Number, PathText, check, read, shown
from swimbase.errors import ArgumentError, RunError
from swimbase.parsing import from_json

SETTINGS, OUTCOME = "settings.json", "outcome.json"
EPISODES, EVALUATIONS, PROGRESS = "episodes.jsonl", "evaluations.jsonl", "progress.jsonl"
LAST, BEST = "policy.npz", "best.npz"
if TYPE_CHECKING:
    from swim2real.rl.environment import Environments

_WRITTEN = (SETTINGS, OUTCOME, EPISODES, EVALUATIONS, PROGRESS, LAST, BEST, "checkpoints/step-*")


class RecordedSettings(BaseModel):
    """Settings in settings.json that others need; the file says more.

    Attributes:
        kind: Kind of run.
        task: Task of the policy.
        robot: Name of the robot.
        robot_file: Its robot file, from the run's folder; None for a built-in robot.
        seed: Seed of the run.
        env_steps: Environment steps.
        exploration: Random steps at the start.
        parameters: Parameter sets of the simulator.
        disturbances: Disturbances of the simulator.
        reference: Where the parameters are from, in words.
    """

    kind: Literal["training"] = "training"
    task: str
    robot: str
    robot_file: PathText | None = None
    seed: int
    env_steps: int
    exploration: int
    parameters: list[dict[str, float]] = Field(min_length=1)
    disturbances: Disturbances
    reference: str = "as trained"


@dataclass
class TrainingSeconds:
    """Seconds that the parts of a training took [s].

    Attributes:
        total: All of it.
        learner: Gradient steps.
        simulator: Steps of the environments.
        evaluation: Evaluations of the policy.
    """

    total: float = 0.0
    learner: float = 0.0
    simulator: float = 0.0
    evaluation: float = 0.0


@dataclass(frozen=True)
class TrainingOutcome:
    """Outcome of a training.

    Attributes:
        complete: Whether all steps were made.
        step: Environment steps that were made.
        seconds: Where the time went.
        steps_per_second: Environment steps per second.
        learner_share: Share of the time that gradient steps took.
        simulator_share: Share of the time that environment steps took.
        gradient_steps: Gradient steps that were made.
        episodes: Number of episodes that ended.
        last_evaluation: Figures of the last evaluation, as in evaluations.jsonl; None before the first one.
    """

    complete: bool
    step: int
    seconds: TrainingSeconds
    steps_per_second: float
    learner_share: float
    simulator_share: float
    gradient_steps: int
    episodes: int
    last_evaluation: dict[str, Any] | None


@dataclass(frozen=True)
class TrainingRun:
    """A training folder that can be read.

    Attributes:
        folder: The folder.
        settings: Its settings.
        allow_code: Whether code may run that its task or its robot file names; where not, code that was allowed before
            may.
        given_robot: Where its robot file is; None for where its settings say.
    """

    folder: Path
    settings: RecordedSettings
    allow_code: bool = False
    given_robot: str | None = None

    @classmethod
    def open(cls, folder: str | Path, *, allow_code: bool = False, robot: str | None = None) -> TrainingRun:
        """Opens a training folder.

        Args:
            folder: The folder.
            allow_code: Run the Python code that its task and its robot file name, when they are asked for, and
                remember that.
            robot: Where its robot file is; by default where its settings say.

        Raises:
            RunError: The folder is no training run, or its settings are damaged.
        """
        path = Path(folder) / SETTINGS
        check_there(Path(folder))
        try:
            settings = read(RecordedSettings, path, "training settings", RunError)
        except ArgumentError as error:
            raise RunError(f"training settings '{path}': {error}") from error
        return cls(Path(folder), settings, allow_code, robot)

    @property
    def task(self) -> str:
        """Task of the policy, as `tasks.find_task` takes it; that of a file with its place from here.

        Raises:
            ConsentError: It names Python code that wasn't allowed.
        """
        task, file = self.settings.task, hook_file(self.settings.task)
        place = task if file is None else task.replace(file, str(self.folder / file), 1)
        check_allowed(place, f"training run '{self.folder}'", allow_code=self.allow_code)
        return place

    @property
    def robot(self) -> Robot:
        """The robot that the policy was trained for.

        Raises:
            RunError: It isn't known here, or another one was given.
            ConsentError: Its file names Python code that wasn't allowed.
        """
        settings = self.settings
        return recorded_robot(
            self.folder, settings.robot, settings.robot_file, self.given_robot, allow_code=self.allow_code
        )

    def check_fits(self, actor: Actor, environments: Environments) -> None:
        """Checks that a policy takes what is observed of a robot as it is now, and commands its actuators.

        Raises:
            RunError: It doesn't, or its file says that it was made for others of as many numbers.
        """
        robot, interface = environments.bodies.robot.name, environments.interface
        here, names = interface["observation"], interface["actions"]
        trained, commanded = actor.about.observation, actor.about.actions
        differing = [part for part in {**trained, **here} if trained and trained.get(part) != here.get(part)]
        size = len((actor.hidden or (actor.mean,))[0].weight), len(actor.mean.bias)
        if differing or (commanded or names) != names or size != (environments.observations.shape[1], len(names)):
            what = f"{', '.join(differing)} of what it observes differ" if differing else f"its network has {size}"
            raise RunError(
                f"the policy of '{self.folder}' doesn't fit robot '{robot}': {what}; it observes {', '.join(trained)} "
                f"and commands {', '.join(commanded)}, the robot has {', '.join(here)} and {', '.join(names)}: take "
                f"another robot, or train anew"
            )

    @property
    def outcome(self) -> TrainingOutcome | None:
        """Outcome of the training; None while it runs for the first time."""
        path = self.folder / OUTCOME
        return read(TrainingOutcome, path, "training outcome", RunError) if path.is_file() else None

    @property
    def episodes(self) -> list[dict[str, Any]]:
        """A line for every episode that ended while learning."""
        return read_record(self.folder / EPISODES)

    @property
    def evaluations(self) -> list[dict[str, Any]]:
        """A line for every evaluation."""
        return read_record(self.folder / EVALUATIONS)


def check_there(folder: Path) -> None:
    """Checks that a folder holds a training run.

    Raises:
        RunError: It holds none, or a calibration.
    """
    path = folder / SETTINGS
    if not path.is_file():
        raise RunError(f"'{folder}' is no training run: it has no {SETTINGS}; `swim2real train` makes one")
    content: Any = None
    with suppress(OSError, ValueError):  # what is wrong with them is said where they are read
        content = store.read_json(path)
    if isinstance(content, dict) and "task" not in content and "method" in content:
        given = shlex.quote(str(folder))
        raise RunError(
            f"'{folder}' is a calibration, not a training run: train a policy in its simulator with "
            f"`swim2real train forward --parameters {given} --out POLICY`, or watch it with `swim2real view {given}`"
        )


@contextmanager
def locked_folder(folder: Path) -> Generator[None]:
    """Keeps other processes out of a training folder, and removes what one that was killed has left half written.

    Raises:
        RunError: Another process has it, or a file can't be written, such as on a full disk.
    """
    busy = f"another process is training into '{folder}'; wait for it or choose another"
    remedy = "--resume goes on from the last checkpoint, or choose another folder"
    with store.writing(folder, RunError, remedy, busy=busy), store.locked(folder):
        store.remove_leftovers(folder, _WRITTEN)
        yield


def check_same_settings(folder: Path, content: Mapping[str, Any]) -> None:
    """Checks that a run to be resumed was begun with the same settings.

    Raises:
        RunError: A setting differs; the sentence names it with both values.
    """
    check_there(folder)
    path = folder / SETTINGS
    recorded = read(dict[str, object], path, "training settings", RunError)
    for key, value in content.items():
        if recorded.get(key) != value:
            raise RunError(
                f"'{folder}' was begun with another {key}: {shown(recorded.get(key))}, now {shown(value)}; "
                f"resume with the same, or begin a new run"
            )


class _Line(BaseModel, extra="allow"):
    """Columns of a record that charts need; its lines say more."""

    step: int
    episode_return: Number | None = None
    distance: Number | None = None
    success: Number | bool | None = None
    stage: int | None = None


def read_record(path: Path) -> list[dict[str, Any]]:
    """Lines of a record; a line that a crash cut off doesn't count, and a file that isn't there has none.

    Raises:
        RunError: A line isn't JSON, or lacks a number that is drawn.
    """
    try:
        lines = [from_json(line) for line in store.read_lines(path)]
    except ValueError as error:
        raise RunError(f"record '{path}' is damaged: {error}") from error
    for number, line in enumerate(lines, start=1):
        check(_Line, line, f"record '{path}', line {number}", RunError, "restore it, or train anew")
    return lines


def cut_record(path: Path, step: int) -> None:
    """Drops the lines of a record that were written after an environment step."""
    if not path.exists():
        return
    store.drop_cut_line(path)
    store.write_text(path, "".join(json.dumps(line) + "\n" for line in read_record(path) if line["step"] <= step))
