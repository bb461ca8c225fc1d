"""The learner: soft actor-critic of Stable-Baselines3 and its environments, its replay buffer, and checkpoints.

A run that goes on from a checkpoint is bit-equal to one that was never interrupted. Stable-Baselines3's own checkpoints
can't do that: they lack the random states and the running episodes. Nor do ours hold any pickle.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from swim2real.parameters import Values
from swim2real.rl.actor import Actor
from swim2real.rl.environment import EnvironmentOptions, Environments, Observation, make_environments, make_spaces
from swim2real.settings import TRAIN_FREQ, TrainingSettings
from swimbase.checking import shown
from swimbase.errors import MissingExtraError, RunError
from swimbase.store import read_arrays, read_json, whole_folder, write_json

try:
    import torch
    from stable_baselines3 import SAC
    from stable_baselines3.common.buffers import ReplayBuffer
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs
except ModuleNotFoundError as error:
    raise MissingExtraError(f"training needs {error.name}; install it with: pip install 'swim2real[rl]'") from error

_NETWORKS, _REPLAY, _EPISODES, _STATE = "networks.npz", "replay.npz", "episodes.npz", "state.json"
_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_SMALL = 1 << 20  # bytes of a checkpoint's replay buffer besides the transitions
_DAMAGED = (OSError, EOFError, LookupError, ArithmeticError, ValueError, TypeError, AttributeError, RuntimeError)


class RobotVecEnv(VecEnv):
    """Environments that step in one call.

    One that has ended begins anew within the step, as Stable-Baselines3 expects: its info has
    `terminal_observation` and `TimeLimit.truncated`.

    Attributes:
        environments: The environments.
    """

    def __init__(self, environments: Environments) -> None:
        """Takes over the environments."""
        self.environments = environments
        super().__init__(environments.count, *make_spaces(environments))
        self._actions: NDArray[Any] = np.zeros((environments.count, 1))

    def reset(self) -> VecEnvObs:
        if seeds := [seed for seed in self._seeds if seed is not None]:  # all or none are given
            self.environments.seed(seeds)
        self.environments.begin(np.arange(self.num_envs), self._options)
        self._reset_seeds()
        self._reset_options()
        return self.environments.observations.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Observation, Observation, NDArray[np.bool_], list[dict[str, Any]]]:
        environments = self.environments
        stepped = environments.step(self._actions)
        ended = np.flatnonzero(stepped.ended)
        infos = [environments.info(i) for i in range(self.num_envs)]
        for i in ended:
            infos[i]["terminal_observation"] = environments.observations[i].copy()
            infos[i]["success"] = bool(stepped.success[i])
            infos[i]["TimeLimit.truncated"] = bool(stepped.truncated[i])
        if len(ended):
            environments.begin(ended)
        return environments.observations.copy(), stepped.rewards.astype(np.float32), stepped.ended, infos

    def close(self) -> None:
        self.environments.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        value = None if attr_name == "render_mode" else getattr(self.environments, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        del indices
        setattr(self.environments, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        result = getattr(self.environments, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        del wrapper_class
        return [False for _ in self._get_indices(indices)]


def make_vector_env(
    task: str, parameters: Values | Sequence[Values] | None = None, count: int = 1,
    **options: Unpack[EnvironmentOptions],
) -> RobotVecEnv:  # fmt: skip
    """Environments that step in one call; the arguments are those of `make_environments`."""
    return RobotVecEnv(make_environments(task, parameters, count, **options))


@dataclass(frozen=True)
class Transitions:
    """Transitions of N environments in one step.

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
            learning_starts=settings.exploration_steps, train_freq=TRAIN_FREQ // settings.environments,
            gradient_steps=settings.updates_per_round,  # which `SAC.learn` of a saved .zip takes
            policy_kwargs={"net_arch": list(settings.layers), "optimizer_kwargs": {"fused": True}},
            seed=settings.seed, device="cpu",
        )  # fmt: skip
        # what the critics' weights would change isn't needed where the actor learns from them
        self._sac.critic.register_forward_pre_hook(
            lambda critic, inputs: critic.requires_grad_(not inputs[1].requires_grad) and None
        )
        self._sac.set_logger(Logger(None, []))
        if self._sac.replay_buffer is None:
            raise RunError("Stable-Baselines3 made a learner without a replay buffer, which can't learn")
        self._buffer: ReplayBuffer = self._sac.replay_buffer
        self._pool, self._learning = pool, list[Future[float] | None]()

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

    def wait(self) -> float:
        """Waits for the round that was begun, if any, and returns the time that it took [s]."""
        seconds = sum(self._learn() if learning is None else learning.result() for learning in self._learning)
        self._learning.clear()
        return seconds

    def _learn(self) -> float:
        begun = perf_counter()
        torch.set_num_threads(1)  # it holds for the thread that says so; small networks gain little from more
        self._sac.train(self._settings.updates_per_round, self._settings.batch)
        return perf_counter() - begun

    def save(self, folder: Path) -> None:
        """Writes networks, optimizers, replay buffer and random states into a folder, between two rounds."""
        buffer = self._buffer
        optimizers = {name: optimizer.state_dict() for name, optimizer in self._optimizers().items()}
        tensors = {**_flat(self._networks()), **_flat(optimizers), "random": torch.get_rng_state()}
        networks: dict[str, NDArray[Any]] = {name: tensor.detach().numpy() for name, tensor in tensors.items()}
        np.savez(folder / _NETWORKS, allow_pickle=False, **networks)
        filled = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: getattr(buffer, name)[:filled] for name in _ARRAYS}
        _, key, position, has_gauss, gauss = np.random.get_state()  # noqa: NPY002 - Stable-Baselines3 draws from it
        np.savez(folder / _REPLAY, allow_pickle=False, pos=buffer.pos, full=buffer.full, random=np.asarray(key),
                 random_rest=np.array([position, has_gauss, gauss]), updates=self.updates, **arrays)  # fmt: skip

    def load(self, folder: Path) -> None:
        """Takes over what `save` wrote, and sets the random states.

        Raises:
            ValueError: An array doesn't fit the settings. Libraries raise other errors about damaged files.
        """
        arrays = read_arrays(folder / _NETWORKS)
        self._set_tensors({name: torch.from_numpy(array) for name, array in arrays.items()})
        buffer = self._buffer
        places = {name: getattr(buffer, name) for name in _ARRAYS}
        stored = read_arrays(folder / _REPLAY, sum(place.nbytes for place in places.values()) + _SMALL)
        position, full = int(stored["pos"]), bool(stored["full"])
        filled = buffer.buffer_size if full else position
        if not 0 <= position < buffer.buffer_size:
            raise ValueError(f"its replay buffer is at {position}; it has {buffer.buffer_size} places")
        for name, place in places.items():
            if stored[name].shape != place[:filled].shape or stored[name].dtype != place.dtype:
                raise ValueError(f"'{name}' of its replay buffer is {stored[name].dtype} {stored[name].shape}")
            place[:filled] = stored[name]
        buffer.pos, buffer.full = position, full
        position, has_gauss, gauss = stored["random_rest"]
        state = ("MT19937", stored["random"], int(position), int(has_gauss), float(gauss))
        np.random.set_state(state)  # noqa: NPY002
        self._sac._n_updates = int(stored["updates"])  # pyright: ignore[reportPrivateUsage]

    def save_zip(self, path: Path, step: int) -> None:
        """Writes a .zip that `stable_baselines3.SAC.load` trains on, without the replay buffer, between two rounds.

        Args:
            path: Path of the .zip.
            step: Environment steps that were made.
        """
        self._sac.num_timesteps = step
        self._sac.save(path)

    def _set_tensors(self, given: Mapping[str, torch.Tensor]) -> None:
        """Takes over networks, optimizers and the random state of torch, by their names as in `networks.npz`."""
        with torch.no_grad():
            for name, tensor in _flat(self._networks()).items():
                if given[name].shape != tensor.shape or given[name].dtype != tensor.dtype:
                    raise ValueError(f"'{name}' is {given[name].dtype} {tuple(given[name].shape)}")
                tensor.copy_(given[name])
        for name, optimizer in self._optimizers().items():
            parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
            state: dict[int, dict[str, torch.Tensor]] = {}
            for i, parameter in enumerate(parameters):
                start, shapes = f"{name}/{i}/", {"step": (), "exp_avg": parameter.shape, "exp_avg_sq": parameter.shape}
                entries = {key.removeprefix(start): value for key, value in given.items() if key.startswith(start)}
                if entries and {key: value.shape for key, value in entries.items()} != shapes:
                    raise ValueError(f"'{start}' doesn't fit the network")
                state |= {i: entries} if entries else {}
            optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
        torch.set_rng_state(given["random"])

    def _networks(self) -> dict[str, Any]:
        """States of the networks, and the entropy coefficient: the tensors themselves, not copies."""
        sac = self._sac
        networks = {"actor": sac.actor, "critic": sac.critic, "critic_target": sac.critic_target}
        return {**{name: part.state_dict() for name, part in networks.items()}, "log_ent_coef": sac.log_ent_coef}

    def _optimizers(self) -> dict[str, torch.optim.Optimizer]:
        sac = self._sac
        assert sac.ent_coef_optimizer is not None  # the entropy coefficient is learned
        return {
            "actor_optimizer": sac.actor.optimizer, "critic_optimizer": sac.critic.optimizer,
            "ent_coef_optimizer": sac.ent_coef_optimizer,
        }  # fmt: skip


def _flat(content: Mapping[str, Any]) -> dict[str, torch.Tensor]:
    """Tensors by name, as `networks.npz` has them: `actor/mu.weight`, `actor_optimizer/0/exp_avg`.

    Args:
        content: States of networks and optimizers by their names, and tensors.
    """
    tensors: dict[str, torch.Tensor] = {}
    for name, part in content.items():
        if isinstance(part, torch.Tensor):
            tensors[name] = part
        elif "param_groups" in part:
            for i, entries in part["state"].items():
                tensors |= {f"{name}/{i}/{key}": value for key, value in entries.items()}
        else:
            tensors |= {f"{name}/{key}": value for key, value in part.items()}
    return tensors


@dataclass(frozen=True)
class _Checkpoint:
    """A checkpoint on the disk: the learner, the episodes that run, and what the run has noted.

    Attributes:
        step: Environment steps that had been made.
        folder: Where it is.
    """

    step: int
    folder: Path

    @property
    def resumable(self) -> bool:
        """True if a run can go on from it; older checkpoints lose their replay buffer."""
        return all((self.folder / name).is_file() for name in (_NETWORKS, _REPLAY, _EPISODES, _STATE))

    def load(self, learner: Learner) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Loads a learner, and returns what else was kept: arrays of the running episodes, and the state.

        Where it is damaged or of other settings, this raises errors of many types, as `errors` names them.
        """
        learner.load(self.folder)
        state = read_json(self.folder / _STATE)
        if state["step"] != self.step:
            raise ValueError(f"its {_STATE} is of step {state['step']}")
        return read_arrays(self.folder / _EPISODES), state

    @contextmanager
    def errors(self) -> Generator[None]:
        """Raises the errors that a damaged or foreign checkpoint causes as a `RunError`."""
        try:
            yield
        except _DAMAGED as error:
            raise RunError(
                f"checkpoint '{self.folder}' is damaged: {type(error).__name__}, {shown(str(error))}; remove it "
                f"to go on from an older one, or begin a new run"
            ) from error


def list_checkpoints(run: Path) -> list[_Checkpoint]:
    """Checkpoints of a run, oldest first."""
    folders = sorted((run / "checkpoints").glob("step-*[0-9]"))
    return [_Checkpoint(int(folder.name.split("-")[1]), folder) for folder in folders if (folder / _STATE).is_file()]


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
    assert step % TRAIN_FREQ == 0
    folder = run / "checkpoints" / f"step-{step:09d}"
    with whole_folder(folder) as part:
        learner.save(part)
        np.savez(part / _EPISODES, allow_pickle=False, **dict(episodes))
        write_json(part / _STATE, state, indent=None)
    remove_older_replay_buffers(run, step)


def remove_older_replay_buffers(run: Path, step: int) -> None:
    """Removes the replay buffers of the checkpoints before a step, for they are large and the latest one is enough."""
    for checkpoint in list_checkpoints(run):
        if checkpoint.step < step:
            (checkpoint.folder / _REPLAY).unlink(missing_ok=True)
