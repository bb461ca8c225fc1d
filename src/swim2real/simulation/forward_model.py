"""Methods that all simulators of a robot share, the engine behind them, and several threads.

From MuJoCo 3.14 on, the lift of thin ellipsoids differs, so parameters calibrated on one side of it aren't valid on
the other. Version numbers alone would hide a next such change: an engine's fingerprint is the fluid force itself.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from threading import Lock
from typing import Any, Protocol, TypeVar

import mujoco
import numpy as np

from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.trials import TrialSet
from swimbase.errors import EngineError

_FINGERPRINT_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Engine:
    """Engine, integrator and fluid fingerprint of a result.

    Attributes:
        name: Engine and version, such as `mujoco 3.13.0`.
        integrator: Integrator of the model.
        timestep: Timestep of the physics [s].
        fluid_fingerprint: Generalized fluid forces of the robot at a fixed state [N and N·m]; all 0 out of a fluid.
    """

    name: str
    integrator: str
    timestep: float
    fluid_fingerprint: tuple[float, ...]

    @classmethod
    def of(cls, robot: Robot) -> Engine:
        """The installed engine, as it treats this robot."""
        model = robot.model
        data = mujoco.MjData(model)
        # a fixed, unremarkable state: every joint off zero and moving
        data.qpos[:] = 0.1 * np.sin(1.0 + np.arange(model.nq))
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:] = 0.3 * np.cos(2.0 + np.arange(model.nv))
        mujoco.mj_forward(model, data)
        integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower()
        forces = tuple(float(f"{force:.12g}") for force in data.qfrc_fluid)
        return cls(f"mujoco {mujoco.__version__}", integrator, float(model.opt.timestep), forces)

    def as_dict(self) -> dict[str, object]:
        return {**asdict(self), "fluid_fingerprint": list(self.fluid_fingerprint)}

    def difference(self, other: Mapping[str, Any]) -> str | None:
        """A sentence when a recorded engine has other physics than this one; None when they agree."""
        mine = np.asarray(self.fluid_fingerprint)
        try:
            recorded = np.asarray(other.get("fluid_fingerprint") or [], dtype=float)
        except (TypeError, ValueError):
            recorded = np.empty(0)
        if recorded.shape != mine.shape:
            return "made without a fluid fingerprint that can be compared with this robot's; its physics is unknown"
        scale = float(np.abs(mine).max(initial=0.0)) or 1.0
        gap = float(np.abs(recorded - mine).max(initial=0.0)) / scale
        if gap > _FINGERPRINT_TOLERANCE:
            by = f"by {100 * gap:.2g} % at the fixed state"
            if other.get("name") == self.name:
                return f"made with another model of the robot: fluid forces differ {by}; evaluate its parameters again"
            return (
                f"made with {other.get('name', 'an unknown engine')}, whose fluid forces differ from those of the "
                f"installed {self.name} {by}; its parameters aren't valid here. Install the recorded engine or "
                f"calibrate again"
            )
        if other.get("integrator") != self.integrator or other.get("timestep") != self.timestep:
            return (
                f"made with integrator {other.get('integrator')} at {other.get('timestep')} s; "
                f"this simulator uses {self.integrator} at {self.timestep} s"
            )
        return None


Request_contra = TypeVar("Request_contra", contravariant=True)


class ForwardModel(Protocol[Request_contra]):
    """Parameter values and requests in, simulated trials out.

    `Simulator` and `PlaybackSimulator` are forward models. Each has a method `request` that makes a request of a real
    trial: a `Swim` or a `Rollout`.

    Attributes:
        robot: The robot that is simulated.
        engine: The physics engine that it is simulated with.
    """

    robot: Robot
    engine: Engine

    def simulate(self, values: Values, requests: Sequence[Request_contra], /) -> TrialSet:
        """Simulated trials for one candidate, in the order of the requests."""
        ...

    def simulate_many(self, candidates: Sequence[Values], requests: Sequence[Request_contra], /) -> list[TrialSet]:
        """Simulated trials for several candidates, in one batch."""
        ...


T = TypeVar("T")

_BUILDING = Lock()
"""Held while a robot is built and compiled: a robot file's code needn't know of threads."""


def model_of(robot: Robot, values: Values) -> mujoco.MjModel | str:
    """The compiled robot with a candidate's values, or why there is none."""
    try:
        with _BUILDING:
            return robot.build(values).compile()
    except (ValueError, mujoco.FatalError) as error:
        return f"the model can't be made: {' '.join(str(error).split())}"


def thread_count(threads: int | None) -> int:
    """Number of threads to use; the number of cores for None.

    Raises:
        EngineError: Fewer than one.
    """
    if threads is not None and threads < 1:
        raise EngineError(f"threads is {threads}; it must be at least 1")
    return threads or os.cpu_count() or 1


def all_of(work: Sequence[Callable[[], T]], costs: Sequence[float], threads: int) -> list[T]:
    """Results in the order of the work, the costliest begun first, so that no thread is left with it at the end."""
    order = sorted(range(len(work)), key=lambda i: -costs[i])
    with ThreadPoolExecutor(threads) as pool:
        done = dict(zip(order, pool.map(lambda i: work[i](), order), strict=True))
    return [done[i] for i in range(len(work))]
