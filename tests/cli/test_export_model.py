"""The calibrated simulator as an MJCF file."""

import json

import mujoco
import numpy as np
import pytest

from swim2real.robots import load_robot
from swim2real.robots.fish import FISH

ARM = """
<mujoco><compiler meshdir="parts"/><asset><mesh name="m" file="m.obj"/></asset>
<worldbody><body name="b"><joint name="j" axis="0 1 0" damping="0.1"/><geom type="mesh" mesh="m"/><site name="s"/>
</body></worldbody></mujoco>"""
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
FILE = """
format = 1
name = "arm"
description = "An arm."
model = "arm.xml"
markers = ["s"]
[recordings]
[[parameters]]
name = "damping"
lower = 0.01
upper = 1.0
meaning = "Of the joint."
targets = 'joint "j" damping'
"""


@pytest.mark.usefixtures("repeatable_swims")
def test_the_published_fish_moves_alike(program, tmp_path):
    out = tmp_path / "fish.xml"
    said = program("export-model", "published", "--out", out)
    assert said.code == 0
    assert "fish.xml: robot 'fish', numbers read back within" in said.out
    model, own = mujoco.MjModel.from_xml_path(str(out)), FISH.build(FISH.space.published).compile()
    ends = []
    for one in (model, own):
        data = mujoco.MjData(one)
        data.ctrl[:] = 6.0
        mujoco.mj_step(one, data, 500)
        ends.append(data.sensordata.copy())
    np.testing.assert_allclose(*ends, atol=1e-4)  # m, half a second


def test_a_robot_files_meshes_are_found_from_anywhere(program, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "m.obj").write_text(MESH)
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "arm.toml").write_text(FILE)
    robot = load_robot(tmp_path / "arm.toml")
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    content = {"format": 1, "robot": "arm", "robot_file": "../arm.toml", "parameters": {"damping": 0.25}}
    (folder / "best.json").write_text(json.dumps(content))
    assert program("export-model", folder, "--out", folder / "out.xml").code == 0
    model = mujoco.MjModel.from_xml_path(str(folder / "out.xml"))
    assert model.joint("j").damping[0] == pytest.approx(0.25)
    assert model.nmesh == robot.build({"damping": 0.25}).compile().nmesh == 1
