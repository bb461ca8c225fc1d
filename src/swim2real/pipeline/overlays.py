"""Overlays of a calibrated simulator for people: a film and a sheet a trial, and one sheet of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from swim2real.advisor.briefing.media import swim_view
from swim2real.errors import ArgumentError
from swim2real.objective import Comparison, swims_of
from swim2real.rendering.swim_clip import write_clip
from swim2real.rendering.swim_encoding import to_png
from swim2real.rendering.swim_sheet import beat_sheet, clip_sheet
from swim2real.rendering.swim_view import common_limits

ALL = "all.png"
_MOMENTS, _COLUMNS, _TILE, _SMALL_TILE = 8, 4, 480, 240  # px for the tiles of a sheet


def write_overlays(
    comparison: Comparison, marker_names: Sequence[str], folder: str | Path, fps: float = 30.0, width: int = 960,
    on_file: Callable[[Path], None] = lambda path: None,
) -> list[Path]:  # fmt: skip
    """Writes simulated (blue) over real (red) swims.

    Args:
        comparison: What is drawn.
        marker_names: Head to tail.
        folder: Where to; it is made if it isn't there.
        fps: Of the films [Hz].
        width: Of the films, even [px].
        on_file: Called after every file.

    Returns:
        The files: `NAME.mp4` and `NAME.png` a trial, by frequency, and last `all.png`.

    Raises:
        ArgumentError: The folder can't be written, or a number is not allowed.
        MissingExtraError: Pillow or PyAV isn't installed.
    """
    views = [swim_view(trial, marker_names) for trial in sorted(swims_of(comparison), key=lambda t: t.frequency)]
    limits, out = common_limits(views), Path(folder)
    files: list[Path] = []

    def done(path: Path) -> None:
        files.append(path)
        on_file(path)

    try:
        out.mkdir(parents=True, exist_ok=True)
        for view in views:
            film, sheet = out / f"{view.name}.mp4", out / f"{view.name}.png"
            write_clip(view, film, fps, width, limits)
            done(film)
            sheet.write_bytes(to_png(clip_sheet(view, _MOMENTS, _COLUMNS, _TILE, limits)))
            done(sheet)
        (out / ALL).write_bytes(to_png(beat_sheet(views, _MOMENTS, _SMALL_TILE, limits)))
        done(out / ALL)
    except OSError as error:
        raise ArgumentError(f"can't write '{out}': {error.strerror or error}; choose another folder") from error
    return files
