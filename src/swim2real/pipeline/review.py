"""The page on which a person corrects a track, with pictures of its film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swim2real.errors import TrackingError
from swim2real.tracking.points import Anchor
from swim2real.tracking.review import MOST_STRETCHES, Cut, make_strips, write_review_page
from swim2real.tracking.stretches import find_stretches
from swim2real.trials import MarkerTrack
from swim2real.video import VideoReader


def write_review(
    video: str | Path, track: MarkerTrack, names: Sequence[str], path: str | Path, first_frame: int, command: str, *,
    anchors: Sequence[Anchor] = (), threads: int = 0,
) -> Path | None:  # fmt: skip
    """Writes a page that shows where a track is lost or doubtful, and takes a person's corrections.

    The video is decoded once more, up to the last frame that is shown.

    Args:
        video: Path of the video.
        track: Track of it in pixels.
        names: Names of its markers.
        path: Path of the page.
        first_frame: Number in the video of the track's first frame.
        command: How to go on with the file that the page lets a person download, such as `swim2real track swim.mp4 …
            --corrections swim.corrections.json`; shown there.
        anchors: What was corrected before, which stays in the file.
        threads: Number of threads that decode the video; 0 for as many as the machine has cores.

    Returns:
        The path; None where nothing is doubtful, and no page is written.

    Raises:
        VideoError: The video can't be read.
        TrackingError: The video isn't the track's, or the page can't be written.
    """
    stretches = find_stretches(track)
    if not stretches:
        return None
    pictures: dict[Cut, str] = {}
    times: dict[int, float] = {}
    with VideoReader(video, threads) as reader:
        info = reader.info
        strips = make_strips(track, stretches[:MOST_STRETCHES], info.width, info.height)
        wanted: dict[int, list[Cut]] = {}
        for cut in (cut for strip in strips for cut in strip.cuts):
            wanted.setdefault(first_frame + cut.frame, []).append(cut)
        for frame in reader:
            for cut in wanted.pop(frame.index, ()):
                pictures[cut] = cut.picture(frame.image)
                times[cut.frame] = frame.time
            if not wanted:
                break
    if wanted:
        raise TrackingError(
            f"video '{video}' has no frame {max(wanted)}, in which its track is; track it again to see what is doubtful"
        )
    return write_review_page(
        path, info.path.name, names, info.width, info.height, strips, pictures, times, first_frame=first_frame,
        command=command, more=len(stretches) - len(strips), anchors=anchors,
    )  # fmt: skip
