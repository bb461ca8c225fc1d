"""Pages on which a person says where markers are: each one a single HTML file without network or libraries.

On one the markers of a frame are clicked. The other shows where a track is doubtful, of each stretch a strip of
enlarged cuts of the film: the last sure frame before, some within, the first sure one after; a click puts a marker.
What they let a person download is what `points` reads. A page is a template in the frame of `page.html`, and data that
its script reads.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image as Pictures

from markertrack.corrections import DOUBTFUL, Stretch, expected_places, spacing
from markertrack.points import Anchor
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import Array, Image, Mask
from swimbase.errors import ArgumentError, TrackingError
from swimbase.escaping import script_source, visible
from swimbase.store import write_text, writing

EXPECTED, DOUBTED, SURE = 0, 1, 2  # what a mark says of its marker
MARGIN = 1.1  # times the usual spacing of markers, around the markers of a stretch: their neighbors are seen as well
LEAST_MARGIN = 24.0  # px
MOST_STRETCHES = 40  # on a page
MOST_WITHIN = 7  # frames of a stretch that are shown, beside the one before and the one after
MOST_BYTES = 8_000_000  # of all pictures on a page
SHARPEST = 400  # px of the longer side of a picture; larger cuts are scaled down
_PICK_QUALITY, _REVIEW_QUALITY = 95, 85  # of JPEG; the first keeps a 4K frame at some megabytes
_HERE = Path(__file__).parent


class _Mark(NamedTuple):
    """A marker in a cut: its index, its place in the film [px], and what is known (`EXPECTED`, `DOUBTED`, `SURE`)."""

    marker: int
    x: float
    y: float
    state: int


@dataclass
class Cut:
    """A part of a frame that is shown.

    Attributes:
        frame: Number of the frame in the track.
        box: Left, top, width and height of the part [px].
        marks: The markers in it.
        picture: The part, as what the `src` of an image can be; empty until the frame was shown.
        time: Time of the frame in the video [s].
    """

    frame: int
    box: tuple[int, ...]
    marks: tuple[_Mark, ...]
    picture: str = field(default="", repr=False)
    time: float = 0.0

    def show(self, image: Image, time: float) -> None:
        """Takes the part of its frame, of shape (H, W, 3)."""
        left, top, width, height = self.box
        part = image[top : top + height, left : left + width]
        share = SHARPEST / max(width, height)
        if share < 1:
            size = max(1, round(share * width)), max(1, round(share * height))
            part = np.asarray(Pictures.fromarray(np.ascontiguousarray(part)).resize(size, Pictures.Resampling.BOX))
        self.picture, self.time = _jpeg_source(part, _REVIEW_QUALITY), time


@dataclass(frozen=True)
class _Strip:
    """Frames of a stretch, as the page shows them."""

    stretch: Stretch
    cuts: tuple[Cut, ...]


def make_strips(track: MarkerTrack, stretches: Sequence[Stretch], width: int, height: int) -> list[_Strip]:
    """Chooses what is shown of each stretch: frames, and a part of them in which its markers are, or should be.

    Args:
        track: Track in pixels.
        stretches: Stretches of it.
        width: Width of the film [px].
        height: Height of the film [px].
    """
    expected, size = expected_places(track), np.array([width, height])
    positions = np.where(track.confidence[:, :, None] > 0, track.positions, np.nan)
    sure = track.confidence >= DOUBTFUL
    margin = max(LEAST_MARGIN, MARGIN * np.nan_to_num(spacing(expected)))
    strips: list[_Strip] = []
    for stretch in stretches:
        markers, within = list(stretch.markers), np.linspace(stretch.first, stretch.last, MOST_WITHIN).round()
        before, after = max(stretch.first - 1, 0), min(stretch.last + 1, track.frame_count - 1)
        frames = np.unique([before, *within.astype(int).tolist(), after])
        places = expected[frames][:, markers]
        found = positions[frames][:, markers]
        with np.errstate(invalid="ignore"):  # one that went astray isn't followed
            found = np.where(np.linalg.norm(found - places, axis=2, keepdims=True) <= 3 * margin, found, places)
        both = np.concatenate([places, found], axis=1)  # (F, 2 m, 2)
        unknown = ~np.isfinite(both).any(axis=(1, 2))
        both[unknown] = (size - 1) / 2
        low, high = np.nanmin(both, axis=1), np.nanmax(both, axis=1)
        reach = max(width, height) if unknown.any() else float((high - low).max()) + 2 * margin
        shape = np.minimum(np.ceil(reach), size).astype(int)
        corners = np.clip(np.round((low + high - shape + 1) / 2), 0, size - shape).astype(int)
        cuts = [
            Cut(frame, (*corner.tolist(), *shape.tolist()),
                _marks(positions[frame], expected[frame], sure[frame], markers, corner, shape))
            for frame, corner in zip(frames.tolist(), corners, strict=True)
        ]  # fmt: skip
        strips.append(_Strip(stretch, tuple(cuts)))
    return strips


def _marks(
    positions: Array, expected: Array, sure: Mask, markers: Sequence[int], corner: Array, shape: Array
) -> tuple[_Mark, ...]:
    """The markers within a cut: those that are seen, and of the others those that it is about."""
    seen = np.isfinite(positions[:, 0])
    places = np.where(seen[:, None], positions, expected)
    inside = ((places >= corner - 0.5) & (places <= corner + shape - 0.5)).all(axis=1)
    states = np.where(seen, np.where(sure, SURE, DOUBTED), EXPECTED).tolist()
    chosen = [m for m in np.flatnonzero(inside).tolist() if seen[m] or m in markers]
    return tuple(_Mark(m, round(float(places[m, 0]), 2), round(float(places[m, 1]), 2), states[m]) for m in chosen)


def write_review_page(
    path: str | Path, video_name: str, names: Sequence[str], width: int, height: int, strips: Sequence[_Strip], *,
    first_frame: int = 0, command: str = "", more: int = 0, anchors: Sequence[Anchor] = (),
) -> Path:  # fmt: skip
    """Writes the page of doubtful stretches.

    Args:
        path: Path of the page.
        video_name: Name of the video, shown on the page and written into the corrections file.
        names: Names of the markers.
        width: Width of the film [px].
        height: Height of the film [px].
        strips: What is shown, the most important first; pictures of more than `MOST_BYTES` are left out.
        first_frame: Number in the video of the track's first frame.
        command: How to go on with the corrections file.
        more: Number of stretches that aren't among the strips.
        anchors: What was corrected before; it goes into the corrections file again.

    Returns:
        The path.

    Raises:
        TrackingError: The page can't be written.
    """
    sizes = np.cumsum([sum(len(cut.picture) for cut in strip.cuts) for strip in strips])
    shown = max(1, int(np.searchsorted(sizes, MOST_BYTES, "right")))
    stretches = [
        {
            "markers": strip.stretch.markers, "reason": strip.stretch.reason,
            "first": first_frame + strip.stretch.first, "last": first_frame + strip.stretch.last,
            "cuts": [
                {**vars(cut), "frame": first_frame + cut.frame,
                 "inside": strip.stretch.first <= cut.frame <= strip.stretch.last}
                for cut in strip.cuts
            ],
        }
        for strip in strips[:shown]
    ]  # fmt: skip
    said = [
        {
            "frame": anchor.frame,
            "markers": {
                names[m]: None if anchor.hidden[m] else anchor.points[m].tolist()
                for m in np.flatnonzero(anchor.hidden | np.isfinite(anchor.points[:, 0])).tolist()
            },
        }
        for anchor in anchors
    ]
    data = {
        "names": list(names), "video": visible(video_name), "width": width, "height": height, "said": said,
        "command": visible(command), "more": more + len(strips) - len(stretches), "stretches": stretches,
    }  # fmt: skip
    remedy = "make room or allow writing there"
    return _write_page("review.html", "Correct the track of", path, video_name, data, remedy)


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
    remedy, image = "give a place that can be written to with --out", _jpeg_source(frame_image, _PICK_QUALITY)
    return _write_page("picker.html", "Pick the markers of", path, video_name, data, remedy, IMAGE=image)


def _write_page(
    template: str, title: str, path: str | Path, video_name: str, data: Mapping[str, object], remedy: str, **more: str
) -> Path:
    """Writes a page."""
    text, place = filled(_HERE / template, title, video_name, data, **more), Path(path)
    with writing(place, TrackingError, remedy):
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


def _jpeg_source(image: Image, quality: int) -> str:
    """A picture as what the `src` of an image can be. Shape (H, W, 3)."""
    buffer = BytesIO()
    # without subsampling a marker's color isn't blurred over its neighbors
    Pictures.fromarray(np.ascontiguousarray(image)).save(buffer, "JPEG", quality=quality, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
