"""Renders a motion with OpenGL and writes raw pictures to standard output; run as a process of its own.

A process has one OpenGL, chosen by MUJOCO_GL before MuJoCo is imported, and a driver that can't be used may end it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np

from swim2real.viewing.marks import RADIUS, add_markers

MODEL, MOTION = "model.mjb", "motion.npz"


def main() -> None:
    """Reads the model and the motion from the folder that is named; pictures are RGB."""
    folder = Path(sys.argv[1])
    model = mujoco.MjModel.from_binary_path(str(folder / MODEL))
    with np.load(folder / MOTION) as motion:
        qpos, simulated, real = motion["qpos"], motion["simulated"], motion["real"]
        width, height = map(int, motion["size"])
        camera = str(motion["camera"])
    data = mujoco.MjData(model)
    with mujoco.Renderer(model, height, width) as renderer:
        for k in range(len(qpos)):
            data.qpos[:] = qpos[k]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            add_markers(renderer.scene, simulated[k], real[k], RADIUS * model.stat.extent)
            sys.stdout.buffer.write(renderer.render().tobytes())
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
