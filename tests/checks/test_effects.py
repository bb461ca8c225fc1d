from dataclasses import replace

import pytest

from made_robots import ARM, RECORDINGS, ROBOT, made, parameter
from refused import refusal, says
from swim2real.checks.effects import model_effects, why_no_effect
from swim2real.robots import load_robot
from swim2real.robots.file import open_robot_file
from swimbase.errors import RobotError


def second(text: str) -> str:
    return text.replace('"x"', '"y"')


def test_a_parameter_reaches_the_model_or_does_not(tmp_path):
    mass = second(parameter("'body \"upper\" mass'", 0.1, 1.0, "value = 0.1"))
    angle = parameter("'joint \"link0\" range[0]'", -40.0, 70.0).replace('"x"', '"z"')
    robot = load_robot(made(tmp_path, ROBOT, RECORDINGS, parameter("'joint \"link0\" damping'"), mass, angle))
    first, other, last = model_effects(robot)
    assert (first.parameter.name, first.lower, first.upper, first.changes) == ("x", None, None, True)
    assert (other.parameter.name, other.lower, other.upper, other.changes) == ("y", None, None, False)
    assert (last.lower, last.changes) == (None, True)
    assert says(last.upper, "robot 'arm', z = 70", "doesn't compile", "range[0] should be smaller")
    broken = robot.build(robot.space.published)
    broken.joint("link0").range = [2.0, 1.0]
    said = refusal(RobotError, model_effects, replace(robot, build=lambda values: broken.copy()))
    assert says(said, "robot 'arm'", "doesn't compile")


NO_CONTACT = ARM.replace("<option", '<option><flag contact="disable" frictionloss="disable"/></option><option')


@pytest.mark.parametrize(("writes", "model", "says"), [
    ("body \"upper\" mass", ARM, "body 'upper' has no <inertial>, so its mass comes from its geoms"),
    ("geom \"rod1\" mass", ARM, "body 'lower' has an <inertial>, which counts instead of geom 'rod1'"),
    ("geom \"rod0\" fluidcoef[0]", ARM, "geom 'rod0' has no fluidshape=\"ellipsoid\""),
    ("geom class \"wet\" fluidcoef[0]", ARM.replace('density="1000"', 'density="0"'),
     "option density is 0, so there is no fluid"),
    ("geom \"rod1\" friction[0]", ARM.replace('name="rod1"', 'name="rod1" contype="0" conaffinity="0"'),
     "geom 'rod1' touches nothing, since its contype and conaffinity are 0"),
    ("geom \"rod1\" friction[0]", NO_CONTACT, "the flag contact of the model's option is off"),
    ("joint \"link0\" frictionloss", NO_CONTACT, "the flag frictionloss of the model's option is off"),
    ("joint \"link1\" springref", ARM.replace('stiffness="2"', ""), "joint 'link1' has no stiffness"),
    ("joint \"link1\" range[1]", ARM, "joint 'link1' has no limits"),
    ("tendon \"cable\" springlength[1]", ARM.replace('stiffness="40"', ""), "tendon 'cable' has no stiffness"),
    ("actuator \"torque\" gear[0]", ARM, "no control drives actuator 'torque'"),
    ("equality \"gear\" polycoef[1]", ARM, "equality 'gear' isn't active"),
    ("joint \"link0\" damping", ARM, None),
    ("option density", ARM, None),
])  # fmt: skip
def test_why_a_parameter_changes_nothing_is_told(tmp_path, writes, model, says):
    place = made(tmp_path, ROBOT, RECORDINGS, parameter(f"'{writes}'", more="value = 1.0"), model=model)
    assert why_no_effect(open_robot_file(place), load_robot(place), "x") == says


def test_what_is_fixed_or_commanded_0_changes_nothing(tmp_path):
    fixed = '<body name="post"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><geom name="post" size="1"/></body>'
    model = ARM.replace("<worldbody>", f"<worldbody>{fixed}")
    place = made(tmp_path, ROBOT, RECORDINGS, parameter("'body \"post\" mass'"), model=model)
    assert why_no_effect(open_robot_file(place), load_robot(place), "x") == "body 'post' is fixed to the world"
    gear = parameter("'actuator \"torque\" gear[0]'")
    for control, why in (("0", "no control drives actuator 'torque'"), ('"table"', None)):
        place = made(tmp_path, ROBOT, f"[recordings.controls]\ntorque = {control}\n", gear)
        assert why_no_effect(open_robot_file(place), load_robot(place), "x") == why


def test_a_number_that_another_parameter_replaces_is_told(tmp_path):
    one, two = parameter("'joint \"link0\" damping'"), parameter("'joint \"link*\" damping'")
    place = made(tmp_path, ROBOT, RECORDINGS, one, second(two))
    file, robot = open_robot_file(place), load_robot(place)
    assert why_no_effect(file, robot, "x") == "parameter 'y' writes to the same place after it"
    assert why_no_effect(file, robot, "y") is None
    relative = parameter("{to = 'joint \"link0\" damping', relative = true}", 0.1, 2.0)
    place = made(tmp_path, ROBOT, RECORDINGS, one, second(relative))
    assert why_no_effect(open_robot_file(place), load_robot(place), "x") is None
