"""A motion as a film, without a display: by MuJoCo's renderer where OpenGL works, else by outlines."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import closing
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.robots.scenery import LARGEST
from swim2real.store import write_arrays
from swim2real.video import VideoWriter
from swim2real.viewing import offscreen
from swim2real.viewing.outlines import Outlines
from swim2real.viewing.shown import RATE, Shown

FPS = 30.0
BACKENDS = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "GLFW"}
OUTLINES = "outlines, since no OpenGL works here (install libegl1 or libosmesa6)"
_LEAST = 64  # px

Image = NDArray[np.uint8]


def write_film(shown: Shown, path: Path, camera: str, width: int) -> str:
    """Writes a motion at 30 pictures a second.

    Args:
        shown: What is shown.
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
    rows = np.arange(0, len(shown.times), round(RATE / FPS))
    for backend in _backends():
        with closing(_rendered(shown, rows, camera, width, height, backend)) as pictures:
            first = next(pictures, None)
            if first is None:
                continue
            with VideoWriter(path, width, height, FPS) as writer:
                for picture in chain([first], pictures):
                    writer.write(picture)
        return f"MuJoCo's renderer, {BACKENDS.get(backend, 'OpenGL')}"
    drawing, data = Outlines(shown.model, camera, width, height), mujoco.MjData(shown.model)
    with VideoWriter(path, width, height, FPS) as writer:
        for k in rows:
            data.qpos[:] = shown.qpos[k]
            mujoco.mj_forward(shown.model, data)
            writer.write(drawing.drawn(data, shown.simulated[k], shown.real[k]))
    return OUTLINES


def _backends() -> list[str]:
    """Ways to OpenGL that are tried, in this order; what the environment says is the only one."""
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in ("disable", "disabled", "off", "false", "0"):
        return []
    if asked:
        return [asked]
    return ["egl", "osmesa"] if sys.platform.startswith("linux") else [""]


def _rendered(
    shown: Shown, rows: NDArray[np.intp], camera: str, width: int, height: int, backend: str
) -> Generator[Image]:
    """Pictures by MuJoCo's renderer, in a process of its own; none where this OpenGL can't be used."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        mujoco.mj_saveModel(shown.model, str(folder / offscreen.MODEL))
        motion = {"qpos": shown.qpos[rows], "simulated": shown.simulated[rows], "real": shown.real[rows],
                  "size": np.array([width, height]), "camera": np.array(camera)}  # fmt: skip
        write_arrays(folder / offscreen.MOTION, motion)
        environment = {**os.environ, "MUJOCO_GL": backend} if backend else dict(os.environ)
        command = [sys.executable, "-m", offscreen.__name__, str(folder)]
        size = 3 * width * height
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
        ) as process:  # fmt: skip
            try:
                for _ in rows:
                    content = process.stdout.read(size) if process.stdout else b""
                    if len(content) < size:
                        return
                    yield np.frombuffer(content, np.uint8).reshape(height, width, 3)
            finally:
                process.kill()
