"""Films of swimmers without markers, drawn as filled outlines with OpenCV, and where their midlines are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from markertrack.video import VideoWriter

FINER = 4  # times, in which outlines are drawn
FPS = 30.0


@dataclass(frozen=True)
class Swimmer:
    """A body that passes a wave from head to tail, its amplitude growing, while it goes straight on.

    Attributes:
        length: [px].
        width: Half of it at the widest place, as a share of the length.
        frequency: Of its beat [Hz].
        wavelength: [lengths].
        amplitude: Of the tail [lengths].
        speed: [lengths/s].
        begin: Place of the head at first [px].
        heading: [rad].
        level: Brightness.
    """

    length: float = 200.0
    width: float = 0.06
    frequency: float = 2.0
    wavelength: float = 0.9
    amplitude: float = 0.1
    speed: float = 0.5
    begin: tuple[float, float] = (280.0, 160.0)
    heading: float = 0.0
    level: int = 40

    def midline(self, time: float, count: int = 201) -> np.ndarray:
        """Points at equal distances on its midline, head first [px]. Shape (count, 2)."""
        s = np.linspace(0, 1, 801)
        y = self.amplitude * (0.2 + 0.8 * s**2) * np.sin(2 * np.pi * (s / self.wavelength - self.frequency * time))
        x = -self.speed * time + s
        travel = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        at = np.linspace(0, 1, count)  # the body keeps its length
        x, y = np.interp(at, travel, x), np.interp(at, travel, y)
        turn = np.array([[np.cos(self.heading), np.sin(self.heading)], [-np.sin(self.heading), np.cos(self.heading)]])
        return np.array(self.begin) + self.length * np.stack([x, y], axis=1) @ turn

    def outline(self, time: float) -> np.ndarray:
        """Corners of its outline [px]."""
        middle = self.midline(time)
        s = np.linspace(0, 1, len(middle))
        half = self.length * self.width * np.sqrt(np.clip(s / 0.15, 0, 1)) * np.clip((1 - s) / 0.75, 0.08, 1)
        along = np.gradient(middle, axis=0)
        across = along[:, ::-1] * [-1, 1] / np.hypot(*along.T)[:, None]
        return np.concatenate([middle + half[:, None] * across, (middle - half[:, None] * across)[::-1]])


def draw(
    swimmers: list[Swimmer], time: float, size: tuple[int, int] = (480, 320), ground: int = 190, noise: float = 4.0,
    add: Callable[[np.ndarray, float], None] = lambda image, time: None, seed: int = 0,
) -> np.ndarray:  # fmt: skip
    """A picture of swimmers on an uneven, noisy ground, RGB."""
    width, height = size
    large = np.full((FINER * height, FINER * width), ground, np.uint8)
    for swimmer in swimmers:
        corners = np.round((swimmer.outline(time) + 0.5) * FINER * 16 - 8).astype(np.int32)
        cv2.fillPoly(large, [corners], swimmer.level, shift=4)
    image = cv2.resize(large, size, interpolation=cv2.INTER_AREA).astype(float)
    image += 12 * np.sin(np.arange(width) / 90)[None] + 8 * np.cos(np.arange(height) / 60)[:, None]
    add(image, time)
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.repeat(np.clip(image, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def film(path: Path, swimmers: list[Swimmer], count: int = 45, **options) -> Path:
    size = options.get("size", (480, 320))
    with VideoWriter(path, *size, fps=FPS) as writer:
        for k in range(count):
            writer.write(draw(swimmers, k / FPS, seed=k, **options))
    return path
