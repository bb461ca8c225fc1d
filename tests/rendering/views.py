"""Trials as they are drawn, for tests: an arm that is played back, and a swimmer with a beat."""

import numpy as np

from swim2real.rendering.trial_frame import COLORS
from swim2real.rendering.trial_view import TrialView

ARM_LINES = ((0, 1, 2), (0, 3))
ARM_RATE = 0.45  # Hz
BEAT = 0.5  # s
REST = np.array([0.0, 0.12, 0.3, 0.4, 0.5])  # m
RIGHT_SPEED, WRONG_SPEED = 0.1, 0.15  # m/s


def view(name, names, times, lost, real, simulated, diverged, lines, axes, frequency=None, paths=None) -> TrialView:
    seen = np.ones(real.shape[:2], bool)
    seen[:, list(lost)] = False
    real, hidden = np.where(seen[:, :, None], real, np.nan), np.nan if diverged else 0.0
    lengths = np.linalg.norm(simulated + hidden - real, axis=2)
    count = np.isfinite(lengths).sum(axis=1)
    errors = np.where(count > 0, np.nansum(lengths, axis=1) / np.maximum(count, 1), np.nan)
    error = float(errors.mean()) if np.isfinite(errors).any() else float("nan")
    if paths is not None:
        paths = np.where(seen[:, :, None], paths[0], np.nan), paths[1] + hidden
    return TrialView(
        name, names, times, seen, real, simulated + hidden, error, errors, lines, axes, frequency,
        *(paths or (None, None)),
    )  # fmt: skip


def arm(
    name: str = "a", seconds: float = 3.0, start: float = 2.0, lost: tuple[int, ...] = (), diverged: bool = False,
    travels: bool = False,
) -> TrialView:  # fmt: skip
    """An arm that swings about its base and a lamp above it that doesn't, 30 times per second."""
    times = start + np.arange(round(30 * seconds) + 1) / 30

    def places(swing: float) -> np.ndarray:
        angles = -np.pi / 2 + swing * np.sin(2 * np.pi * ARM_RATE * times)
        hand = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        lamp = np.zeros_like(hand) + np.array([0.1, 0.15])
        return np.stack([0 * hand, 0.2 * hand, 0.4 * hand, lamp], axis=1) + np.array([1.0, 0.5])

    real, simulated = places(0.5), places(0.9)
    shift = np.stack([0.1 * (times - times[0]), 0 * times], axis=-1)[:, None]
    paths = (real - shift, simulated - 2 * shift) if travels else None
    names = ("base", "elbow", "hand", "lamp")
    return view(name, names, times, lost, real, simulated, diverged, ARM_LINES, "x right, z up", None, paths)


def swim(
    name: str = "f2_00", seconds: float = 2.0, lost: tuple[int, ...] = (), diverged: bool = False, beat: float = BEAT
) -> TrialView:
    """A body of five markers whose tail beats, 60 times per second."""
    times = np.arange(round(60 * seconds) + 1) / 60

    def body(swing: float, lag: float) -> np.ndarray:
        bend = swing * np.array([0.0, 0.0, 0.2, 0.5, 1.0])
        side = bend * np.cos(2 * np.pi * (times / beat)[:, None] - lag * np.arange(5))
        return np.stack([np.broadcast_to(REST, side.shape), side], axis=-1)

    def path(shape: np.ndarray, speed: float) -> np.ndarray:
        return shape - [REST[:2].mean(), 0] - np.stack([speed * times, 0 * times], axis=-1)[:, None]

    real, simulated = body(0.06, 0.0), body(0.12, 0.3)
    paths = path(real, RIGHT_SPEED), path(simulated, WRONG_SPEED)
    names = ("M0", "M1", "M2", "M3", "M4")
    axes = "body frame, head at the left"
    return view(name, names, times, lost, real, simulated, diverged, (tuple(range(5)),), axes, 1 / beat, paths)


def pixels(image) -> np.ndarray:
    return np.asarray(image).astype(int)


def like(image: np.ndarray, side: str, tolerance: int = 90) -> np.ndarray:
    """Which pixels are rather of a side's color than white. Shape (H, W)."""
    return np.abs(image - np.array(COLORS[side])).max(axis=-1) < tolerance


def near(image: np.ndarray, place, side: str, radius: float) -> float:
    """The share of a disc that has a side's color."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return float(like(image, side)[np.hypot(x - place[0], y - place[1]) <= radius].mean())


def found(sheet: np.ndarray, tile: np.ndarray) -> list[tuple[int, int]]:
    """Where a tile stands in a sheet: rows and columns of its top left pixel."""
    height, width = tile.shape[:2]
    y, x = np.unravel_index(np.argmin(tile.sum(axis=-1)), (height, width))  # its darkest pixel
    starts = np.argwhere((sheet == tile[y, x]).all(axis=-1)) - (y, x)
    starts = starts[(starts >= 0).all(axis=1)].tolist()
    return [(r, c) for r, c in starts if np.array_equal(sheet[r : r + height, c : c + width], tile)]
