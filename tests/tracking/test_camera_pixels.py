"""From meters back to pixels: what `to_meters` does, undone."""

import numpy as np
import pytest

from swim2real.errors import TrackingError
from swim2real.tracking.camera import camera_for, fixed_camera
from swim2real.tracking.camera_file import CameraFile, Lens
from swim2real.trials import MarkerTrack

REST = np.array([[0.0, 0.0], [0.14, 0.0], [0.35, 0.0]])
HEIGHTS = np.array([0.0, 0.0, 0.05])
SIZE = (1280, 720)
LENS = Lens(np.array([[900.0, 0, 630], [0, 910, 350], [0, 0, 1]]), np.array([-0.21, 0.06, 0.001, -0.002, 0.0]))
PLANE = np.array([[0.002, 1e-4, -1.2], [5e-5, -0.0021, 0.8], [1e-5, 2e-5, 1.0]])


@pytest.mark.parametrize(
    "known",
    [None, CameraFile(camera_height=2.0), CameraFile(homography=PLANE), CameraFile(camera_height=2.0, lens=LENS),
     CameraFile(camera_height=1.5, homography=PLANE, lens=LENS)],
    ids=["scale", "height", "plane", "lens", "all"],
)  # fmt: skip
def test_markers_come_back_to_their_pixels(known: CameraFile | None) -> None:
    rng = np.random.default_rng(0)
    start = np.array([400.0, 300.0]) + 500 * REST
    pixels = start + 4 * np.cumsum(rng.normal(size=(40, 3, 2)), axis=0)
    pixels[7, 1] = np.nan
    track = MarkerTrack(np.arange(40) / 60, pixels)
    camera = camera_for(track, REST, HEIGHTS, ("a", "b", "c"), (0, 1), known, SIZE)
    world = camera.to_meters(track).positions
    assert camera.to_pixels(world) == pytest.approx(pixels, abs=1e-3, nan_ok=True)
    again = fixed_camera(known, camera.scale.meters_per_pixel, HEIGHTS, SIZE)
    assert again.to_pixels(world) == pytest.approx(pixels, abs=1e-3, nan_ok=True)


def test_no_scale_is_said() -> None:
    with pytest.raises(TrackingError, match=r"there is no scale.*add points to the camera file"):
        fixed_camera(None, None, HEIGHTS, SIZE)
