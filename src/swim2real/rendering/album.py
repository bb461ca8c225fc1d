"""The trials of a comparison as pictures and films: a frame, a sheet and a clip of each, and a sheet of all."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL.Image import Image

from swim2real.errors import ArgumentError
from swim2real.objective import Comparison
from swim2real.rendering.drawing import INK, PAGE, Bytes, Canvas, contact_sheet, plain, text_size, to_pillow
from swim2real.rendering.panel import MUTED, Panel, draw_heading, gap_of, shortened, text_height
from swim2real.rendering.swing_chart import swing_chart
from swim2real.rendering.trial_frame import ErrorChart, TrialFrames, path_strip, plane_panel
from swim2real.rendering.trial_view import (
    Limits,
    TrialView,
    common_limits,
    grid_step,
    length_text,
    millimeters,
    view_of,
)
from swim2real.robots.robot import Robot

LEAST_TILE = 160  # px, width of a picture of a sheet
TEXT = 13.0  # px, of the heads of rows and columns
STAMP = 11.0  # px, of the times in pictures
ROW_HEAD = 120  # px, that a trial's name takes at most
_GAP = 8  # px


class Album:
    """All trials of a comparison, drawn in one scale.

    Attributes:
        scenes: The trials by frequency, or in the order of the reference where they have none.
    """

    def __init__(self, comparison: Comparison, robot: Robot) -> None:
        """Prepares the trials of a robot."""
        trials = sorted(comparison.trials, key=lambda trial: trial.frequency or 0.0)
        self._views = [view_of(trial, robot) for trial in trials]
        self._limits = common_limits(self._views)
        self.scenes = [Scene(view, trial.loss, self._limits) for view, trial in zip(self._views, trials, strict=True)]

    def overview(self, moments: int, width: int) -> Bytes:
        """Every trial in several moments: a row is a trial. See `trials_sheet`."""
        return trials_sheet(self._views, moments, width, self._limits)


class Scene:
    """A trial, ready to be drawn.

    Attributes:
        name: Name of the trial.
        title: The name, and the frequency of a beat.
        loss: What the trial adds to the loss [m].
        pace: Rate of the fastest motion, which a film must not miss [Hz].
        start: Start of what is compared, since the first frame of the real film [s].
        duration: Duration of what is compared [s].
        clip_note: What is where in a film of the trial.
        film_note: Which moments of the real film are shown.
    """

    def __init__(self, view: TrialView, loss: float, limits: Limits) -> None:
        """Prepares one trial; limits are those of all trials."""
        self._view, self._limits, self.loss = view, limits, loss
        self.name, self.title = view.name, ", ".join(part for part in (view.name, view.about) if part)
        self.pace, self.duration = view.pace, view.duration
        self.start = 0.0 if view.frequency is not None else max(float(view.times[0]), 0.0)
        path = ", then both from the same start" if view.path_real is not None else ""
        self.clip_note = f"{view.axes}{path}; below the markers' mean distance over time"
        self.film_note = "the same moments" if view.frequency is None else "moments of one beat"

    def write_clip(self, path: str | Path, fps: float, width: int) -> None:
        """Writes a film of the simulated trial over the real one.

        Raises:
            ArgumentError: A number is not allowed.
            VideoError: The file can't be written.
        """
        TrialFrames(self._view, self._limits, width).write_clip(path, fps)

    def frame(self, index: int, width: int) -> Bytes:
        """One sample, RGB. See `TrialFrames.draw`."""
        return TrialFrames(self._view, self._limits, width).draw(index)

    def sheet(self, moments: int, columns: int, width: int) -> Bytes:
        """Several moments in one picture. See `moments_sheet`."""
        return moments_sheet(self._view, moments, columns, width, self._limits)

    def sheet_note(self, moments: int) -> str:
        """What is where in that picture."""
        shown = "from start to end" if self._view.frequency is None else "of one beat"
        path = " both paths and" if self._view.path_real is not None else ""
        factor, _ = self._view.enlarged(self._limits.plane.right - self._limits.plane.left)
        enlarged = f", and the same with differences {factor} times as large as they are" if factor > 1 else ""
        count, swings = (
            (moments + 1) // 2 if factor > 1 else moments,
            ", and how the head swings" * bool(self._view.swings),
        )
        return (
            f"{count} moments {shown} with the markers' mean distance{enlarged}, then{path} that distance over time"
            f"{swings}"
        )

    def film_times(self, moments: int) -> list[float]:
        """Times of as many moments of the real film [s]."""
        view = self._view
        if view.frequency is None:
            return view.times[view.nearest(view.moments(moments)[0])].clip(min=0.0).tolist()
        period = 1 / view.frequency
        return (np.arange(moments) / moments * period + max(self.duration - period, 0) / 2).tolist()


def moments_sheet(
    view: TrialView, count: int, columns: int, width: int, limits: Limits | None = None
) -> Bytes:  # fmt: skip
    """A trial in several moments, of a beat or from start to end; below them both paths and the error over time.

    Where simulated and real places hardly differ, half of the pictures are the others once more with their differences
    enlarged. Where the head's swings are compared, they stand below the error.

    Args:
        view: The trial.
        count: Number of moments.
        columns: Pictures in a row.
        width: Width of each picture [px].
        limits: What is shown; None for what this view needs.

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: A number is too small.
    """
    _check_tile(width)
    limits = limits or common_limits([view])
    times, shares = view.moments(count)
    panel, samples = Panel(limits.plane, width, grid_step(limits.plane)), view.nearest(times).tolist()
    factor, enlarged = view.enlarged(limits.plane.right - limits.plane.left)
    if factor > 1:  # every second moment, as it is and then enlarged
        shares, samples = shares[::2], samples[::2]
    images = [np.asarray(plane_panel(view, k, panel, TEXT)) for k in samples]
    beats = [f"beat {_fraction(share, count)}   " if view.frequency is not None else "" for share in shares.tolist()]
    captions = [
        f"{beat}{view.times[k]:.3f} s   {millimeters(float(view.errors[k]))}"
        for beat, k in zip(beats, samples, strict=True)
    ]
    if factor > 1:
        images += [np.asarray(plane_panel(enlarged, k, panel, TEXT)) for k in samples]
        captions += [f"{beat}{factor} times the difference" for beat in beats]
    sheet = to_pillow(contact_sheet(images, captions, columns, width))
    heading = draw_heading(
        "   ".join(part for part in (view.name, view.about) if part), _note(view, panel), sheet.width
    )
    return _stacked([heading, sheet, _foot(view, samples, limits, sheet.width)])


def trials_sheet(views: Sequence[TrialView], count: int, width: int, limits: Limits | None = None) -> Bytes:
    """Every trial in several moments: a row is a trial, a column a share of a beat or of the trial's time.

    All beats begin where the last real marker is farthest to the left of the swimmer (up in the picture).

    Args:
        views: The trials, in the order of the rows.
        count: Number of moments of each trial.
        width: Width of each picture [px].
        limits: What is shown; None for what these views need together.

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No views, or a number is too small.
    """
    _check_tile(width)
    limits = limits or common_limits(views)
    panel, beats = Panel(limits.plane, width, grid_step(limits.plane)), views[0].frequency is not None
    names = [shortened(view.name, TEXT, ROW_HEAD) for view in views]
    notes = [view.about or millimeters(view.error) for view in views]
    heads = [str(Fraction(k, count)) if beats else f"{100 * k / (count - 1):.0f} %" for k in range(count)]
    left, top = 2 * _GAP + max(text_size(text, TEXT)[0] for text in [*names, *notes]), round(2 * TEXT)
    image = plain(left + count * (width + _GAP), top + len(views) * (panel.height + _GAP), PAGE)
    canvas = Canvas(image)
    canvas.text((_GAP, top / 2), "beat" if beats else "time", MUTED, TEXT, (0, 0.5))
    for column, head in enumerate(heads):
        canvas.text((left + column * (width + _GAP) + width / 2, top / 2), head, MUTED, TEXT, (0.5, 0.5))
    for row, view in enumerate(views):
        y = top + row * (panel.height + _GAP)
        canvas.text((_GAP, y + panel.height / 2), names[row], INK, TEXT, (0, 1))
        canvas.text((_GAP, y + panel.height / 2), notes[row], INK, TEXT, (0, 0))
        for column, sample in enumerate(view.nearest(view.moments(count)[0]).tolist()):
            picture = plane_panel(view, sample, panel, TEXT)
            Canvas(picture).text((5, 3), f"{view.times[sample]:.3f} s", MUTED, STAMP)
            canvas.paste(picture, (left + column * (width + _GAP), y))
    title = "One beat of each trial" if beats else "Each trial from start to end"
    return _stacked([draw_heading(title, _note(views[0], panel), image.width), image])


def _foot(view: TrialView, samples: Sequence[int], limits: Limits, width: int) -> Image:
    """The error and the head's swings over time, at the right of both paths if there are any."""
    path = path_strip(view, view.last_seen, limits, width // 2)
    left = 0 if path is None else path.width
    size, gap = text_height(width), gap_of(width)
    room = width - left - 2 * gap
    charts = [ErrorChart(view, limits.error, room, 0.9 * size).at(*samples)]
    charts += [
        swing_chart(swing, view.times, top, room, 0.9 * size)
        for swing, top in zip(view.swings, limits.swings, strict=True)
    ]
    tall = sum(chart.height + gap for chart in charts)
    foot = plain(width, gap + max(tall, 0 if path is None else path.height), PAGE)
    canvas, y = Canvas(foot), 0
    if path is not None:
        canvas.paste(path, (0, 0))
    for chart in charts:
        canvas.paste(chart, (left + gap, y))
        y += chart.height + gap
    return foot


def _stacked(images: Sequence[Image]) -> Bytes:
    """Pictures of the same width below one another."""
    canvas, y = Canvas(plain(images[0].width, sum(image.height for image in images), PAGE)), 0
    for image in images:
        canvas.paste(image, (0, y))
        y += image.height
    return canvas.pixels()


def _note(view: TrialView, panel: Panel) -> str:
    return f"{view.axes}   grid {length_text(panel.step)}"


def _fraction(share: float, count: int) -> str:
    """A share of the beat as a fraction where it is one."""
    fraction = Fraction(share).limit_denominator(count)
    return str(fraction) if abs(fraction - share) < 1e-9 else f"{share:.2f}"


def _check_tile(width: int) -> None:
    """Refuses widths of pictures in which nothing can be seen."""
    if width < LEAST_TILE:
        raise ArgumentError(f"width is {width} px; a picture of a sheet must be at least {LEAST_TILE} px wide")
