"""Trains a policy: environment steps, learning, evaluations, checkpoints, and going on after an interruption."""

from __future__ import annotations

import logging
import shutil
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.errors import RunError
from swim2real.parameters import Values
from swim2real.rl import run_files
from swim2real.rl.curriculum import Curriculum
from swim2real.rl.disturbances import UNDISTURBED, Disturbances
from swim2real.rl.extras import require_learning
from swim2real.robots.robot import Robot
from swim2real.settings import BLOCK, TrainingSettings

REPORT_EVERY = 2.0  # s, between two words on progress
EVALUATION_SEED = 1_000_000  # of the episodes that choose the best policy; the test's begin elsewhere
EVALUATION_EPISODES = 8
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Attributes:
        step: Environment steps made.
        total: To be made.
        rate: Environment steps a second of late.
        episodes: Ended so far, this time.
        episode_return: Mean of the last 50 episodes; None before the first has ended.
        distance: Forward, likewise [m].
        success: Share of successes, likewise.
        stage: Of the curriculum; None without one.
        learner_share: Share of the time that learning took, so far.
        seconds_left: [s].
        evaluation: Of the newest policy, when there is a new one.
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
) -> dict[str, Any]:  # fmt: skip
    """Trains a policy into a folder.

    Args:
        settings: Of the run.
        parameters: Of the simulator; of several, one is drawn for each episode.
        robot: Whose they are.
        out: Folder to write.
        about: What else settings.json should tell, such as versions.
        disturbances: Of the simulator while it learns.
        threads: Of the environments; torch takes one. Results don't depend on it.
        resume: Go on with the run that is there.
        on_progress: Called now and then.
        stop: Asked after every 200 transitions; when true, a checkpoint is written and the run ends.

    Returns:
        The outcome, as in outcome.json, with `complete` false when it was stopped.

    Raises:
        RunError: The folder holds another run, or a damaged one.
        MissingExtraError: torch or Stable-Baselines3 isn't installed.
    """
    require_learning()
    run = _Run(settings, list(parameters), robot, Path(out), disturbances, threads)
    run.begin(dict(about or {}), resume)
    try:
        return run.go(on_progress, stop)
    finally:
        run.close()


class _Run:
    """One run: what learns, what it learns in, and what is written down."""

    def __init__(
        self, settings: TrainingSettings, parameters: list[Values], robot: Robot, out: Path,
        disturbances: Disturbances, threads: int,
    ) -> None:  # fmt: skip
        from swim2real.rl import learner as learning
        from swim2real.rl.target import STAGES
        from swim2real.rl.vector import make_vector_env

        learning.use_threads(1)
        self.settings, self.parameters, self.robot, self.out = settings, parameters, robot, out
        self.disturbances, self._learning = disturbances, learning
        stages = tuple(STAGES) if settings.task == "target" else ()
        self.curriculum = Curriculum(stages) if stages else None
        self._vector = make_vector_env(
            settings.task, parameters, settings.environments, robot=robot, threads=threads, seed=settings.seed,
            disturbances=disturbances, stage=stages[0] if stages else 3,
        )  # fmt: skip
        self.environments = learning.Watched(self._vector, self._ended, settings.reward_scale)
        self.ended: list[dict[str, Any]] = []
        self.recent: deque[dict[str, Any]] = deque(maxlen=50)
        self.episodes = 0
        self.seconds = {"total": 0.0, "learner": 0.0, "simulator": 0.0, "evaluation": 0.0}
        self.best: tuple[float, ...] | None = None

    def begin(self, about: dict[str, Any], resume: bool) -> None:
        """Makes the folder and the learner, or reads them."""
        from swim2real.rl.checkpoints import checkpoints, read_state

        resolved = {
            "kind": "training", "robot": self.robot.name, **asdict(self.settings),
            "exploration": self.settings.exploration_steps, "updates": self.settings.updates_a_block,
            "checkpoint_every": self.settings.checkpoint_steps, "disturbances": asdict(self.disturbances),
            "parameters": [dict(values) for values in self.parameters],
        }  # fmt: skip
        resolved = _as_json(resolved)
        path = self.out / run_files.SETTINGS
        if resume:
            there = run_files.read_json(path)
            for key, value in resolved.items():
                if there.get(key) != value:
                    raise RunError(
                        f"'{self.out}' was begun with another {key}: {_short(there.get(key))}, now {_short(value)}; "
                        f"resume with the same, or begin a new run"
                    )
            whole = [one for one in checkpoints(self.out) if one.resumable]
            if whole:
                last = whole[-1]
                self.learner = self._learning.load_learner(last.model, self.environments)
                self._restore(read_state(last, self.learner))
                for name in (run_files.EPISODES, run_files.EVALUATIONS, run_files.PROGRESS):
                    run_files.cut(self.out / name, last.step)
                self._learning.log_to(self.learner, self.out / "tensorboard")
                return
            _log.info("'%s' has no checkpoint yet; it is begun anew", self.out)
            for name in (run_files.EPISODES, run_files.EVALUATIONS, run_files.PROGRESS):
                (self.out / name).unlink(missing_ok=True)
        elif path.exists():
            raise RunError(f"'{self.out}' already holds a run; go on with --resume, or choose another folder")
        else:
            self.out.mkdir(parents=True, exist_ok=True)
            run_files.write_json(path, {**resolved, **about})
        self.learner = self._learning.make_learner(self.settings, self.environments)
        self._learning.log_to(self.learner, self.out / "tensorboard")

    def go(self, on_progress: Callable[[Progress], None], stop: Callable[[], bool]) -> dict[str, Any]:
        """Steps and learns to the end, or until it is told to stop."""
        settings, learner = self.settings, self.learner
        begun, told, mark = time.perf_counter(), 0.0, (time.perf_counter(), learner.num_timesteps)
        before = dict(self.seconds)
        learned, simulated = learner.learner_seconds, self.environments.simulator_seconds
        stopped = False
        while learner.num_timesteps < settings.total_steps and not stopped:
            learner.learn(BLOCK, reset_num_timesteps=learner.num_timesteps == 0, log_interval=None)
            step, now = learner.num_timesteps, time.perf_counter()
            self.seconds["total"] = before["total"] + now - begun
            self.seconds["learner"] = before["learner"] + learner.learner_seconds - learned
            self.seconds["simulator"] = before["simulator"] + self.environments.simulator_seconds - simulated
            self._write_episodes(step)
            if self.curriculum and self.curriculum.advance():
                self._vector.env_method("set_stage", self.curriculum.stage)
            stopped = stop()
            evaluation = None
            if step % settings.checkpoint_steps == 0 or stopped or step >= settings.total_steps:
                if step > settings.exploration_steps and not stopped:
                    evaluation = self._evaluate(step)
                self._save()
            if evaluation or now - told > REPORT_EVERY or step >= settings.total_steps:
                rate = (step - mark[1]) / max(now - mark[0], 1e-9)
                progress = self._progress(step, rate, evaluation)
                told, mark = now, (now, step)
                self._log_progress(progress)
                on_progress(progress)
        return self._finish(complete=not stopped or learner.num_timesteps >= settings.total_steps)

    def close(self) -> None:
        """Lets the environments go."""
        self.environments.close()

    def _ended(self, info: dict[str, Any]) -> None:
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

    def _write_episodes(self, step: int) -> None:
        run_files.append(self.out / run_files.EPISODES, [{"step": step, **line} for line in self.ended])
        self.ended.clear()

    def _evaluate(self, step: int) -> dict[str, Any]:
        """Swims without exploration, on starts of its own; keeps the policy if it is the best so far."""
        from swim2real.rl.evaluation import figures
        from swim2real.rl.rollout import roll, some_environments

        begun = time.perf_counter()
        stage = self.curriculum.stage if self.curriculum else 3
        environments = some_environments(
            self.settings.task, self.parameters, EVALUATION_EPISODES, robot=self.robot,
            disturbances=self.disturbances, stage=stage,
        )  # fmt: skip
        seeds = range(EVALUATION_SEED, EVALUATION_SEED + EVALUATION_EPISODES)
        found = figures(roll(environments, _Mean(self.learner), seeds))
        line = {"step": step, **({"stage": stage} if self.curriculum else {}), **found}
        run_files.append(self.out / run_files.EVALUATIONS, [line])
        rank = (float(stage), found["success"], found["episode_return"])
        if self.best is None or rank > self.best:
            self.best = rank
            self.learner.save(self.out / run_files.BEST)
        self.seconds["evaluation"] += time.perf_counter() - begun
        return line

    def _progress(self, step: int, rate: float, evaluation: Mapping[str, Any] | None) -> Progress:
        def mean(key: str) -> float | None:
            return float(np.mean([line[key] for line in self.recent])) if self.recent else None

        left = self.settings.total_steps - step
        whole = max(self.seconds["total"], 1e-9)
        return Progress(
            step, self.settings.total_steps, rate, self.episodes, mean("episode_return"), mean("distance"),
            mean("success"), self.curriculum.stage if self.curriculum else None, self.seconds["learner"] / whole,
            left * whole / step, evaluation,
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
        run_files.append(self.out / run_files.PROGRESS, [line])

    def _save(self) -> None:
        from swim2real.rl.checkpoints import write_checkpoint
        from swim2real.rl.resuming import environment_state

        state = {
            "seconds": dict(self.seconds), "episodes": self.episodes, "recent": list(self.recent), "best": self.best,
            "curriculum": self.curriculum.state() if self.curriculum else None,
            "returns": self.environments.returns.copy(), "lengths": self.environments.lengths.copy(),
            "environments": [environment_state(env) for env in self._vector.envs],
        }  # fmt: skip
        checkpoint = write_checkpoint(self.out, self.learner, state)
        shutil.copyfile(checkpoint.model, self.out / f"{run_files.POLICY}.part")
        (self.out / f"{run_files.POLICY}.part").replace(self.out / run_files.POLICY)

    def _restore(self, state: dict[str, Any]) -> None:
        from swim2real.rl.resuming import restore_environment

        self.seconds, self.episodes, self.best = state["seconds"], state["episodes"], state["best"]
        self.recent.extend(state["recent"])
        if self.curriculum:
            self.curriculum.restore(state["curriculum"])
            self._vector.env_method("set_stage", self.curriculum.stage)
        self.environments.returns[:], self.environments.lengths[:] = state["returns"], state["lengths"]
        for env, kept in zip(self._vector.envs, state["environments"], strict=True):
            restore_environment(env, kept)

    def _finish(self, complete: bool) -> dict[str, Any]:
        step, whole = self.learner.num_timesteps, max(self.seconds["total"], 1e-9)
        evaluations = run_files.read_lines(self.out / run_files.EVALUATIONS)
        outcome = {
            "complete": complete, "step": step, "seconds": dict(self.seconds),
            "steps_per_second": step / whole, "learner_share": self.seconds["learner"] / whole,
            "simulator_share": self.seconds["simulator"] / whole,
            "gradient_steps": int(self.learner._n_updates),  # pyright: ignore[reportPrivateUsage]
            "episodes": self.episodes, "last_evaluation": evaluations[-1] if evaluations else None,
        }  # fmt: skip
        run_files.write_json(self.out / run_files.OUTCOME, outcome)
        return outcome


class _Mean:
    """The mean action of what is still learning."""

    def __init__(self, learner: Any) -> None:
        self._learner = learner

    def actions(self, observations: Any, commands: Any, step: int) -> Any:
        return self._learner.predict(observations, deterministic=True)[0]


def _as_json(content: dict[str, Any]) -> dict[str, Any]:
    import json

    return json.loads(json.dumps(content))


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
