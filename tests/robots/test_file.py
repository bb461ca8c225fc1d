import os
import pickle
import textwrap
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from made_robots import ARM, DAMPING, RECORDINGS, ROBOT, made, made_of_files, parameter
from refused import refusal, says
from swim2real.robots import load_robot, robot_file
from swim2real.robots.drives import SPEED, TABLE, Drive
from swim2real.robots.file import open_robot_file
from swim2real.robots.fish import FISH, FISH_EXTENDED
from swim2real.robots.robot import Sensor
from swimbase.errors import ArgumentError, RobotError

WHOLE = (ROBOT, RECORDINGS, DAMPING)
SWIMMER = """
<mujoco>
  <worldbody>
    <body name="hull">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <geom size="0.1"/><site name="nose"/><site name="stern" pos="0.2 0 0"/>
      <body><joint name="crank" axis="0 0 1"/><geom size="0.02" pos="0.05 0 0"/></body>
    </body>
  </worldbody>
  <actuator><velocity name="crank" joint="crank" kv="1"/></actuator>
  <sensor><jointpos joint="crank"/></sensor>
</mujoco>
"""
SWIMS = """
[swims]
surge_joints = ["x", "y"]
motor_joint = "crank"
tail_markers = ["stern"]
"""
SWIMMING = ROBOT.replace('["base", "elbow", "tip"]', '["nose", "stern"]').replace('"side"', '"above"')


def refused(place) -> str:
    """The message with which a robot file is refused."""
    return refusal(RobotError, load_robot, place, allow_code=True)


def test_a_small_file_makes_a_robot(tmp_path):
    place = made(tmp_path, *WHOLE)
    robot = load_robot(place)
    assert (robot.name, robot.description, robot.source) == ("arm", "An arm of two links.", place)
    assert robot.marker_names == ("base", "elbow", "tip")
    assert robot.links == ((0, 1), (1, 2))
    assert robot.plane == (0, 2)
    np.testing.assert_allclose(robot.rest_markers, [[0, 0], [0.1, 0], [0.2, 0]])
    np.testing.assert_allclose(robot.marker_heights, 0)
    assert not robot.rest_markers.flags.writeable
    parameter = robot.space["damping"]
    assert (parameter.unit, parameter.lower, parameter.upper, parameter.log_offset) == ("N·m·s/rad", 1e-3, 1.0, 0.0)
    assert parameter.published == 0.02
    recordings = robot.recordings
    assert (recordings.controls, recordings.sensors, recordings.start) == ({}, (), "rest")
    assert (recordings.frame, recordings.score_progress) == (None, False)


def test_the_spec_has_the_models_sensors_and_then_the_markers(tmp_path):
    robot = load_robot(made(tmp_path, *WHOLE))
    model = robot.build({"damping": 0.5}).compile()
    assert [model.sensor(i).name for i in range(model.nsensor)] == [
        "angle", "imu", "marker:base", "marker:elbow", "marker:tip"
    ]  # fmt: skip
    np.testing.assert_array_equal(model.dof_damping.reshape(2, -1)[:, 0], [0.5, 0.5])
    assert model.nkey == 2
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.sensordata[-9:], [0, 0, 0, 0.1, 0, 0, 0.2, 0, 0], atol=1e-12)


def test_building_leaves_no_trace_and_tracking_takes_the_lengths_that_parameters_set(tmp_path):
    robot = load_robot(made(tmp_path, *WHOLE))
    before = robot.build(robot.space.published).to_xml()
    robot.build({"damping": 1.0})
    assert robot.build(robot.space.published).to_xml() == before
    longer = parameter("'body \"lower\" pos[0]'", more="value = 0.3")
    tracked = load_robot(made(tmp_path, ROBOT, RECORDINGS, longer), markers_only=True)
    np.testing.assert_allclose(tracked.rest_markers[:, 0], [0, 0.1, 0.4])


@pytest.mark.parametrize(("camera", "plane", "rest", "heights"), [
    ("above", (0, 1), [[0, 0], [1, 2]], [0, 3]),
    ("side", (0, 2), [[0, 0], [1, 3]], [0, -2]),
    ("front", (1, 2), [[0, 0], [2, 3]], [0, 1]),
])  # fmt: skip
def test_the_camera_decides_the_plane(tmp_path, camera, plane, rest, heights):
    model = ARM.replace('<site name="tip" pos="0.1 0 0"/>', '<site name="tip" pos="0.9 2 3"/>')
    text = ROBOT.replace('"side"', f'"{camera}"').replace('"elbow", ', "")
    robot = load_robot(made(tmp_path, text, RECORDINGS, DAMPING, model=model))
    assert robot.plane == plane
    np.testing.assert_allclose(robot.rest_markers, rest)
    np.testing.assert_allclose(robot.marker_heights, heights)


def test_markers_may_have_other_names_and_rest_elsewhere(tmp_path):
    text = ROBOT.replace(
        '["base", "elbow", "tip"]', '[{site = "base", name = "B"}, {site = "tip", name = "T", rest = [0.21, 0]}]'
    )
    robot = load_robot(made(tmp_path, text, 'links = [["T", "B"]]\n', RECORDINGS, DAMPING))
    assert robot.marker_names == ("B", "T")
    assert robot.links == ((1, 0),)
    np.testing.assert_allclose(robot.rest_markers, [[0, 0], [0.21, 0]])
    model = robot.build(robot.space.published).compile()
    assert [model.sensor(i).name for i in range(2, 4)] == ["marker:B", "marker:T"]


def test_controls_sensors_start_and_frame_of_recordings(tmp_path):
    about = """
    [recordings]
    start = "up"
    frame = ["base", "tip"]
    score_progress = true
    [recordings.controls]
    servo = "table"
    motor = "frequency"
    torque = 0.5
    damped = {amplitude = 0.2, phase = 1.5, offset = 0.1}
    [recordings.sensors]
    angle = {unit = "rad", meters_per_unit = 0.1}
    "imu[2]" = {unit = "m/s²", meters_per_unit = 0.001}
    """
    recordings = load_robot(made(tmp_path, ROBOT, textwrap.dedent(about), DAMPING)).recordings
    assert recordings.controls == {
        "servo": TABLE, "motor": SPEED, "torque": Drive(offset=0.5), "damped": Drive(0.2, 1.5, 0.1)
    }  # fmt: skip
    assert recordings.sensors == (Sensor("angle", "rad", 0.1, turn=2 * np.pi), Sensor("imu[2]", "m/s²", 0.001))
    assert (recordings.start, recordings.frame, recordings.score_progress) == ("up", (0, 2), True)


@pytest.mark.parametrize(("said", "factor", "turn", "wraps"), [
    ("unit = 'deg'", 180 / np.pi, 360.0, False),
    ("unit = 'mrad'", 1e3, 2e3 * np.pi, False),
    ("unit = 'rev', range = [0, 1]", 0.5 / np.pi, 1.0, True),
    ("range = [-2048, 2047]", 1.0, 4095.0, True),
])  # fmt: skip
def test_a_unit_converts_and_a_range_is_a_turn(tmp_path, said, factor, turn, wraps):
    text = RECORDINGS + f"[recordings.sensors]\nangle = {{{said}, meters_per_unit = 0.1}}\n"
    (sensor,) = load_robot(made(tmp_path, ROBOT, text, DAMPING)).recordings.sensors
    assert (sensor.factor, sensor.turn, sensor.wraps) == (pytest.approx(factor), pytest.approx(turn), wraps)


def test_one_value_goes_to_several_places_each_in_its_own_way(tmp_path):
    targets = """[
      'joint "link0" damping', {to = 'joint "link1" damping', factor = 0.5, offset = 0.1},
      {to = 'body "lower" mass', factor = 5.0, relative = true},
    ]"""
    robot = load_robot(made(tmp_path, ROBOT, RECORDINGS, parameter(targets, more="value = 0.2")))
    model = robot.build({"x": 0.4}).compile()
    np.testing.assert_allclose(model.dof_damping.reshape(2, -1)[:, 0], [0.4, 0.3])
    assert model.body("lower").mass == pytest.approx(0.4)


@pytest.mark.parametrize("folder", ["", "models"])
def test_meshes_and_included_files_are_found_from_anywhere(tmp_path, monkeypatch, folder):
    text = ROBOT.replace("arm.xml", f"{folder}/arm.xml".lstrip("/"))
    scale = parameter("'mesh \"fin\" scale[0]'")
    place = made_of_files(tmp_path / "robots", text, RECORDINGS, scale, models=folder)
    monkeypatch.chdir(tmp_path)
    robot = load_robot(os.path.relpath(place))
    monkeypatch.chdir("/")
    model = robot.build({"x": 0.3}).compile()
    edges = np.linalg.norm(model.mesh_vert[:, None] - model.mesh_vert, axis=2)
    assert edges.max() == pytest.approx(np.hypot(0.3, 0.1), rel=1e-5)  # only its x is scaled


def test_a_model_may_come_from_a_function_beside_the_file_with_hooks_of_its_own(tmp_path):
    code = """
    from __future__ import annotations
    import mujoco
    from dataclasses import dataclass
    @dataclass
    class Plan:
        stages: tuple = ()
    SPEC = mujoco.MjSpec.from_string('''MODEL''')
    def model(): return SPEC
    def plan(): return Plan()
    """
    text = SWIMMING.replace('"arm.xml"', '"python:robot.py:model"')
    place = made(
        tmp_path, text, SWIMS, 'fit_plan = "python:robot.py:plan"\n',
        parameter("'joint \"crank\" armature'", 0.0, 1.0),
    )  # fmt: skip
    (tmp_path / "robot.py").write_text(textwrap.dedent(code).replace("MODEL", SWIMMER))
    for _ in range(2):  # the function may return the same spec again
        robot = load_robot(place, allow_code=True)
        assert type(robot.swims.fit_plan).__name__ == "Plan"
        assert robot.build({"x": 0.5}).compile().dof_armature[2] == 0.5


def test_no_parameter_and_no_hook_keeps_a_robot_from_being_tracked(tmp_path):
    hooks = 'response = "python:nowhere:answer"\n'
    policy = '[policy.actuators]\nwinch = {lower = 0, upper = 1, rate = 1, unit = "m"}\n'
    damping = parameter("'joint \"crank\" damping'", more="value = 0.5").replace('"x"', '"good"')
    wrong = [
        parameter("'joint \"tail\" damping'"),  # there is no such joint
        parameter("'body \"hull\" pos[0]'", 1.0, 2.0),  # the model's 0 is out of bounds
        parameter("'joint \"crank\" damping'", 0.2, 0.1),
        '[[parameters]]\nname = "nothing"\n',
        parameter("'joint \"crank\" armature'", -1.0, 1.0),
        damping,  # a second time
    ]
    place = made(tmp_path, SWIMMING, SWIMS, hooks, policy, damping, *wrong, model=SWIMMER)
    with pytest.raises(RobotError):
        load_robot(place)
    robot = load_robot(place, markers_only=True)
    assert robot.space.published == {"good": 0.5}
    assert robot.build({"good": 0.7}).compile().dof_damping.reshape(3, -1)[2, 0] == 0.7
    np.testing.assert_allclose(robot.rest_markers, [[0, 0], [0.2, 0]])
    copy = pickle.loads(pickle.dumps(robot))  # as it goes to a process that tracks a film
    assert copy.layout.rigid == robot.layout.rigid == (0, 1)


def test_where_a_value_keeps_the_model_from_compiling_the_models_own_count(tmp_path):
    light = parameter("'body \"lower\" mass'", 0.0, 1.0, "value = 0.0")
    place = made(tmp_path, ROBOT, RECORDINGS, light)
    assert "doesn't compile" in refused(place)
    robot = load_robot(place, markers_only=True)
    assert (len(robot.space), robot.marker_names) == (0, ("base", "elbow", "tip"))
    assert robot.build({}).compile().body("lower").mass == pytest.approx(0.2)
    wrong = made(tmp_path, ROBOT.replace('"tip"', '"thumb"'), RECORDINGS, DAMPING)
    assert says(refusal(RobotError, load_robot, wrong, markers_only=True), "'markers' is 'thumb'", "a site")


def test_a_file_takes_over_what_it_does_not_say(tmp_path):
    text = SWIMMING.replace('"arm.xml"', '"python:robot.py:model"')
    hook = 'response = "python:robot.py:answer"\n'
    base = made(tmp_path / "base", text, SWIMS, hook, parameter("'option density'", 0, 9))
    (base.parent / "robot.py").write_text(
        f"import mujoco\ndef model(): return mujoco.MjSpec.from_string('''{SWIMMER}''')\ndef answer(): return 42\n"
    )
    place = tmp_path / "loaded.toml"
    more = 'extends = "base/arm.toml"\nname = "arm, loaded"\n[swims]\ntail_markers = ["nose"]\n'
    changed = '[[parameters]]\nname = "x"\nupper = 8.0\n'
    place.write_text(more + changed + parameter("'option viscosity'", 0.0).replace('"x"', '"y"'))
    robot, plain = (load_robot(one, allow_code=True) for one in (place, base))
    assert (robot.name, robot.description) == ("arm, loaded", plain.description)
    assert robot.space.names == ("x", "y")
    assert robot.space["x"] == replace(plain.space["x"], upper=8.0)
    assert (robot.swims.tail_markers, plain.swims.tail_markers) == ((0,), (1,))
    assert (robot.swims.response, plain.swims.response) == (None, 42)  # which was measured without the parameter y
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.toml").write_text(f'extends = "{other}.toml"\n')
    assert says(refused(tmp_path / "a.toml"), f"'{tmp_path / 'b.toml'}'", "'extends' is 'a.toml'")
    assert says(refused(tmp_path / "none.toml"), "is not there", "swim2real init")
    for content in (b"name = ", b"\xff"):
        place.write_bytes(content)
        assert "can't be read as TOML: " in refused(place)


def test_robots_are_found_by_name_or_file(tmp_path):
    place = made(tmp_path, *WHOLE)
    assert load_robot(place).name == load_robot(str(place)).name == "arm"
    assert load_robot("fish") is FISH
    assert load_robot("fish-extended") is FISH_EXTENDED
    assert says(refusal(ArgumentError, load_robot, "finch"), "'finch'", "fish, fish-extended", ".toml")
    file = open_robot_file(robot_file("fish-extended"))  # the fish has a robot file, too
    assert len(file.calibrated) == 18
    assert [target.line for target in file.calibrated[-1].targets] == ['joint "slide_x", "slide_y" damping']
    assert robot_file("other.toml").name == "other.toml"


@pytest.mark.parametrize(("old", "new", "parts"), [
    ("format = 1", "format = 2", ["'format' is 2", "must be 1"]),
    ('"side"', '"below"', ["'camera' is \"below\"", "'above', 'side' or 'front'"]),
    ('name = "arm"', 'name = " "', ["'name'", "blank"]),
    ('"arm.xml"', '"leg.xml"', ["FOLDER/leg.xml' is not there", "give the MJCF file's path"]),
    ('"arm.xml"', '"arm.toml"', ["MuJoCo can't read model 'FOLDER/arm.toml'"]),
    ('"arm.xml"', '"python:arm"', ["'model' is 'python:arm'", "python:MODULE:FUNCTION"]),
    ('"tip"]', '"toe"]', ["'markers' is 'toe'", "base, elbow, tip"]),
    ('"tip"]', '"base"]', ["'markers' has 'base' twice"]),
    ('["base", "elbow", "tip"]', "[]", ["there are neither 'markers' nor [recordings.sensors]"]),
    ('"tip"]', '{site = "tip", rest = [1, "2"]}]', ["'markers[2].rest[1]' is \"2\"", "a number"]),
    ('"tip"]', '"tip"]\nlinks = [["tip", "toe"]]', ["'links' is 'toe'", "base, elbow, tip"]),
    ("[recordings]", "", ["[recordings]", "[swims]", "neither"]),
    ("[recordings]", SWIMS + "[recordings]", ["[recordings]", "[swims]", "both"]),
    ("[recordings]", '[recordings]\nstart = "left"', ["'start' is 'left'", "rest, markers, fitted, up, down"]),
    ("[recordings]", '[recordings]\nframe = ["tip", "tip"]', ["'frame'", "two different markers"]),
    ("[recordings]", "[recordings]\nscore_progress = true", ["'score_progress'", "needs 'frame'"]),
    ("[recordings]", '[recordings.controls]\nmoter = "table"', ["'moter'", "servo, motor, torque, damped, law"]),
    ("[recordings]", '[recordings.controls]\nmotor = "tables"',
     ["'recordings.controls.motor' is \"tables\"", "'interpolated table' or 'frequency'"]),
    ("[recordings]", "[recordings.sensors]\nload = {meters_per_unit = 1}", ["no sensor 'load'", "angle, imu"]),
    ("[recordings]", "[recordings.sensors]\nimu = {meters_per_unit = 1}", ["'imu' has 3", '"imu[0]" to "imu[2]"']),
    ("[recordings]", "[recordings.sensors]\nangle = {unit = 'V', meters_per_unit = 1}",
     ["'unit' of sensor 'angle' is 'V'", "in rad", "rev, deg, °, rad, mrad"]),
    ("[recordings]", "[recordings.sensors]\nangle = {range = [360, 0], meters_per_unit = 1}",
     ["angle.range': it is [360.0, 0.0]", "below the second"]),
    (DAMPING, DAMPING * 2, ["two parameters are named 'damping'"]),
    ("meaning", "meanings", ["parameter 'damping'", "'meanings'", "did you mean 'meaning'?"]),
    ("upper = 1.0", "upper = 0.02\nvalue = 0.03", ["'damping' is 0.03", "0.001 to 0.02 N·m·s/rad"]),
    ("upper = 1.0", "upper = 1e-4", ["parameter 'damping'", "0.001 is above upper bound 0.0001", "swap them"]),
    ("lower = 1e-3", "lower = 0", ["lower bound 0.0 plus log offset 0.0 must be above 0"]),
    ("lower = 1e-3", "lower = -1", ["-1 would write -1 to joint \"link*\" damping", "change the bound"]),
    ("'joint \"link*\" damping'", "{to = 'option density', factor = 0}", ["'factor' is 0", "changes nothing"]),
    ("link*", "leg", ["parameter 'damping'", "no joint 'leg'", "link0, link1"]),
    ("joint \"link*\" damping", 'geom "rod1" mass', ["sets no number there", "value = …"]),
    ("joint \"link*\" damping", 'joint "link*" stiffness', ["several numbers there (2, 3)", "value = …"]),
    ("joint \"link*\" damping", 'joint "link0" range[1]', ["'damping' is 60", "the model's own value"]),
])  # fmt: skip
def test_what_is_wrong_is_named_with_its_value_and_what_is_allowed(tmp_path, old, new, parts):
    text = "".join(WHOLE)
    assert old in text
    place = made(tmp_path, text.replace(old, new, 1))
    message = refused(place).replace(str(tmp_path), "FOLDER")
    assert message.startswith("robot file 'FOLDER/arm.toml'")
    assert "\n" not in message
    assert [part for part in parts if part not in message] == [], message


@pytest.mark.parametrize(("old", "new", "parts"), [
    ('"x", "y"', '"x", "z"', ["'surge_joints' is 'z'", "x, y, crank"]),
    ('motor_joint = "crank"', 'motor_joint = "motor"', ["'motor_joint' is 'motor'", "x, y, crank"]),
    ('motor_joint = "crank"', "", ["'motor_joint'", "'servo'", "neither"]),
    ('motor_joint = "crank"', 'motor_joint = "crank"\nservo = {amplitude = 1.0}', ["'servo'", "both"]),
    ('["stern"]', '["tail"]', ["'tail_markers' is 'tail'", "nose, stern"]),
    ('["nose", "stern"]', '["stern"]', ["there is one marker", "need two"]),
    ('"arm.xml"', '"two.xml"', ["the model has 2 actuators", "use [recordings]"]),
    ("[swims]", '[swims]\nfit_plan = "plan"', ["'swims.fit_plan'", "'plan'", "python:FILE.py:FUNCTION"]),
    ("[swims]", '[swims]\nresponse = "python:nowhere:answer"', ["'response'", "No module named 'nowhere'"]),
    ("[swims]", '[swims]\nresponse = "python:json:decoder"', ["'response'", "must name a function"]),
    ("[swims]", '[swims]\nresponse = "python:json:loads"', ["'response'", "failed: TypeError"]),
    ('"arm.xml"', '"python:json:JSONDecoder"', ["'model'", "an MjSpec, not JSONDecoder"]),
    ('"arm.xml"', '"python:broken.py:model"', ["'model'", "can't be imported: SyntaxError"]),
])  # fmt: skip
def test_what_is_wrong_with_swims_is_named(tmp_path, old, new, parts):
    text = SWIMMING + SWIMS + parameter("'joint \"crank\" armature'", 0.0, 1.0)
    assert old in text
    (tmp_path / "broken.py").write_text("def :")
    (tmp_path / "two.xml").write_text(SWIMMER.replace("</actuator>", '<motor joint="x"/></actuator>'))
    message = refused(made(tmp_path, text.replace(old, new, 1), model=SWIMMER))
    assert [part for part in parts if part not in message] == [], message
