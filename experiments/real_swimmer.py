"""What a real film of an unmarked swimmer determines: its bends are played back, and the fluid moves it.

    python experiments/real_swimmer.py VIDEO CLICKS FOLDER [--length 0.1] [--budget 150]

CLICKS is a JSON file with `frames`, of each of which `head` and `tail` are places [px]; the first frame's are taken.
The swimmer is a chain of ellipsoids of that length, whose joints are driven to the bends of the midline. Drag that
grows with the square of speed makes the same way at any rate of the film and at any length, so neither need be known.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from markertrack.points import save_points
from markertrack.quality import DOUBTFUL
from markertrack.video import VideoReader
from swim2real import (
    CalibrationSettings,
    TrackingSettings,
    calibrate,
    load_reference,
    load_robot,
    track_video,
)  # fmt: skip
from swimbase.store import write_json

LINKS = 8
FPS = 100.0  # of the clock that the playback runs on
WIDTH, HEIGHT = 0.16, 0.2  # of the widest link, and of all with the fin fold, in lengths of a larva
FREE = (
    '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/><joint name="yaw"/>'
    '<site name="s0"/>'
)
COEFFICIENTS = {
    "blunt_drag": (0.1, 10.0),
    "slender_drag": (0.02, 2.0),
    "angular_drag": (0.1, 10.0),
    "lift": (0.1, 10.0),
}


def written(folder: Path, length: float) -> Path:
    """The model and its robot file."""
    link, taper = length / LINKS, np.interp(np.arange(LINKS), [0, 1, 3, LINKS - 1], [0.8, 1.0, 0.5, 0.2])
    chain = ""
    for k in reversed(range(LINKS)):
        size = f"{0.5 * link} {0.5 * WIDTH * length * taper[k]} {0.5 * HEIGHT * length}"
        geom = f'<geom name="g{k}" size="{size}" pos="{0.5 * link} 0 0"/><site name="s{k + 1}" pos="{link} 0 0"/>'
        inner = f"{geom}{chain}"
        chain = f'<body pos="{link} 0 0"><joint name="b{k}"/>{inner}</body>' if k else f"<body>{FREE}{inner}</body>"
    servos = "".join(f'<position name="m{k}" joint="b{k}" kp="0.3" kv="0.001"/>' for k in range(1, LINKS))
    (folder / "swimmer.xml").write_text(
        f'<mujoco><compiler angle="radian"/><option timestep="0.001" density="1000" gravity="0 0 0" '
        f'integrator="implicitfast"/><default><geom type="ellipsoid" density="1000" contype="0" conaffinity="0" '
        f'fluidshape="ellipsoid" fluidcoef="1 0.5 1.5 1 0"/><joint axis="0 0 1" damping="0.00001"/></default>'
        f"<worldbody>{chain}</worldbody><actuator>{servos}</actuator></mujoco>"
    )
    parameters = "".join(
        f'[[parameters]]\nname = "{name}"\nunit = "-"\nlower = {low}\nupper = {high}\nscale = "log"\n'
        f"meaning = \"Of all links.\"\ntargets = 'geom \"*\" fluidcoef[{k}]'\n\n"
        for k, (name, (low, high)) in enumerate(COEFFICIENTS.items())
    )  # fmt: skip
    servo = "".join(f'm{k} = "interpolated table"\n' for k in range(1, LINKS))
    sites = ", ".join(f'"s{k}"' for k in range(LINKS + 1))
    path = folder / "swimmer.toml"
    path.write_text(
        f'format = 1\nname = "swimmer"\ndescription = "A swimmer whose bends are those of a film."\n'
        f'model = "swimmer.xml"\ncamera = "above"\nmarkers = [{sites}]\n\n[recordings]\nstart = "rest"\n'
        f'frame = ["s0", "s1"]\nscore_progress = true\n\n[recordings.controls]\n{servo}\n{parameters}'
    )
    return path


def bends(places: np.ndarray) -> np.ndarray:
    """Angles between neighboring links of a chain of places (T, N, 2) [rad]. Shape (T, N - 2)."""
    along = np.diff(places, axis=1)
    turns = np.arctan2(along[..., 1], along[..., 0])
    bent = np.diff(turns, axis=1)
    return np.arctan2(np.sin(bent), np.cos(bent))


def _filled(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (T,) with straight lines where they are NaN."""
    known = np.isfinite(values)
    return np.interp(times, times[known], values[known])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video", type=Path)
    parser.add_argument("clicks", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--length", type=float, default=0.1, help="of the swimmer [m]")
    parser.add_argument("--budget", type=int, default=150, help="of evaluations")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    robot = load_robot(str(written(given.folder, given.length)))
    first = next(iter(json.loads(given.clicks.read_text())["frames"].values()))
    ends = np.array([first["head"], first["tail"]], dtype=float)
    with VideoReader(given.video) as reader:
        width, height = reader.info.width, reader.info.height
    points, camera = given.folder / "points.json", given.folder / "camera.json"
    save_points(points, ends, (robot.marker_names[0], robot.marker_names[-1]), given.video.name, width, height)
    scale = {"pixels": ends.tolist(), "meters": given.length}
    write_json(camera, {"format": 1, "lengths": [{"name": "the swimmer at rest", **scale}]})
    how = TrackingSettings(camera=camera, midline=True, overlay=False)
    zeros = given.folder / "zeros.csv"
    names = ",".join(f"m{k}" for k in range(1, LINKS))
    zeros.write_text(f"time_s,{names}\n0,{','.join('0' * (LINKS - 1))}\n")
    seen = track_video(given.video, points, robot, how, given.folder / "seen", controls=zeros, fps=FPS)
    (trial,) = load_reference(given.folder / "seen").trials
    track = trial.track
    places = np.where((track.confidence >= DOUBTFUL)[..., None], track.positions, np.nan)
    known = np.isfinite(places[..., 0])
    angles = np.column_stack([_filled(track.times, one) for one in bends(places).T])
    table = np.column_stack([track.times, angles])
    controls = given.folder / "bends.csv"
    np.savetxt(controls, table, delimiter=",", header=f"time_s,{names}", comments="", fmt="%.6g")
    print(f"{seen.name}: {100 * known.mean():.1f} % of places on the midline are known")
    track_video(given.video, points, robot, how, given.folder / "reference", controls=controls, fps=FPS)
    reference = load_reference(given.folder / "reference")
    print(calibrate(reference, robot, CalibrationSettings(budget=given.budget), given.folder / "run"))


if __name__ == "__main__":
    main()
