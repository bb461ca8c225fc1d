"""Robots that float, sink and capsize."""

import pytest

from swim2real.checks.floating import afloat
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH

BOAT = """<mujoco model="boat"><option timestep="0.002" density="{density}" gravity="0 0 -9.81"/><worldbody>
  <body name="hull"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
    <joint name="heave" type="slide" axis="0 0 1" stiffness="{line}" damping="30"/>
    <joint name="roll" axis="1 0 0" stiffness="2" damping="0.02"/>
    <geom type="box" size="0.1 0.03 0.02" mass="1" fluidshape="ellipsoid"/>
    <geom name="mast" type="box" size="0.02 0.02 0.02" pos="0 0 0.1" mass="0.5" fluidshape="ellipsoid"/>
    <site name="bow" pos="-0.1 0 0.02"/><site name="stern" pos="0.1 0 0.02"/></body></worldbody></mujoco>"""
ROBOT = """format = 1
name = "boat"
model = "boat.xml"
markers = ["bow", "stern"]
description = "A boat for tests, seen from above, that nothing drives. It has two markers."
[recordings]
[[parameters]]
name = "roll_stiffness"
unit = "N·m/rad"
lower = {lower}
upper = 4.0
meaning = "Righting moment."
targets = 'joint "roll" stiffness'
"""


@pytest.fixture
def boat(tmp_path):
    def made(line=400.0, lower=1.0, density=1000.0):
        (tmp_path / "boat.xml").write_text(BOAT.format(line=line, density=density))
        (tmp_path / "boat.toml").write_text(ROBOT.format(lower=lower))
        return load_robot(tmp_path / "boat.toml")

    return made


def test_what_floats_upright_is_left_in_peace_and_what_capsizes_or_sinks_is_told(boat):
    assert afloat(boat()) == []
    assert afloat(FISH) == []
    (told,) = afloat(boat(lower=0.1))  # the mast alone wants 0.5 kg * 9.81 m/s² * 0.1 m = 0.49 N·m/rad
    assert told.startswith("body 'hull' capsizes with roll_stiffness = 0.1: left alone with a tilt of 5° it turns by ")
    (told,) = afloat(boat(line=0.0))
    assert told.startswith("body 'hull' sinks by ")
    assert afloat(boat(line=0.0, density=1.2)) == []
