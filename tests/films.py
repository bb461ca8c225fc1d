"""Small films of a swimming fish, with the truth about them."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import av
import numpy as np
from pool import Filmed, PoolCamera, film, scene

import pools
from markertrack.camera_file import CameraFile, write_camera
from markertrack.points import save_points
from markertrack.track import MarkerTrack
from swim2real.demo import SyntheticCamera
from swim2real.demo.synthetic import turned
from swim2real.robots.fish import FISH
from swim2real.trials import Trial

FREQUENCY = 1.5  # Hz
LENGTH = 1.2  # s
CAMERA = PoolCamera(width=640, height=360, view=1.0, fps=30.0)  # markers have a radius of 5 px


@dataclass(frozen=True)
class Shot:
    """A film, the points of its first frame, the camera's file and the truth."""

    video: Path
    points: Path
    camera: Path
    filmed: Filmed

    @property
    def name(self) -> str:
        return self.video.stem

    @property
    def times(self) -> np.ndarray:
        return self.filmed.truth.times

    def errors(self, trial: Trial) -> np.ndarray:
        """How far markers are from the truth in the body frame [m]. Shape (T, M)."""
        return np.linalg.norm(trial.track.body - true_body(trial.track.times), axis=2)

    def pixel_errors(self, track: MarkerTrack) -> np.ndarray:
        """Likewise in the picture [px]."""
        return np.linalg.norm(track.positions - self.filmed.truth.positions[: track.frame_count], axis=2)


@cache
def swim() -> MarkerTrack:
    """A simulated fish that swims along x, or nearly so."""
    track = pools.film(SyntheticCamera(fps=120.0), (FREQUENCY,), LENGTH).trials[0].track
    x, y = (track.positions[:, -1] - track.positions[:, 0]).mean(axis=0)
    return MarkerTrack(track.times, turned(track.positions, 0.25 - np.arctan2(y, x)))


def true_body(times: np.ndarray) -> np.ndarray:
    """The swim in the body frame at any times [m]. Shape (T, M, 2)."""
    flat = swim().positions.reshape(len(swim().times), -1)
    there = np.column_stack([np.interp(times, swim().times, column) for column in flat.T])
    return MarkerTrack(times, there.reshape(len(times), -1, 2)).body


def shoot(
    folder: Path, name: str = "f1_50", seconds: float = LENGTH, camera: PoolCamera = CAMERA, turn: float = 0.0,
    seed: int = 1, **options,
) -> Shot:  # fmt: skip
    """Films the first seconds of the swim. The options are those of `film`."""
    kept = swim().times <= seconds + 1e-9
    track = MarkerTrack(swim().times[kept], turned(swim().positions[kept], turn))
    folder.mkdir(parents=True, exist_ok=True)
    video, points, known = (folder / f"{name}{ending}" for ending in (".mp4", ".points.json", ".camera.json"))
    filmed = film(scene(track, FISH.marker_heights, camera, seed), video, **options)
    clicks = filmed.truth.positions[0]
    save_points(points, clicks, FISH.marker_names, video.name, camera.width, camera.height)
    write_camera(known, CameraFile(camera_height=camera.camera_height - float(FISH.marker_heights[0])))
    return Shot(video, points, known, filmed)


def named(shot: Shot, folder: Path, name: str) -> Shot:
    """The same film under another name."""
    folder.mkdir(parents=True, exist_ok=True)
    video = folder / f"{name}.mp4"
    video.write_bytes(shot.video.read_bytes())
    return replace(shot, video=video)


def slowed(path: Path, other: Path, times: int, **metadata: str) -> Path:
    """The same pictures, which play so many times as slowly."""
    with av.open(str(path)) as early, av.open(str(other), "w", options={"movflags": "use_metadata_tags"}) as late:
        late.metadata.update(metadata)
        stream = late.add_stream_from_template(early.streams.video[0])
        for packet in early.demux(video=0):
            if packet.dts is not None:
                packet.pts, packet.dts, packet.stream = times * packet.pts, times * packet.dts, stream
                late.mux(packet)
    return other


def discs(places, colors, size: tuple[int, int]) -> np.ndarray:
    """A picture (H, W) of discs on blue."""
    image = np.full((*size, 3), [40.0, 90.0, 120.0])
    y, x = np.mgrid[: size[0], : size[1]]
    for (cx, cy), color in zip(places, colors, strict=True):
        cover = np.clip(7.5 - np.hypot(x - cx, y - cy), 0, 1)[..., None]
        image = image * (1 - cover) + np.array(color) * cover
    return np.round(image).astype(np.uint8)


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def tables(folder: Path) -> dict[str, bytes]:
    """All tables of a folder."""
    return {name: content for name, content in contents(folder).items() if name.endswith(".csv")}


def parts(folder: Path) -> list[str]:
    """Unfinished files."""
    return [name for name in contents(folder) if ".part" in name]
