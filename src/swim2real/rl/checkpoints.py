"""Checkpoints of a training run: networks, optimizers, replay buffer, random states, and the episodes that run."""

from __future__ import annotations

import os
import pickle
import random
import shutil
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.buffers import ReplayBuffer

from swim2real.errors import RunError
from swim2real.rl.learner import TimedSAC

_MODEL, _REPLAY, _STATE = "model.zip", "replay.npz", "state.pickle"
_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint on the disk.

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
        """Whether a run can go on from it; older ones lose their replay buffer."""
        return all((self.folder / name).is_file() for name in (_MODEL, _REPLAY, _STATE))


def checkpoints(run: Path) -> list[Checkpoint]:
    """Checkpoints of a run, oldest first."""
    folders = sorted((run / "checkpoints").glob("step-*[0-9]"))
    return [Checkpoint(int(folder.name.split("-")[1]), folder) for folder in folders if (folder / _MODEL).is_file()]


def write_checkpoint(run: Path, learner: TimedSAC, state: dict[str, Any]) -> Checkpoint:
    """Writes a checkpoint at once, and then removes the older ones' replay buffers.

    Args:
        run: Folder of the run.
        learner: What learns.
        state: What else a resumed run needs; it is pickled.
    """
    if learner.replay_buffer is None:
        raise RunError("a learner without a replay buffer has nothing to go on with")
    before = checkpoints(run)
    place = run / "checkpoints" / f"step-{learner.num_timesteps:09d}"
    part = place.with_name(place.name + ".part")
    for folder in (part, place):
        shutil.rmtree(folder, ignore_errors=True)
    part.mkdir(parents=True)
    learner.save(part / _MODEL)
    _write_replay(part / _REPLAY, learner.replay_buffer)
    randomness = {
        "python": random.getstate(), "numpy": np.random.get_state(), "torch": torch.get_rng_state(),  # noqa: NPY002
        "exploration": learner.action_space.np_random.bit_generator.state,
    }  # fmt: skip
    with (part / _STATE).open("wb") as file:
        pickle.dump({"randomness": randomness, **state}, file)
    os.replace(part, place)
    for old in before:
        if old.folder != place:
            (old.folder / _REPLAY).unlink(missing_ok=True)
    return Checkpoint(learner.num_timesteps, place)


def read_state(checkpoint: Checkpoint, learner: TimedSAC) -> dict[str, Any]:
    """Fills a loaded learner's replay buffer, sets the random states, and returns what else was kept.

    Raises:
        RunError: The checkpoint is damaged.
    """
    try:
        with (checkpoint.folder / _STATE).open("rb") as file:
            state: dict[str, Any] = pickle.load(file)
        if learner.replay_buffer is None:
            raise RunError("a learner without a replay buffer can't go on")
        _read_replay(checkpoint.folder / _REPLAY, learner.replay_buffer)
        randomness = state.pop("randomness")
        random.setstate(randomness["python"])
        np.random.set_state(randomness["numpy"])  # noqa: NPY002 - Stable-Baselines3 draws from it
        torch.set_rng_state(randomness["torch"])
        learner.action_space.np_random.bit_generator.state = randomness["exploration"]
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, pickle.UnpicklingError) as error:
        raise RunError(
            f"checkpoint '{checkpoint.folder}' is damaged: {error!r}; remove it to go on from an older one, "
            f"or begin a new run"
        ) from error
    return state


def _write_replay(path: Path, buffer: ReplayBuffer) -> None:
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: getattr(buffer, name)[:filled] for name in _ARRAYS}
    np.savez(path, pos=buffer.pos, full=buffer.full, allow_pickle=False, **arrays)


def _read_replay(path: Path, buffer: ReplayBuffer) -> None:
    with path.open("rb") as file, np.load(file) as content:
        for name in _ARRAYS:
            kept = content[name]
            getattr(buffer, name)[: len(kept)] = kept
        buffer.pos, buffer.full = int(content["pos"]), bool(content["full"])
