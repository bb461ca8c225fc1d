"""`board`: a camera file from a picture of a chessboard."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from swim2real.cli.options import finite_above_0
from swim2real.cli.terminal import say
from swimbase.errors import ArgumentError

From = Annotated[float, tyro.conf.arg(name="from")]


def board(
    film: Positional[Path], *, squares: str, square_size: float, to: Path, begin: From = 0.0, fps: float | None = None
) -> int:
    """Make a camera file of a chessboard that lies in the robot's plane, as `track --camera` takes it.

    Reads a film or a picture that shows the whole board, at the height of the head's markers. An existing camera file
    keeps its other keys, such as camera_height.

    Args:
        film: Film or picture of the board, taken with the camera in its place and with the same picture size as the
            films of the robot.
        squares: Squares along the board's two sides, such as 9x6; one more than the inner corners.
        square_size: Side of a square [m].
        to: Camera file to write.
        begin: Use the first frame from this time on [s].
        fps: Frames per second that the camera took, if --from is given and the film doesn't state them.
    """
    counts = re.fullmatch(r"(\d+)\s*[x×]\s*(\d+)", squares)
    if counts is None:
        raise ArgumentError(f"--squares is '{squares}'; write the squares along both sides, such as 9x6")
    finite_above_0("square-size", square_size, unit=" m")
    from markertrack.camera import fit_plane, local_scale
    from markertrack.camera_file import CameraFile, find_board, read_camera, write_camera
    from markertrack.span import Span
    from markertrack.video import first_frame

    known = read_camera(to) if to.exists() else CameraFile()
    corners, places = find_board(
        first_frame(film, Span(begin).begin, fps).image, (int(counts[1]), int(counts[2])), square_size
    )
    write_camera(to, replace(known, points=(corners, places), homography=None))
    plane, residual = fit_plane(corners if known.lens is None else known.lens.undistort(corners), places)
    scale = 1e3 * abs(local_scale(plane, corners.mean(axis=0)))
    say(f"{to}: {len(corners)} corners, {scale:.4f} mm per pixel at the board, off a plane by {1e3 * residual:.2f} mm")
    return 0
