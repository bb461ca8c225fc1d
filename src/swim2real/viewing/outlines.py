"""Pictures of a model without OpenGL: the outline of each body's hull, the farthest first, under the model's camera."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull, QhullError

from swim2real.rendering.drawing import PAGE, Bytes, Canvas, Color
from swim2real.viewing.marks import REAL, SIMULATED

Array = NDArray[np.float64]

_SHARPNESS = 2  # times as large as the picture, for smooth edges
_DIRECTIONS = 48
_HIDDEN_GROUP = 3  # from which on MuJoCo's viewer hides geometry
_EDGE: Color = (70, 84, 98)
_NEAR = 1e-3  # m, nearer to the camera than which nothing is drawn


class Outlines:
    """Draws a model as seen by one of its cameras."""

    def __init__(self, model: mujoco.MjModel, camera: str, width: int, height: int) -> None:
        """Works out what doesn't move.

        Args:
            model: Compiled.
            camera: Name of its camera.
            width: Width of the pictures [px].
            height: Height of the pictures [px].
        """
        self._model, self._camera = model, model.camera(camera).id
        self._size = (width, height)
        self._scale = height / 2 / np.tan(np.radians(model.cam_fovy[self._camera]) / 2)
        self._clouds = {
            geom: cloud
            for geom in range(model.ngeom)
            if model.geom_group[geom] < _HIDDEN_GROUP
            and model.geom_rgba[geom, 3] > 0
            and len(cloud := _cloud(model, geom))
        }

    def drawn(self, data: mujoco.MjData, simulated: Array, real: Array) -> Bytes:
        """The picture, RGB. Shape (H, W, 3).

        Args:
            data: Where the bodies are; `mj_forward` was called.
            simulated: Simulated markers [m]. Shape (M, 3).
            real: Real markers, NaN for those that aren't drawn [m]. Shape (M, 3).
        """
        width, height = self._size
        image = Image.new("RGB", (_SHARPNESS * width, _SHARPNESS * height), PAGE)
        brush = ImageDraw.Draw(image)
        away = {geom: self._seen(data, data.geom_xpos[geom][None])[0, 2] for geom in self._clouds}
        for geom in sorted(away, key=lambda geom: -away[geom]):
            points = data.geom_xpos[geom] + self._clouds[geom] @ data.geom_xmat[geom].reshape(3, 3).T
            seen = self._seen(data, points)
            if seen[:, 2].min() < _NEAR:
                continue
            color = tuple(int(255 * share) for share in self._color(geom))
            outline = [tuple(place) for place in _SHARPNESS * _hull(seen[:, :2])]
            if len(outline) > 2:
                brush.polygon(outline, fill=color, outline=_EDGE)
        canvas = Canvas(image.resize((width, height), Image.Resampling.LANCZOS))
        for markers, color in ((simulated, SIMULATED), (real, REAL)):
            dyed = (int(255 * color[0]), int(255 * color[1]), int(255 * color[2]))
            for x, y, depth in self._seen(data, markers[np.isfinite(markers).all(axis=1)]):
                if depth > _NEAR:
                    canvas.dot((x, y), height / 100, dyed, 1.0)
        return canvas.pixels()

    def _seen(self, data: mujoco.MjData, points: Array) -> Array:
        """Places in the picture and distances along the camera's axis [px, px, m]. Shape (N, 3)."""
        local = (points - data.cam_xpos[self._camera]) @ data.cam_xmat[self._camera].reshape(3, 3)
        depth = -local[:, 2]
        scale = self._scale / np.maximum(depth, _NEAR)
        width, height = self._size
        return np.stack([width / 2 + scale * local[:, 0], height / 2 - scale * local[:, 1], depth], axis=1)

    def _color(self, geom: int) -> Array:
        material = int(self._model.geom_matid[geom])
        return (self._model.mat_rgba[material] if material >= 0 else self._model.geom_rgba[geom])[:3]


def _hull(places: Array) -> Array:
    """The corners around places in a plane; none where they lie on a line. Shape (K, 2)."""
    try:
        return places[ConvexHull(places).vertices]
    except QhullError:
        return places[:0]


def _cloud(model: mujoco.MjModel, geom: int) -> Array:
    """Points on a geom, in its own frame, whose hull is its own; none for planes and height fields. Shape (N, 3)."""
    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    turns = np.pi * (1 + 5**0.5) * np.arange(_DIRECTIONS)
    heights = 1 - 2 * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    ball = np.stack([np.cos(turns), np.sin(turns), heights], axis=1)
    ball[:, :2] *= np.sqrt(1 - heights**2)[:, None]
    ends = np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]])
    match int(model.geom_type[geom]):
        case kinds.mjGEOM_SPHERE:
            return size[0] * ball
        case kinds.mjGEOM_ELLIPSOID:
            return size * ball
        case kinds.mjGEOM_BOX:
            return size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        case kinds.mjGEOM_CAPSULE:
            return (size[0] * ball + ends[:, None]).reshape(-1, 3)
        case kinds.mjGEOM_CYLINDER:
            angles = np.linspace(0, 2 * np.pi, _DIRECTIONS // 2, endpoint=False)
            rim = size[0] * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
            return (rim + ends[:, None]).reshape(-1, 3)
        case kinds.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first = int(model.mesh_vertadr[mesh])
            points = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float)
            try:
                return points[ConvexHull(points).vertices]
            except QhullError:  # a flat one
                return points
        case _:
            return np.empty((0, 3))
