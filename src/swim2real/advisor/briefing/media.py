"""What is shown at a round: films for those who take them, sheets of pictures for the others."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swim2real.advisor.briefing.detail import MOST_BYTES, PIXELS_A_TOKEN, VIDEO_FRAME_TOKENS, Detail
from swim2real.advisor.vlm.exchange import Media
from swim2real.errors import VideoError
from swim2real.objective import Comparison, TrialComparison, swims_of
from swim2real.rendering.drawing import Bytes
from swim2real.rendering.swim_clip import clip_times, film_clip, write_clip
from swim2real.rendering.swim_encoding import to_png
from swim2real.rendering.swim_sheet import clip_sheet, film_sheet
from swim2real.rendering.swim_view import Limits, SwimView, common_limits

FRAMES_A_BEAT = 5  # at least, so that a beat isn't mistaken for a slower one
MOST_FPS = 24.0  # that services take
_COLUMNS = 4  # of a sheet
_FOLLOWED = 0.5  # share of frames in which a marker is seen, for its static offset to be believed


@dataclass(frozen=True)
class Shown:
    """A picture or film with what it takes.

    Attributes:
        media: Itself.
        tokens: By estimate.
    """

    media: Media
    tokens: int


def swim_view(trial: TrialComparison, marker_names: Sequence[str]) -> SwimView:
    """A compared trial as it is drawn: registered, as the loss sees it."""
    hidden = np.nan if trial.divergence else 0.0
    seen = trial.weights > 0
    followed, index = seen.mean(axis=0) > _FOLLOWED, np.arange(len(marker_names))
    offsets = trial.registration
    if followed.any():  # the offset of a marker that was mostly lost says little; its neighbors' say more
        known = index[followed]
        offsets = np.stack([np.interp(index, known, trial.registration[known, axis]) for axis in (0, 1)], axis=1)
    return SwimView(
        trial.name, trial.frequency, trial.times, seen, trial.real, trial.simulated + offsets + hidden,
        trial.course_real, trial.course_simulated + hidden, tuple(marker_names),
    )  # fmt: skip


def gather_media(
    comparison: Comparison, marker_names: Sequence[str], detail: Detail, takes_video: bool, videos: Mapping[str, Path]
) -> tuple[tuple[Media, ...], tuple[str, ...]]:
    """Pictures or films of the incumbent's swims, within the budget of a detail, and remarks on what is missing.

    The trials that fit worst are chosen first; what is chosen comes in the order of frequencies, and the real film of
    the worst trial last.

    Args:
        comparison: Of the incumbent.
        marker_names: Head to tail.
        detail: How much.
        takes_video: Films, or sheets of pictures.
        videos: Real films by trial, where there are any.

    Raises:
        MissingExtraError: Pillow or PyAV isn't installed.
    """
    swims = swims_of(comparison)
    worst_first = sorted(swims, key=lambda trial: -trial.loss(comparison.protocol))
    limits = common_limits([swim_view(trial, marker_names) for trial in swims])
    fps = min(MOST_FPS, max(detail.fps, FRAMES_A_BEAT * max(trial.frequency for trial in swims)))
    remarks: list[str] = []
    film, bytes_left, tokens_left = None, MOST_BYTES, detail.tokens
    try:
        film = _real(worst_first[0], detail, takes_video, fps, videos)
    except VideoError as error:
        remarks.append(f"The real robot's film can't be shown: {error}.")
    if film is not None:
        bytes_left, tokens_left = bytes_left - len(film.media.data), tokens_left - film.tokens
    chosen: list[tuple[float, Media]] = []
    for trial in worst_first[: detail.trials]:
        shown = _overlay(swim_view(trial, marker_names), limits, detail, takes_video, fps)
        bytes_left, tokens_left = bytes_left - len(shown.media.data), tokens_left - shown.tokens
        if chosen and min(bytes_left, tokens_left) < 0:
            break
        chosen.append((trial.frequency, shown.media))
    left_out = len(swims) - len(chosen)
    if left_out:
        remarks.append(f"{left_out} of {len(swims)} trials, those that fit best, aren't shown.")
    media = [one for _, one in sorted(chosen, key=lambda pair: pair[0])]
    return (*media, *([film.media] if film is not None else [])), tuple(remarks)


def _overlay(view: SwimView, limits: Limits, detail: Detail, takes_video: bool, fps: float) -> Shown:
    about = f"Trial {view.name}, {view.frequency:.2f} Hz: simulated (blue) over real (red)"
    if not takes_video:
        each = detail.width // 2
        sheet = clip_sheet(view, detail.moments, min(_COLUMNS, detail.moments), each - each % 2, limits)
        return _picture(f"{about}, {detail.moments} moments of one beat, then both courses over the whole time.", sheet)
    with _place() as path:
        write_clip(view, path, fps, detail.width, limits)
        data = path.read_bytes()
    label = f"{about}; above in the body frame, below side by side in the world frame; {fps:g} frames a second."
    return Shown(Media(label, "video/mp4", data, fps), VIDEO_FRAME_TOKENS * len(clip_times(view.duration, fps)))


def _real(
    trial: TrialComparison, detail: Detail, takes_video: bool, fps: float, videos: Mapping[str, Path]
) -> Shown | None:
    """The real film of a trial, None where there is none."""
    video = videos.get(trial.name)
    if video is None:
        return None
    about = f"The real robot in trial {trial.name}, {trial.frequency:.2f} Hz"
    seconds = float(trial.times[-1])
    if not takes_video:
        times = np.arange(detail.moments) / detail.moments / trial.frequency + max(seconds - 1 / trial.frequency, 0) / 2
        sheet = film_sheet(video, times.tolist(), min(_COLUMNS, detail.moments), detail.width // 2)
        return _picture(f"{about}, as filmed: moments of one beat.", sheet)
    with _place() as path:
        film_clip(video, path, fps, detail.width, seconds)
        data = path.read_bytes()
    return Shown(
        Media(f"{about}, as filmed.", "video/mp4", data, fps), VIDEO_FRAME_TOKENS * len(clip_times(seconds, fps))
    )


@contextmanager
def _place() -> Generator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "clip.mp4"


def _picture(label: str, image: Bytes) -> Shown:
    return Shown(Media(label, "image/png", to_png(image)), image.shape[0] * image.shape[1] // PIXELS_A_TOKEN)
