from pathlib import Path

import mujoco
import pytest

from swim2real.robots import load_robot
from swim2real.robots.fish import FISH

EXAMPLES = Path(__file__).parents[2] / "examples"
ROBOT = """
format = 1
name = "rod"
description = "A rod on a hinge, a plate that is welded to it, and a stone of its own."
model = "rod.xml"
markers = ["stone", "rod", "plate"]
[recordings]
[[parameters]]
name = "damping"
lower = 0.1
upper = 1.0
meaning = "Of the hinge."
value = 0.5
targets = 'joint "hinge" damping'
"""
MODEL = """
<mujoco>
  <worldbody>
    <site name="stone"/>
    <body name="rod">
      <joint name="hinge"/>
      <geom size="0.1"/>
      <site name="rod"/>
      <body name="plate" pos="1 0 0"><site name="plate"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def test_markers_of_the_first_ones_body_keep_their_distances():
    assert FISH.layout.rigid == (0, 1, 2)
    assert load_robot(EXAMPLES / "finger" / "finger.toml").layout.rigid == (0, 1)
    assert load_robot(EXAMPLES / "snake" / "snake.toml").layout.rigid == (0, 1)


@pytest.mark.parametrize(
    ("markers", "rigid"), [('["stone", "rod", "plate"]', (0,)), ('["rod", "stone", "plate"]', (0, 2))]
)
def test_a_body_without_a_joint_moves_with_its_parent(tmp_path, markers, rigid):
    (tmp_path / "rod.xml").write_text(MODEL, encoding="utf-8")
    mujoco.MjSpec.from_string(MODEL).compile()
    (tmp_path / "rod.toml").write_text(ROBOT.replace('["stone", "rod", "plate"]', markers), encoding="utf-8")
    assert load_robot(tmp_path / "rod.toml").layout.rigid == rigid
