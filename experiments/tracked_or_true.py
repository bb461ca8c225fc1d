"""What tracking costs a calibration: the same swims, once with the true markers and once tracked in a film.

    python experiments/tracked_or_true.py --seeds 3 --out runs/tracked_or_true

Both references are calibrated with the same seeds; every result is then judged by both.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from pool import film, scene
from scipy.interpolate import CubicSpline
from swims import CAMERA, PLACEMENT, SAMPLE_INTERVAL, TIMESTEP

from markertrack.camera_file import CameraFile, write_camera
from markertrack.points import save_points
from markertrack.track import MarkerTrack
from swim2real.calibration import Problem
from swim2real.demo import hidden_values
from swim2real.demo.synthetic import (
    placed_by_hand,
    steady_swims,
    turned,
)
from swim2real.parameters import read_parameters
from swim2real.pipeline import calibrate, track_videos
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings, TrackingSettings
from swim2real.trials import Trial, TrialSet, load_reference, save_reference

FREQUENCIES = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75)  # Hz
SECONDS = 5.0
NAMES = ("aligned_marker_error", "shape_error", "velocity_error")


def filmed(job):
    """Films one swim and picks its markers; the true markers at the frames' times."""
    name, frequency, times, positions, path, seed = job
    truth = film(scene(MarkerTrack(times, positions), FISH.marker_heights, CAMERA, seed), path).truth
    clicks = truth.positions[0] + np.random.default_rng(seed).normal(0, 1.0, (len(FISH.marker_names), 2))
    save_points(path.with_suffix(".json"), clicks, FISH.marker_names, path.name, CAMERA.width, CAMERA.height)
    return Trial(name, MarkerTrack(truth.times, CubicSpline(times, positions)(truth.times)), frequency)


def references(out):
    """The true reference and the tracked one."""
    films = out / "films"
    films.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(11)
    swims = steady_swims(FISH, hidden_values(), FREQUENCIES, SECONDS, SAMPLE_INTERVAL, rng, TIMESTEP)
    jobs = []
    for number, (swim, frequency) in enumerate(zip(swims, FREQUENCIES, strict=True)):
        positions = placed_by_hand(turned(swim.track.positions, rng.uniform(-0.3, 0.3)), PLACEMENT, rng)
        jobs.append((swim.name, frequency, swim.track.times, positions, films / f"{swim.name}.mp4", number))
    with ProcessPoolExecutor() as pool:
        true = TrialSet(tuple(pool.map(filmed, jobs)), FISH.marker_names)
    save_reference(true, out / "true")
    write_camera(out / "camera.json", CameraFile(camera_height=CAMERA.camera_height - float(FISH.marker_heights[0])))
    paths = [job[4] for job in jobs]
    settings = TrackingSettings(camera=out / "camera.json", overlay=False)
    for result in track_videos(paths, [p.with_suffix(".json") for p in paths], FISH, settings, out / "tracked"):
        if isinstance(result, Exception):
            raise result
    return load_reference(out / "true"), load_reference(out / "tracked")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("runs/tracked_or_true"))
    a = parser.parse_args()
    true, tracked = references(a.out)
    for trial in tracked:
        body, real = trial.track.body, true[trial.name].track.body
        off = np.linalg.norm(body - real, axis=2)
        speeds = trial.track.speed - true[trial.name].track.speed
        print(
            f"{trial.name}: body frame off by {1e3 * np.nanmean(off):.2f} mm on average, "
            f"speed by {1e3 * speeds:+.2f} mm/s, {100 * np.isnan(off).mean():.1f} % of marker-frames lost"
        )
    judges = {name: Problem(FISH, r, "aligned") for name, r in (("true", true), ("tracked", tracked))}
    for seed in range(a.seeds):
        for name, reference in (("true", true), ("tracked", tracked)):
            folder = a.out / f"{name}_{seed}"
            settings = CalibrationSettings(budget=a.budget, seed=seed, protocol="aligned")
            calibrate(reference, FISH, settings, folder, resume=folder.exists())
            best = read_parameters(folder, FISH.name, FISH.space).values
            figures = {judge: problem.evaluate(best).figures() for judge, problem in judges.items()}
            line = ", ".join(f"{n} {1e3 * figures['true'][n]:.2f} / {1e3 * figures['tracked'][n]:.2f}" for n in NAMES)
            print(
                f"seed {seed}, fitted to {name} markers, judged by true / tracked ones [mm, mm/s]: {line}", flush=True
            )


if __name__ == "__main__":
    main()
