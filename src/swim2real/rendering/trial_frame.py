"""One moment of a trial, simulated over real: the frame of comparison, both paths and the error, as far as it has them.

From top to bottom: name and time; both bodies in the frame of comparison, with what they did just before; both as seen
from the same start, where the robot goes somewhere; the markers' mean distance over time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Bytes, Canvas, plain, text_size
from swim2real.rendering.film import CRF, clip_times
from swim2real.rendering.panel import (
    COLORS,
    GRID,
    GROUND,
    LINES,
    MUTED,
    RADII,
    SIDES,
    START,
    Panel,
    Side,
    check_width,
    draw_body,
    draw_legends,
    draw_moment,
    draw_scale_bar,
    gap_of,
    name_lost,
    points,
    say_diverged,
    text_height,
)
from swim2real.rendering.trial_view import Limits, TrialView, grid_step, leads, length_text, millimeters
from swim2real.video import VideoWriter

Array = NDArray[np.float64]

FROM_THE_START = "both from the same start"
MOST_PATH = 0.4  # height of the panel of the paths, as a share of the picture's width
CHART = 5.5  # height of the chart of errors, in sizes of its text
_DOT = 3.5  # px
_FAR = 1.4  # of a ring's radius, from a marker to its name


class TrialFrames:
    """Draws the samples of a trial: the simulation in blue over the real robot in red."""

    def __init__(self, view: TrialView, limits: Limits, width: int) -> None:
        """Draws what is the same in all of them.

        Args:
            view: The trial.
            limits: What is shown; `common_limits` of all trials makes them comparable.
            width: Width of the pictures, even [px].

        Raises:
            ArgumentError: The width is odd or too small.
        """
        check_width(width)
        self._view, self._limits, self._width = view, limits, width
        self._size, self._gap = text_height(width), gap_of(width)
        self._panel = Panel(limits.plane, width - 2 * self._gap, grid_step(limits.plane))
        self._chart = ErrorChart(view, limits.error, width - 2 * self._gap, self._size)

    def draw(self, index: int) -> Bytes:
        """One sample: RGB, of even sizes. Shape (H, width, 3).

        Raises:
            ArgumentError: There is no such sample.
        """
        view, gap = self._view, self._gap
        if not 0 <= index < view.times.size:
            raise ArgumentError(f"index is {index}; view '{view.name}' has samples 0 to {view.times.size - 1}")
        path = path_strip(view, index, self._limits, self._width)
        parts = [(gap, self._plane(index)), *([(0, path)] if path is not None else []), (gap, self._chart.at(index))]
        head = round(2 * self._size)
        height = head + sum(part.height for _, part in parts) + gap
        canvas, y = Canvas(plain(self._width, height + height % 2, PAGE)), head
        about = f"   {view.about}" if view.about else ""
        draw_moment(canvas, view.name, about, view.times[index], index, self._size)
        for left, part in parts:
            canvas.paste(part, (left, y))
            y += part.height
        return canvas.pixels()

    def write_clip(self, path: str | Path, fps: float) -> None:
        """Writes a film of the trial in true speed.

        Args:
            path: Path of the film, such as `.mp4`.
            fps: Frames a second; each shows the sample nearest to its time.

        Raises:
            ArgumentError: The fps is not allowed.
            VideoError: The file can't be written.
        """
        times = clip_times(self._view.duration, fps)
        samples = self._view.nearest(self._view.times[0] + times).tolist()
        image = self.draw(samples[0])
        with VideoWriter(path, image.shape[1], image.shape[0], fps, crf=CRF) as writer:
            for k, (time, sample) in enumerate(zip(times.tolist(), samples, strict=True)):
                writer.write(image if k == 0 else self.draw(sample), time)

    def _plane(self, index: int) -> Image:
        image, size = plane_panel(self._view, index, self._panel, self._size), self._size
        canvas = Canvas(image)
        draw_legends(canvas, size)
        canvas.text((self._panel.width - 0.6 * size, size), self._view.axes, MUTED, 0.8 * size, (1, 0.5))
        draw_scale_bar(canvas, self._panel, length_text(self._panel.step), size)
        return image


def plane_panel(view: TrialView, index: int, panel: Panel, size: float = 0.0) -> Image:
    """Both bodies over one another in the frame of comparison, with the path of some markers just before.

    Args:
        view: The trial.
        index: Index of the sample.
        panel: Where it is drawn.
        size: Size of the text [px]; 0 for none but what is needed.
    """
    samples, markers = view.trail(index)
    places: dict[Side, Array] = {"real": panel.places(view.real), "simulated": panel.places(view.simulated)}
    image = panel.empty()
    canvas, strength = Canvas(image), panel.strength
    for side in SIDES:
        for marker in markers:
            trail = points(places[side][samples, marker])
            canvas.polyline(trail, COLORS[side], 1.2 * LINES[side] * strength, opacity=0.45, fade=True)
    for side in SIDES:
        draw_body(canvas, places[side][index], side, strength, view.lines)
    if size:
        _name_markers(canvas, view, [places[side][index] for side in SIDES], panel, max(0.8 * size, 11.0))
        lost = [name for name, there in zip(view.marker_names, view.seen[index], strict=True) if not there]
        name_lost(canvas, lost, len(view.marker_names), size)
    if view.diverged:
        say_diverged(canvas, panel.height - 2.3 * size, max(size, 12.0))
    return image


def path_panel(view: TrialView, index: int, panel: Panel) -> Image:
    """Both as seen from the same start, with the path of the front so far.

    Args:
        view: A trial that has paths.
        index: Index of the sample.
        panel: Where it is drawn.
    """
    paths: Mapping[Side, Array | None] = {"real": view.path_real, "simulated": view.path_simulated}
    image = panel.empty()
    canvas, strength = Canvas(image), float(np.clip(panel.width / 800, 0.5, 1.2))
    start = round(panel.places(np.zeros(2))[0])
    canvas.fill((start, 0, start + 1, panel.height), START)
    for side, path in paths.items():
        if path is not None:
            canvas.polyline(points(panel.places(leads(path[: index + 1]))), COLORS[side], 2.0, opacity=0.55)
    for side, path in paths.items():
        if path is not None:
            draw_body(canvas, panel.places(path[index]), side, strength, view.lines)
    return image


def path_strip(view: TrialView, index: int, limits: Limits, width: int) -> Image | None:
    """The panel of the paths with a line of text above it; None for a trial without paths.

    Args:
        view: The trial.
        index: Index of the sample.
        limits: What is shown.
        width: Width of the picture [px].
    """
    if limits.path is None or view.path_real is None:
        return None
    size, gap, box = text_height(width), gap_of(width), limits.path
    tall = (box.top - box.bottom) / (box.right - box.left)
    panel = Panel(box, min(width - 2 * gap, round(MOST_PATH * width / tall)), grid_step(box))
    head, left = round(1.8 * size), (width - panel.width) // 2
    image = plain(width, head + panel.height, PAGE)
    canvas = Canvas(image)
    canvas.text((left, head / 2), FROM_THE_START, INK, 0.9 * size, (0, 0.5))
    canvas.text((left + panel.width, head / 2), f"grid {length_text(panel.step)}", MUTED, 0.8 * size, (1, 0.5))
    canvas.paste(path_panel(view, index, panel), (left, head))
    return image


class ErrorChart:
    """The mean distance of a trial's markers over time; what doesn't change from moment to moment is drawn once."""

    def __init__(self, view: TrialView, top: float, width: int, size: float) -> None:
        """Draws the curve.

        Args:
            view: The trial.
            top: Distance at the upper edge [m].
            width: Width of the picture [px].
            size: Size of the text [px].
        """
        small, height = 0.8 * size, round(CHART * size)
        self._image = plain(width, height, PAGE)
        canvas = Canvas(self._image)
        head, foot = round(1.4 * size), round(1.3 * small)
        canvas.fill((0, head, width, height - foot), GROUND)
        canvas.fill((0, height - foot - 1, width, height - foot), GRID)
        canvas.fill((0, head, width, head + 1), GRID)
        shares = (view.times - view.times[0]) / view.duration
        level = head + (height - foot - 1 - head) * (1 - np.minimum(view.errors / top, 1.0))
        self._places = np.stack([shares * (width - 1), level], axis=1)
        self._range, self._size = (head, height - foot), size
        canvas.polyline(points(self._places), INK, 1.6)
        canvas.text((0, height - foot / 2), f"{view.times[0]:.2f} s", MUTED, small, (0, 0.5))
        canvas.text((width, height - foot / 2), f"{view.times[-1]:.2f} s", MUTED, small, (1, 0.5))
        scale = f"mean {millimeters(view.error)}   full height {length_text(top)}"
        canvas.text((width / 2, height - foot / 2), scale, MUTED, small, (0.5, 0.5))
        self._errors = view.errors.tolist()

    def at(self, *moments: int, text: str = "distance of the markers, simulated to real") -> Image:
        """The chart with lines at moments; the distance at a single one is written.

        Args:
            moments: Indices of samples.
            text: What stands above the chart.
        """
        image = self._image.copy()
        canvas, (top, bottom) = Canvas(image), self._range
        for moment in moments:
            column = round(self._places[moment, 0])
            canvas.fill((column, top, column + 1, bottom), START)
            if np.isfinite(self._places[moment]).all():
                x, y = self._places[moment].tolist()
                canvas.dot((x, y), _DOT, INK)
        if len(moments) == 1:
            text += f": {millimeters(self._errors[moments[0]])}"
        canvas.text((0, top / 2), text, INK, 0.9 * self._size, (0, 0.5))
        return image


def _name_markers(canvas: Canvas, view: TrialView, bodies: Sequence[Array], panel: Panel, size: float) -> None:
    """Names beside the markers, outside of both bodies; only of the ends where there is no room."""
    count, widest = len(view.marker_names), max(text_size(name, size)[0] for name in view.marker_names)
    crowded = view.spacing() * panel.scale < widest + 0.3 * size
    known = [body[np.isfinite(body).all(axis=1)].mean(axis=0) for body in bodies if np.isfinite(body).any()]
    taken: list[tuple[float, float, float, float]] = []
    for m in dict.fromkeys((0, count - 1) if crowded else (0, count - 1, *range(count))):
        name, here = view.marker_names[m], [body[m] for body in bodies if np.isfinite(body[m]).all()]
        if not here:
            continue
        middle, out = np.mean(here, axis=0), _outward(view, m, bodies, np.mean(known, axis=0))
        width, height = text_size(name, size)[0], 0.9 * size
        reach = max(float((place - middle) @ out) for place in here) + _FAR * RADII["real"] * panel.strength
        x, y = (middle + (reach + float(np.abs(out) @ (width, height)) / 2) * out).tolist()
        x = min(max(x, width / 2 + 2), canvas.width - width / 2 - 2)
        y = min(max(y, height / 2 + 2), canvas.height - height / 2 - 2)
        box = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        if not any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
            taken.append(box)
            canvas.text((x, y), name, MUTED, size, (0.5, 0.5))


def _outward(view: TrialView, marker: int, bodies: Sequence[Array], center: Array) -> Array:
    """A direction that leads away from the lines at a marker: beyond an end, else to one side. Shape (2,).

    Along a line the sides take turns, so that names have room and stay where they are from frame to frame.
    """
    near: list[int] = []
    for line in view.lines:
        for k in (k for k, m in enumerate(line) if m == marker):
            near += line[max(k - 1, 0) : k] + line[k + 1 : k + 2]
    here = [body[marker] for body in bodies if np.isfinite(body[marker]).all()]
    spans = [body[[near[0], near[-1]]] for body in bodies if near and np.isfinite(body[[near[0], near[-1]]]).all()]
    if not spans:
        out = np.mean(here, axis=0) - center
    elif len(near) == 1:
        out = np.mean(here, axis=0) - np.mean([span[0] for span in spans], axis=0)
    else:
        along = np.mean([span[1] - span[0] for span in spans], axis=0)
        out = np.array([along[1], -along[0]]) * (-1 if marker % 2 else 1)
    length = float(np.hypot(*out))
    return out / length if length > 1e-9 else np.array([0.0, -1.0])
