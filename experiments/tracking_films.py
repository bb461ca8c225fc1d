"""The films of docs/tracking.md: made, damaged, judged against the truth, labeled.

python experiments/tracking_films.py make | damage | judge TRACKED | scattered | label | gaps TRACKS
"""

import random
import shutil
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import av
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from pool import Glare, PoolCamera, film, scene

from markertrack.camera_file import CameraFile, write_camera
from markertrack.cleaning import fill_gaps
from markertrack.points import save_points
from markertrack.quality import DOUBTFUL, check_track
from markertrack.track import MarkerTrack
from markertrack.tracking.labeling import label_markers
from markertrack.video import VideoReader
from markertrack.video.damage import marked
from markertrack.video.decoding import Picture
from swim2real.demo.synthetic import placed_by_hand, steady_swims, turned
from swim2real.robots.fish import FISH
from swim2real.trials import load_reference
from swim2real.trials.pose_tables import read_dlc
from swimbase.errors import TrackingError

CAMERA = PoolCamera(width=1280, height=720, glints=2.0)
KINDS = {
    "plain": (CAMERA, {}),
    "hevc": (CAMERA, {"codec": "hevc"}),
    "mjpeg": (CAMERA, {"codec": "mjpeg"}),
    "glare": (replace(CAMERA, glares=(Glare(1.0, 1.15, over=(4, 5)),)), {}),
    "portrait": (replace(CAMERA, width=720, height=1280, view=1.5), {"rotation": 90}),
    "uneven": (replace(CAMERA, jitter=0.3, dropped=0.1), {}),
    "fps30": (replace(CAMERA, fps=30.0), {}),
    "fps240": (replace(CAMERA, fps=240.0), {}),
    "radius3": (replace(CAMERA, marker_radius=0.003), {}),
    "radius5": (replace(CAMERA, marker_radius=0.005), {}),
    "radius7": (replace(CAMERA, marker_radius=0.007), {}),
    "radius9": (replace(CAMERA, marker_radius=0.009), {}),
    "low": (replace(CAMERA, camera_height=1.5), {}),
    "pale": (replace(CAMERA, contrast=0.18), {}),
    "blurred": (replace(CAMERA, fps=30.0, shutter=1.0), {}),
}


def make():
    Path("films").mkdir()
    rng = np.random.default_rng(3)
    swim = steady_swims(FISH, FISH.space.published, [1.5], 5.0, 0.004, rng, 5e-4).trials[0].track
    positions = placed_by_hand(turned(swim.positions, 0.2), 3e-3, rng)[swim.times <= 3]
    for name, (camera, options) in KINDS.items():
        path, shown = Path(f"films/{name}.mp4"), turned(positions, np.pi / 2) if name == "portrait" else positions
        track = MarkerTrack(swim.times[swim.times <= 3], shown)
        truth = film(scene(track, FISH.marker_heights, camera, 7), path, **options).truth
        clicks = truth.positions[0] + np.random.default_rng(5).normal(0, 1, (9, 2))
        save_points(path.with_suffix(".json"), clicks, FISH.marker_names, path.name, camera.width, camera.height)
        np.savez(path.with_suffix(".npz"), times=truth.times, places=truth.positions)
    write_camera("camera.json", CameraFile(camera_height=CAMERA.camera_height - FISH.marker_heights[0].item()))


def noisy(name, chosen, noise):
    """A film as bytes, the middle of some pictures replaced by noise."""
    with av.open(f"films/{name}.mp4") as file:
        packets = [(packet.pos, packet.size) for packet in file.demux(video=0) if packet.size]
    content = bytearray(Path(f"films/{name}.mp4").read_bytes())
    for place, size in [packets[number] for number in chosen]:
        start, end = place + int(0.3 * size), place + int(0.7 * size)
        content[start:end] = noise.randbytes(end - start)
    return content


def damage():
    """The middle of five pictures becomes noise, half a second apart."""
    Path("damaged").mkdir()
    for name in ("plain", "hevc", "mjpeg"):
        Path(f"damaged/{name}.mp4").write_bytes(noisy(name, range(30, 151, 30), random.Random(1)))
        shutil.copy(f"films/{name}.json", f"damaged/{name}.json")


def scattered():
    """Five pictures at other places, eight times: which of those that change, for one frame or longer, are doubted."""

    def frames(path):
        with VideoReader(path) as reader:
            for frame in reader:
                yield round(frame.time * 60), frame.intact, frame.image.mean(axis=2, dtype=np.float32)

    for name in ("hevc", "mjpeg"):
        whole = {number: image for number, _, image in frames(f"films/{name}.mp4")}
        count, stretches = Counter(), []
        for seed in range(1, 9):
            noise = random.Random(seed)
            chosen = sorted(noise.sample(range(12, len(whole) - 8, 12), 5))
            Path("scattered.mp4").write_bytes(noisy(name, chosen, noise))
            before = False
            for number, intact, image in frames("scattered.mp4"):
                off = np.abs(image - whole[number]).reshape(45, 16, 80, 16).mean(axis=(1, 3)).max()
                if off > 8:  # gray levels, in the mean of a block
                    if not before:
                        stretches.append([])
                    stretches[-1].append(not intact)
                count["frames"] += 1
                count["unharmed but doubted"] += off <= 8 and not intact
                before = off > 8
        single = [found[0] for found in stretches if len(found) == 1]
        longer = [found for found in stretches if len(found) > 1]
        print(
            f"{name}: {dict(count)}; harmed for one frame {len(single)}, doubted {sum(single)}; for longer "
            f"{len(longer)} times, {sum(map(len, longer))} frames, doubted {sum(map(sum, longer))}"
        )
    count = Counter()
    for path in sorted(Path("films").glob("*.mp4")):
        with av.open(path) as file:
            stored = (Picture(picture, picture.pts, True, 0) for picture in file.decode(video=0))
            count.update("doubted" if picture.odd else "not doubted" for picture in marked(stored))
    print(f"undamaged frames of all films, whatever their codec: {dict(count)}")


def judge(folder):
    for trial in load_reference(folder):
        truth = np.load(f"films/{trial.name}.npz")
        pixels, _ = read_dlc(f"{folder}/tracks/{trial.name}.pixels.csv", 60)
        nearest = np.abs(truth["times"] - trial.track.times[:, None]).argmin(axis=1)
        off = np.linalg.norm(pixels.positions - truth["places"][nearest], axis=2)
        seen, used = pixels.confidence >= DOUBTFUL, check_track(trial.track, FISH.rest_markers).weights > 0
        print(
            f"{trial.name}: {off.size} marker-frames, {(~seen).sum()} lost; of those seen RMSE "
            f"{np.sqrt((off[seen] ** 2).mean()):.2f} px, {(off[seen] > 3).sum()} off by over 3 px, "
            f"{(off[seen] > 10).sum()} by over 10 px; of {used.sum()} in use {(off[used] > 3).sum()} and "
            f"{(off[used] > 10).sum()}"
        )


def label():
    """First frames in ten places and poses, in three sizes, labeled without a click."""
    swims = steady_swims(FISH, FISH.space.published, [0.5, 1.0, 1.5, 2.25], 2.0, 0.004, np.random.default_rng(3))
    for width, height in ((1280, 720), (1920, 1080), (3840, 2160)):
        came, rng = Counter(), np.random.default_rng(8)
        for number in range(10):
            track = swims.trials[number % 4].track
            positions = turned(track.positions, rng.uniform(-0.4, 0.4) + np.pi * rng.integers(2))
            track = MarkerTrack(track.times, placed_by_hand(positions, 3e-3, rng))
            shot = scene(track, FISH.marker_heights, replace(CAMERA, width=width, height=height), number)
            try:
                points = label_markers(next(iter(shot))[1], FISH.rest_markers, FISH.marker_heights)
                came["right" if np.abs(points - shot.filmed.truth.positions[0]).max() < 4 else "wrong"] += 1
            except TrackingError:
                came["refused"] += 1
        print(width, dict(came))


def gaps(folder):
    """Six frames of the last marker hidden at a time, filled in the picture and in the body frame."""
    for trial in load_reference(folder):
        track = trial.track
        lost = check_track(track, FISH.rest_markers).lost[:, [0, 1, 8]].any(axis=1)
        body = MarkerTrack(track.times, track.body)
        worst = []
        for start in range(20, track.frame_count - 20, 7):
            near = slice(start - 10, start + 16)
            if lost[near].any():
                continue
            for view in (track, body):
                sure = view.confidence.copy()
                sure[start : start + 6, 8] = 0
                filled = fill_gaps(MarkerTrack(view.times[near], view.positions[near], sure[near])).positions
                worst.append(np.linalg.norm(filled[10:16, 8] - view.positions[start : start + 6, 8], axis=1).max())
        picture, frame = 1e3 * np.median(np.reshape(worst, (-1, 2)), axis=0)
        print(f"{trial.name}: {len(worst) // 2} gaps, {picture:.1f} mm in the picture, {frame:.1f} in the body frame")


command, *given = sys.argv[1:]
{"make": make, "damage": damage, "judge": judge, "scattered": scattered, "label": label, "gaps": gaps}[command](*given)
