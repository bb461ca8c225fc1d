"""The trials of a comparison as pictures and films: a sheet and a clip of each, and a sheet of all."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL.Image import Image

from markertrack.drawing import INK, PAGE, Bytes, Canvas, contact_sheet, plain, text_size, to_pillow
from swim2real.objective import Comparison
from swim2real.rendering import trial_frame
from swim2real.rendering.trial_view import Limits, TrialView, common_limits, length_text, millimeters, view_of
from swim2real.robots.robot import Robot
from swimbase.errors import ArgumentError

LEAST_TILE = 160  # px, width of a picture of a sheet
TEXT = 13.0  # px, of the heads of rows and columns
ROW_HEAD = 120  # px, that a trial's name takes at most
_STAMP = 11.0  # px, of the times in pictures
_GAP = 8  # px


class Album:
    """All trials of a comparison, drawn in one scale.

    Attributes:
        trials: By frequency, or in the order of the reference where they have none.
    """

    def __init__(self, comparison: Comparison, robot: Robot) -> None:
        """Prepares the trials of a robot."""
        trials = sorted(comparison.trials, key=lambda trial: trial.frequency or 0.0)
        self._views = [view_of(trial, robot) for trial in trials]
        limits = common_limits(self._views)
        self.trials = [TrialPictures(v, trial.loss, limits) for v, trial in zip(self._views, trials, strict=True)]

    def overview(self, moments: int, width: int) -> Bytes:
        """Every trial in several moments: a row is a trial. See `trials_sheet`."""
        return trials_sheet(self._views, moments, width)


class TrialPictures:
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
        trial_frame.TrialFrames(self._view, self._limits, width).write_clip(path, fps)

    def sheet(self, count: int, columns: int, width: int) -> Bytes:
        """Several moments, of a beat or from start to end; below them both paths and the error over time.

        Where simulated and real places hardly differ, half of the pictures are the others once more with their
        differences enlarged. Where the head's swings are compared, they stand below the error.

        Args:
            count: Number of moments.
            columns: Pictures in a row.
            width: Width of each picture [px].

        Returns:
            The sheet, RGB.

        Raises:
            ArgumentError: A number is too small.
        """
        _check_tile(width)
        view, panel = self._view, trial_frame.Panel(self._limits.plane, width)
        times, shares = view.moments(count)
        samples = view.nearest(times).tolist()
        factor, enlarged = self._enlarged()
        if factor > 1:  # every second moment, as it is and then enlarged
            shares, samples = shares[::2], samples[::2]
        images = [np.asarray(trial_frame.plane_panel(view, k, panel, TEXT)) for k in samples]
        beats = [f"beat {_fraction(share, count)}   " if view.about else "" for share in shares.tolist()]
        captions = [
            f"{beat}{view.times[k]:.3f} s   {millimeters(float(view.errors[k]))}"
            for beat, k in zip(beats, samples, strict=True)
        ]
        if factor > 1:
            images += [np.asarray(trial_frame.plane_panel(enlarged, k, panel, TEXT)) for k in samples]
            captions += [f"{beat}{factor} times the difference" for beat in beats]
        sheet = to_pillow(contact_sheet(images, captions, columns, width))
        title = "   ".join(part for part in (view.name, view.about) if part)
        return _stacked(
            [trial_frame.draw_heading(title, _note(view, panel), sheet.width), sheet, self._foot(samples, sheet.width)]
        )

    def sheet_note(self, moments: int) -> str:
        """Description of that picture's parts."""
        view, (factor, _) = self._view, self._enlarged()
        count = (moments + 1) // 2 if factor > 1 else moments
        shown = "from start to end" if view.frequency is None else "of one beat"
        enlarged = f", and the same with differences {factor} times as large as they are" if factor > 1 else ""
        path = " both paths and" if view.path_real is not None else ""
        swings = ", and how the head swings" if view.swings else ""
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

    def _enlarged(self) -> tuple[int, TrialView]:
        return self._view.enlarged(self._limits.plane.right - self._limits.plane.left)

    def _foot(self, samples: Sequence[int], width: int) -> Image:
        """The error and the head's swings over time, at the right of both paths if there are any."""
        view, limits = self._view, self._limits
        path = trial_frame.path_strip(view, view.last_seen, limits, width // 2)
        left = 0 if path is None else path.width
        size, gap = trial_frame.text_height(width), trial_frame.gap_of(width)
        room = width - left - 2 * gap
        charts = [trial_frame.ErrorChart(view, limits.error, room, 0.9 * size).at(*samples)]
        charts += [
            trial_frame.swing_chart(swing, view.times, top, room, 0.9 * size)
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


def trials_sheet(views: Sequence[TrialView], count: int, width: int) -> Bytes:
    """Every trial in several moments: a row is a trial, a column a share of a beat or of the trial's time.

    All beats begin where the last real marker is farthest to the left of the swimmer (up in the picture).

    Args:
        views: The trials, in the order of the rows; they are drawn in one scale.
        count: Number of moments of each trial.
        width: Width of each picture [px].

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No views, or a number is too small.
    """
    _check_tile(width)
    panel, beats = trial_frame.Panel(common_limits(views).plane, width), views[0].frequency is not None
    names = [trial_frame.shortened(view.name, TEXT, ROW_HEAD) for view in views]
    notes = [view.about or millimeters(view.error) for view in views]
    heads = [str(Fraction(k, count)) if beats else f"{100 * k / (count - 1):.0f} %" for k in range(count)]
    left, top = 2 * _GAP + max(text_size(text, TEXT)[0] for text in [*names, *notes]), round(2 * TEXT)
    image = plain(left + count * (width + _GAP), top + len(views) * (panel.height + _GAP), PAGE)
    canvas = Canvas(image)
    canvas.text((_GAP, top / 2), "beat" if beats else "time", trial_frame.MUTED, TEXT, (0, 0.5))
    for column, head in enumerate(heads):
        canvas.text((left + column * (width + _GAP) + width / 2, top / 2), head, trial_frame.MUTED, TEXT, (0.5, 0.5))
    for row, view in enumerate(views):
        y = top + row * (panel.height + _GAP)
        canvas.text((_GAP, y + panel.height / 2), names[row], INK, TEXT, (0, 1))
        canvas.text((_GAP, y + panel.height / 2), notes[row], INK, TEXT, (0, 0))
        for column, sample in enumerate(view.nearest(view.moments(count)[0]).tolist()):
            picture = trial_frame.plane_panel(view, sample, panel, TEXT)
            Canvas(picture).text((5, 3), f"{view.times[sample]:.3f} s", trial_frame.MUTED, _STAMP)
            canvas.paste(picture, (left + column * (width + _GAP), y))
    title = "One beat of each trial" if beats else "Each trial from start to end"
    return _stacked([trial_frame.draw_heading(title, _note(views[0], panel), image.width), image])


def _stacked(images: Sequence[Image]) -> Bytes:
    """Pictures of the same width below one another."""
    canvas, y = Canvas(plain(images[0].width, sum(image.height for image in images), PAGE)), 0
    for image in images:
        canvas.paste(image, (0, y))
        y += image.height
    return canvas.pixels()


def _note(view: TrialView, panel: trial_frame.Panel) -> str:
    return f"{view.axes}   grid {length_text(panel.step)}"


def _fraction(share: float, count: int) -> str:
    """A share of the beat as a fraction where it is one."""
    fraction = Fraction(share).limit_denominator(count)
    return str(fraction) if abs(fraction - share) < 1e-9 else f"{share:.2f}"


def _check_tile(width: int) -> None:
    """Refuses widths of pictures in which nothing can be seen."""
    if width < LEAST_TILE:
        raise ArgumentError(f"width is {width} px; a picture of a sheet must be at least {LEAST_TILE} px wide")
