"""Small videos for tests: what each frame shows is known, so a frame can be told from its neighbors."""

from __future__ import annotations

import random
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from markertrack.video import VideoReader, VideoWriter, first_frame

WIDTH, HEIGHT, FPS = 160, 96, 30
CORNERS = ((200, 30, 30), (30, 160, 30), (30, 30, 200), (210, 200, 30))  # top left, top right, bottom left, ...


def picture(index: int = 0, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """Four colored quarters and a white block that moves by 3 px a frame."""
    image = np.empty((height, width, 3), np.uint8)
    image[: height // 2, : width // 2], image[: height // 2, width // 2 :] = CORNERS[0], CORNERS[1]
    image[height // 2 :, : width // 2], image[height // 2 :, width // 2 :] = CORNERS[2], CORNERS[3]
    left = 4 + 3 * index % (width - 24)
    image[height // 2 - 10 : height // 2 + 10, left : left + 16] = 255
    return image


@cache
def noisy(index: int) -> NDArray[np.uint8]:
    """A picture that takes many bytes."""
    grain = np.random.default_rng(index).integers(-20, 20, (HEIGHT, WIDTH, 1))
    return np.clip(picture(index).astype(int) + grain, 0, 255).astype(np.uint8)


def clip(path: Path, count: int = 36, show: Callable[[int], NDArray[np.uint8]] = picture, **options) -> Path:
    options = {"fps": FPS, **options}
    first = show(0)
    with VideoWriter(path, first.shape[1], first.shape[0], **options) as writer:
        for index in range(count):
            writer.write(show(index))
    return path


def raw(
    path: Path, encoder: str, count: int = 36, pixels: str = "yuv420p", stamps: Callable[[int], int] | None = None,
    options: dict[str, str] | None = None, colors: int = 1, pixel_shape: Fraction | None = None,
) -> Path:  # fmt: skip
    """A video as other programs write them: any pixels, any key frames, time stamps changed after the encoder."""
    with av.open(str(path), "w", options={"movflags": "+faststart"} if path.suffix == ".mp4" else {}) as container:
        stream = container.add_stream(encoder, rate=FPS, options=options or {})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        stream.codec_context.colorspace, stream.codec_context.color_range = colors, 1
        if pixel_shape is not None:
            stream.codec_context.sample_aspect_ratio = pixel_shape
        pending = []
        for index in range(count):
            frame = av.VideoFrame.from_ndarray(noisy(index), format="rgb24")
            frame = frame.reformat(format=pixels, dst_colorspace=colors, dst_color_range=1)
            frame.pts, frame.time_base = index, Fraction(1, FPS)
            pending += stream.encode(frame)
        for index, packet in enumerate(pending + stream.encode(None)):
            if stamps is not None:
                packet.pts, packet.dts = stamps(index), index - 20
            container.mux(packet)
    return path


def packets(path: Path) -> list[tuple[int, int, int]]:
    """Place and size in the file, and presentation time stamp, of every packet."""
    with av.open(str(path)) as container:
        return [(p.pos, p.size, p.pts) for p in container.demux(video=0) if p.size]


def damage(path: Path, packet: int, share: tuple[float, float] = (0.0, 1.0), seed: int = 0) -> Path:
    """Overwrites a packet, or a part of it, with noise."""
    place, size, _ = packets(path)[packet]
    start, end = (place + int(edge * size) for edge in share)
    data = bytearray(path.read_bytes())
    data[start:end] = random.Random(seed).randbytes(end - start)
    return _beside(path, "damaged", data)


def cut(path: Path, share: float) -> Path:
    """The first part of a file."""
    data = path.read_bytes()
    return _beside(path, "cut", data[: int(share * len(data))])


def patched(path: Path, old: bytes, new: bytes) -> Path:
    data = path.read_bytes()
    assert old in data
    return _beside(path, "patched", data.replace(old, new))


def read(path: Path, **options):
    """All frames, converted, and the notes."""
    with VideoReader(path, **options) as reader:
        frames = [(frame.time, frame.image.astype(int), frame.intact) for frame in reader]
        return frames, reader.notes, reader.info


def error(image: NDArray, truth: NDArray) -> float:
    """Mean deviation of two pictures, in gray levels."""
    return float(np.abs(image.astype(int) - truth.astype(int)).mean())


def _beside(path: Path, word: str, data: bytes) -> Path:
    other = path.with_name(f"{path.stem}-{word}{path.suffix}")
    other.write_bytes(data)
    return other


def first_frame_corners(path: Path) -> tuple[tuple[int, int], NDArray[np.uint8]]:
    """Height and width, and the colors near the four corners, as the reader sees them."""
    image = first_frame(path).image
    return image.shape[:2], np.array([image[5, 5], image[5, -6], image[-6, 5], image[-6, -6]], dtype=int)
