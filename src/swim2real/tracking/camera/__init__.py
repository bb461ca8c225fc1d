"""From pixels to meters: scale, plane, lens, and markers that stand higher than others."""

from swim2real.tracking.camera.camera import Camera, camera_for
from swim2real.tracking.camera.camera_file import CameraFile, Length, camera_from_board, read_camera, write_camera

__all__ = ["Camera", "CameraFile", "Length", "camera_for", "camera_from_board", "read_camera", "write_camera"]
