"""Overlays for a person to judge: a film with its track drawn on it, or with simulated markers beside real ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image, Resampling
from scipy.optimize import isotonic_regression

from markertrack.drawing import DARK, Bytes, Canvas, Color, Place, plain, text_size, to_pillow
from markertrack.video import VideoWriter
from swimbase.arrays import Array, Mask
from swimbase.errors import ArgumentError

States = NDArray[np.int64]

_SEEN, _FILLED, _LOST = 0, 1, 2
# from head to tail hue and lightness change together, so the order shows with any color blindness, and in gray
STOPS: tuple[Color, ...] = (
    (134, 106, 255), (200, 90, 224), (246, 102, 144), (255, 146, 88), (255, 198, 74), (250, 246, 124),
)  # fmt: skip
_TEXT: Color = (231, 235, 240)
_MUTED: Color = (163, 174, 187)
ALERT: Color = (198, 40, 40)
_TAIL = 2  # of the last markers have trails
TRAIL_TIME = 0.5  # s
_EDGE = 0.8  # px
_EARLY = 0.1  # of the time between two drawn frames, by which the next one may come early
_RATE = 30.0  # frames per second that are drawn at most while all markers are seen
_FOLLOW_TIME = 0.15  # s in which it follows the fish: it must not shake with every beat
_MOST_ZOOM, _LEAST_ZOOM = 3.0, 1.3  # with less it would show nothing new
_SHARE = (0.56, 0.45)  # of the picture's width and height, which it takes at most
_ROOM, _BREADTH = 0.3, 0.5  # of the fish's length: more than the fish takes now, and in any direction: it beats
_GAP = 14  # px to the edges of the picture
_NEAR = 24  # px from a marker to what hides the track
_REAL: Color = (255, 82, 82)
_SIMULATED: Color = (64, 156, 255)


class _Overlay:
    """A film that is written. A context manager."""

    _writer: VideoWriter

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self._writer.__exit__(kind, *error)


class TrackOverlay(_Overlay):
    """Writes a video of a film with its track. A context manager.

    A marker that is seen has a ring in its color; one that was filled in (a position with confidence 0) a dotted ring;
    one that is lost a broken ring with a cross, where it was last. A line joins neighbors that have a position, and the
    last two markers draw their last half second. An enlarged view of the fish, with labels, stands in a corner where it
    hides nothing of the track. The strip below the film says the frame, its time, and how each marker is. Of a faster
    film 30 frames per second are drawn, and every frame in which a marker is lost.

    Attributes:
        width: Width of the film in the overlay [px]: `Frame.scaled(overlay.width)` fits without being scaled again.
        height: Height of the film in the overlay, without the strip [px].
    """

    def __init__(
        self, path: str | Path, width: int, height: int, fps: float, names: Sequence[str], longest_side: int = 1280
    ) -> None:
        """Opens the file.

        Args:
            path: Path of the overlay, such as `.mp4`.
            width: Width of the upright film [px].
            height: Height of the upright film [px].
            fps: Frames a second.
            names: Names of the markers, head to tail.
            longest_side: To which the film is scaled down [px]. A smaller film keeps its size.

        Raises:
            ArgumentError: A size is too small, or there are no names.
            VideoError: The file can't be written.
        """
        if min(width, height) < 16 or longest_side < 64:
            raise ArgumentError(
                f"the film is {width} x {height} px and longest_side {longest_side} px; both sides of the film must be "
                "at least 16 and longest_side at least 64"
            )
        if not names:
            raise ArgumentError("names is empty; an overlay needs the name of every marker")
        share = min(1.0, longest_side / max(width, height))
        self.width, self.height = (max(2, 2 * round(share * side / 2)) for side in (width, height))
        self._film = (width, height)
        self._names, self._colors = tuple(names), marker_colors(len(names))
        self._strip = _Strip(self._names, self._colors, self.width)
        self._writer = VideoWriter(path, self.width, self.height + self._strip.height, fps)
        self._last = np.full((len(names), 2), np.nan)  # where each marker was last, in the overlay [px]
        self._trail: deque[tuple[float, Array]] = deque()
        self._inset: Inset | None = None
        self._radius = 6.0
        self._count = 0
        self._due = -np.inf  # when the next frame is drawn [s]

    def wants(self, time: float, confidence: Array) -> bool:
        """True if the next frame is drawn; one that isn't is counted and needn't be added."""
        drawn = time >= self._due or not np.all(confidence > 0)
        if drawn:
            self._due = time + (1 - _EARLY) / _RATE
        else:
            self._count += 1
        return drawn

    def add(
        self, image: Bytes, scale: float, time: float, positions: Array, confidence: Array,
        *, refused: Mask | None = None, detail: Bytes | None = None,
    ) -> None:  # fmt: skip
        """Adds a frame.

        Args:
            image: The upright film, RGB, in any size; that of the overlay is the cheapest. Shape (H, W, 3).
            scale: Pixels of `image` to a pixel of the film.
            time: Time of the frame [s].
            positions: Positions of the markers in the film, NaN where lost [px]. Shape (M, 2).
            confidence: Confidence from 0 to 1; a position with 0 was filled in. Shape (M,).
            refused: Markers that a check takes for lost though they have a position, where they are drawn as lost.
                Shape (M,).
            detail: The same frame in full resolution; the enlarged view is cut from it, which is sharper.

        Raises:
            ArgumentError: Shapes don't fit.
            VideoError: The time doesn't follow the last one, or the file can't be written.
        """
        self._check(image, scale, positions, confidence, refused)
        known = np.isfinite(positions).all(axis=1)
        states = np.where(known, np.where(confidence > 0, _SEEN, _FILLED), _LOST)
        if refused is not None:
            states[refused & (states == _SEEN)] = _LOST
        to_overlay = np.array([self.width, self.height]) / self._film
        self._last = np.where(known.reshape(-1, 1), (positions + 0.5) * to_overlay - 0.5, self._last)
        self._trail.append((time, np.where((states == _LOST)[:, None], np.nan, self._last)[-_TAIL:]))
        while self._trail[0][0] < time - TRAIL_TIME:
            self._trail.popleft()
        film = to_pillow(image)
        if film.size != (self.width, self.height):
            film = film.resize((self.width, self.height), reducing_gap=2.0)
        picture = plain(self.width, self.height + self._strip.height, DARK)
        picture.paste(film)
        canvas = Canvas(picture)
        self._draw(canvas, image if detail is None else detail, time, states)
        canvas.paste(self._strip.drawn(self._count, time, states), (0, self.height))
        self._writer.write(canvas.pixels(), time)
        self._count += 1

    def _draw(self, canvas: Canvas, detail: Bytes, time: float, states: States) -> None:
        """The track, and the enlarged view with the track."""
        present = self._last[states != _LOST]
        if self._inset is None and 2 * len(present) > len(states):
            self._inset = Inset(present, (self.width, self.height))
            gaps = np.hypot(*np.diff(present, axis=0).T)
            self._radius = float(np.clip(0.45 * np.median(gaps), 5, 8)) if len(gaps) else self._radius
        trails = np.array([tail for _, tail in self._trail])
        self._track(canvas, self._last, states, trails, self._radius)
        if self._inset is not None:
            self._inset.follow(present, time)
        if self._inset is None or self._inset.corner is None:
            self._labels(canvas, self._last, states, self._radius, *self._around(present))
            return
        picture = self._inset.cut(detail)
        close = Canvas(picture)
        places, radius = self._inset.places(self._last), float(np.clip(0.8 * self._radius * self._inset.zoom, 8, 16))
        self._track(close, places, states, self._inset.places(trails), radius)
        self._labels(close, places, states, radius, np.full(2, 10.0), np.array(self._inset.size) - 11.0)
        (left, top), (width, height) = self._inset.corner, self._inset.size
        canvas.fill((left - 2, top - 2, left + width + 2, top + height + 2), _TEXT)
        canvas.paste(picture, (left, top))

    def _track(self, canvas: Canvas, places: Array, states: States, trails: Array, radius: float) -> None:
        for m in range(trails.shape[1]):
            canvas.polyline(_points(trails[:, m]), self._colors[m - trails.shape[1]], 2.4, opacity=0.9, fade=True)
        for m in range(len(places) - 1):
            if states[m] != _LOST and states[m + 1] != _LOST:
                canvas.polyline(_between(places[m], places[m + 1], radius, radius), _TEXT, 1.4, _EDGE, 0.8)
        for m in np.argsort(-states, kind="stable").tolist():  # lost ones below the others
            if np.isfinite(places[m]).all():
                _draw_marker(canvas, _points(places[m : m + 1])[0], radius, self._colors[m], int(states[m]))

    def _labels(self, canvas: Canvas, places: Array, states: States, radius: float, low: Array, high: Array) -> None:
        """Labels at the sides of a box, each with a line to its marker."""
        size = 15.0 if self.width >= 640 else 11.0
        sizes = [(w + round(size), h + round(0.4 * size)) for w, h in (text_size(name, size) for name in self._names)]
        at = label_places(places, sizes, low, high)
        drawn = np.flatnonzero(np.isfinite(at).all(axis=1)).tolist()
        for m in drawn:
            canvas.polyline(_between(places[m], at[m], radius + 2, 0.0), self._colors[m], 1.4, opacity=0.9)
        for m in drawn:
            text, plate = (_TEXT, ALERT) if states[m] == _LOST else (self._colors[m], DARK)
            canvas.text(_points(at[m : m + 1])[0], self._names[m], text, size, (0.5, 0.5), plate)

    def _around(self, present: Array) -> tuple[Array, Array]:
        """Two corners of a box as long as the picture, and as wide as the fish takes with labels at its sides."""
        end = np.array([self.width - 1.0, self.height - 1.0])
        if not len(present):
            return np.zeros(2), end
        low, high, reach = present.min(axis=0), present.max(axis=0), 4 * self._radius + 24
        across = int(np.argmin(high - low))
        free = np.arange(2) != across
        return np.where(free, 0.0, np.maximum(low - reach, 0)), np.where(free, end, np.minimum(high + reach, end))

    def _check(self, image: Bytes, scale: float, positions: Array, confidence: Array, refused: Mask | None) -> None:
        count = len(self._names)
        if positions.shape != (count, 2) or confidence.shape != (count,):
            raise ArgumentError(
                f"positions have shape {positions.shape} and confidence {confidence.shape}; "
                f"for {count} markers they must have ({count}, 2) and ({count},)"
            )
        if refused is not None and refused.shape != (count,):
            raise ArgumentError(f"refused has shape {refused.shape}; for {count} markers it must have ({count},)")
        wide, tall = (scale * side for side in self._film)
        height, width = image.shape[:2]
        if not (abs(width - wide) <= 2 and abs(height - tall) <= 2):
            raise ArgumentError(
                f"the image is {width} x {height} px and scale is {scale:g}; at this scale the film of {self._film[0]} "
                f"x {self._film[1]} px is {wide:.0f} x {tall:.0f} px"
            )


def marker_colors(count: int) -> list[Color]:
    """A color for each marker, from violet at the head to yellow at the tail; they get lighter all the way."""
    at = np.linspace(0, len(STOPS) - 1, count)
    channels = [np.interp(at, range(len(STOPS)), channel) for channel in zip(*STOPS, strict=True)]
    return [(round(r), round(g), round(b)) for r, g, b in zip(*channels, strict=True)]


def _draw_marker(canvas: Canvas, place: Place, radius: float, color: Color, state: int) -> None:
    """A ring if the marker is seen, a dotted one if it was filled in, a broken one with a cross if it is lost."""
    if state == _SEEN:
        canvas.ring(place, radius, color, 2.0, _EDGE)
    elif state == _FILLED:
        canvas.ring(place, radius, color, 2.0, _EDGE, min(max(round(1.2 * radius), 6), 12), 0.4)
    else:
        canvas.ring(place, 1.35 * radius, color, 1.6, _EDGE, 6, 0.55)
        canvas.cross(place, 0.7 * radius, _TEXT, 2.0, _EDGE)


def _points(places: Array) -> list[Place]:
    return [(x, y) for x, y in places.tolist()]


def _between(start: Array, end: Array, before: float, after: float) -> list[Place]:
    """The line from one place to another without its first and last pixels; none where nothing is left."""
    way = end - start
    length = float(np.hypot(*way))
    if length <= before + after:
        return []
    return _points(np.stack([start + way * before / length, end - way * after / length]))


class _Strip:
    """The strip below the film: frame, time, how many markers are lost, and how each one is."""

    def __init__(self, names: Sequence[str], colors: Sequence[Color], width: int) -> None:
        self._names, self._colors, self._width = names, colors, width
        self._size = size = float(np.clip(round(width / 56), 11, 18))
        row_height = 2 * round(size)
        fields = ["frame 00000", "000.000 s", f"{len(names)} of {len(names)} lost"]
        widths = [text_size(field, size)[0] + size for field in fields]
        widths += [text_size(name, size)[0] + 1.5 * size for name in names]
        x, row = 0.8 * size, 0
        self._places: list[Place] = []
        for wide in widths:
            if x + wide > width and x > size:
                x, row = 0.8 * size, row + 1
            self._places.append((x, (row + 0.5) * row_height - 0.5))
            x += wide + 0.8 * size
        self.height = (row + 1) * row_height
        self._states: list[int] = []
        self._ground = plain(width, self.height, DARK)

    def drawn(self, frame: int, time: float, states: States) -> Image:
        if self._states != states.tolist():  # most frames are like the last one
            self._states = states.tolist()
            self._ground = self._markers()
        image = self._ground.copy()
        canvas = Canvas(image)
        canvas.text(self._places[0], f"frame {frame}", _TEXT, self._size, (0, 0.5))
        canvas.text(self._places[1], f"{time:.3f} s", _TEXT, self._size, (0, 0.5))
        return image

    def _markers(self) -> Image:
        image, size, lost = plain(self._width, self.height, DARK), self._size, self._states.count(_LOST)
        canvas, count = Canvas(image), f"{lost} of {len(self._states)} lost"
        canvas.text(self._places[2], count, _TEXT if lost else _MUTED, size, (0, 0.5), ALERT if lost else None)
        for (x, y), name, color, state in zip(self._places[3:], self._names, self._colors, self._states, strict=True):
            place, radius = (x + 0.4 * size, y), 0.36 * size
            if state == _SEEN:
                canvas.dot(place, radius, color)
            elif state == _FILLED:
                _draw_marker(canvas, place, radius, color, state)
            else:
                canvas.cross(place, 1.2 * radius, color, 2.4)
            plate = ALERT if state == _LOST else None
            canvas.text((x + 1.3 * size, y), name, _MUTED if state == _FILLED else _TEXT, size, (0, 0.5), plate)
        return image


class Inset:
    """An enlarged view that follows the fish, from a corner where it hides none of it.

    All places are in pixels of the picture that it stands in.

    Attributes:
        zoom: Pixels to a pixel of the picture around it.
        size: Width and height [px].
        corner: Where its top left pixel is [px]; None while every corner would hide some of the fish, or where the fish
            is so large that nothing can be enlarged.
    """

    def __init__(self, points: Array, picture: tuple[int, int]) -> None:
        """Fits a view around the fish as it is now; size and zoom stay.

        Args:
            points: Markers that are seen [px]. Shape (N, 2).
            picture: Width and height of the picture [px].
        """
        self._picture = np.array(picture, dtype=float)
        extent = np.ptp(points, axis=0)
        length = float(np.hypot(*extent))
        extent = np.maximum(extent + _ROOM * length, max(_BREADTH * length, 16.0))
        self.zoom = float(min(_MOST_ZOOM, *(_SHARE * self._picture / extent)))
        width, height = (2 * round(side * self.zoom / 2) for side in extent.tolist())
        self.size = (width, height)
        right, bottom = picture[0] - width - _GAP, picture[1] - height - _GAP
        self._corners = [(right, bottom), (_GAP, bottom), (right, _GAP), (_GAP, _GAP)]
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        self._middle, self._time = (self._low + self._high) / 2, 0.0
        self.corner: tuple[int, int] | None = None

    def follow(self, points: Array, time: float) -> None:
        """Moves along with the markers that are seen. Shape (N, 2)."""
        if len(points):
            self._low, self._high = points.min(axis=0), points.max(axis=0)
            share = 1 - np.exp(-max(time - self._time, 0.0) / _FOLLOW_TIME)
            self._middle = self._middle + share * ((self._low + self._high) / 2 - self._middle)
        self._time = time
        self.corner = self._best()

    def places(self, points: Array) -> Array:
        """Maps places of the picture into the view [px]. Shape (..., 2)."""
        return (points + 0.5 - self._start()) * self.zoom - 0.5

    def cut(self, image: Bytes) -> Image:
        """The view, out of the picture in any resolution."""
        factor = np.array(image.shape[1::-1]) / self._picture
        low = self._start() * factor
        high = low + np.array(self.size) / self.zoom * factor
        first = np.maximum(np.floor(low).astype(int) - 4, 0)
        last = np.ceil(high).astype(int) + 4
        part = to_pillow(image[first[1] : last[1], first[0] : last[0]])
        left, top, right, bottom = *(low - first), *np.minimum(high - first, part.size)
        box = (float(left), float(top), float(right), float(bottom))
        return part.resize(self.size, Resampling.BILINEAR, box)

    def _start(self) -> Array:
        """The corner of what is shown, measured from the corner of the picture."""
        part = np.array(self.size) / self.zoom
        return np.clip(self._middle + 0.5 - part / 2, 0, self._picture - part)

    def _best(self) -> tuple[int, int] | None:
        """A corner where it hides nothing of the fish: the one it is in, or else the one farthest from the fish."""
        if self.zoom < _LEAST_ZOOM:
            return None
        corners, size = np.array(self._corners), np.array(self.size)
        low, high = self._low - _NEAR, self._high + _NEAR
        free = ((corners >= high) | (corners + size <= low)).any(axis=1)
        if not free.any():
            return None
        if self.corner is not None and free[self._corners.index(self.corner)]:
            return self.corner
        away = np.hypot(*(corners + size / 2 - (low + high) / 2).T)
        return self._corners[int(np.argmax(np.where(free, away, -1.0)))]


def label_places(places: Array, sizes: Sequence[tuple[int, int]], low: Array, high: Array) -> Array:
    """Places labels in rows at the long sides of a box, by turns, each as close to its marker as there is room.

    Args:
        places: Places of the markers, NaN where unknown [px]. Shape (M, 2).
        sizes: Sizes of the labels: width and height [px].
        low: Top left corner of the box [px]. Shape (2,).
        high: Bottom right corner of the box [px]. Shape (2,).

    Returns:
        The middles of the labels [px]; NaN for markers that aren't in the box, and for rows that are too long for it.
        Shape (M, 2).
    """
    axis = 0 if high[0] - low[0] >= high[1] - low[1] else 1  # along the long sides
    halves = np.array(sizes, dtype=float) / 2
    known = np.flatnonzero((places >= low).all(axis=1) & (places <= high).all(axis=1))
    out = np.full(places.shape, np.nan)
    for side in (0, 1):
        row = known[known % 2 == side]
        row = row[np.argsort(places[row, axis], kind="stable")]
        if len(row) == 0:
            continue
        steps = np.concatenate([[0.0], np.cumsum(halves[row[1:], axis] + halves[row[:-1], axis])])
        at = isotonic_regression(places[row, axis] - steps).x + steps  # labels that touch move as one
        first, last = low[axis] + halves[row[0], axis], high[axis] - halves[row[-1], axis] - steps[-1]
        if first > last:
            continue
        out[row, axis] = np.clip(at, first + steps, last + steps)
        depth = halves[row, 1 - axis]
        out[row, 1 - axis] = low[1 - axis] + depth if side == 0 else high[1 - axis] - depth
    return out


class FilmOverlay(_Overlay):
    """Writes a film with real markers as red rings and simulated ones as blue dots with lines. A context manager.

    Attributes:
        width: Width of the pictures [px]: `Frame.scaled(overlay.width)` fits.
        height: Their height [px].
    """

    def __init__(
        self, path: str | Path, size: tuple[int, int], fps: float, lines: Sequence[Sequence[int]],
        longest_side: int = 1280,
    ) -> None:  # fmt: skip
        """Opens the file.

        Args:
            path: Path of the film to write, such as `.mp4`.
            size: Width and height of the upright film [px].
            fps: Frames a second.
            lines: Indices of the markers that each line goes through.
            longest_side: To which the film is scaled down [px]. A smaller film keeps its size.

        Raises:
            VideoError: The file can't be written.
        """
        share = min(1.0, longest_side / max(size))
        self.width = max(2, 2 * round(share * size[0] / 2))
        self.height = max(2, 2 * round(self.width * size[1] / size[0] / 2))  # as `Frame.scaled` has it
        self._share = np.array([self.width, self.height]) / size
        self._lines = lines
        self._radius = max(3.0, self.width / 260)
        self._writer = VideoWriter(path, self.width, self.height, fps)
        self._begin: float | None = None

    def add(self, image: Bytes, time: float, real: Array, simulated: Array) -> None:
        """Adds a frame.

        Args:
            image: The upright film, RGB, in the overlay's size. Shape (height, width, 3).
            time: Time of the frame; the film that is written begins at the first one [s].
            real: Real markers in the film, NaN where unknown [px]. Shape (M, 2).
            simulated: Simulated markers in the film [px]. Shape (M, 2).

        Raises:
            VideoError: The time doesn't follow the last one, or the file can't be written.
        """
        canvas = Canvas(to_pillow(image))
        for place in self._places(real):
            if self._within(place):
                canvas.ring(place, 1.9 * self._radius, _REAL, 2.0, 1.0)
        places = self._places(simulated)
        for line in self._lines:
            canvas.polyline([places[m] for m in line], _SIMULATED, 2.2, 1.0, 0.9)
        for place in places:
            if self._within(place):
                canvas.dot(place, self._radius, _SIMULATED, 1.0)
        size = 15.0 if self.width >= 640 else 11.0
        canvas.text((0.8 * size, 0.8 * size), "simulated", _SIMULATED, size, plate=DARK)
        canvas.text((7.5 * size, 0.8 * size), "tracked", _REAL, size, plate=DARK)
        self._begin = time if self._begin is None else self._begin
        self._writer.write(canvas.pixels(), time - self._begin)

    def _places(self, positions: Array) -> list[Place]:
        scaled = (positions + 0.5) * self._share - 0.5
        return [(float(x), float(y)) for x, y in scaled]

    def _within(self, place: Place) -> bool:
        return -50 < place[0] < self.width + 50 and -50 < place[1] < self.height + 50
