"""Trains a policy: environment steps, learning, evaluations, checkpoints, and going on after an interruption."""

from __future__ import annotations

import json
import logging
import shutil
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from swim2real.errors import RunError
from swim2real.parameters import Values
from swim2real.rl import training_run as files
from swim2real.rl.conditions import UNDISTURBED, Disturbances
from swim2real.rl.environment import make_environments
from swim2real.rl.learner import (
    EpisodeMonitor,
    list_checkpoints,
    load_checkpoint,
    log_to,
    make_learner,
    write_checkpoint,
)
from swim2real.rl.policies import LearnedPolicy
from swim2real.rl.rollout import EpisodeStatistics, run_episodes
from swim2real.rl.tasks import STAGES, Curriculum
from swim2real.rl.training_run import TrainingOutcome, TrainingSeconds
from swim2real.rl.vector import make_vector_env
from swim2real.robots.robot import Robot
from swim2real.settings import BLOCK, TrainingSettings
from swim2real.store import whole_file, write_json

REPORT_EVERY = 2.0  # s, between two reports of progress
EVALUATION_SEED = 1_000_000  # of the episodes that choose the best policy; an assessment's begin elsewhere
EVALUATION_EPISODES = 8
RECENT_EPISODES = 50  # of which progress reports the means
_RECORDS = (files.EPISODES, files.EVALUATIONS, files.PROGRESS)
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    Attributes:
        step: Environment steps made.
        total: Environment steps to be made.
        rate: Environment steps a second of late.
        episodes: Episodes that ended so far.
        episode_return: Mean return of the last 50 episodes; None before the first has ended.
        distance: Mean distance forward of these [m].
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
    resume: bool = False, on_progress: Callable[[Progress], None] = lambda progress: None,
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
        threads: Threads of the environments; torch takes one. Results don't depend on it.
        resume: Whether to go on with the run that is in the folder.
        on_progress: Called every two seconds, and after every evaluation.
        stop: Called after every 200 transitions; when it returns true, a checkpoint is written and the run ends.

    Returns:
        The outcome, as in outcome.json, with `complete` false when the run was stopped.

    Raises:
        RunError: The folder holds another run, or a damaged one.
    """
    trainer = _Trainer(settings, list(parameters), robot, Path(out), disturbances, threads)
    try:
        trainer.begin(dict(about or {}), resume)
        return trainer.run(on_progress, stop)
    finally:
        trainer.close()


class _Trainer:
    """One run: the learner, its environments, and the records of both."""

    def __init__(
        self, settings: TrainingSettings, parameters: list[Values], robot: Robot, out: Path,
        disturbances: Disturbances, threads: int,
    ) -> None:  # fmt: skip
        torch.set_num_threads(1)  # the networks are small, and more threads gain little
        self.settings, self.parameters, self.robot, self.out = settings, parameters, robot, out
        self.disturbances = disturbances
        self.curriculum = Curriculum(tuple(STAGES)) if settings.task == "target" else None
        self.environments = make_vector_env(
            settings.task, parameters, settings.environments, robot=robot, threads=threads, seed=settings.seed,
            disturbances=disturbances, stage=self.curriculum.stage if self.curriculum else 3,
        )  # fmt: skip
        self.monitor = EpisodeMonitor(settings.environments, self._note_episode)
        self.ended: list[dict[str, Any]] = []
        self.recent: deque[dict[str, Any]] = deque(maxlen=RECENT_EPISODES)
        self.episodes = 0
        self.seconds = {"total": 0.0, "learner": 0.0, "simulator": 0.0, "evaluation": 0.0}
        self.best: tuple[float, ...] | None = None
        self._counted = time.perf_counter()

    def begin(self, about: dict[str, Any], resume: bool) -> None:
        """Makes the folder and the learner, or reads them."""
        content = {
            "kind": "training", "robot": self.robot.name, **asdict(self.settings),
            "exploration": self.settings.exploration_steps, "updates": self.settings.updates_a_block,
            "checkpoint_every": self.settings.checkpoint_steps, "disturbances": asdict(self.disturbances),
            "parameters": [dict(values) for values in self.parameters],
        }  # fmt: skip
        content = json.loads(json.dumps(content))  # tuples as lists, as in the file
        if resume:
            files.check_same_settings(self.out, content)
            if whole := [checkpoint for checkpoint in list_checkpoints(self.out) if checkpoint.resumable]:
                self.learner, state = load_checkpoint(whole[-1], self.environments)
                self._restore(state)
                for name in _RECORDS:
                    files.cut_record(self.out / name, whole[-1].step)
                log_to(self.learner, self.out / "tensorboard")
                return
            _log.info("'%s' has no checkpoint yet; it is begun anew", self.out)
            for name in _RECORDS:
                (self.out / name).unlink(missing_ok=True)
        elif (self.out / files.SETTINGS).exists():
            raise RunError(f"'{self.out}' already holds a run; go on with --resume, or choose another folder")
        else:
            files.write_settings(self.out, {**content, **about})
        self.learner = make_learner(self.settings, self.environments)
        log_to(self.learner, self.out / "tensorboard")

    def run(self, on_progress: Callable[[Progress], None], stop: Callable[[], bool]) -> TrainingOutcome:
        """Steps and learns to the end, or until `stop` returns true."""
        settings, learner = self.settings, self.learner
        self._counted = time.perf_counter()
        last_report, mark = 0.0, (self._counted, learner.num_timesteps)
        stopped = False
        while learner.num_timesteps < settings.total_steps and not stopped:
            evaluation = None
            self._learn_block()
            step = learner.num_timesteps
            files.append_record(self.out / files.EPISODES, [{"step": step, **line} for line in self.ended])
            self.ended.clear()
            if self.curriculum and self.curriculum.advance():
                self.environments.env_method("set_stage", self.curriculum.stage)
            stopped = stop()
            if step % settings.checkpoint_steps == 0 or stopped or step >= settings.total_steps:
                if step > settings.exploration_steps and not stopped:
                    evaluation = self._evaluate(step)
                self._save()
            now = self._count_time()
            if evaluation or now - last_report > REPORT_EVERY or step >= settings.total_steps:
                progress = self._progress((step - mark[1]) / max(now - mark[0], 1e-9), evaluation)
                last_report, mark = now, (now, step)
                self._log_progress(progress)
                on_progress(progress)
        return self._finish(complete=not stopped or learner.num_timesteps >= settings.total_steps)

    def close(self) -> None:
        """Ends the threads of the environments."""
        self.environments.close()

    def _count_time(self) -> float:
        """Adds the time since the last call to the total, and returns the time now [s of time.perf_counter]."""
        now = time.perf_counter()
        self.seconds["total"] += now - self._counted
        self._counted = now
        return now

    def _learn_block(self) -> None:
        """Makes 200 transitions and the gradient steps after them."""
        simulated = self.environments.step_seconds
        first = self.learner.num_timesteps == 0
        self.learner.learn(
            BLOCK,
            self.monitor,
            log_interval=None,  # pyright: ignore[reportArgumentType] - None is what switches its own log off
            reset_num_timesteps=first,
        )
        self.seconds["learner"] += time.perf_counter() - self.monitor.rollout_end
        self.seconds["simulator"] += self.environments.step_seconds - simulated

    def _note_episode(self, info: dict[str, Any]) -> None:
        line: dict[str, Any] = {
            "episode_return": info["episode_return"], "length": info["length"], "distance": float(info["distance"]),
            "success": bool(info["success"]), "ended": info.get("diverged") or "",
        }  # fmt: skip
        if self.curriculum:
            line["stage"] = int(info.get("stage", self.curriculum.stage))
            self.curriculum.note(line["success"], line["stage"])
        self.ended.append(line)
        self.recent.append(line)
        self.episodes += 1

    def _evaluate(self, step: int) -> dict[str, Any]:
        """Swims without exploration, on starts of its own, and keeps the policy if it is the best so far."""
        begun = time.perf_counter()
        stage = self.curriculum.stage if self.curriculum else 3
        environments = make_environments(
            self.settings.task, self.parameters, EVALUATION_EPISODES, robot=self.robot,
            disturbances=self.disturbances, stage=stage,
        )  # fmt: skip
        seeds = range(EVALUATION_SEED, EVALUATION_SEED + EVALUATION_EPISODES)
        statistics = EpisodeStatistics.of(run_episodes(environments, LearnedPolicy(self.learner), seeds))
        line = {"step": step, **({"stage": stage} if self.curriculum else {}), **statistics.as_dict()}
        files.append_record(self.out / files.EVALUATIONS, [line])
        rank = (float(stage), statistics.success, statistics.episode_return)
        if self.best is None or rank > self.best:
            self.best = rank
            with whole_file(self.out / files.BEST) as part:
                self.learner.save(part)
        self.seconds["evaluation"] += time.perf_counter() - begun
        return line

    def _progress(self, rate: float, evaluation: Mapping[str, Any] | None) -> Progress:
        def mean(key: str) -> float | None:
            return float(np.mean([line[key] for line in self.recent])) if self.recent else None

        step, total = self.learner.num_timesteps, self.settings.total_steps
        seconds = max(self.seconds["total"], 1e-9)
        return Progress(
            step, total, rate, self.episodes, mean("episode_return"), mean("distance"), mean("success"),
            self.curriculum.stage if self.curriculum else None, self.seconds["learner"] / seconds,
            (total - step) * seconds / step, evaluation,
        )  # fmt: skip

    def _log_progress(self, progress: Progress) -> None:
        logger = self.learner.logger
        for key, value in (
            ("episodes/return", progress.episode_return), ("episodes/distance", progress.distance),
            ("episodes/success", progress.success), ("time/steps_per_second", progress.rate),
            ("time/learner_share", progress.learner_share),
        ):  # fmt: skip
            if value is not None:
                logger.record(key, value)
        for key in ("episode_return", "distance", "success"):
            if progress.evaluation:
                logger.record(f"evaluation/{key}", progress.evaluation[key])
        logger.dump(progress.step)
        line = {"step": progress.step, "rate": progress.rate, **self.seconds}
        files.append_record(self.out / files.PROGRESS, [line])

    def _save(self) -> None:
        self._count_time()
        state = {
            "seconds": dict(self.seconds), "episodes": self.episodes, "recent": list(self.recent), "best": self.best,
            "curriculum": self.curriculum.state() if self.curriculum else None,
            "returns": self.monitor.returns.copy(), "lengths": self.monitor.lengths.copy(),
            "environments": [env.save_state() for env in self.environments.envs],
        }  # fmt: skip
        checkpoint = write_checkpoint(self.out, self.learner, state)
        with whole_file(self.out / files.LAST) as part:
            shutil.copyfile(checkpoint.model, part)

    def _restore(self, state: dict[str, Any]) -> None:
        self.seconds, self.episodes, self.best = state["seconds"], state["episodes"], state["best"]
        self.recent.extend(state["recent"])
        if self.curriculum:
            self.curriculum.restore(state["curriculum"])
            self.environments.env_method("set_stage", self.curriculum.stage)
        self.monitor.returns[:], self.monitor.lengths[:] = state["returns"], state["lengths"]
        for env, kept in zip(self.environments.envs, state["environments"], strict=True):
            env.restore_state(kept)

    def _finish(self, complete: bool) -> TrainingOutcome:
        evaluations = files.read_record(self.out / files.EVALUATIONS)
        outcome = TrainingOutcome(
            complete=complete,
            step=self.learner.num_timesteps,
            seconds=TrainingSeconds(**self.seconds),
            gradient_steps=int(self.learner._n_updates),  # pyright: ignore[reportPrivateUsage]
            episodes=self.episodes,
            last_evaluation=evaluations[-1] if evaluations else None,
        )
        try:
            write_json(self.out / files.OUTCOME, outcome.as_dict())
        except OSError as error:
            raise RunError(f"'{self.out / files.OUTCOME}' can't be written: {error.strerror or error}") from error
        return outcome
