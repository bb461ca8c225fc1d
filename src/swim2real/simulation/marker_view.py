"""A model's markers as the camera sees them: where they are in the plane, and how the joints move them."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """Markers and equality constraints in one pose.

    Attributes:
        markers: In the plane [m]. Shape (M, 2).
        slopes: Of the markers by the joints' velocities [m/rad or 1]. Shape (M, 2, nv).
        gaps: By which equality constraints are violated [m or rad]. Shape (E,).
        gap_slopes: Shape (E, nv).
    """

    markers: Array
    slopes: Array
    gaps: Array
    gap_slopes: Array


class MarkerView:
    """Looks at one model. It has a state of its own, so it is for one thread."""

    def __init__(self, model: mujoco.MjModel, count: int, plane: tuple[int, int]) -> None:
        """Takes the model's last sensors for its markers.

        Args:
            model: Compiled; its last sensors are one `framepos` a marker.
            count: Of markers, M.
            plane: Axes of the world that the camera sees.
        """
        self._model, self._data, self._plane = model, mujoco.MjData(model), list(plane)
        last = range(model.nsensor - count, model.nsensor)
        self._objects = [(int(model.sensor_objtype[i]), int(model.sensor_objid[i])) for i in last]

    def at(self, qpos: Array) -> View:
        """What is seen in a pose. Shape (nq,)."""
        model, data = self._model, self._data
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        slopes = np.zeros((len(self._objects), 3, model.nv))
        places: list[Array] = []
        for rows, one in zip(slopes, self._objects, strict=True):
            point, body = self._place(*one)
            mujoco.mj_jac(model, data, rows, None, point, body)
            places.append(point.copy())
        gaps = slice(0, data.ne)
        return View(
            np.array(places)[:, self._plane], slopes[:, self._plane], data.efc_pos[gaps].copy(), self._rows()[gaps]
        )

    def _rows(self) -> Array:
        """Jacobian of the constraints. Shape (nefc, nv)."""
        model, data = self._model, self._data
        rows = np.zeros((data.nefc, model.nv))
        if mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        else:
            rows[:] = data.efc_J.reshape(rows.shape)
        return rows

    def _place(self, kind: int, index: int) -> tuple[Array, int]:
        """Position and body of an object."""
        model, data = self._model, self._data
        match mujoco.mjtObj(kind):
            case mujoco.mjtObj.mjOBJ_SITE:
                return data.site_xpos[index], int(model.site_bodyid[index])
            case mujoco.mjtObj.mjOBJ_GEOM:
                return data.geom_xpos[index], int(model.geom_bodyid[index])
            case mujoco.mjtObj.mjOBJ_BODY:
                return data.xipos[index], index
            case _:
                return data.xpos[index], index
