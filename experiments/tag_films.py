"""Films of ArUco and AprilTag markers that move fast under glare: how many are lost at which blur, and how far off.

python experiments/tag_films.py
"""

import tempfile
import time
from collections import defaultdict
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from markertrack.tracking.tags import TagTracker
from markertrack.video import VideoReader, VideoWriter
from swimbase.errors import TrackingError

WIDTH, HEIGHT, FPS, FRAMES, TAGS = 1280, 720, 60.0, 120, 6
FINER = 4  # pixels of the drawing in a pixel of the film, along each side
EDGES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 2.0)  # of a tag's side, blurred over
TRIED = (("DICT_4X4_50", 24), ("DICT_4X4_50", 40), ("DICT_APRILTAG_36h11", 40), ("DICT_APRILTAG_36h11", 64))  # px
SHUTTER = 0.5  # of a frame's time


def stamp(dictionary, number):
    """A tag with its white border, 12 px a cell, and the side of the whole in sides of the tag."""
    cells = dictionary.markerSize + 2
    tag = cv2.aruco.generateImageMarker(dictionary, number, 12 * cells)
    return np.pad(tag, 12, constant_values=235).clip(25, 235).astype(np.float32), (cells + 2) / cells


def paint(canvas, weight, drawing, whole, center, angle, side):
    """Adds a tag, at a place of the film, to sums of light and of the share that it covers."""
    reach = 0.75 * whole * side + 2
    x0, y0 = (int(v) for v in np.floor(center - reach))
    size = int(2 * reach) + 2
    scale = FINER * whole * side / len(drawing)
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    middle = (len(drawing) - 1) / 2
    there = FINER * (center - [x0, y0] + 0.5) - 0.5
    matrix = np.array([[c, -s, there[0] - c * middle + s * middle], [s, c, there[1] - s * middle - c * middle]])
    big = (FINER * size, FINER * size)
    patch = cv2.warpAffine(drawing, matrix, big, flags=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    mask = cv2.warpAffine(np.ones_like(drawing), matrix, big)
    small, cover = (cv2.resize(part, (size, size), interpolation=cv2.INTER_AREA) for part in (patch * mask, mask))
    rows, columns = slice(max(y0, 0), min(y0 + size, HEIGHT)), slice(max(x0, 0), min(x0 + size, WIDTH))
    inner = slice(rows.start - y0, rows.stop - y0), slice(columns.start - x0, columns.stop - x0)
    canvas[rows, columns] += small[inner]
    weight[rows, columns] += cover[inner]


def film(path, family, side, fastest, seed):
    """Writes a film; places of the tags [px], shape (T, M, 2), and how far each moves while the shutter is open."""
    rng = np.random.default_rng(seed)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family))
    drawings = [stamp(dictionary, number) for number in rng.choice(30, TAGS, replace=False)]
    homes = np.stack(np.meshgrid([250, 640, 1030], [210, 510]), axis=2).reshape(-1, 2).astype(float)
    swing = np.array([110.0, 70.0])
    rates = fastest / np.linalg.norm(swing) * rng.uniform(0.4, 1.0, (TAGS, 1))  # rad a frame
    phases, turn = rng.uniform(0, 2 * np.pi, (TAGS, 2)), rng.uniform(-0.5, 0.5, TAGS)

    def places(t):
        return homes + swing * np.sin(rates * t + phases)

    ground = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 6) * 4 + 120
    glare = rng.uniform([200, 150], [1080, 570])
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    shine = 220 * np.exp(-((x - glare[0]) ** 2 + (y - glare[1]) ** 2) / (2 * 60.0**2))
    truth, blurs = [], []
    with VideoWriter(path, WIDTH, HEIGHT, FPS, crf=20) as writer:
        for t in range(FRAMES):
            canvas, weight = np.zeros((HEIGHT, WIDTH), np.float32), np.zeros((HEIGHT, WIDTH), np.float32)
            moved = np.linalg.norm(places(t + SHUTTER / 2) - places(t - SHUTTER / 2), axis=1)
            for m, (drawing, whole) in enumerate(drawings):
                count = max(1, int(np.ceil(1.5 * moved[m])))
                tag, cover = np.zeros_like(canvas), np.zeros_like(canvas)
                for k in range(count):
                    when = t + SHUTTER * ((k + 0.5) / count - 0.5)
                    paint(tag, cover, drawing, whole, places(when)[m], turn[m] + 0.2 * np.sin(0.05 * when), side)
                canvas += tag / count
                weight += cover / count
            light = canvas + (1 - weight.clip(0, 1)) * ground + shine + rng.normal(0, 3, canvas.shape)
            picture = light.clip(0, 255).round().astype(np.uint8)
            writer.write(np.repeat(picture[:, :, None], 3, axis=2), t / FPS)
            truth.append(places(t))
            blurs.append(moved)
    return np.array(truth), np.array(blurs) / side


def main():
    for family, side in TRIED:
        found, seconds, frames = defaultdict(list), 0.0, 0
        for seed, fastest in enumerate((2, 8, 20, 40)):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "tags.mp4"
                truth, blurs = film(path, family, side, fastest, seed)
                tracker = TagTracker(family)

                def begin(points, image, time, tracker=tracker):
                    return tracker.start(image, points, time)

                with VideoReader(path) as reader:
                    began = False
                    for frame in reader:
                        image, t = frame.image, frame.index
                        start = time.process_time()
                        try:
                            places, sure = (tracker.follow if began else partial(begin, truth[t]))(image, frame.time)
                        except TrackingError:  # not all are seen yet: glare, or blur
                            continue
                        began = True
                        seconds, frames = seconds + time.process_time() - start, frames + 1
                        off = np.linalg.norm(places - truth[t], axis=1)
                        for m in range(TAGS):
                            found[int(np.searchsorted(EDGES, blurs[t, m], side="right"))].append((sure[m] > 0, off[m]))
        print(f"{family}, side {side} px, {1e3 * seconds / max(frames, 1):.1f} ms per frame")
        for place in sorted(found):
            seen = np.array([good for good, _ in found[place]])
            off = np.array([far for good, far in found[place] if good])
            rmse = np.sqrt(np.mean(off**2)) if off.size else np.nan
            worst = off.max() if off.size else np.nan
            print(
                f"  blur {EDGES[place - 1]:.2f} to {EDGES[place]:.2f} sides: "
                f"{len(seen)} marker-frames, {100 * (1 - seen.mean()):.1f} % lost, RMSE {rmse:.2f} px, "
                f"worst {worst:.2f}, {(off > 10).sum()} off by over 10 px"
            )


if __name__ == "__main__":
    main()
