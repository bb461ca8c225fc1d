"""Looks whether a floating robot stays upright at the water's line: MuJoCo's water has no buoyancy."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from swim2real.robots.robot import Robot

_SECONDS = 2.0
_TILT = np.radians(5.0)  # at the start
_OVER = np.radians(60.0)  # tilted as far, it doesn't come back
_WATER = 100.0  # kg/m³, less dense than which is no liquid


def afloat(robot: Robot) -> list[str]:
    """A sentence for each thing that gravity does to a robot in water, left alone, that a floating one doesn't do.

    Its own values are tried, and each parameter at both bounds. Without gravity there is nothing to report.
    """
    model, published = robot.model, robot.space.published
    if model.opt.density < _WATER or not np.any(model.opt.gravity):
        return []
    found = list(_faults(robot, model, ""))
    for p in () if found else robot.space:
        for value in (p.lower, p.upper):
            try:
                bound = robot.build({**published, p.name: value}).compile()
            except ValueError:  # `probe` reports it
                continue
            found += _faults(robot, bound, f" with {p.name} = {value:g}")
    return found


def _faults(robot: Robot, model: mujoco.MjModel, given: str) -> Iterator[str]:
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    for body in roots:
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        kinds = [mujoco.mjtJoint(int(model.jnt_type[j])) for j in joints]
        if mujoco.mjtJoint.mjJNT_FREE not in kinds and mujoco.mjtJoint.mjJNT_SLIDE not in kinds:
            continue
        name, size = model.body(body).name, robot.size
        sunk, tilted = _left_alone(model, body, joints)
        if sunk > size:
            yield (
                f"body '{name}' sinks by {sunk:.2g} m within {_SECONDS:g} s{given}: nothing holds it at the water's "
                f"line, since MuJoCo's water has no buoyancy; set gravity to 0 0 0 in <option>, gravcomp to 1 in its "
                f"bodies, or give it a vertical slide joint with a stiffness (9.81 × density × area there)"
            )
        elif tilted > _OVER:
            yield (
                f"body '{name}' capsizes{given}: left alone with a tilt of {np.degrees(_TILT):.0f}° it turns by "
                f"{np.degrees(tilted):.0f}° within {_SECONDS:g} s; the stiffness of its roll must be above its weight "
                f"times the height of its center of mass over the roll axis, or its masses lie lower"
            )


def _left_alone(model: mujoco.MjModel, body: int, joints: range) -> tuple[float, float]:
    """Depth by which a body sinks [m], and its largest tilt [rad], from a small tilt about the axes of its roll."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    up = data.xmat[body].reshape(3, 3)[2].copy()  # in the body's own axes
    velocity = np.zeros(model.nv)
    for j in joints:
        kind, dof = int(model.jnt_type[j]), int(model.jnt_dofadr[j])
        level = kind == mujoco.mjtJoint.mjJNT_HINGE and abs(model.jnt_axis[j, 2]) < 0.5
        if kind == mujoco.mjtJoint.mjJNT_BALL or level:
            velocity[dof] = _TILT
        elif kind == mujoco.mjtJoint.mjJNT_FREE:
            velocity[dof + 3] = _TILT
    mujoco.mj_integratePos(model, data.qpos, velocity, 1.0)
    mujoco.mj_kinematics(model, data)
    begun, tilted = float(data.xpos[body, 2]), 0.0
    for _ in range(round(_SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, data)
        upright = float(np.einsum("i,i->", data.xmat[body].reshape(3, 3)[2], up))
        tilted = max(tilted, float(np.arccos(np.clip(upright, -1.0, 1.0))))
    return begun - float(data.xpos[body, 2]), tilted
