"""Markers on the pictures of a film; and, as a process of its own, a film of a motion rendered by OpenGL.

Markers are drawn on the finished picture, so that nothing hides them: blue ones simulated, red ones real, as on all
pictures, the red ones smaller and last. A process has one OpenGL, chosen by MUJOCO_GL before MuJoCo is imported, and a
driver that can't be used may end it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np

from markertrack.drawing import INK, PAGE, Bytes, Canvas, Color, to_pillow
from markertrack.video import VideoWriter
from swimbase.arrays import Array

MODEL, MOTION = "model.mjb", "motion.npz"
SIMULATED: Color = (20, 89, 191)
REAL: Color = (219, 38, 38)
SMALLER = 0.6  # of a simulated marker's radius: where both are in one place, both are seen
NEAR = 1e-3  # m, nearer to the camera than which nothing is drawn
_RADIUS, _TEXT = 0.01, 0.035  # of a picture's height: of a marker, and the size of the legend


class Lens:
    """Projection of points by a camera of a model."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, camera: str, size: tuple[int, int]) -> None:
        """Takes a camera, of which the data tell the place at any time.

        Args:
            model: Has the camera.
            data: Its state.
            camera: Name of the camera.
            size: Width and height of the pictures [px].
        """
        self._data, self._camera, self._size = data, model.camera(camera).id, size
        self._scale = size[1] / 2 / np.tan(np.radians(model.cam_fovy[self._camera]) / 2)

    def seen(self, points: Array) -> Array:
        """Places in the picture and distances along the camera's axis [px, px, m]. Shape (N, 3)."""
        local = (points - self._data.cam_xpos[self._camera]) @ self._data.cam_xmat[self._camera].reshape(3, 3)
        depth = -local[:, 2]
        scale = self._scale / np.maximum(depth, NEAR)
        width, height = self._size
        return np.stack([width / 2 + scale * local[:, 0], height / 2 - scale * local[:, 1], depth], axis=1)

    def with_markers(self, canvas: Canvas, simulated: Array, real: Array) -> Bytes:
        """The picture with markers on top of all, and what their colors mean. Shapes (M, 3), NaN for ones not seen."""
        radius, size = _RADIUS * canvas.height, _TEXT * canvas.height
        row = size
        for places, color, share, name in (
            (simulated, SIMULATED, 1.0, "simulated"), (real, REAL, SMALLER, "real"),
        ):  # fmt: skip
            for x, y, depth in self.seen(places[np.isfinite(places).all(axis=1)]):
                if depth > NEAR:
                    canvas.dot((x, y), share * radius, color, 1.0)
            if len(places):
                canvas.dot((size, row), share * radius, color, 1.0)
                canvas.text((2 * size, row), name, INK, size, (0.0, 0.5), PAGE)
                row += 1.6 * size
        return canvas.pixels()


def _main(folder: Path, film: Path) -> None:
    """Reads the model and the motion from a folder and writes the film."""
    model = mujoco.MjModel.from_binary_path(str(folder / MODEL))
    with np.load(folder / MOTION) as motion:
        qpos, simulated, real = motion["qpos"], motion["simulated"], motion["real"]
        (width, height), fps, camera = map(int, motion["size"]), float(motion["fps"]), str(motion["camera"])
    data = mujoco.MjData(model)
    lens = Lens(model, data, camera, (width, height))
    with mujoco.Renderer(model, height, width) as renderer, VideoWriter(film, width, height, fps) as writer:
        for k in range(len(qpos)):
            data.qpos[:] = qpos[k]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            writer.write(lens.with_markers(Canvas(to_pillow(renderer.render())), simulated[k], real[k]))


if __name__ == "__main__":
    _main(Path(sys.argv[1]), Path(sys.argv[2]))
