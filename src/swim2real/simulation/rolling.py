"""A stretch of the engine's own steps, and whether it went well."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


@dataclass(frozen=True)
class Rolled:
    """States and sensors before each of N steps; where the simulation failed the engine repeats its last state.

    Attributes:
        qpos: Shape (N, nq).
        qvel: Shape (N, nv).
        sensors: Shape (N, nsensordata).
        failed_at: Time at which the engine gave up [s]; None when it didn't.
    """

    qpos: Array
    qvel: Array
    sensors: Array
    failed_at: float | None


def physics_state(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Time, positions, velocities and activations in a row, as the engine rolls out from. Shape (n,)."""
    state = np.empty(mujoco.mj_stateSize(model, _PHYSICS))
    mujoco.mj_getState(model, data, state, _PHYSICS)
    return state


def roll(model: mujoco.MjModel, data: mujoco.MjData, controls: Array) -> Rolled:
    """Steps without Python's lock; the data is left where the last step ended.

    Args:
        model: Compiled.
        data: Where to begin.
        controls: Of every step. Shape (N, nu).
    """
    state = physics_state(model, data)
    states, sensors = rollout.rollout(model, data, state[None], controls[None], nstep=len(controls))
    states, sensors = states[0], sensors[0]
    mujoco.mj_setState(model, data, states[-1], _PHYSICS)
    before = np.concatenate([state[None], states[:-1]])
    stalled = np.flatnonzero(states[:, 0] <= before[:, 0])  # after a warning the engine repeats its last state
    broken = np.flatnonzero(~np.isfinite(sensors).all(axis=1))
    first_bad = min([*stalled[:1], *broken[:1]], default=None)
    failed_at = None if first_bad is None else float(before[first_bad, 0])
    qpos = before[:, 1 : 1 + model.nq]
    return Rolled(qpos, before[:, 1 + model.nq : 1 + model.nq + model.nv], sensors, failed_at)
