import os
import textwrap

import mujoco
import numpy as np
import pytest

from made_robots import ARM, DAMPING, RECORDINGS, ROBOT, made, parameter
from swim2real.errors import ArgumentError, ParameterError, RobotError
from swim2real.robots import robot_file, robot_named
from swim2real.robots.file import load_robot, open_robot_file
from swim2real.robots.robot import Sensor, Sine

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
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MESHED = ARM.replace("<option", '<compiler meshdir="parts"/><option', 1).replace(
    "<worldbody>",
    '<asset><mesh name="fin" file="fin.obj" scale="0.1 0.1 0.1"/></asset><worldbody><include file="rest.xml"/>',
)
INCLUDED = '<mujocoinclude><body name="fin"><geom name="fin" type="mesh" mesh="fin"/></body></mujocoinclude>'


def sentence(place) -> str:
    """What is said of a robot file, without where it is."""
    with pytest.raises(RobotError) as caught:
        load_robot(place)
    return str(caught.value).replace(f"robot file '{place}'", "FILE")


# what a file says


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


def test_building_checks_the_values_and_leaves_no_trace(tmp_path):
    robot = load_robot(made(tmp_path, *WHOLE))
    before = robot.build(robot.space.published).to_xml()
    robot.build({"damping": 1.0})
    assert robot.build(robot.space.published).to_xml() == before
    with pytest.raises(ParameterError, match="out of bounds"):
        robot.build({"damping": 2.0})


@pytest.mark.parametrize(
    ("camera", "plane", "rest", "heights"),
    [
        ("above", (0, 1), [[0, 0], [1, 2]], [0, 3]),
        ("side", (0, 2), [[0, 0], [1, 3]], [0, -2]),
        ("front", (1, 2), [[0, 0], [2, 3]], [0, 1]),
    ],
)
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


def test_no_links_are_none(tmp_path):
    assert load_robot(made(tmp_path, ROBOT, "links = []\n", RECORDINGS, DAMPING)).links == ()


def test_controls_sensors_start_and_frame_of_recordings(tmp_path):
    about = """
    [recordings]
    start = "up"
    frame = ["base", "tip"]
    travels = true
    [recordings.controls]
    servo = "table"
    motor = "frequency"
    torque = 0.5
    damped = {amplitude = 0.2, phase = 1.5, offset = 0.1}
    [recordings.sensors]
    angle = {unit = "rad", worth = 0.1}
    "imu[2]" = {unit = "m/s²", worth = 0.001}
    """
    recordings = load_robot(made(tmp_path, ROBOT, textwrap.dedent(about), DAMPING)).recordings
    assert recordings.controls == {
        "servo": "table", "motor": "frequency", "torque": 0.5, "damped": Sine(0.2, 1.5, 0.1)
    }  # fmt: skip
    assert recordings.sensors == (Sensor("angle", "rad", 0.1), Sensor("imu[2]", "m/s²", 0.001))
    assert (recordings.start, recordings.frame, recordings.score_progress) == ("up", (0, 2), True)


def test_a_swimmer_has_its_markers_sensors_only(tmp_path):
    robot = load_robot(
        made(tmp_path, SWIMMING, SWIMS, parameter("'joint \"crank\" armature'"), "value = 0.01", model=SWIMMER)
    )
    assert (robot.swims.surge_joints, robot.swims.motor_joint, robot.swims.tail_markers) == (("x", "y"), "crank", (1,))
    model = robot.build(robot.space.published).compile()
    assert [model.sensor(i).name for i in range(model.nsensor)] == ["nose", "stern"]
    with pytest.raises(ArgumentError, match="are steady swims; this needs recordings"):
        _ = robot.recordings


# what parameters write


def test_one_value_goes_to_several_places_each_in_its_own_way(tmp_path):
    writes = """[
      'joint "link0" damping', {to = 'joint "link1" damping', factor = 0.5, offset = 0.1},
      {to = 'body "lower" mass', factor = 5.0, relative = true},
    ]"""
    robot = load_robot(made(tmp_path, ROBOT, RECORDINGS, parameter(writes, more="value = 0.2")))
    model = robot.build({"x": 0.4}).compile()
    np.testing.assert_allclose(model.dof_damping.reshape(2, -1)[:, 0], [0.4, 0.3])
    assert model.body("lower").mass == pytest.approx(0.4)


def test_both_gains_of_a_servo_can_be_parameters_down_to_0(tmp_path):
    first = parameter("'actuator \"servo\" kp'", 0.0, 10.0)
    second = parameter("'actuator \"servo\" kv'", 0.0, 1.0).replace('"x"', '"y"')
    for parts in ((first, second), (second, first)):
        robot = load_robot(made(tmp_path, ROBOT, RECORDINGS, *parts))
        assert robot.space.published == {"x": 5.0, "y": 0.3}
        servo = robot.build({"x": 0.0, "y": 0.5}).compile().actuator("servo")
        np.testing.assert_array_equal(servo.gainprm[:2], [0, 0])
        np.testing.assert_array_equal(servo.biasprm[:3], [0, 0, -0.5])


def test_a_parameter_has_the_models_value_where_its_places_agree(tmp_path):
    line = "['geom \"rod1\" fluidcoef[0]', {to = 'geom class \"wet\" fluidcoef[1]', factor = 0.5}]"
    assert load_robot(made(tmp_path, ROBOT, RECORDINGS, parameter(line))).space.published == {"x": 0.5}


@pytest.mark.parametrize("folder", ["", "models"])
def test_meshes_and_included_files_are_found_from_anywhere(tmp_path, monkeypatch, folder):
    text = ROBOT.replace("arm.xml", f"{folder}/arm.xml".lstrip("/"))
    place = made(tmp_path / "robots", text, RECORDINGS, parameter("'mesh \"fin\" scale[0]'"))
    models = place.parent / folder
    (models / "parts").mkdir(parents=True)
    (models / "arm.xml").write_text(MESHED)
    (models / "rest.xml").write_text(INCLUDED)
    (models / "parts" / "fin.obj").write_text(TETRAHEDRON)
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
        robot = load_robot(place)
        assert type(robot.swims.fit_plan).__name__ == "Plan"
        assert robot.build({"x": 0.5}).compile().dof_armature[2] == 0.5


# files that extend others


def test_a_file_takes_over_what_it_does_not_say(tmp_path):
    base = made(tmp_path / "base", ROBOT, RECORDINGS, 'start = "up"\ntravels = false\n', DAMPING)
    more = """
    extends = "base/arm.toml"
    name = "arm, loaded"
    [recordings]
    start = "down"
    """
    place = tmp_path / "loaded.toml"
    place.write_text(textwrap.dedent(more) + parameter("'body \"lower\" mass'"))
    robot = load_robot(place)
    assert (robot.name, robot.description) == ("arm, loaded", load_robot(base).description)
    assert robot.space.names == ("damping", "x")
    assert robot.recordings.start == "down"
    assert robot.build({"damping": 0.1, "x": 2.0}).compile().body("lower").mass == 2.0


def test_hooks_of_an_extended_file_are_beside_that_one(tmp_path):
    text = SWIMMING.replace('"arm.xml"', '"python:robot.py:model"')
    made(tmp_path / "base", text, SWIMS, 'response = "python:robot.py:answer"\n', parameter("'option density'", 0, 9))
    (tmp_path / "base" / "robot.py").write_text(
        f"import mujoco\ndef model(): return mujoco.MjSpec.from_string('''{SWIMMER}''')\ndef answer(): return 42\n"
    )
    place = tmp_path / "more.toml"
    place.write_text('extends = "base/arm.toml"\nname = "more"\n')
    assert load_robot(place).swims.response == 42


def test_files_that_extend_one_another_are_refused(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.toml").write_text(f'extends = "{other}.toml"\n')
    with pytest.raises(RobotError) as caught:
        load_robot(tmp_path / "a.toml")
    assert str(caught.value) == (
        f"robot file '{tmp_path / 'b.toml'}': extends is 'a.toml'; it must not lead back to the file itself"
    )


# robots by name


def test_robots_are_found_by_name_or_file(tmp_path):
    place = made(tmp_path, *WHOLE)
    assert robot_named(place).name == "arm"
    assert robot_named(str(place)).name == "arm"
    assert robot_named("fish").name == "fish"
    with pytest.raises(ArgumentError) as caught:
        robot_named("finch")
    assert str(caught.value) == "there is no robot 'finch'; there are fish, fish-extended, or give a robot file (.toml)"


def test_the_fish_has_a_robot_file_too():
    file = open_robot_file(robot_file("fish-extended"))
    assert len(file.calibrated) == 17
    assert [write.line for write in file.calibrated[-1].writes] == ['joint "slide_x", "slide_y" frictionloss']
    assert robot_file("other.toml").name == "other.toml"


# what is refused


def test_a_file_that_is_not_there_or_no_toml(tmp_path):
    place = tmp_path / "arm.toml"
    assert sentence(place) == "FILE is not there; `swim2real init MODEL.xml` writes one"
    place.write_text("name = ")
    assert sentence(place).startswith("FILE can't be read as TOML: Invalid value (at end of document)")
    place.write_bytes(b"\xff")
    assert sentence(place).startswith("FILE can't be read as TOML: 'utf-8' codec can't decode")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("format = 1", "format = 2", "FILE: format is 2; it must be 1 for this version"),
        ("format = 1", "", "FILE: format is None; it must be 1 for this version"),
        (
            "camera", "camara",
            "FILE: 'camara' means nothing here; did you mean 'camera'? there are format, extends, name, description, "
            "model, camera, markers, links, recordings, swims, parameters",
        ),
        ('"side"', '"below"', "FILE: camera is 'below'; it must be one of above, side, front"),
        ('name = "arm"', "", "FILE: name is missing"),
        ('name = "arm"', 'name = " "', "FILE: name is ' '; it must be a text"),
        ('"arm.xml"', "3", "FILE: model is 3; it must be a text"),
        ('"arm.xml"', '"leg.xml"', "FILE: model 'FOLDER/leg.xml' is not there; give the MJCF file's way from the robot "
         "file"),
        ('"arm.xml"', '"arm.toml"', None),
        ('"tip"]', '"toe"]', "FILE, markers: the model has no site 'toe'; there are base, elbow, tip"),
        ('"tip"]', '"base"]', "FILE: markers is ['base', 'elbow', 'base']; it must name one site at least, each once; "
         "there are base, elbow, tip"),
        ('["base", "elbow", "tip"]', "[]", "FILE: markers is []; it must name one site at least, each once; there are "
         "base, elbow, tip"),
        ('"tip"]', '{site = "tip", rest = [1]}]', "FILE, markers: rest is [1]; it must be 2 finite numbers, in m from "
         "the first marker"),
        ('"tip"]', '{site = "tip", rest = [1, "2"]}]', "FILE, markers: rest is [1, '2']; it must be 2 finite numbers, "
         "in m from the first marker"),
        ('"tip"]', '{site = "tip", at = 1}]', "FILE, markers: 'at' means nothing here; there are site, name, rest"),
        ('"tip"]', '"tip"]\nlinks = [["tip"]]', "FILE: links is ['tip']; it must be pairs of markers"),
        ('"tip"]', '"tip"]\nlinks = [["tip", "toe"]]', "FILE: links is 'toe'; it must be a marker: base, elbow, tip"),
        ('"tip"]', '"tip"]\nlinks = 3', "FILE: links is 3; it must be a list"),
        ("[recordings]", "", "FILE: there must be [recordings], for trials that are played back, or [swims], for a "
         "motor that turns at a constant speed; found neither"),
        ("[recordings]", "[swims]\n[recordings]", "FILE: there must be [recordings], for trials that are played back, "
         "or [swims], for a motor that turns at a constant speed; found recordings and swims"),
        ("[recordings]", "[recordings]\nstop = 1", "FILE, [recordings]: 'stop' means nothing here; there are controls, "
         "sensors, start, frame, travels"),
        ("[recordings]", '[recordings]\nstart = "left"', "FILE, [recordings]: start is 'left'; it must be one of rest, "
         "markers, up, down"),
        ("[recordings]", '[recordings]\nframe = ["base"]', "FILE, [recordings]: frame is ['base']; it must be a list "
         "of 2 names"),
        ("[recordings]", '[recordings]\nframe = ["tip", "tip"]', "FILE, [recordings]: frame is ['tip', 'tip']; it must "
         "be two different markers"),
        ("[recordings]", '[recordings]\ntravels = true', "FILE, [recordings]: travels is True; it needs frame, the two "
         "markers that say where it points"),
        ("[recordings]", '[recordings]\ntravels = 1', "FILE, [recordings]: travels is 1; it must be true or false"),
        ("[recordings]", "[recordings]\ncontrols = 1", "FILE, [recordings]: controls is 1; it must be a table, "
         "[controls]"),
        ("[recordings]", '[recordings.controls]\nmoter = "table"', "FILE, [recordings], [controls]: the model has no "
         "actuator 'moter'; there are servo, motor, torque, damped, law"),
        ("[recordings]", '[recordings.controls]\nmotor = "tables"', "FILE, [recordings], [controls]: motor is "
         "'tables'; it must be \"table\", \"frequency\", a number, or {amplitude = …}"),
        ("[recordings]", "[recordings.controls]\nmotor = nan", "FILE, [recordings], [controls]: motor is nan; it must "
         "be a finite number"),
        ("[recordings]", "[recordings.controls]\nmotor = {phase = 1}", "FILE, [recordings], [controls], motor: "
         "amplitude is missing"),
        ("[recordings]", "[recordings.sensors]\nload = {worth = 1}", "FILE, [recordings], [sensors]: the model has no "
         "sensor 'load'; there are angle, imu"),
        ("[recordings]", "[recordings.sensors]\nangle = {worth = 0}", "FILE, [recordings], [sensors], [angle]: worth "
         "is 0.0; it must be above 0: meters of marker error that one unit counts as"),
        ("[recordings]", "[recordings.sensors]\nimu = {worth = 1}", "FILE, [recordings], [sensors]: sensor 'imu' has 3 "
         'values; say which one: "imu[0]" to "imu[2]"'),
        ("[recordings]", '[recordings.sensors]\n"imu[3]" = {worth = 1}', "FILE, [recordings], [sensors]: sensor 'imu' "
         "has 3 values, from [0]; there is no [3]"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_a_sentence(tmp_path, old, new, says):
    text = "".join(WHOLE)
    assert old in text
    found = sentence(made(tmp_path, text.replace(old, new, 1))).replace(str(tmp_path), "FOLDER")
    if says is None:
        assert found.startswith("FILE: MuJoCo can't read model 'FOLDER/arm.toml': ")
        assert "\n" not in found
    else:
        assert found == says


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (DAMPING, "", "FILE: there are no [[parameters]], so nothing could be calibrated"),
        (DAMPING, "[parameters]", "FILE: parameters is {}; it must be a list"),
        (DAMPING, DAMPING * 2, "FILE: two parameters are named 'damping'; give each its own name"),
        ("meaning", "meanings", "FILE, parameter 'damping': 'meanings' means nothing here; did you mean 'meaning'? "
         "there are name, unit, lower, upper, scale, log_offset, meaning, value, writes"),
        ('name = "damping"', "", "FILE, parameter 1: name is missing"),
        ("lower = 1e-3", "", "FILE, parameter 'damping': lower is missing"),
        ("upper = 1.0", "upper = inf", "FILE, parameter 'damping': upper is inf; it must be a finite number"),
        ("upper = 1.0", "upper = 0.02\nvalue = 0.03", "FILE, parameter 'damping': parameter 'damping' is 0.03, out of "
         "bounds; allowed is 0.001 to 0.02 N·m·s/rad"),
        ("upper = 1.0", "upper = 1e-4", "FILE, parameter 'damping': parameter 'damping': lower bound 0.001 is "
         "above upper bound 0.0001; swap them"),
        ("lower = 1e-3", "lower = 0", "FILE, parameter 'damping': parameter 'damping': lower bound 0.0 plus log offset "
         "0.0 must be above 0"),
        ("lower = 1e-3", "lower = -1", "FILE, parameter 'damping': -1 would write -1 to joint \"link*\" damping, which "
         "can't be negative; change the bound, or the factor and offset"),
        ('"log"', '"logarithmic"', "FILE, parameter 'damping': scale is 'logarithmic'; it must be one of log, linear"),
        ("writes = 'joint \"link*\" damping'", "", "FILE, parameter 'damping': writes is None; it must say what the "
         "parameter writes, such as ['joint \"hip\" damping']"),
        ("'joint \"link*\" damping'", "[3]", "FILE, parameter 'damping': writes is 3; it must be texts or tables with "
         "to, factor, offset and relative"),
        ("'joint \"link*\" damping'", "{to = 'option density', factor = 0}", "FILE, parameter 'damping', writes: "
         "factor is 0.0; it must not be 0, or the parameter changes nothing"),
        ("'joint \"link*\" damping'", "{factor = 2}", "FILE, parameter 'damping', writes: to is missing"),
        ("link*", "leg", "FILE, parameter 'damping': the model has no joint 'leg'; there are "
         "link0, link1"),
        ("joint \"link*\" damping", 'geom "rod1" mass', "FILE, parameter 'damping': the model sets no number there, so "
         "the parameter needs value = …"),
        ("joint \"link*\" damping", 'joint "link*" stiffness', "FILE, parameter 'damping': the model has several "
         "numbers there (2, 3), so the parameter needs value = …"),
        ("joint \"link*\" damping", 'joint "link0" range[1]', "FILE, parameter 'damping': parameter 'damping' is 60, "
         "out of bounds; allowed is 0.001 to 1 N·m·s/rad; this is the model's own value, so widen the bounds, change "
         "it in the model, or say value = …"),
        ("joint \"link*\" damping'", "joint \"link0\" range[1]'\nvalue = 0.001", None),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_parameter_is_a_sentence(tmp_path, old, new, says):
    text = "".join(WHOLE)
    assert old in text
    model = ARM.replace('range="-30 60"', 'range="5 60"') if says is None else ARM
    found = sentence(made(tmp_path, text.replace(old, new, 1), model=model))
    if says is None:
        assert found.startswith("FILE: the model doesn't compile: ")
    else:
        assert found == says


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"x", "y"', '"x", "z"', "FILE, [swims]: surge_joints is 'z'; it must be a joint of the model: x, y, crank"),
        ('motor_joint = "crank"', 'motor_joint = "motor"', "FILE, [swims]: motor_joint is 'motor'; it must be a joint "
         "of the model: x, y, crank"),
        ('["stern"]', '["tail"]', "FILE, [swims]: tail_markers is 'tail'; it must be a marker: nose, stern"),
        ('["nose", "stern"]', '["stern"]', "FILE, [swims]: there is one marker; steady swims need two, the first two "
         "on the head"),
        ("[swims]", '[swims]\nfit_plan = "plan"', "FILE, [swims]: fit_plan is 'plan'; it must be "
         "python:MODULE:FUNCTION or python:FILE.py:FUNCTION"),
        ("[swims]", '[swims]\nresponse = "python:nowhere:answer"', "FILE, [swims]: response 'python:nowhere:answer' "
         "can't be imported: ModuleNotFoundError: No module named 'nowhere'"),
        ("[swims]", '[swims]\nresponse = "python:json:decoder"', "FILE, [swims]: response is 'python:json:decoder'; it "
         "must name a function"),
        ("[swims]", '[swims]\nresponse = "python:json:loads"', "FILE, [swims]: response 'python:json:loads' failed: "
         "TypeError: loads() missing 1 required positional argument: 's'"),
        ('"arm.xml"', '"python:json:JSONDecoder"', "FILE: model is 'python:json:JSONDecoder'; it must return an "
         "MjSpec, not JSONDecoder"),
        ('"arm.xml"', '"python:broken.py:model"', "FILE: model 'python:broken.py:model' can't be imported: "
         "SyntaxError: invalid syntax (broken.py, line 1)"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_swims_is_a_sentence(tmp_path, old, new, says):
    text = SWIMMING + SWIMS + parameter("'joint \"crank\" armature'", 0.0, 1.0)
    assert old in text
    (tmp_path / "broken.py").write_text("def :")
    assert sentence(made(tmp_path, text.replace(old, new, 1), model=SWIMMER)) == says


def test_steady_swims_need_one_motor(tmp_path):
    text = ROBOT + SWIMS.replace('"x", "y"', '"link0", "link1"').replace("crank", "link1").replace("stern", "tip")
    assert sentence(made(tmp_path, text, DAMPING)) == (
        "FILE, [swims]: the model has 5 actuators; steady swims need one, which turns motor_joint at the speed that it "
        "is given [rad/s]; use [recordings] for other robots"
    )
