"""Overlays of a calibrated simulator for people: a film and a sheet a trial, and one sheet of all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from swim2real import store
from swim2real.errors import ArgumentError
from swim2real.objective import Comparison
from swim2real.rendering.album import Album
from swim2real.rendering.drawing import to_png
from swim2real.robots.robot import Robot

ALL = "all.png"
_MOMENTS, _COLUMNS, _TILE, _SMALL_TILE = 8, 4, 480, 240  # px for the tiles of a sheet


def write_overlays(
    comparison: Comparison, robot: Robot, folder: str | Path, fps: float = 30.0, width: int = 960,
    on_file: Callable[[Path], None] = lambda path: None,
) -> list[Path]:  # fmt: skip
    """Writes simulated (blue) over real (red) trials.

    Args:
        comparison: What is drawn.
        robot: The robot whose trials they are.
        folder: Where to; it is made if it isn't there.
        fps: Frames a second of the films [Hz].
        width: Width of the films, even [px].
        on_file: Called after every file.

    Returns:
        The files: `NAME.mp4` and `NAME.png` a trial, and last `all.png`.

    Raises:
        ArgumentError: The folder can't be written, or a number is not allowed.
    """
    album, out = Album(comparison, robot), Path(folder)
    files: list[Path] = []

    def done(path: Path) -> None:
        files.append(path)
        on_file(path)

    try:
        out.mkdir(parents=True, exist_ok=True)
        for scene in album.scenes:
            film, sheet = out / f"{scene.name}.mp4", out / f"{scene.name}.png"
            scene.write_clip(film, fps, width)
            done(film)
            store.write_bytes(sheet, to_png(scene.sheet(_MOMENTS, _COLUMNS, _TILE)))
            done(sheet)
        store.write_bytes(out / ALL, to_png(album.overview(_MOMENTS, _SMALL_TILE)))
        done(out / ALL)
    except OSError as error:
        raise ArgumentError(f"can't write '{out}': {store.reason(error)}; choose another folder") from error
    return files
