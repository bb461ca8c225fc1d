"""Markers in MuJoCo's own scene; and, as a process of its own, a film of a motion rendered by OpenGL.

Markers are small spheres: blue ones simulated, red ones real, as on all pictures. A process has one OpenGL, chosen by
MUJOCO_GL before MuJoCo is imported, and a driver that can't be used may end it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.video import VideoWriter

MODEL, MOTION = "model.mjb", "motion.npz"
SIMULATED, REAL = (0.08, 0.35, 0.75, 1.0), (0.86, 0.15, 0.15, 0.6)
_RADIUS = 0.013  # of the model's extent


def add_markers(
    scene: mujoco.MjvScene, model: mujoco.MjModel, simulated: NDArray[np.float64], real: NDArray[np.float64]
) -> None:
    """Adds spheres to a scene, as far as it has room.

    Args:
        scene: Gets them after what it has.
        model: Whose extent their size is a share of.
        simulated: Places [m]. Shape (M, 3).
        real: Places, NaN for markers that aren't drawn [m]. Shape (M, 3).
    """
    size = np.full(3, _RADIUS * model.stat.extent)
    for places, color in ((simulated, SIMULATED), (real, REAL)):
        for place in places[np.isfinite(places).all(axis=1)]:
            if scene.ngeom >= scene.maxgeom:
                return
            mujoco.mjv_initGeom(
                scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_SPHERE, size, place, np.eye(3).ravel(),
                np.array(color, dtype=np.float32),
            )  # fmt: skip
            scene.ngeom += 1


def _main(folder: Path, film: Path) -> None:
    """Reads the model and the motion from a folder and writes the film."""
    model = mujoco.MjModel.from_binary_path(str(folder / MODEL))
    with np.load(folder / MOTION) as motion:
        qpos, simulated, real = motion["qpos"], motion["simulated"], motion["real"]
        (width, height), fps, camera = map(int, motion["size"]), float(motion["fps"]), str(motion["camera"])
    data = mujoco.MjData(model)
    with mujoco.Renderer(model, height, width) as renderer, VideoWriter(film, width, height, fps) as writer:
        for k in range(len(qpos)):
            data.qpos[:] = qpos[k]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            add_markers(renderer.scene, model, simulated[k], real[k])
            writer.write(renderer.render())


if __name__ == "__main__":
    _main(Path(sys.argv[1]), Path(sys.argv[2]))
