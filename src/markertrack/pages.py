"""Pages that are one HTML file without network or libraries, and the one on which the markers of a frame are clicked.

What it lets a person download is what `points` reads. A page is a template in the frame of `page.html`, and data that
its script reads.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image as Pictures

from markertrack.tracking.tracker import Array, Image
from swimbase.errors import ArgumentError, TrackingError
from swimbase.escaping import script_source, visible
from swimbase.store import write_text, writing

_QUALITY = 95  # of JPEG, which keeps a 4K frame at some megabytes
_HERE = Path(__file__).parent


def write_pick_page(
    frame_image: Image, names: Sequence[str], video_name: str, path: str | Path, rest_markers: Array | None = None,
    frame: int = 0, dots: bool = True,
) -> Path:  # fmt: skip
    """Writes the page to click markers on.

    Args:
        frame_image: The frame, upright, RGB. Shape (H, W, 3).
        names: Names of the robot's markers, head first.
        video_name: Name of the video, shown on the page and written into the points file.
        path: Path of the page.
        rest_markers: Marker positions of the robot in its rest pose, for a sketch of it [m]. Shape (M, 2).
        frame: Number of the frame.
        dots: Whether clicks snap to the middle of dots at first.

    Returns:
        The path.

    Raises:
        ArgumentError: The image isn't one.
        TrackingError: The page can't be written.
    """
    shape = frame_image.shape
    if len(shape) != 3 or shape[2] != 3 or frame_image.dtype != np.uint8 or 0 in shape:
        raise ArgumentError(
            f"the frame is an array of {frame_image.dtype} with shape {shape}; it must be uint8 with shape (H, W, 3)"
        )
    steps = np.ones(len(names) - 1) if rest_markers is None else np.linalg.norm(np.diff(rest_markers, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])  # on the sketch
    data = {
        "names": list(names), "video": visible(video_name), "width": shape[1], "height": shape[0], "number": frame,
        "dots": dots,
        "places": np.round(along / max(float(along[-1]), 1e-9), 4).tolist(),
    }  # fmt: skip
    title, image = "Pick the markers of", _jpeg_source(frame_image)
    text, place = filled(_HERE / "picker.html", title, video_name, data, IMAGE=image), Path(path)
    with writing(place, TrackingError, "give a place that can be written to with --out"):
        write_text(place, text)
    return place


def filled(
    template: Path, title: str, video_name: str, data: Mapping[str, object], allowed: str = "", **more: str
) -> str:
    """A page as text: a template's style, body and script in the frame of `page.html`.

    `@@NAME@@` is where a value goes, and `@@name.js@@` a file beside the template or of those that pages share.

    Args:
        template: File of what is the page's own.
        title: Its title, before the name of the video.
        video_name: Name of the video.
        data: What its script reads.
        allowed: What its policy permits besides, as it follows the sources of pictures.
        more: Further parts, by name.
    """
    kept = re.fullmatch(
        r"<style>\n(.*)\n</style>\n(.*)\n<script>\n(.*)\n</script>\n", template.read_text("utf-8"), re.S
    )
    assert kept is not None
    text = (_HERE / "page.html").read_text("utf-8")
    for name, part in zip(("OWN", "BODY", "SCRIPT"), kept.groups(), strict=True):
        text = text.replace(f"@@{name}@@", part)
    while name := re.search("@@([a-z]+\\.[a-z]+)@@", text):
        file = next(folder / name[1] for folder in (template.parent, _HERE) if (folder / name[1]).is_file())
        text = text.replace(name[0], file.read_text("utf-8").rstrip())
    script = text[text.rindex("<script>") + len("<script>") : text.rindex("</script>")]
    parts = {
        "SCRIPTS": script_source(script), "TITLE": title, "VIDEO": html.escape(visible(video_name)), "ALLOWED": allowed,
        "DATA": json.dumps(data, allow_nan=False).replace("<", "\\u003c"), **more,
    }  # fmt: skip
    return re.sub("@@([A-Z]+)@@", lambda match: parts[match.group(1)], text)


def _jpeg_source(image: Image) -> str:
    """A picture as what the `src` of an image can be. Shape (H, W, 3)."""
    buffer = BytesIO()
    # without subsampling a marker's color isn't blurred over its neighbors
    Pictures.fromarray(np.ascontiguousarray(image)).save(buffer, "JPEG", quality=_QUALITY, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
