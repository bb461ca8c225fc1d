"""A video from one of its frames back to an earlier one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from swim2real.video.reader import Frame, VideoReader

MOST_BYTES = 256 << 20  # of decoded frames that are kept at a time
_BYTES = 1.5  # of a pixel, as it is decoded


def frames_backwards(path: str | Path, first: int, last: int, threads: int = 0) -> Iterator[Frame]:
    """Frames of a video in reverse order.

    A video is decoded forward only, so it is read several times, up to the end of one part after the other: of 1000
    frames of 1080p each is decoded six times on average.

    Args:
        path: Path of the video.
        first: Number of the frame that comes last.
        last: Number of the frame that comes first.
        threads: Number of threads that decode; 0 for as many as the machine has cores.

    Raises:
        VideoError: The file can't be read.
    """
    with VideoReader(path, threads) as reader:
        part = max(1, int(MOST_BYTES / (_BYTES * reader.info.width * reader.info.height)))
        while last >= first:
            begin = max(first, last - part + 1)
            kept = [frame for frame in islice(reader, last + 1) if begin <= frame.index <= last]
            yield from reversed(kept)
            last = begin - 1
