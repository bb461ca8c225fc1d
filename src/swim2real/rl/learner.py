"""The learner: soft actor-critic of Stable-Baselines3, its replay buffer, and checkpoints to go on from.

A run that goes on from a checkpoint is bit-equal to one that was never interrupted. Stable-Baselines3's own checkpoints
can't do that: they lack the random states and the running episodes. Nor do ours hold any pickle.
"""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.vec_env import VecEnv

from swim2real.errors import RunError
from swim2real.rl.actor import Actor
from swim2real.settings import BLOCK, TrainingSettings
from swim2real.store import read_arrays, read_json, whole_folder, write_json

_NETWORKS, _REPLAY, _EPISODES, _STATE = "networks.pt", "replay.npz", "episodes.npz", "state.json"
_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_DAMAGED = (
    OSError, EOFError, KeyError, ValueError, TypeError, RuntimeError, zipfile.BadZipFile, pickle.UnpicklingError,
)  # fmt: skip


@dataclass(frozen=True)
class Transitions:
    """What N environments went through in one step.

    Attributes:
        observations: Before. Shape (N, n).
        actions: Shape (N, A).
        rewards: Shape (N,).
        next_observations: After, of an ended episode its last. Shape (N, n).
        ended: Whether the episode is over. Shape (N,).
        truncated: Whether it is only since its time is over. Shape (N,).
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float64]
    rewards: NDArray[np.float64]
    next_observations: NDArray[np.float32]
    ended: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class Learner:
    """Soft actor-critic that learns in a thread of the environments, while the others simulate.

    What it learns from is added between two rounds of learning only, so results don't depend on who is faster.

    Attributes:
        updates: Gradient steps that were made.
        seconds: Time that they took [s].
    """

    def __init__(
        self, settings: TrainingSettings, environments: VecEnv, discount: float, pool: ThreadPoolExecutor | None = None
    ) -> None:
        """A learner that has seen nothing yet. It sets the random state of torch and NumPy.

        Args:
            settings: Settings of the run.
            environments: What it learns for.
            discount: Of rewards, a step.
            pool: Thread to learn in; None to learn where it is waited for.
        """
        self._settings = settings
        self._sac = SAC(
            "MlpPolicy", environments, learning_rate=settings.learning_rate, buffer_size=settings.replay,
            batch_size=settings.batch, tau=settings.target_rate, gamma=discount,
            policy_kwargs={"net_arch": list(settings.layers), "optimizer_kwargs": {"foreach": True}},
            seed=settings.seed, device="cpu",
        )  # fmt: skip
        self._sac.set_logger(Logger(None, []))
        if self._sac.replay_buffer is None:
            raise RunError("Stable-Baselines3 made a learner without a replay buffer, which can't learn")
        self._buffer: ReplayBuffer = self._sac.replay_buffer
        self._pool, self._learning = pool, list[Future[None] | None]()
        self.seconds = 0.0

    @property
    def updates(self) -> int:
        return int(self._sac._n_updates)  # pyright: ignore[reportPrivateUsage]

    @property
    def actor(self) -> Actor:
        """A copy of the actor as it is now."""
        return Actor.of(self._sac)

    def add(self, transitions: Transitions) -> None:
        """Adds transitions to the replay buffer, between two rounds of learning."""
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": bool(cut)} for cut in transitions.truncated]
        self._buffer.add(
            transitions.observations, transitions.next_observations, transitions.actions.astype(np.float32),
            transitions.rewards.astype(np.float32), transitions.ended, infos,
        )  # fmt: skip

    def start(self) -> None:
        """Begins a round of gradient steps, those of 200 transitions."""
        self._learning.append(None if self._pool is None else self._pool.submit(self._learn))

    def wait(self) -> None:
        """Waits for the round that was begun, if any."""
        for learning in self._learning:
            self._learn() if learning is None else learning.result()
        self._learning.clear()

    def _learn(self) -> None:
        begun = perf_counter()
        torch.set_num_threads(1)  # it holds for the thread that says so; small networks gain little from more
        self._sac.train(self._settings.updates_a_block, self._settings.batch)
        self.seconds += perf_counter() - begun

    def save(self, folder: Path) -> None:
        """Writes networks, optimizers, replay buffer and random states into a folder, between two rounds."""
        sac, buffer = self._sac, self._buffer
        networks = {name: part.state_dict() for name, part in self._parts().items()}
        networks |= {"log_ent_coef": sac.log_ent_coef, "random": torch.get_rng_state()}
        torch.save(networks, folder / _NETWORKS)
        filled = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: getattr(buffer, name)[:filled] for name in _ARRAYS}
        _, key, position, has_gauss, gauss = np.random.get_state()  # noqa: NPY002 - Stable-Baselines3 draws from it
        np.savez(folder / _REPLAY, allow_pickle=False, pos=buffer.pos, full=buffer.full, random=np.asarray(key),
                 random_rest=np.array([position, has_gauss, gauss]), updates=self.updates, **arrays)  # fmt: skip

    def load(self, folder: Path) -> None:
        """Takes over what `save` wrote, and sets the random states."""
        networks = torch.load(folder / _NETWORKS, weights_only=True)
        for name, part in self._parts().items():
            part.load_state_dict(networks[name])
        with torch.no_grad():
            if self._sac.log_ent_coef is not None:
                self._sac.log_ent_coef.copy_(networks["log_ent_coef"])
        torch.set_rng_state(networks["random"])
        stored = read_arrays(folder / _REPLAY)
        for name in _ARRAYS:
            getattr(self._buffer, name)[: len(stored[name])] = stored[name]
        self._buffer.pos, self._buffer.full = int(stored["pos"]), bool(stored["full"])
        position, has_gauss, gauss = stored["random_rest"]
        state = ("MT19937", stored["random"], int(position), int(has_gauss), float(gauss))
        np.random.set_state(state)  # noqa: NPY002
        self._sac._n_updates = int(stored["updates"])  # pyright: ignore[reportPrivateUsage]

    def _parts(self) -> dict[str, Any]:
        sac = self._sac
        return {
            "actor": sac.actor, "critic": sac.critic, "critic_target": sac.critic_target,
            "actor_optimizer": sac.actor.optimizer, "critic_optimizer": sac.critic.optimizer,
            "ent_coef_optimizer": sac.ent_coef_optimizer,
        }  # fmt: skip


def make_log(folder: Path) -> Logger:
    """A log for TensorBoard where it is installed, and of nothing elsewhere."""
    return configure(str(folder), [] if find_spec("tensorboard") is None else ["tensorboard"])


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint on the disk: the learner, the episodes that run, and what the run has noted.

    Attributes:
        step: Environment steps that had been made.
        folder: Where it is.
    """

    step: int
    folder: Path

    @property
    def resumable(self) -> bool:
        """Whether a run can go on from it; older checkpoints lose their replay buffer."""
        return all((self.folder / name).is_file() for name in (_NETWORKS, _REPLAY, _EPISODES, _STATE))


def list_checkpoints(run: Path) -> list[Checkpoint]:
    """Checkpoints of a run, oldest first."""
    folders = sorted((run / "checkpoints").glob("step-*[0-9]"))
    return [Checkpoint(int(folder.name.split("-")[1]), folder) for folder in folders if (folder / _STATE).is_file()]


def write_checkpoint(
    run: Path, step: int, learner: Learner, episodes: Mapping[str, NDArray[Any]], state: Mapping[str, Any]
) -> None:
    """Writes a checkpoint, whole or not at all, and then removes the older ones' replay buffers.

    Args:
        run: Folder of the run.
        step: Environment steps that were made; a multiple of 200.
        learner: The learner, between two rounds.
        episodes: Arrays of the running episodes.
        state: What else a resumed run needs, as JSON.
    """
    assert step % BLOCK == 0
    folder = run / "checkpoints" / f"step-{step:09d}"
    older = [checkpoint for checkpoint in list_checkpoints(run) if checkpoint.folder != folder]
    with whole_folder(folder) as part:
        learner.save(part)
        np.savez(part / _EPISODES, allow_pickle=False, **dict(episodes))
        write_json(part / _STATE, state, indent=None)
    for checkpoint in older:
        (checkpoint.folder / _REPLAY).unlink(missing_ok=True)


def load_checkpoint(checkpoint: Checkpoint, learner: Learner) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Loads a learner, and returns what else was kept: arrays of the running episodes, and the state.

    Raises:
        RunError: The checkpoint is damaged, or of other settings.
    """
    folder = checkpoint.folder
    try:
        learner.load(folder)
        return read_arrays(folder / _EPISODES), read_json(folder / _STATE)
    except _DAMAGED as error:
        raise RunError(
            f"checkpoint '{folder}' is damaged: {error!r}; remove it to go on from an older one, or begin a new run"
        ) from error
