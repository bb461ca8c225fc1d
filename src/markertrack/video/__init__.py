"""Videos, read and written frame by frame in constant memory. Knows nothing of markers."""

from markertrack.video.pictures import film_files, film_name, film_title
from markertrack.video.reader import Frame, VideoInfo, VideoReader, first_frame, frames_backwards, most_frames
from markertrack.video.seeking import SeekableFilm
from markertrack.video.writer import VideoWriter

__all__ = [
    "Frame", "SeekableFilm", "VideoInfo", "VideoReader", "VideoWriter", "film_files", "film_name", "film_title",
    "first_frame", "frames_backwards", "most_frames",
]  # fmt: skip
