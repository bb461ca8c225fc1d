"""Films two simulated swims with the synthetic pool camera, and tracks their markers.

python examples/track.py [FOLDER]
"""

import sys
from pathlib import Path

from pool import Glare, PoolCamera
from swims import film_swims

from markertrack.camera_file import CameraFile, write_camera
from swim2real.pipeline import track_videos
from swim2real.robots.fish import FISH
from swim2real.settings import TrackingSettings
from swimbase.errors import Swim2RealError


def main(out: Path) -> None:
    """Films into `out/videos`, tracks into the reference folder `out/reference`."""
    plain = PoolCamera(width=1280, height=720)
    glare = PoolCamera(width=1280, height=720, glares=(Glare(0.4, 0.6, over=(4, 5)),))
    videos = film_swims(FISH, FISH.space.published, [(1.0, plain), (1.5, glare)], 1.0, 0, out / "videos")

    # For a real camera: docs/tracking.md. Heights count from the markers of the head
    known = CameraFile(camera_height=plain.camera_height - float(FISH.marker_heights[0]))
    write_camera(out / "camera.json", known)
    points = [video.with_suffix(".points.json") for video in videos]  # `swim2real pick` makes them of real videos
    settings = TrackingSettings(camera=out / "camera.json")

    for result in track_videos(videos, points, FISH, settings, out / "reference"):
        if isinstance(result, Swim2RealError):
            raise result
        report = result.report
        print(f"{result.name}: {1e3 * report.meters_per_pixel:.4f} mm per pixel", end=", ")
        print(f"known lengths disagree by {100 * report.scale_spread:.1f} %")
        for name, share in zip(FISH.marker_names, report.lost_share, strict=True):
            if share > 0:
                print(f"{result.name}: {name} is lost in {100 * share:.0f} % of {report.frames} frames")
    print(f"overlays in {out / 'reference' / 'tracks'}")


if __name__ == "__main__":  # films are made and tracked in processes of their own, which import this file
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "tracked-example"))
