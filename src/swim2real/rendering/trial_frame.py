"""One moment of a trial, simulated over real: the frame of comparison, both paths and the error, as far as it has them.

From top to bottom: name and time; both bodies in the frame of comparison, with what they did just before; both as seen
from the same start, where the robot goes somewhere; the markers' mean distance over time.

Red and blue are a pair that people with any color blindness tell apart. In gray the shapes do: real markers are rings
on a thin line, simulated ones dots on a thick line. Rings are larger, so a dot that is right sits in its ring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from PIL.Image import Image

from markertrack.drawing import INK, PAGE, Bytes, Canvas, Color, Place, plain, text_size
from markertrack.video import VideoWriter
from swim2real.rendering.film import CRF, clip_times
from swim2real.rendering.trial_view import Box, Limits, Swing, TrialView, grid_step, leads, length_text, millimeters
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

Side = Literal["real", "simulated"]

COLORS: dict[Side, Color] = {"real": (213, 43, 30), "simulated": (0, 84, 190)}
SIDES: tuple[Side, Side] = ("real", "simulated")
GROUND: Color = (255, 255, 255)
MUTED: Color = (92, 104, 120)
DIVERGED = "simulation diverged"
_GRID: Color = (221, 226, 232)
_LINE: Color = (150, 159, 170)
_LEAST_WIDTH = 320  # px
_RADII: dict[Side, float] = {"real": 6.2, "simulated": 3.7}  # px, at the strength 1
_WIDTHS: dict[Side, float] = {"real": 1.9, "simulated": 2.8}  # px, at the strength 1
_MOST_PATH = 0.4  # height of the panel of the paths, as a share of the picture's width
_CHART, _SWING = 5.5, 4.0  # height of a chart, in sizes of its text
_DOT = 3.5  # px
_FAR = 1.4  # of a ring's radius, from a marker to its name


@dataclass(frozen=True)
class Panel:
    """A box of the plane as a picture: x to the right and y up, in the same scale.

    Attributes:
        box: What is shown.
        width: Width of the picture [px].
    """

    box: Box
    width: int

    @property
    def step(self) -> float:
        """Step of the grid [m]."""
        return grid_step(self.box)

    @property
    def scale(self) -> float:
        """Pixels to a meter."""
        return self.width / (self.box.right - self.box.left)

    @property
    def height(self) -> int:
        """Height of the picture [px]."""
        return max(1, round((self.box.top - self.box.bottom) * self.scale))

    @property
    def strength(self) -> float:
        """By which lines and markers of bodies are wider than usual."""
        return float(np.clip(self.width / 600, 0.5, 2.0))

    def places(self, points: Array) -> Array:
        """Maps points of the plane into the picture [px]. Shape (..., 2)."""
        return np.stack([points[..., 0] - self.box.left, self.box.top - points[..., 1]], axis=-1) * self.scale - 0.5

    def empty(self) -> Image:
        """The picture with nothing but a grid."""
        image = plain(self.width, self.height, GROUND)
        canvas = Canvas(image)
        for x in self._steps(self.box.left, self.box.right):
            column = round((x - self.box.left) * self.scale - 0.5)
            canvas.fill((column, 0, column + 1, self.height), _GRID)
        for y in self._steps(self.box.bottom, self.box.top):
            row = round((self.box.top - y) * self.scale - 0.5)
            canvas.fill((0, row, self.width, row + 1), _GRID)
        return image

    def _steps(self, low: float, high: float) -> list[float]:
        """Multiples of the grid's step within limits [m]."""
        step = self.step
        return [k * step for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


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
        if width < _LEAST_WIDTH or width % 2:
            raise ArgumentError(f"width is {width} px; it must be even and at least {_LEAST_WIDTH}")
        self._view, self._limits, self._width = view, limits, width
        self._size, self._gap = text_height(width), gap_of(width)
        self._panel = Panel(limits.plane, width - 2 * self._gap)
        self._chart = ErrorChart(view, limits.error, width - 2 * self._gap, self._size)

    def draw(self, index: int) -> Bytes:
        """One sample: RGB, of even sizes. Shape (H, width, 3).

        Raises:
            ArgumentError: There is no such sample.
        """
        view, gap, size = self._view, self._gap, self._size
        if not 0 <= index < view.times.size:
            raise ArgumentError(f"index is {index}; view '{view.name}' has samples 0 to {view.times.size - 1}")
        path = path_strip(view, index, self._limits, self._width)
        parts = [(gap, self._plane(index)), *([(0, path)] if path is not None else []), (gap, self._chart.at(index))]
        head = round(2 * size)
        height = head + sum(part.height for _, part in parts) + gap
        canvas, y = Canvas(plain(self._width, height + height % 2, PAGE)), head
        moment, about = f"{view.times[index]:.3f} s   frame {index}", f"   {view.about}" if view.about else ""
        canvas.text((self._width - gap, head / 2), moment, INK, size, (1, 0.5))
        room = self._width - 3 * gap - text_size(moment, size)[0] - text_size(about, size)[0]
        canvas.text((gap, head / 2), shortened(view.name, size, room) + about, INK, size, (0, 0.5))
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
        """Both bodies with legends, the axes, and a bar as long as a step of the grid."""
        panel, size = self._panel, self._size
        image = plane_panel(self._view, index, panel, size)
        canvas, x = Canvas(image), 0.6 * size
        for side in SIDES:
            x = _draw_legend(canvas, (x, size), side, size) + size
        canvas.text((panel.width - 0.6 * size, size), self._view.axes, MUTED, 0.8 * size, (1, 0.5))
        left, bottom, length = round(0.6 * size), panel.height - round(0.7 * size), round(panel.step * panel.scale)
        canvas.fill((left, bottom - 1, left + length + 1, bottom + 1), INK)
        for end in (left, left + length):
            canvas.fill((end, bottom - 5, end + 1, bottom + 5), INK)
        canvas.text((left + length + 0.5 * size, bottom), length_text(panel.step), INK, size, (0, 0.5))
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
            trail = _points(places[side][samples, marker])
            canvas.polyline(trail, COLORS[side], 1.2 * _WIDTHS[side] * strength, opacity=0.45, fade=True)
    for side in SIDES:
        _draw_body(canvas, places[side][index], side, strength, view.lines)
    if size:
        _name_markers(canvas, view, [places[side][index] for side in SIDES], panel, max(0.8 * size, 11.0))
        _name_lost(canvas, view, index, size)
    if view.diverged:
        wanted = max(size, 12.0)
        fitting = min(wanted, 0.9 * wanted * canvas.width / text_size(DIVERGED, wanted)[0])
        place = (canvas.width / 2, panel.height - 2.3 * size)
        canvas.text(place, DIVERGED, GROUND, fitting, (0.5, 0.5), COLORS["simulated"])
    return image


def path_panel(view: TrialView, index: int, panel: Panel) -> Image:
    """Both as seen from the same start, with the path of the front so far.

    Args:
        view: A trial that has paths.
        index: Index of the sample.
        panel: Where it is drawn.
    """
    image = panel.empty()
    canvas, strength = Canvas(image), float(np.clip(panel.width / 800, 0.5, 1.2))
    start = round(panel.places(np.zeros(2))[0])
    canvas.fill((start, 0, start + 1, panel.height), _LINE)
    paths: dict[Side, Array | None] = {"real": view.path_real, "simulated": view.path_simulated}
    for side, path in paths.items():
        if path is not None:
            canvas.polyline(_points(panel.places(leads(path[: index + 1]))), COLORS[side], 2.0, opacity=0.55)
    for side, path in paths.items():
        if path is not None:
            _draw_body(canvas, panel.places(path[index]), side, strength, view.lines)
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
    panel = Panel(box, min(width - 2 * gap, round(_MOST_PATH * width / tall)))
    head, left = round(1.8 * size), (width - panel.width) // 2
    image = plain(width, head + panel.height, PAGE)
    canvas = Canvas(image)
    canvas.text((left, head / 2), "both from the same start", INK, 0.9 * size, (0, 0.5))
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
        small, height = 0.8 * size, round(_CHART * size)
        self._image = plain(width, height, PAGE)
        canvas = Canvas(self._image)
        head, foot = round(1.4 * size), round(1.3 * small)
        canvas.fill((0, head, width, height - foot), GROUND)
        canvas.fill((0, height - foot - 1, width, height - foot), _GRID)
        canvas.fill((0, head, width, head + 1), _GRID)
        shares = (view.times - view.times[0]) / view.duration
        level = head + (height - foot - 1 - head) * (1 - np.minimum(view.errors / top, 1.0))
        self._places = np.stack([shares * (width - 1), level], axis=1)
        self._range, self._size = (head, height - foot), size
        canvas.polyline(_points(self._places), INK, 1.6)
        scale = f"mean {millimeters(view.error)}   full height {length_text(top)}"
        for x, text in enumerate((f"{view.times[0]:.2f} s", scale, f"{view.times[-1]:.2f} s")):
            canvas.text((x * width / 2, height - foot / 2), text, MUTED, small, (x / 2, 0.5))
        self._errors = view.errors.tolist()

    def at(self, *moments: int) -> Image:
        """The chart with lines at moments (indices of samples); the distance at a single one is written."""
        image = self._image.copy()
        canvas, (top, bottom) = Canvas(image), self._range
        for moment in moments:
            column = round(self._places[moment, 0])
            canvas.fill((column, top, column + 1, bottom), _LINE)
            if np.isfinite(self._places[moment]).all():
                x, y = self._places[moment].tolist()
                canvas.dot((x, y), _DOT, INK)
        single = f": {millimeters(self._errors[moments[0]])}" if len(moments) == 1 else ""
        title = f"distance of the markers, simulated to real{single}"
        canvas.text((0, top / 2), title, INK, 0.9 * self._size, (0, 0.5))
        return image


def swing_chart(swing: Swing, times: Array, top: float, width: int, size: float) -> Image:
    """Chart of the head's swing over time, real and simulated, left or counterclockwise up.

    Args:
        swing: What swings.
        times: Rising [s]. Shape (T,).
        top: Value at the upper edge; its negative is at the lower one.
        width: Width of the picture [px].
        size: Size of the text [px].
    """
    head, height = round(1.4 * size), round(_SWING * size)
    image = plain(width, height, PAGE)
    canvas = Canvas(image)
    canvas.fill((0, head, width, height), GROUND)
    middle = (head + height) / 2
    canvas.fill((0, round(middle), width, round(middle) + 1), _GRID)
    x = (times - times[0]) / (times[-1] - times[0]) * (width - 1)
    for side in SIDES:
        level = np.clip(getattr(swing, side) / top, -1.0, 1.0)
        canvas.polyline(_points(np.stack([x, middle - level * (height - head) / 2], axis=1)), COLORS[side], 1.6)
    canvas.text((0, head / 2), swing.name, INK, 0.9 * size, (0, 0.5))
    canvas.text((width, head / 2), f"edges ±{top:g} {swing.unit}", MUTED, 0.8 * size, (1, 0.5))
    return image


def draw_heading(text: str, note: str, width: int) -> Image:
    """The heading of a sheet: a text, the legend, and a note at the right on what the axes and the grid are."""
    size, gap = text_height(width), gap_of(width)
    image = plain(width, round(2 * size), PAGE)
    canvas, y = Canvas(image), round(2 * size) / 2
    x = width - gap - text_size(note, size)[0]
    canvas.text((x, y), note, MUTED, size, (0, 0.5))
    for side in SIDES[::-1]:
        x -= 3.5 * size + text_size(side, size)[0]
        _draw_legend(canvas, (x, y), side, size)
    canvas.text((gap, y), shortened(text, size, x - 2 * gap), INK, size, (0, 0.5))
    return image


def shortened(text: str, size: float, room: float) -> str:
    """A text whose end is cut off if there is no room for it [px]."""
    cut = text
    while len(cut) > 4 and text_size(cut, size)[0] > room:
        cut = cut.removesuffix("...")[:-1] + "..."
    return cut


def text_height(width: int) -> float:
    """Size of the text in a picture [px]."""
    return float(np.clip(round(width / 36), 11, 22))


def gap_of(width: int) -> int:
    """To the edges of a picture [px]."""
    return round(width / 80)


def _points(places: Array) -> list[Place]:
    """Places as a canvas takes them. Shape (N, 2)."""
    return [(x, y) for x, y in places.tolist()]


def _draw_body(canvas: Canvas, places: Array, side: Side, strength: float, lines: Sequence[Sequence[int]]) -> None:
    """A skeleton: markers without a position are left out, and the lines to them. Places have shape (M, 2) [px]."""
    color, radius, width = COLORS[side], _RADII[side] * strength, _WIDTHS[side] * strength
    for line in lines:
        canvas.polyline(_points(places[list(line)]), color, max(width, 1.0), opacity=0.8)
    for place in _points(places[np.isfinite(places).all(axis=1)]):
        if side == "real":
            canvas.ring(place, radius, color, max(2.0 * strength, 1.0))
        else:
            canvas.dot(place, radius, color)


def _draw_legend(canvas: Canvas, place: Place, side: Side, size: float) -> float:
    """A short piece of body and what it is; the x at which it ends [px]."""
    x, y = place
    ends = np.array([[x, y], [x + 1.1 * size, y], [x + 2.2 * size, y]])
    ends[[0, 2], :] += [[0.35 * size, 0], [-0.35 * size, 0]]
    _draw_body(canvas, ends, side, float(np.clip(size / 20, 0.6, 1.0)), [range(len(ends))])
    canvas.text((x + 2.5 * size, y), side, COLORS[side], size, (0, 0.5))
    return x + 2.5 * size + text_size(side, size)[0]


def _name_lost(canvas: Canvas, view: TrialView, index: int, size: float) -> None:
    """Says at the bottom right which real markers are lost, or how many of them where there is no room."""
    lost = [name for name, there in zip(view.marker_names, view.seen[index], strict=True) if not there]
    if not lost:
        return
    text = f"real lost: {', '.join(lost)}"
    if len(lost) == len(view.marker_names) or text_size(text, size)[0] > 0.8 * canvas.width:
        text = f"real lost: {len(lost)} of {len(view.marker_names)}"
    canvas.text((canvas.width - 0.5 * size, canvas.height - 0.4 * size), text, COLORS["real"], size, (1, 1))


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
        reach = max(float((place - middle) @ out) for place in here) + _FAR * _RADII["real"] * panel.strength
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
