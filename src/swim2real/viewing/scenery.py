"""Cameras, lights, water and ground: what a viewer needs, and physics doesn't feel.

Nothing that is added has mass, collides, or moves; a model's own cameras, lights and planes stay as they are.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

ABOVE, SIDE, AHEAD = "above", "side", "ahead"
LARGEST = (1920, 1080)  # px of a picture
WATER_DENSITY = 100.0  # kg/m³, above which a robot is in water
_TILT = np.radians(70)  # of the view from the side: 90 degrees would be level
_DISTANCE = 2.6  # radii of the robot, from the camera to its middle
_SURFACE = (0.35, 0.65, 0.85, 0.18)
_TRAVELS = (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def furnish(spec: mujoco.MjSpec) -> None:
    """Adds what a viewer needs to a spec that compiles; cameras follow a robot that travels.

    Args:
        spec: Gets cameras `above`, `side` and `ahead`, a light, a ground, and a surface of water where it is in water.
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    number = _traveler(model)
    center, radius = _ball(model, data, number)
    for name, tilt, turn in ((ABOVE, 0.0, 0.0), (SIDE, _TILT, 0.0), (AHEAD, _TILT, -np.pi / 2)):
        if name not in {camera.name for camera in spec.cameras}:
            _add_camera(spec, data, number, name, tilt, turn, center, _DISTANCE * radius)
    frame = spec.visual.global_
    frame.offwidth, frame.offheight = max(frame.offwidth, LARGEST[0]), max(frame.offheight, LARGEST[1])
    if not spec.lights:
        above = center + np.array([0.0, 0.0, 4 * radius])
        spec.worldbody.add_light(
            pos=above, dir=[0.3, 0.4, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=[0.35] * 3,
            specular=[0.0] * 3, castshadow=False,
        )  # fmt: skip
        light = spec.visual.headlight
        light.ambient, light.diffuse, light.specular = [0.4] * 3, [0.35] * 3, [0.0] * 3
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.geoms):
        _add_ground(spec, float(center[2] - 1.3 * radius), radius)
        if spec.option.density > WATER_DENSITY:
            _add_plane(spec, "water", float(center[2] + 0.3 * radius), rgba=_SURFACE)
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        spec.add_texture(
            name="scenery:sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.86, 0.91, 0.95], rgb2=[0.55, 0.68, 0.80], width=128, height=768,
        )  # fmt: skip


def _traveler(model: mujoco.MjModel) -> int:
    """The heaviest body that slides or floats in the world; 0 for a robot that stays where it is."""
    travels = [
        body
        for body in range(1, model.nbody)
        if model.body_parentid[body] == 0
        and any(model.jnt_type[j] in _TRAVELS for j in np.flatnonzero(model.jnt_bodyid == body))
    ]
    return max(travels, key=lambda body: float(model.body_subtreemass[body]), default=0)


def _ball(model: mujoco.MjModel, data: mujoco.MjData, number: int) -> tuple[NDArray[np.float64], float]:
    """Middle and radius of what hangs on a body [m]."""
    finite = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    mine = finite & (model.body_rootid[model.geom_bodyid] == number) if number else finite
    if not mine.any():
        return np.array(model.stat.center), float(model.stat.extent)
    places, reach = data.geom_xpos[mine], model.geom_rbound[mine]
    center = (places.min(axis=0) + places.max(axis=0)) / 2
    return center, float((np.linalg.norm(places - center, axis=1) + reach).max())


def _add_camera(
    spec: mujoco.MjSpec, data: mujoco.MjData, number: int, name: str, tilt: float, about: float,
    center: NDArray[np.float64], distance: float,
) -> None:  # fmt: skip
    """A camera that looks down, tilted toward +y and turned about z, at a place; it goes where its body goes."""
    place = center + distance * np.array([np.sin(tilt) * np.sin(about), -np.sin(tilt) * np.cos(about), np.cos(tilt)])
    turn, upright = np.empty(4), np.array([np.cos(about / 2), 0.0, 0.0, np.sin(about / 2)])
    mujoco.mju_mulQuat(turn, upright, np.array([np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0]))
    if not number:
        spec.worldbody.add_camera(name=name, pos=place, quat=turn)
        return
    back, local = np.empty(4), np.empty(4)
    mujoco.mju_negQuat(back, data.xquat[number])
    mujoco.mju_mulQuat(local, back, turn)
    inside = data.xmat[number].reshape(3, 3).T @ (place - data.xpos[number])
    spec.bodies[number].add_camera(name=name, pos=inside, quat=local, mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM)


def _add_ground(spec: mujoco.MjSpec, height: float, radius: float) -> None:
    texture = spec.add_texture(
        name="scenery:ground", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.78, 0.82, 0.86], rgb2=[0.70, 0.75, 0.80], width=128, height=128,
    )  # fmt: skip
    material = spec.add_material(name="scenery:ground", texuniform=True, texrepeat=[1 / radius] * 2, reflectance=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name
    _add_plane(spec, "ground", height, material=material.name)


def _add_plane(spec: mujoco.MjSpec, name: str, height: float, **looks: object) -> None:
    spec.worldbody.add_geom(
        name=f"scenery:{name}", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, height], contype=0,
        conaffinity=0, **looks,
    )  # fmt: skip
