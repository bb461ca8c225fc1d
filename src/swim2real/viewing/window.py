"""MuJoCo's own interactive viewer, playing a motion again and again."""

from __future__ import annotations

import os
import sys
import time

import mujoco
import mujoco.viewer

from swim2real.errors import ArgumentError
from swim2real.viewing.motion import Motion
from swim2real.viewing.offscreen import add_markers

KEYS = "space pauses, up and down change the speed, left and right step, [ and ] change the camera, Esc frees it"
_SPACE, _RIGHT, _LEFT, _DOWN, _UP = 32, 262, 263, 264, 265  # as GLFW numbers them
_PERIOD = 1 / 60  # s between pictures
_SLOWEST, _FASTEST = 1 / 16, 4.0


class _Player:
    """Where a motion is, and what the keys do to it."""

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
    with viewer:
        viewer.cam.type, viewer.cam.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera(camera).id
        while viewer.is_running():
            began = time.perf_counter()
            with viewer.lock():
                k = motion.nearest(player.time)
                data.time, data.qpos[:] = motion.times[k], motion.qpos[k]
                mujoco.mj_forward(model, data)
                if viewer.user_scn is not None:
                    viewer.user_scn.ngeom = 0
                    add_markers(viewer.user_scn, model, motion.simulated[k], motion.real[k])
            viewer.sync()
            if not player.paused:
                player.move(_PERIOD * player.speed)
            time.sleep(max(0.0, _PERIOD - (time.perf_counter() - began)))
