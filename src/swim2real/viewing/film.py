"""A motion as a film, without a display: by MuJoCo's renderer where OpenGL works, else by outlines."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull, QhullError

from markertrack.drawing import PAGE, Bytes, Canvas, Color
from markertrack.video import VideoWriter
from swim2real.viewing import offscreen
from swim2real.viewing.motion import RATE, Motion
from swim2real.viewing.scenery import LARGEST
from swimbase.arrays import Array
from swimbase.errors import ArgumentError
from swimbase.store import write_arrays

_FPS = 30.0
_BACKENDS = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "GLFW"}
_OUTLINES = "outlines, since no OpenGL works here (install libegl1 or libosmesa6)"
_LEAST = 64  # px
_SHARPNESS = 2  # times as large as the picture, for smooth edges
_DIRECTIONS = 48
_HIDDEN_GROUP = 3  # from which on MuJoCo's viewer hides geometry
_EDGE: Color = (70, 84, 98)


def write_film(motion: Motion, path: Path, camera: str, width: int) -> str:
    """Writes a motion at 30 pictures per second.

    Args:
        motion: What is shown.
        path: Film to write, such as `.mp4`.
        camera: Name of the model's camera.
        width: Width of the film, even [px]; it is 16 to 9.

    Returns:
        What rendered it, for a person.

    Raises:
        ArgumentError: The width isn't allowed.
        VideoError: The film can't be written.
    """
    if width % 2 or not _LEAST <= width <= LARGEST[0]:
        raise ArgumentError(f"width is {width} px; it must be even and from {_LEAST} to {LARGEST[0]}")
    height = 2 * round(width * 9 / 32)
    rows = np.arange(0, len(motion.times), round(RATE / _FPS))
    with tempfile.TemporaryDirectory() as temporary:  # a driver of OpenGL may end its process
        folder = Path(temporary)
        mujoco.mj_saveModel(motion.model, str(folder / offscreen.MODEL))
        arrays = {"qpos": motion.qpos[rows], "simulated": motion.simulated[rows], "real": motion.real[rows],
                  "size": np.array([width, height]), "fps": np.array(_FPS), "camera": np.array(camera)}  # fmt: skip
        write_arrays(folder / offscreen.MOTION, arrays)
        command = [sys.executable, "-m", offscreen.__name__, str(folder), str(path.absolute())]
        for backend in _backends():
            environment = {**os.environ, "MUJOCO_GL": backend} if backend else dict(os.environ)
            if subprocess.run(command, env=environment, capture_output=True, check=False).returncode == 0:
                return f"MuJoCo's renderer, {_BACKENDS.get(backend, 'OpenGL')}"
    drawing = Outlines(motion, camera, width, height)
    with VideoWriter(path, width, height, _FPS) as writer:
        for k in rows.tolist():
            writer.write(drawing.drawn(k))
    return _OUTLINES


def _backends() -> list[str]:
    """Ways to OpenGL that are tried, in this order; what the environment says is the only one."""
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in ("disable", "disabled", "off", "false", "0"):
        return []
    if asked:
        return [asked]
    return ["egl", "osmesa"] if sys.platform.startswith("linux") else [""]


class Outlines:
    """Draws a motion without OpenGL, as one camera sees it: the outline of each body's hull, the farthest first."""

    def __init__(self, motion: Motion, camera: str, width: int, height: int) -> None:
        """Works out what doesn't move.

        Args:
            motion: What is drawn.
            camera: Name of a camera of its model.
            width: Width of the pictures [px].
            height: Height of the pictures [px].
        """
        model = motion.model
        self._motion, self._model, self._data = motion, model, mujoco.MjData(model)
        self._size = width, height
        self._lens = offscreen.Lens(model, self._data, camera, self._size)
        seen = (model.geom_group < _HIDDEN_GROUP) & (model.geom_rgba[:, 3] > 0)
        clouds = {int(geom): _cloud(model, int(geom)) for geom in np.flatnonzero(seen)}
        self._clouds = {geom: cloud for geom, cloud in clouds.items() if len(cloud)}

    def drawn(self, row: int) -> Bytes:
        """The picture of a sample, RGB. Shape (H, W, 3)."""
        (width, height), motion, data = self._size, self._motion, self._data
        data.qpos[:] = motion.qpos[row]
        mujoco.mj_forward(self._model, data)
        image = Image.new("RGB", (_SHARPNESS * width, _SHARPNESS * height), PAGE)
        brush = ImageDraw.Draw(image)
        away = {geom: self._lens.seen(data.geom_xpos[geom][None])[0, 2] for geom in self._clouds}
        for geom in sorted(away, key=lambda geom: -away[geom]):
            points = data.geom_xpos[geom] + self._clouds[geom] @ data.geom_xmat[geom].reshape(3, 3).T
            seen = self._lens.seen(points)
            if seen[:, 2].min() < offscreen.NEAR:
                continue
            material = int(self._model.geom_matid[geom])
            color = self._model.mat_rgba[material] if material >= 0 else self._model.geom_rgba[geom]
            outline = [tuple(place) for place in _SHARPNESS * _hull(seen[:, :2])]
            if len(outline) > 2:
                brush.polygon(outline, fill=_dyed(color), outline=_EDGE)
        canvas = Canvas(image.resize((width, height), Image.Resampling.LANCZOS))
        return self._lens.with_markers(canvas, motion.simulated[row], motion.real[row])


def _dyed(color: Sequence[float] | Array) -> Color:
    """Shares of red, green and blue as 8-bit numbers."""
    return int(255 * color[0]), int(255 * color[1]), int(255 * color[2])


def _hull(places: Array) -> Array:
    """The corners around places; none where they lie on a line, or in a plane of space. Shape (K, 2 or 3)."""
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
    angles = np.linspace(0, 2 * np.pi, _DIRECTIONS // 2, endpoint=False)
    rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
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
            return (size[0] * rim + ends[:, None]).reshape(-1, 3)
        case kinds.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first = int(model.mesh_vertadr[mesh])
            points = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float)
            hull = _hull(points)
            return hull if len(hull) else points  # a flat one
        case _:
            return np.empty((0, 3))
