"""Markers that nothing hides: on films, and in the viewer's scene."""

import mujoco
import numpy as np
import pytest

from swim2real.viewing.film import Outlines
from swim2real.viewing.motion import Motion
from swim2real.viewing.window import add_markers, eye_of

BOX = """
<mujoco><worldbody>
  <camera name="above" pos="0 0 3"/>
  <body><joint name="turn"/><geom type="box" size="0.5 0.5 0.5" rgba="0.5 0.5 0.5 1"/></body>
</worldbody></mujoco>
"""
INSIDE = np.array([[[0.1, 0.0, 0.0]]])  # of the box, which hides it


def test_markers_and_a_legend_lie_on_top_the_real_one_last():
    model = mujoco.MjModel.from_xml_string(BOX)
    motion = Motion("box", model, np.zeros(1), np.zeros((1, 1)), INSIDE, INSIDE)
    picture = Outlines(motion, "above", 640, 360).drawn(0)
    red, _, blue = np.moveaxis(picture.astype(int), 2, 0)
    place = 180, 320 + round(0.1 * 180 / np.tan(np.radians(22.5)) / 3)
    assert red[place] - blue[place] > 100
    near = slice(place[0] - 5, place[0] + 6), slice(place[1] - 5, place[1] + 6)
    assert (blue[near] - red[near]).max() > 100  # the simulated one is larger
    corner = slice(0, 60), slice(0, 40)
    assert (red[corner] - blue[corner]).max() > 100
    assert (blue[corner] - red[corner]).max() > 100


@pytest.mark.parametrize("fixed", [True, False])
def test_spheres_in_the_viewer_are_before_all_else_and_look_as_where_they_belong(fixed):
    model = mujoco.MjModel.from_xml_string(BOX)
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)
    camera.distance, camera.azimuth, camera.elevation = 3.0, 90.0, -90.0
    if fixed:
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    eye = eye_of(camera, data)
    np.testing.assert_allclose(eye, [0, 0, 3], atol=1e-9)
    scene = mujoco.MjvScene(model, 10)
    add_markers(scene, model, eye, INSIDE[0], np.array([[0.1, 0.0, 0.0], [np.nan] * 3]))
    blue, red = (scene.geoms[i] for i in range(2))
    assert scene.ngeom == 2
    for sphere in (blue, red):
        way = np.array(sphere.pos) - eye
        far = INSIDE[0, 0] - eye
        np.testing.assert_allclose(way / np.linalg.norm(way), far / np.linalg.norm(far), atol=1e-6)
        assert model.vis.map.znear * model.stat.extent < np.linalg.norm(way) - sphere.size[0] < 0.5
    assert np.linalg.norm(red.pos - eye) < np.linalg.norm(blue.pos - eye)
    assert red.size[0] / np.linalg.norm(red.pos - eye) < blue.size[0] / np.linalg.norm(blue.pos - eye)
