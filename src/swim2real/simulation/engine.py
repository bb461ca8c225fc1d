"""Which physics a result was made with.

From MuJoCo 3.14 on, the lift of thin ellipsoids differs, so parameters calibrated on one side of it aren't valid on
the other. Version numbers alone would hide a next such change: the fingerprint is the fluid force itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from swim2real.robots.robot import Robot

FINGERPRINT_TOLERANCE = 1e-9


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
        model = robot.build(robot.space.published).compile()
        data = mujoco.MjData(model)
        # a fixed, unremarkable state: every joint off zero and moving
        data.qpos[:] = 0.1 * np.sin(1.0 + np.arange(model.nq))
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:] = 0.3 * np.cos(2.0 + np.arange(model.nv))
        mujoco.mj_forward(model, data)
        integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower()
        forces = tuple(float(f"{force:.12g}") for force in data.qfrc_fluid)
        return cls(f"mujoco {mujoco.__version__}", integrator, float(model.opt.timestep), forces)

    def as_dict(self) -> dict[str, Any]:
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
        if gap > FINGERPRINT_TOLERANCE:
            return (
                f"made with {other.get('name', 'an unknown engine')}, whose fluid forces differ from those of the "
                f"installed {self.name} by {100 * gap:.2g} % at the fixed state; its parameters aren't valid here. "
                f"Install the recorded engine or calibrate again"
            )
        if other.get("integrator") != self.integrator or other.get("timestep") != self.timestep:
            return (
                f"made with integrator {other.get('integrator')} at {other.get('timestep')} s; "
                f"this simulator uses {self.integrator} at {self.timestep} s"
            )
        return None
