"""MuJoCo's own interactive viewer, playing a motion again and again."""

from __future__ import annotations

import os
import sys
import time

import mujoco
import mujoco.viewer
import numpy as np

from swim2real.viewing.motion import Motion
from swim2real.viewing.offscreen import REAL, SIMULATED, SMALLER
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

KEYS = "space pauses, up and down change the speed, left and right step, [ and ] change the camera, Esc frees it"
_SPACE, _RIGHT, _LEFT, _DOWN, _UP = 32, 262, 263, 264, 265  # as GLFW numbers them
_PERIOD = 1 / 60  # s between pictures
_SLOWEST, _FASTEST = 1 / 16, 4.0
_RADIUS = 0.013  # of the model's extent
_BEFORE = 3.0  # times as far as the nearest that is drawn, where markers are that nothing is to hide


class _Player:
    """Place in a motion, and the keys that change it."""

    def __init__(self, duration: float) -> None:
        self.time, self.speed, self.paused = 0.0, 1.0, False
        self._duration = duration

    def press(self, key: int) -> None:
        if key == _SPACE:
            self.paused = not self.paused
        elif key in (_UP, _DOWN):
            self.speed = min(max(self.speed * (2.0 if key == _UP else 0.5), _SLOWEST), _FASTEST)
        elif key in (_LEFT, _RIGHT):
            self.paused = True
            self.move(_PERIOD if key == _RIGHT else -_PERIOD)

    def move(self, seconds: float) -> None:
        self.time = (self.time + seconds) % max(self._duration, _PERIOD)


def check_display() -> None:
    """Refuses to open a window where there can't be one.

    Raises:
        ArgumentError: There is no display.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ArgumentError("there is no display to open a window on; --film FILE.mp4 renders the same without one")


def open_window(motion: Motion, camera: str) -> None:
    """Opens the viewer, and returns when it is closed.

    Args:
        motion: What is played.
        camera: Name of the model's camera to begin with.

    Raises:
        ArgumentError: It can't open.
    """
    model, data = motion.model, mujoco.MjData(motion.model)
    player = _Player(float(motion.times[-1]))
    try:
        viewer = mujoco.viewer.launch_passive(
            model, data, key_callback=player.press, show_left_ui=False, show_right_ui=False
        )
    except RuntimeError as error:  # on a Mac the viewer needs Python's main thread, which only mjpython gives
        raise ArgumentError(f"MuJoCo's viewer can't open: {error}; --film FILE.mp4 renders the same") from error
    legend = "blue\nred", "simulated\nreal"
    with viewer:
        if motion.simulated.size:
            viewer.set_texts((None, mujoco.mjtGridPos.mjGRID_TOPLEFT, *legend))
        viewer.cam.type, viewer.cam.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera(camera).id
        while viewer.is_running():
            began = time.perf_counter()
            with viewer.lock():
                k = motion.nearest(player.time)
                data.time, data.qpos[:] = motion.times[k], motion.qpos[k]
                mujoco.mj_forward(model, data)
                if viewer.user_scn is not None:
                    viewer.user_scn.ngeom = 0
                    eye = eye_of(viewer.cam, data)
                    add_markers(viewer.user_scn, model, eye, motion.simulated[k], motion.real[k])
            viewer.sync()
            if not player.paused:
                player.move(_PERIOD * player.speed)
            time.sleep(max(0.0, _PERIOD - (time.perf_counter() - began)))


def eye_of(camera: mujoco.MjvCamera, data: mujoco.MjData) -> Array:
    """Place of a camera in the world [m]. Shape (3,)."""
    if camera.type == mujoco.mjtCamera.mjCAMERA_FIXED:
        return np.array(data.cam_xpos[camera.fixedcamid])
    turn, rise = np.radians([camera.azimuth, camera.elevation])
    ahead = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    return np.array(camera.lookat) - camera.distance * ahead


def add_markers(scene: mujoco.MjvScene, model: mujoco.MjModel, eye: Array, simulated: Array, real: Array) -> None:
    """Adds spheres to a scene, as far as it has room, right before the eye, where nothing hides them.

    So much smaller as they are nearer, they look as they would where they belong.

    Args:
        scene: Gets them after what it has.
        model: Whose extent their size is a share of.
        eye: Place of the camera [m]. Shape (3,).
        simulated: Places [m]. Shape (M, 3).
        real: Places, NaN for markers that aren't drawn [m]. Shape (M, 3).
    """
    extent, near = model.stat.extent, _BEFORE * model.vis.map.znear * model.stat.extent
    for places, color, share, depth in ((simulated, SIMULATED, 1.0, near), (real, REAL, SMALLER, near / 1.2)):
        for place in places[np.isfinite(places).all(axis=1)]:
            if scene.ngeom >= scene.maxgeom:
                return
            nearer = min(depth / max(float(np.linalg.norm(place - eye)), depth), 1.0)
            mujoco.mjv_initGeom(
                scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, share * _RADIUS * extent * nearer),
                eye + nearer * (place - eye), np.eye(3).ravel(), np.array([*color, 255], dtype=np.float32) / 255,
            )  # fmt: skip
            scene.ngeom += 1
