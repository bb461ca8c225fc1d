from pathlib import Path

import pytest

from made_robots import RECORDINGS, ROBOT, made, parameter
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH

EXAMPLES = Path(__file__).parents[2] / "examples"
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


@pytest.mark.parametrize(("first", "rigid"), [('"stone", "rod"', (0,)), ('"rod", "stone"', (0, 2))])
def test_a_body_without_a_joint_moves_with_its_parent(tmp_path, first, rigid):
    text = ROBOT.replace('"base", "elbow", "tip"', f'{first}, "plate"')
    damping = parameter("'joint \"hinge\" damping'", more="value = 0.5")
    assert load_robot(made(tmp_path, text, RECORDINGS, damping, model=MODEL)).layout.rigid == rigid
