"""Cameras, lights and water, which physics doesn't feel."""

import mujoco
import numpy as np
import pytest

from small_models import PENDULUM, snake
from swim2real.viewing.scenery import furnish


def stepped(model):
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.3
    data.qvel[:] = 0.5
    mujoco.mj_step(model, data, 200)
    return data.qpos


@pytest.mark.parametrize(("xml", "way"), [(PENDULUM, 0), (snake(), 2)])
def test_a_furnished_model_moves_to_the_last_digit_as_before_and_cameras_follow_what_travels(xml, way):
    spec = mujoco.MjSpec.from_string(xml)
    bare = spec.compile()
    furnish(spec)
    model = spec.compile()
    assert (model.ncam, model.nlight, model.nbody) == (3, 1, bare.nbody)
    np.testing.assert_array_equal(stepped(model), stepped(bare))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.cam_xpos.copy()
    data.qpos[0] = 2.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.cam_xpos - before, [[way, 0, 0]] * 3, atol=1e-9)
    ahead = model.camera("ahead").id
    np.testing.assert_allclose(data.cam_xmat[ahead].reshape(3, 3)[:, 0], [0, -1, 0], atol=1e-9)  # +x is away from it
    assert before[ahead, 0] < 0


def test_water_has_a_surface_and_a_models_own_things_stay():
    spec = mujoco.MjSpec.from_string(snake())
    spec.worldbody.add_camera(name="above", pos=[0, 0, 7])
    spec.worldbody.add_light(pos=[1, 2, 3])
    furnish(spec)
    model = spec.compile()
    assert {model.geom(i).name for i in range(model.ngeom)} > {"scenery:water", "scenery:ground"}
    assert model.nlight == 1
    np.testing.assert_allclose(model.camera("above").pos, [0, 0, 7])
    dry = mujoco.MjSpec.from_string(PENDULUM)
    furnish(dry)
    assert "scenery:water" not in {geom.name for geom in dry.geoms}
