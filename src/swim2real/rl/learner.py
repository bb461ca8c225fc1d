"""The learner: soft actor-critic of Stable-Baselines3, watched while it learns, with checkpoints to go on from.

A run that goes on from a checkpoint is bit-equal to one that was never interrupted. Stable-Baselines3's own checkpoints
can't do that: they lack the random states and the running episodes, are made between two environment steps instead of
after the gradient steps, and hold the whole replay buffer, filled or not.
"""

from __future__ import annotations

import pickle
import random
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv

from swim2real.errors import RunError
from swim2real.settings import BLOCK, TrainingSettings
from swim2real.store import whole_folder

_MODEL, _REPLAY, _STATE = "model.zip", "replay.npz", "state.pickle"
_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_DAMAGED = (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, pickle.UnpicklingError)


def make_learner(settings: TrainingSettings, environments: VecEnv) -> SAC:
    """A learner that has seen nothing yet."""
    return SAC(
        "MlpPolicy", environments, learning_rate=settings.learning_rate, buffer_size=settings.replay,
        learning_starts=settings.exploration_steps, batch_size=settings.batch, tau=settings.target_rate,
        gamma=settings.discount, train_freq=BLOCK // settings.environments, gradient_steps=settings.updates_a_block,
        policy_kwargs={"net_arch": list(settings.layers)}, seed=settings.seed, device="cpu",
    )  # fmt: skip


def log_to(learner: SAC, folder: Path) -> None:
    """Logs to TensorBoard where it is installed, and to nothing else."""
    formats = [] if find_spec("tensorboard") is None else ["tensorboard"]
    learner.set_logger(configure(str(folder), formats))


class EpisodeMonitor(BaseCallback):
    """Sums up the rewards of running episodes and reports those that end.

    Attributes:
        returns: Sums of the rewards of the running episodes. Shape (N,).
        lengths: Steps of the running episodes. Shape (N,).
        rollout_end: Time at which the last environment steps ended and gradient steps began [s of
            time.perf_counter].
    """

    def __init__(self, environments: int, on_episode: Callable[[dict[str, Any]], None]) -> None:
        """Prepares the sums.

        Args:
            environments: Number of environments.
            on_episode: Called with the return, the length and the last info of every episode that ends.
        """
        super().__init__()
        self._on_episode = on_episode
        self.returns: NDArray[np.float64] = np.zeros(environments)
        self.lengths = np.zeros(environments, dtype=int)
        self.rollout_end = time.perf_counter()

    def _on_step(self) -> bool:
        self.returns += self.locals["rewards"]
        self.lengths += 1
        for i in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][i]
            self._on_episode({"episode_return": float(self.returns[i]), "length": int(self.lengths[i]), **info})
            self.returns[i], self.lengths[i] = 0.0, 0
        return True

    def _on_rollout_end(self) -> None:
        self.rollout_end = time.perf_counter()


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint on the disk: networks, optimizers, replay buffer, random states, and the episodes that run.

    Attributes:
        step: Environment steps that had been made.
        folder: Where it is.
    """

    step: int
    folder: Path

    @property
    def model(self) -> Path:
        """File with the networks."""
        return self.folder / _MODEL

    @property
    def resumable(self) -> bool:
        """Whether a run can go on from it; older checkpoints lose their replay buffer."""
        return all((self.folder / name).is_file() for name in (_MODEL, _REPLAY, _STATE))


def list_checkpoints(run: Path) -> list[Checkpoint]:
    """Checkpoints of a run, oldest first."""
    folders = sorted((run / "checkpoints").glob("step-*[0-9]"))
    return [Checkpoint(int(folder.name.split("-")[1]), folder) for folder in folders if (folder / _MODEL).is_file()]


def write_checkpoint(run: Path, learner: SAC, state: dict[str, Any]) -> Checkpoint:
    """Writes a checkpoint, whole or not at all, and then removes the older ones' replay buffers.

    Args:
        run: Folder of the run.
        learner: The learner.
        state: What else a resumed run needs; it is pickled.
    """
    older = list_checkpoints(run)
    folder = run / "checkpoints" / f"step-{learner.num_timesteps:09d}"
    randomness = {
        "python": random.getstate(), "numpy": np.random.get_state(), "torch": torch.get_rng_state(),  # noqa: NPY002
        "exploration": learner.action_space.np_random.bit_generator.state,
    }  # fmt: skip
    with whole_folder(folder) as part:
        learner.save(part / _MODEL)
        _write_replay(part / _REPLAY, _replay_buffer(learner))
        with (part / _STATE).open("wb") as file:
            pickle.dump({"randomness": randomness, **state}, file)
    for checkpoint in older:
        if checkpoint.folder != folder:
            (checkpoint.folder / _REPLAY).unlink(missing_ok=True)
    return Checkpoint(learner.num_timesteps, folder)


def load_checkpoint(checkpoint: Checkpoint, environments: VecEnv) -> tuple[SAC, dict[str, Any]]:
    """Loads a learner with its replay buffer, and sets the random states.

    Returns:
        The learner, which goes on in the episodes that were running, and what else was kept.

    Raises:
        RunError: The checkpoint is damaged, or of another version of swim2real.
    """
    folder = checkpoint.folder
    try:
        learner = SAC.load(checkpoint.model, environments, device="cpu", force_reset=False)
        with (folder / _STATE).open("rb") as file:
            state: dict[str, Any] = pickle.load(file)
        _read_replay(folder / _REPLAY, _replay_buffer(learner))
        randomness = state.pop("randomness")
        random.setstate(randomness["python"])
        np.random.set_state(randomness["numpy"])  # noqa: NPY002 - Stable-Baselines3 draws from it
        torch.set_rng_state(randomness["torch"])
        learner.action_space.np_random.bit_generator.state = randomness["exploration"]
    except (ModuleNotFoundError, AttributeError) as error:
        raise RunError(
            f"checkpoint '{folder}' is of another version of swim2real ({error}); go on with the version that wrote "
            f"it, or begin a new run: `swim2real rollout` reads the policies of both"
        ) from error
    except _DAMAGED as error:
        raise RunError(
            f"checkpoint '{folder}' is damaged: {error!r}; remove it to go on from an older one, or begin a new run"
        ) from error
    return learner, state


def _replay_buffer(learner: SAC) -> ReplayBuffer:
    if learner.replay_buffer is None:
        raise RunError("a learner without a replay buffer can't go on")
    return learner.replay_buffer


def _write_replay(path: Path, buffer: ReplayBuffer) -> None:
    """Writes the part of the buffer that is filled."""
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: getattr(buffer, name)[:filled] for name in _ARRAYS}
    np.savez(path, pos=buffer.pos, full=buffer.full, allow_pickle=False, **arrays)


def _read_replay(path: Path, buffer: ReplayBuffer) -> None:
    with path.open("rb") as file, np.load(file) as content:
        for name in _ARRAYS:
            kept = content[name]
            getattr(buffer, name)[: len(kept)] = kept
        buffer.pos, buffer.full = int(content["pos"]), bool(content["full"])
