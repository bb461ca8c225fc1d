"""Trains a policy: environment steps and learning beside them, evaluations, checkpoints, resuming.

A round is 200 transitions, made with the policy of the round before: meanwhile the learner learns from what was there
before the round. So learning and simulating use different cores, and the results depend on neither's speed.
"""

from __future__ import annotations

import json
import logging
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from swim2real.parameters import Values
from swim2real.rl import learner
from swim2real.rl import training_run as files
from swim2real.rl.conditions import CONTROL_INTERVAL, UNDISTURBED, Disturbances
from swim2real.rl.environment import Environments, make_environments
from swim2real.rl.rollout import EpisodeStatistics, run_episodes
from swim2real.rl.tasks import Curriculum
from swim2real.rl.training_run import TrainingOutcome, TrainingSeconds
from swim2real.robots.robot import Robot
from swim2real.robots.schema import hook_file
from swim2real.settings import TRAIN_FREQ, TrainingSettings
from swimbase.errors import ArgumentError, RunError
from swimbase.store import append_lines, path_from, write_json

REPORT_EVERY = 2.0  # s, between two reports of progress
EVALUATION_SEED = 1_000_000  # of the episodes that choose the best policy; an assessment's begin elsewhere
EVALUATION_EPISODES = 8
_EXPLORATION, _RETURNS, _NOISE = 1, "returns", "noise"  # number of a random stream; arrays of a checkpoint
RECENT_EPISODES = 50  # of which progress reports the means
_FIGURES = ("episode_return", "distance", "success")
_RECORDS = (files.EPISODES, files.EVALUATIONS, files.PROGRESS)
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainingProgress:
    """Progress of a training.

    Attributes:
        step: Environment steps made.
        total: Environment steps to be made.
        rate: Environment steps per second of late.
        episodes: Episodes that ended so far.
        episode_return: Mean return of the last 50 episodes; None before the first has ended.
        distance: Mean distance forward of these [m]; 0 for a robot without a frame.
        success: Share of successes of these.
        stage: Stage of the curriculum; None without one.
        learner_share: Share of the time that learning took so far.
        seconds_left: Estimate of the time left [s].
        evaluation: Figures of the present policy, as in evaluations.jsonl; None between evaluations.
    """

    step: int
    total: int
    rate: float
    episodes: int
    episode_return: float | None
    distance: float | None
    success: float | None
    stage: int | None
    learner_share: float
    seconds_left: float
    evaluation: Mapping[str, Any] | None = None


def train(
    settings: TrainingSettings, parameters: Sequence[Values], robot: Robot, out: str | Path, *,
    about: Mapping[str, Any] | None = None, disturbances: Disturbances = UNDISTURBED, threads: int = 1,
    resume: bool = False, on_progress: Callable[[TrainingProgress], None] = lambda progress: None,
    stop: Callable[[], bool] = lambda: False,
) -> TrainingOutcome:  # fmt: skip
    """Trains a policy into a folder.

    Args:
        settings: Settings of the run.
        parameters: Parameters of the simulator; of several sets, one is drawn for each episode.
        robot: Robot whose parameters they are.
        out: Folder to write.
        about: Further entries of settings.json, such as versions.
        disturbances: Disturbances of the simulator while it learns.
        threads: Threads that step the environments; one of them learns in between. Results don't depend on it.
        resume: Whether to go on with the run that is in the folder.
        on_progress: Called every two seconds, and after every evaluation.
        stop: Called after every 200 transitions; when it returns true, a checkpoint is written and the run ends.

    Returns:
        The outcome, as in outcome.json, with `complete` false when the run was stopped.

    Raises:
        RunError: The folder holds another run, or a damaged one.
    """
    if resume:
        files.check_there(Path(out))  # before anything is made of it
    with (
        closing(Trainer(settings, list(parameters), robot, Path(out), disturbances, threads)) as trainer,
        files.locked_folder(trainer.out),
    ):
        trainer.begin(about or {}, resume)
        return trainer.run(on_progress, stop)


class Trainer:
    """One run: the learner, its environments, and the records of both."""

    def __init__(
        self, settings: TrainingSettings, parameters: list[Values], robot: Robot, out: Path,
        disturbances: Disturbances, threads: int,
    ) -> None:  # fmt: skip
        self.settings, self.parameters, self.robot, self.out = settings, parameters, robot, out
        self.disturbances, self.threads = disturbances, threads
        self.environments = make_environments(
            settings.task, parameters, settings.environments, robot=robot, threads=threads, seed=settings.seed,
            disturbances=disturbances,
        )  # fmt: skip
        self.curriculum = Curriculum(self.environments.task.stages)
        task, pool = self.environments.task, self.environments.robots.batch.pool
        self.discount = task.discount if settings.discount is None else settings.discount
        self.learner = learner.Learner(settings, learner.RobotVecEnv(self.environments), self.discount, pool)
        self.actor = self.learner.actor
        for name in ("near_goals", "turn_reward"):
            value = getattr(settings, name)
            if name in getattr(task, "takes", ()):
                setattr(task, name, value)
            elif value:
                raise ArgumentError(f"{name} is {value:g}, which isn't for task '{settings.task}': leave it out")
        self.exploration = np.random.default_rng(np.random.SeedSequence([settings.seed, _EXPLORATION]))
        self.noise = self.exploration.standard_normal((settings.environments, len(self.environments.bodies.actuators)))
        self.memory = math.exp(-CONTROL_INTERVAL / settings.noise_time) if settings.noise_time else 0.0
        self.returns = np.zeros(settings.environments)
        self.ended: list[dict[str, Any]] = []
        self.recent: deque[dict[str, Any]] = deque(maxlen=RECENT_EPISODES)
        self.step = self.episodes = 0
        self.seconds = TrainingSeconds()
        self.best: list[float] | None = None
        self._counted = time.perf_counter()

    def begin(self, about: Mapping[str, Any], resume: bool) -> None:
        """Makes the folder, or goes on with the last checkpoint in it."""
        from stable_baselines3.common.logger import configure

        source = {} if self.robot.source is None else {"robot_file": path_from(self.out, self.robot.source)}
        task, file = self.settings.task, hook_file(self.settings.task)  # with its place from the folder
        content = {
            "kind": "training", "robot": self.robot.name, **source, **asdict(self.settings),
            "task": task if file is None else task.replace(file, path_from(self.out, Path(file)), 1),
            "exploration": self.settings.exploration_steps,
            "updates": self.settings.updates_per_round, "discount": self.discount,
            "checkpoint_every": self.settings.checkpoint_steps, "disturbances": asdict(self.disturbances),
            "parameters": [dict(values) for values in self.parameters],
        }  # fmt: skip
        content = json.loads(json.dumps(content))  # tuples as lists, as in the file
        self._set_stage()
        self.environments.begin(np.arange(self.environments.count))
        if resume:
            files.check_same_settings(self.out, content)
            whole = [checkpoint for checkpoint in learner.list_checkpoints(self.out) if checkpoint.resumable]
            if whole:
                with whole[-1].errors():
                    self._restore(*whole[-1].load(self.learner))
                learner.remove_older_replay_buffers(self.out, self.step)
            else:
                _log.info("'%s' has no checkpoint yet; it is begun anew", self.out)
            for name in _RECORDS:
                files.cut_record(self.out / name, self.step)
        elif (self.out / files.SETTINGS).exists():
            raise RunError(f"'{self.out}' already holds a run; go on with --resume, or choose another folder")
        else:
            write_json(self.out / files.SETTINGS, {**content, **about})
        self.log = configure(str(self.out / "tensorboard"), ["tensorboard"] if find_spec("tensorboard") else [])

    def run(self, on_progress: Callable[[TrainingProgress], None], stop: Callable[[], bool]) -> TrainingOutcome:
        """Steps and learns to the end, or until `stop` returns true."""
        settings = self.settings
        self._counted = time.perf_counter()
        last_report, mark, stopped = 0.0, (self._counted, self.step), False
        while self.step < settings.total_steps and not stopped:
            evaluation = None
            self.round()
            append_lines(self.out / files.EPISODES, [{"step": self.step, **line} for line in self.ended])
            self.ended.clear()
            if self.curriculum.advance():
                self._set_stage()
            over = self.step >= settings.total_steps
            if over and self._learns:  # from the last transitions, which no round follows
                self.learner.start()
                self._wait()
            stopped = stop()
            if self.step % settings.checkpoint_steps == 0 or stopped or over:
                paused = time.perf_counter()
                if self._learns and not stopped:
                    evaluation = self._evaluate()
                self._save()
                mark = (mark[0] + time.perf_counter() - paused, mark[1])  # the rate is of training alone
            now = self._count_time()
            if evaluation or now - last_report > REPORT_EVERY or over:
                progress = self._progress((self.step - mark[1]) / max(now - mark[0], 1e-9), evaluation)
                last_report, mark = now, (now, self.step)
                self._log_progress(progress)
                on_progress(progress)
        return self._finish()

    def close(self) -> None:
        """Ends the threads."""
        self.environments.close()
        if "_evaluation" in vars(self):
            self._evaluation.close()

    @cached_property
    def _evaluation(self) -> Environments:
        """Environments of evaluations, compiled once."""
        return make_environments(
            self.settings.task, self.parameters, EVALUATION_EPISODES, robot=self.robot,
            disturbances=self.disturbances, threads=self.threads,
        )  # fmt: skip

    @property
    def _learns(self) -> bool:
        return self.step > self.settings.exploration_steps

    def _set_stage(self) -> None:
        if self.curriculum.stage is not None:
            self.environments.set_stage(self.curriculum.stage)

    def _count_time(self) -> float:
        """Adds the time since the last call to the total, and returns the time now [s of time.perf_counter]."""
        now = time.perf_counter()
        self.seconds.total += now - self._counted
        self._counted = now
        return now

    def round(self) -> None:
        """Makes 200 transitions, while the learner learns from those before them."""
        if self._learns:
            self.learner.start()
        begun = time.perf_counter()
        made = [self._step() for _ in range(TRAIN_FREQ // self.environments.count)]
        self.seconds.simulator += time.perf_counter() - begun
        self._wait()
        for transitions in made:
            self.learner.add(transitions)

    def _wait(self) -> None:
        """Waits for the learner, and takes its policy over."""
        self.seconds.learner += self.learner.wait()
        self.actor = self.learner.actor

    def _step(self) -> learner.Transitions:
        """One step of all environments."""
        environments = self.environments
        before = environments.observations.copy()
        if self.step < self.settings.exploration_steps:
            actions = 2.0 * ndtr(self.noise) - 1.0  # each is uniform, and alike from step to step as the noise is
        else:
            actions = self.actor.sample(before, self.noise)
        fresh = self.exploration.standard_normal(self.noise.shape)
        self.noise = self.memory * self.noise + math.sqrt(1.0 - self.memory**2) * fresh
        stepped = environments.step(actions)
        after = environments.observations.copy()
        self.returns += stepped.rewards
        ended = np.flatnonzero(stepped.ended)
        for i in ended:
            self._note_episode(int(i), bool(stepped.success[i]))
        if len(ended):
            environments.begin(ended)
        self.step += environments.count
        return learner.Transitions(before, actions, stepped.rewards, after, stepped.ended, stepped.truncated)

    def _note_episode(self, index: int, success: bool) -> None:
        info = self.environments.info(index)
        line: dict[str, Any] = {
            "episode_return": float(self.returns[index]), "length": round(info["time"] / CONTROL_INTERVAL),
            "distance": float(info["distance"]), "success": success,
            "ended": info.get("diverged", ""),
        }  # fmt: skip
        if self.curriculum.stage is not None:
            line["stage"] = int(info.get("stage", self.curriculum.stage))
            self.curriculum.note(success, line["stage"])
        self.returns[index] = 0.0
        self.ended.append(line)
        self.recent.append(line)
        self.episodes += 1

    def _evaluate(self) -> Mapping[str, object]:
        """Runs without exploration, from starts of its own, and keeps the policy if it is the best so far."""
        begun = time.perf_counter()
        environments, stage = self._evaluation, self.curriculum.stage
        if stage is not None:
            environments.set_stage(stage)
        seeds = range(EVALUATION_SEED, EVALUATION_SEED + EVALUATION_EPISODES)
        statistics = EpisodeStatistics.of(run_episodes(environments, self.actor, seeds))
        line = {"step": self.step, **({} if stage is None else {"stage": stage}), **asdict(statistics)}
        append_lines(self.out / files.EVALUATIONS, [line])
        rank = [float(stage or 0), statistics.success, statistics.episode_return]
        if self.best is None or rank > self.best:
            self.best = rank
            self._write_policy(files.BEST)
        self.seconds.evaluation += time.perf_counter() - begun
        return line

    def _write_policy(self, name: str) -> None:
        about = {
            "robot": self.robot.name, "task": self.settings.task, "step": self.step, **self.environments.interface,
        }  # fmt: skip
        self.actor.save(self.out / name, about)

    def _progress(self, rate: float, evaluation: Mapping[str, Any] | None) -> TrainingProgress:
        def mean(key: str) -> float | None:
            return float(np.mean([line[key] for line in self.recent])) if self.recent else None

        total, seconds = self.settings.total_steps, max(self.seconds.total, 1e-9)
        return TrainingProgress(
            self.step, total, rate, self.episodes, mean("episode_return"), mean("distance"), mean("success"),
            self.curriculum.stage, self.seconds.learner / seconds, (total - self.step) * seconds / self.step,
            evaluation,
        )  # fmt: skip

    def _log_progress(self, progress: TrainingProgress) -> None:
        for key, value in (
            ("episodes/return", progress.episode_return), ("episodes/distance", progress.distance),
            ("episodes/success", progress.success), ("time/steps_per_second", progress.rate),
            ("time/learner_share", progress.learner_share),
        ):  # fmt: skip
            if value is not None:
                self.log.record(key, value)
        for key in _FIGURES:
            if progress.evaluation:
                self.log.record(f"evaluation/{key}", progress.evaluation[key])
        self.log.dump(progress.step)
        append_lines(
            self.out / files.PROGRESS, [{"step": progress.step, "rate": progress.rate, **asdict(self.seconds)}]
        )

    def _save(self) -> None:
        self._count_time()
        arrays, rest = self.environments.save()
        state = {
            "step": self.step, "seconds": asdict(self.seconds), "episodes": self.episodes, "recent": list(self.recent),
            "best": self.best, "curriculum": self.curriculum.state(),
            "exploration": self.exploration.bit_generator.state, "environments": rest,
        }  # fmt: skip
        arrays |= {_RETURNS: self.returns, _NOISE: self.noise}
        self._write_policy(files.LAST)  # first: after the last checkpoint a run that goes on writes no policy
        learner.write_checkpoint(self.out, self.step, self.learner, arrays, state)

    def _restore(self, arrays: dict[str, NDArray[Any]], state: Mapping[str, Any]) -> None:
        """Goes on with what `_save` kept. Damaged content raises errors of many types."""
        self.step, self.episodes = int(state["step"]), int(state["episodes"])
        self.seconds = TrainingSeconds(**state["seconds"])
        self.best = None if state["best"] is None else [float(figure) for figure in state["best"]]
        for line in state["recent"]:
            _ = [float(line[figure]) for figure in _FIGURES]  # which progress reports the means of
            self.recent.append(line)
        self.exploration.bit_generator.state = state["exploration"]
        self.curriculum.restore(state["curriculum"])
        self._set_stage()
        self.returns[:], self.noise[:] = arrays[_RETURNS], arrays[_NOISE]
        self.environments.restore(arrays, state["environments"])
        self.actor = self.learner.actor

    def _finish(self) -> TrainingOutcome:
        evaluations, seconds = files.read_record(self.out / files.EVALUATIONS), self.seconds
        total = max(seconds.total, 1e-9)
        outcome = TrainingOutcome(
            self.step >= self.settings.total_steps, self.step, seconds, self.step / total, seconds.learner / total,
            seconds.simulator / total, self.learner.updates, self.episodes, evaluations[-1] if evaluations else None,
        )  # fmt: skip
        write_json(self.out / files.OUTCOME, asdict(outcome))
        return outcome
