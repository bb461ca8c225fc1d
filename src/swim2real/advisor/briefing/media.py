"""Media shown at a round: films for those who take them, sheets of pictures for the others."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from markertrack.drawing import Bytes, to_png
from swim2real.advisor.vlm.exchange import Media
from swim2real.rendering.album import TrialPictures
from swim2real.rendering.film import clip_times, film_clip, film_sheet
from swim2real.settings import DetailName
from swimbase.errors import ArgumentError, VideoError

Films: TypeAlias = Mapping[str, tuple[Path, float | None]]  # by trial; the rate that was given for each

MOST_BYTES = 14_000_000  # of all media; as text they are a third longer, and many services stop at 20 MB
VIDEO_FRAME_TOKENS = 258  # the most that a service of today counts for a frame of a film
PIXELS_A_TOKEN = 750  # of a picture, likewise
FRAMES_A_CYCLE = 5  # at least, so that a motion isn't mistaken for a slower one
MOST_FPS = 24.0  # that services take
_COLUMNS = 4  # of a sheet
_TILE = 0.375  # of a film's width, that a picture of a sheet has


@dataclass(frozen=True)
class Detail:
    """One order of detail.

    Attributes:
        name: Name on the command line.
        fps: Frame rate of films [Hz], raised where the fastest motion would have fewer than five frames per cycle.
        width: Width of films [px]; pictures of a sheet have a part of it.
        moments: Moments on a sheet.
        trials: Number of trials that are shown, those that fit worst first; None for all.
        tokens: Most tokens that the media may take, by estimate.
    """

    name: str
    fps: float
    width: int
    moments: int
    trials: int | None
    tokens: int


_LEAST = Detail("least", 10.0, 320, 4, 1, 8_000)
DETAILS: dict[DetailName, Detail] = {
    "low": Detail("low", 10.0, 480, 4, 1, 40_000),
    "medium": Detail("medium", 12.0, 640, 8, 1, 120_000),
    "high": Detail("high", 24.0, 960, 12, None, 300_000),
}


def shorter(detail: Detail) -> Detail:
    """The next order down."""
    order = [_LEAST, *DETAILS.values()]
    return order[max(order.index(detail) - 1, 0)]


@dataclass(frozen=True)
class _Shown:
    """A picture or film with what it takes.

    Attributes:
        media: The picture or film.
        tokens: Number of tokens that it takes, by estimate.
    """

    media: Media
    tokens: int


def gather_media(
    scenes: Sequence[TrialPictures], detail: Detail, takes_video: bool, videos: Films
) -> tuple[tuple[Media, ...], tuple[str, ...]]:
    """Pictures or films of a point's trials, within the budget of a detail, and remarks on what is missing.

    The trials that fit worst are chosen first; what is chosen comes in its own order, then the real film of the worst.

    Args:
        scenes: The trials of the point.
        detail: How much is shown.
        takes_video: Whether films are shown, or sheets of pictures.
        videos: Real films by the names of their trials, where there are any, with the rates that were given.
    """
    worst_first = sorted(range(len(scenes)), key=lambda i: -scenes[i].loss)
    remarks: list[str] = []
    film, bytes_left, tokens_left = None, MOST_BYTES, detail.tokens
    try:
        film = _real(scenes[worst_first[0]], detail, takes_video, _rate(scenes, detail), videos)
    except (VideoError, ArgumentError) as error:
        remarks.append(f"The real robot's film can't be shown: {error}.")
    if film is not None:
        bytes_left, tokens_left = bytes_left - len(film.media.data), tokens_left - film.tokens
    chosen: dict[int, Media] = {}
    for i in worst_first[: detail.trials]:
        shown = _overlay(scenes[i], detail, takes_video, fps=_rate(scenes, detail))
        bytes_left, tokens_left = bytes_left - len(shown.media.data), tokens_left - shown.tokens
        if chosen and min(bytes_left, tokens_left) < 0:
            break
        chosen[i] = shown.media
    left_out = len(scenes) - len(chosen)
    if left_out:
        remarks.append(f"{left_out} of {len(scenes)} trials, those that fit best, aren't shown.")
    media = [chosen[i] for i in sorted(chosen)]
    return (*media, *([film.media] if film is not None else [])), tuple(remarks)


def _rate(scenes: Sequence[TrialPictures], detail: Detail) -> float:
    """Frame rate of films [Hz]."""
    return min(MOST_FPS, max(detail.fps, FRAMES_A_CYCLE * max(scene.pace for scene in scenes)))


def _overlay(scene: TrialPictures, detail: Detail, takes_video: bool, fps: float) -> _Shown:
    """A trial's picture or film, simulated over real."""
    about = f"Trial {scene.title}: simulated (blue) over real (red)"
    if not takes_video:
        each = round(_TILE * detail.width)
        sheet = scene.sheet(detail.moments, min(_COLUMNS, detail.moments), each - each % 2)
        return _picture(f"{about}, {scene.sheet_note(detail.moments)}.", sheet)
    with _place() as path:
        scene.write_clip(path, fps, detail.width)
        data = path.read_bytes()
    label = f"{about}; {scene.clip_note}; {fps:g} frames per second."
    return _Shown(Media(label, "video/mp4", data, fps), VIDEO_FRAME_TOKENS * len(clip_times(scene.duration, fps)))


def _real(scene: TrialPictures, detail: Detail, takes_video: bool, fps: float, videos: Films) -> _Shown | None:
    """The real film of a trial, None where there is none."""
    if scene.name not in videos:
        return None
    video, rate = videos[scene.name]
    about = f"The real robot in trial {scene.title}, as filmed"
    if not takes_video:
        times = scene.film_times(detail.moments)
        sheet = film_sheet(video, times, min(_COLUMNS, detail.moments), detail.width // 2, rate)
        return _picture(f"{about}: {scene.film_note}.", sheet)
    with _place() as path:
        film_clip(video, path, fps, detail.width, scene.duration, scene.start, rate)
        data = path.read_bytes()
    return _Shown(Media(f"{about}.", "video/mp4", data, fps), VIDEO_FRAME_TOKENS * len(clip_times(scene.duration, fps)))


@contextmanager
def _place() -> Generator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "clip.mp4"


def _picture(label: str, image: Bytes) -> _Shown:
    return _Shown(Media(label, "image/png", to_png(image)), image.shape[0] * image.shape[1] // PIXELS_A_TOKEN)
