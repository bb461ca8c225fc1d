"""A parameter changes what it says, whatever the model's own settings make of it; found without knowing any of them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made_robots import RECORDINGS, ROBOT, made, parameter
from refused import refusal, says
from swim2real.checks.effects import model_effects
from swim2real.robots import load_robot
from swim2real.robots.read_back import check_targets, undone
from swimbase.errors import RobotError

LINKS = """
<mujoco model="arm">
  <compiler angle="radian" COMPILER/>
  <option timestep="0.002"/>
  <asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/></asset>
  <worldbody>
    <frame euler="0.3 0.2 0.1">
    <body name="base"><inertial pos="0 0 .01" mass="0.5" diaginertia="1e-3 1e-3 1.5e-3"/>
      <joint name="hip" axis="0 1 0" damping=".1" JOINT/><site name="base"/>
      <geom name="shell" type="capsule" fromto="0 0 0 0 0 .2" size=".02"/>
      <body name="link" pos="0 0 .2"><joint name="knee" axis="0 1 0" range="-1 1" stiffness="2"/>
        <geom name="rod" type="capsule" fromto="0 0 0 0 0 .2" size=".01" mass=".2"/>
        <geom name="tool" type="sphere" size=".02" pos=".01 0 .2" mass=".1" GEOM/>
        <geom name="cork" type="box" size=".01 .02 .03" pos="0 .1 .1" quat="1 .2 0 0" density="300"/>
        <geom name="cut" type="mesh" mesh="wedge" pos="0 0 .1" mass=".01"/>
        <site name="elbow"/><site name="tip" pos="0 0 .2"/></body></body>
    </frame>
  </worldbody>
  <tendon><fixed name="cable" stiffness="3" springlength="0 .2"><joint joint="hip" coef="1"/></fixed></tendon>
  <equality><joint name="gear" joint1="hip" joint2="knee" polycoef="0 .1 0 0 0" active="false"/></equality>
  <actuator><position name="servo" joint="knee" kp="4" kv=".1" ACTUATOR/><motor name="torque" joint="hip"/></actuator>
</mujoco>
"""


def robot_of(folder, writes, lower, upper, more="", **places):
    text = LINKS
    for place in ("COMPILER", "JOINT", "GEOM", "ACTUATOR"):
        text = text.replace(place, places.get(place.lower(), ""))
    table = parameter(f"'{writes}'", lower, upper, more or f"value = {(lower + upper) / 2}")
    return load_robot(made(folder, ROBOT, RECORDINGS, table, model=text))


TOOL, HULL = 'geom "tool" mass', 'body "base" diaginertia[0]'


@pytest.mark.filterwarnings("ignore:compiler attribute")  # which MuJoCo 4 deprecates
@pytest.mark.parametrize(("writes", "lower", "upper", "places", "names"), [
    (TOOL, 0.05, 0.3, {"compiler": 'settotalmass="0.6"'}, ['compiler has settotalmass="0.6"']),
    (TOOL, 0.05, 0.3, {"compiler": 'boundmass="0.6"'}, ['compiler has boundmass="0.6"']),
    (TOOL, 0.05, 0.3, {"compiler": 'boundmass="5"'}, ['compiler has boundmass="5"']),
    (TOOL, 0.05, 0.3, {"compiler": 'boundinertia="0.01"'}, ['compiler has boundinertia="0.01"']),
    (TOOL, 0.05, 0.3, {"compiler": 'settotalmass="1" boundmass="0.6"'}, ["boundmass", " and ", "settotalmass"]),
    (TOOL, 0.05, 0.3, {"compiler": 'inertiagrouprange="0 2"', "geom": 'group="3"'}, ['inertiagrouprange="0 2"']),
    ('geom "cork" density', 100, 900, {"compiler": 'settotalmass="0.6"'}, ["settotalmass"]),
    ('geom "tool" density', 100, 900, {}, ["geom 'tool' has mass=\"0.1\""]),
    ('body "base" mass', 0.1, 0.9, {"compiler": 'inertiafromgeom="true"'}, ['inertiafromgeom="true"']),
    ('body "base" mass', 0.1, 0.9, {"compiler": 'settotalmass="2"'}, ["settotalmass"]),
    (HULL, 1e-4, 1e-3, {"compiler": 'balanceinertia="true"'}, ['balanceinertia="true"']),
    (HULL, 9e-4, 2e-3, {"compiler": 'boundinertia="0.001"'}, ['boundinertia="0.001"']),
    ('joint "hip" damping', 0.01, 1.0, {"joint": 'springdamper="0.1 1"'}, ['springdamper="0.1 1"']),
    ('geom "rod" size[1]', 0.01, 0.2, {}, ["geom 'rod' has fromto=\"0 0 0 0 0 0.2\""]),
    ('actuator "servo" ctrlrange[1]', 0.1, 2.0, {"actuator": 'inheritrange="1"'}, ['inheritrange="1"']),
])  # fmt: skip
def test_what_the_model_undoes_is_refused_with_the_setting(tmp_path, writes, lower, upper, places, names):
    robot = robot_of(tmp_path, writes, lower, upper, **places)
    said = refusal(RobotError, check_targets, robot)
    assert says(said, "robot 'arm': x: the compiled model doesn't have what it writes to", *names, "out of the model")
    assert model_effects(robot)[0].undone is not None


@pytest.mark.parametrize("degrees", [True, False])
@pytest.mark.parametrize(
    ("writes", "lower", "upper"),
    [
        (TOOL, 0.05, 0.3), ('geom "tool", "rod" mass', 0.05, 0.3), ('geom "cork" density', 100, 900),
        ('geom "cut" mass', 0.001, 1.0), ('geom "cut" pos[0]', -0.1, 0.1), ('geom "cork" quat[1]', 0.1, 0.5),
        ('body "base" mass', 0.1, 0.9), (HULL, 1e-3, 2e-3), ('body "link" pos[2]', 0.1, 0.3),
        ('body "base" pos[0]', -0.1, 0.1), ('joint "knee" range[1]', 0.5, 1.5), ('joint "knee" springref', -0.5, 0.5),
        ('joint "knee" ref', -0.5, 0.5), ('joint "hip", "knee" damping', 0.1, 2.0), ('joint "knee" axis[0]', -0.2, 0.2),
        ('tendon "cable" springlength[1]', 0.1, 0.3), ('equality "gear" polycoef[1]', -1, 1),
        ('actuator "servo" kp', 1, 9), ('actuator "servo" kv', 0.1, 0.9), ('actuator "torque" gear[0]', 1, 9),
        ("option density", 0, 1000), ("option gravity[2]", -10, -9), ('mesh "wedge" scale[0]', 0.5, 2),
        ('geom "tool" friction[0]', 0.1, 2),
    ],
)  # fmt: skip
def test_what_a_model_has_as_written_or_only_transforms_is_taken(tmp_path, degrees, writes, lower, upper):
    usual = 'balanceinertia="true" autolimits="true" boundmass="1e-6" boundinertia="1e-12"'
    robot = robot_of(tmp_path, writes, lower, upper, compiler=usual)
    assert undone(robot, robot.space["x"]) is None


@settings(max_examples=15, deadline=None)
@given(bound=st.floats(0.05, 1.0), lower=st.floats(0.01, 0.9), relative=st.booleans(), target=st.sampled_from("bg"))
def test_a_bound_on_masses_is_named_exactly_where_it_counts(tmp_path_factory, bound, lower, relative, target):
    mass, rest = (0.5, 0.0) if target == "b" else (0.1, 0.2 + 0.01 + 300 * 0.02 * 0.04 * 0.06)
    place = 'body "base" mass' if target == "b" else TOOL
    upper, text = lower + 1.0, f"{{to = '{place}', relative = {str(relative).lower()}}}"
    table = parameter(text, lower, upper, f"value = {lower + 0.5}")
    model = LINKS.replace("COMPILER", f'boundmass="{bound}"')
    for word in ("JOINT", "GEOM", "ACTUATOR"):
        model = model.replace(word, "")
    robot = load_robot(made(tmp_path_factory.mktemp("robot"), ROBOT, RECORDINGS, table, model=model))
    least = rest + lower * (mass if relative else 1.0)
    said = undone(robot, robot.space["x"])
    assert (said is not None and "boundmass" in said) == (least < bound)
