"""The page on which a person corrects a track where it is doubtful.

It shows of each stretch a strip of enlarged cuts of the film: the last sure frame before, some within, the first sure
one after. A click puts a marker; what the page lets a person download is what `load_anchors` reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from swim2real.escaping import visible
from swim2real.tracking.page import jpeg_source, write_page
from swim2real.tracking.points import Anchor
from swim2real.tracking.quality import DOUBTFUL
from swim2real.tracking.stretches import Stretch, expected_places, spacing
from swim2real.trials.trial import MarkerTrack

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]

EXPECTED, DOUBTED, SURE = 0, 1, 2  # what a mark says of its marker
MARGIN = 1.1  # times the usual spacing of markers, around the markers of a stretch: their neighbors are seen as well
LEAST_MARGIN = 24.0  # px
MOST_STRETCHES = 40  # on a page
MOST_WITHIN = 7  # frames of a stretch that are shown, beside the one before and the one after
MOST_BYTES = 8_000_000  # of all pictures on a page
SHARPEST = 400  # px of the longer side of a picture; larger cuts are scaled down
_JPEG_QUALITY = 85
_TEMPLATE = Path(__file__).with_name("review.html")


class Mark(NamedTuple):
    """A marker in a cut: its index, its place in the film [px], and what is known (`EXPECTED`, `DOUBTED`, `SURE`)."""

    marker: int
    x: float
    y: float
    state: int


class Cut(NamedTuple):
    """A part of a frame that is shown: number of the frame in the track, the part, and the markers in it."""

    frame: int
    box: tuple[int, ...]  # left, top, width, height [px]
    marks: tuple[Mark, ...]

    def picture(self, image: Image) -> str:
        """The part, of the whole frame, as what the `src` of an image can be. Shape of the frame (H, W, 3)."""
        left, top, width, height = self.box
        part = image[top : top + height, left : left + width]
        share = SHARPEST / max(width, height)
        if share < 1:
            size = max(1, round(share * width)), max(1, round(share * height))
            part = np.asarray(Picture.fromarray(np.ascontiguousarray(part)).resize(size, Picture.Resampling.BOX))
        return jpeg_source(part, _JPEG_QUALITY)


@dataclass(frozen=True)
class Strip:
    """What is shown of a stretch, frame by frame."""

    stretch: Stretch
    cuts: tuple[Cut, ...]


def make_strips(track: MarkerTrack, stretches: Sequence[Stretch], width: int, height: int) -> list[Strip]:
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
    strips: list[Strip] = []
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
        cuts: list[Cut] = []
        for frame, corner in zip(frames.tolist(), corners, strict=True):
            marks = _marks(positions[frame], expected[frame], sure[frame], markers, corner, shape)
            cuts.append(Cut(frame, (*corner.tolist(), *shape.tolist()), marks))
        strips.append(Strip(stretch, tuple(cuts)))
    return strips


def write_review_page(
    path: str | Path, video_name: str, names: Sequence[str], width: int, height: int, strips: Sequence[Strip],
    pictures: Mapping[Cut, str], times: Mapping[int, float], *,
    first_frame: int = 0, command: str = "", more: int = 0, anchors: Sequence[Anchor] = (),
) -> Path:  # fmt: skip
    """Writes the page.

    Args:
        path: Path of the page.
        video_name: Name of the video, shown on the page and written into the corrections file.
        names: Names of the markers.
        width: Width of the film [px].
        height: Height of the film [px].
        strips: What is shown, the most important first; pictures of more than `MOST_BYTES` are left out.
        pictures: Picture of each cut, from `Cut.picture`; cuts without one are left out.
        times: Time in the video of each frame of the track that is shown [s].
        first_frame: Number in the video of the track's first frame.
        command: How to go on with the corrections file.
        more: Number of stretches that aren't among the strips.
        anchors: What was corrected before; it goes into the corrections file again.

    Returns:
        The path.

    Raises:
        TrackingError: The page can't be written.
    """
    room, shown = MOST_BYTES, list[dict[str, Any]]()
    for place, strip in enumerate(strips):
        cuts = [cut for cut in strip.cuts if cut in pictures]
        room -= sum(len(pictures[cut]) for cut in cuts)
        if shown and room < 0:
            more += len(strips) - place
            break
        if cuts:
            shown.append(_told(strip.stretch, cuts, pictures, times, first_frame))
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
        "names": list(names), "video": visible(video_name), "width": width, "height": height,
        "command": visible(command), "more": more, "said": said, "stretches": shown,
    }  # fmt: skip
    return write_page(_TEMPLATE, path, video_name, data, "make room or allow writing there")


def _told(
    stretch: Stretch, cuts: Sequence[Cut], pictures: Mapping[Cut, str], times: Mapping[int, float], first_frame: int
) -> dict[str, Any]:
    """A stretch as the page's script reads it, with frames as the video counts them."""
    told = [
        {
            "frame": first_frame + cut.frame, "time": times[cut.frame], "box": cut.box, "picture": pictures[cut],
            "inside": stretch.first <= cut.frame <= stretch.last,
            "marks": [(mark.marker, round(mark.x, 2), round(mark.y, 2), mark.state) for mark in cut.marks],
        }
        for cut in cuts
    ]  # fmt: skip
    return {
        "markers": stretch.markers, "reason": stretch.reason,
        "first": first_frame + stretch.first, "last": first_frame + stretch.last, "cuts": told,
    }  # fmt: skip


def _marks(
    positions: Array, expected: Array, sure: Mask, markers: Sequence[int], corner: Array, shape: Array
) -> tuple[Mark, ...]:
    """The markers within a cut: those that are seen, and of the others those that it is about."""
    seen = np.isfinite(positions[:, 0])
    places = np.where(seen[:, None], positions, expected)
    inside = ((places >= corner - 0.5) & (places <= corner + shape - 0.5)).all(axis=1)
    chosen = [m for m in np.flatnonzero(inside).tolist() if seen[m] or m in markers]
    states = np.where(seen, np.where(sure, SURE, DOUBTED), EXPECTED).tolist()
    return tuple(Mark(m, float(places[m, 0]), float(places[m, 1]), states[m]) for m in chosen)
