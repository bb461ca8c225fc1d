"""Markers as small spheres in MuJoCo's own scene: blue ones simulated, red ones real, as on all pictures."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

SIMULATED, REAL = (0.08, 0.35, 0.75, 1.0), (0.86, 0.15, 0.15, 0.6)
RADIUS = 0.013  # of the model's extent


def add_markers(
    scene: mujoco.MjvScene, simulated: NDArray[np.float64], real: NDArray[np.float64], radius: float
) -> None:
    """Adds spheres to a scene, as far as it has room.

    Args:
        scene: Gets them after what it has.
        simulated: Places [m]. Shape (M, 3).
        real: Places, NaN for markers that aren't drawn [m]. Shape (M, 3).
        radius: Of each [m].
    """
    for places, color in ((simulated, SIMULATED), (real, REAL)):
        for place in places[np.isfinite(places).all(axis=1)]:
            if scene.ngeom >= scene.maxgeom:
                return
            mujoco.mjv_initGeom(
                scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, radius), place, np.eye(3).ravel(),
                np.array(color, dtype=np.float32),
            )  # fmt: skip
            scene.ngeom += 1
