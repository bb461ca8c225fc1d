"""Opens video files, and says in a sentence why one can't be opened."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING

from swim2real.errors import MissingExtraError, VideoError

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.stream import VideoStream

TOP_BOXES = {b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"}  # with which MP4 and QuickTime files begin
NOT_VIDEO = {"tty"}  # the format that FFmpeg takes text for


def require_av() -> None:
    """Raises a sentence where PyAV isn't installed.

    Raises:
        MissingExtraError: PyAV isn't installed.
    """
    try:
        importlib.import_module("av")
    except ImportError:
        raise MissingExtraError("videos need PyAV; install it with: pip install 'swim2real[track]'") from None


def open_stream(path: Path, threads: int) -> tuple[InputContainer, VideoStream]:
    """Opens a file and its best video stream, ready to decode.

    Args:
        path: Of the video.
        threads: That decode; 0 for as many as the machine has cores.

    Raises:
        VideoError: Not there, a folder, not a video, no video in it, cut off, or no decoder for it.
    """
    require_av()
    import av
    from av.error import FFmpegError

    if path.is_dir():
        raise VideoError(f"'{path}' is a folder; give the path of a video file")
    if not path.exists():
        raise VideoError(f"no video '{path}'; check the path")
    if path.stat().st_size == 0:
        raise VideoError(f"'{path}' is empty (0 bytes); copy it again")
    if _lacks_index(path):
        raise VideoError(
            f"'{path}' ends before its index (the 'moov' box): the recording or the copy was cut off; copy it again, "
            "or repair it with a tool that has an intact video of the same camera"
        )
    try:
        container = av.open(str(path.absolute()))
    except FFmpegError as error:
        if isinstance(error, PermissionError):
            raise VideoError(f"'{path}' can't be read: permission denied") from None
        raise VideoError(f"'{path}' is not a video that FFmpeg can read ({error.strerror})") from None
    try:
        return container, _video_stream(container, path, threads)
    except VideoError:
        container.close()
        raise


def _video_stream(container: InputContainer, path: Path, threads: int) -> VideoStream:
    if container.format.name in NOT_VIDEO:
        raise VideoError(f"'{path}' is a text file, not a video")
    from av.stream import Disposition
    from av.video.stream import VideoStream

    stream = container.streams.best("video")
    if (
        not isinstance(stream, VideoStream) or stream.disposition & Disposition.attached_pic
    ):  # the cover of a sound file
        held = ", ".join(sorted({other.type for other in container.streams})) or "nothing"
        raise VideoError(f"'{path}' has no video in it, only {held}")
    # without a decoder PyAV has no codec context, whatever its stubs say
    if getattr(stream, "codec_context", None) is None:
        raise VideoError(f"no decoder for the video in '{path}'; convert it to H.264, for example")
    stream.thread_type = "AUTO"
    stream.thread_count = threads
    return stream


def _lacks_index(path: Path) -> bool:
    """Whether this is an MP4 or QuickTime file without a whole 'moov' box (a photo has a 'meta' box instead)."""
    with path.open("rb") as file:
        end = path.stat().st_size
        place = 0
        while place + 8 <= end:
            file.seek(place)
            head = file.read(16)
            size, kind = int.from_bytes(head[:4], "big"), head[4:8]
            if (place == 0 and kind not in TOP_BOXES) or kind == b"meta":
                return False
            if size == 1:
                size = int.from_bytes(head[8:16], "big")
            if kind == b"moov":
                return place + size > end
            if size < 8:  # 0: up to the end of the file
                break
            place += size
        return place > 0 or end >= 8
