"""The one function that is used, in the form in which it is used; its own annotations promise any array-like."""

import numpy as np
from mujoco import MjData, MjModel
from numpy.typing import NDArray

def rollout(
    model: MjModel, data: MjData, initial_state: NDArray[np.float64], control: NDArray[np.float64], *, nstep: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
