"""The state of an environment in the middle of an episode, so that a resumed run goes on as if nothing had happened."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from swim2real.rl.environment import SwimEnv
from swim2real.rl.observation import Swimmer

# compiled robots are made anew; of the one that swims, the physics are kept
_MADE_ANEW = ("_bodies", "_swimmers", "_swimmer", "observation_space", "action_space", "spec")
_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION


def environment_state(env: SwimEnv) -> dict[str, Any]:
    """Everything that decides how an environment goes on, to be pickled."""
    swimmer = env.swimmer
    members: dict[int, Swimmer] = vars(env)["_swimmers"]
    physics = np.empty(mujoco.mj_stateSize(swimmer.body.model, _PHYSICS))
    mujoco.mj_getState(swimmer.body.model, swimmer.data, physics, _PHYSICS)
    return {
        "member": next(member for member, one in members.items() if one is swimmer),
        "physics": physics,
        "rest": {name: value for name, value in vars(env).items() if name not in _MADE_ANEW},
    }


def restore_environment(env: SwimEnv, state: dict[str, Any]) -> None:
    """Goes on as `environment_state` said."""
    env.reset(options={"member": state["member"]})
    swimmer = env.swimmer
    mujoco.mj_setState(swimmer.body.model, swimmer.data, state["physics"], _PHYSICS)
    for name, value in state["rest"].items():
        setattr(env, name, value)
    swimmer.read(markers=True)
