"""Robot files that are begun for models of several kinds: they load, and every parameter shows."""

import re
import tomllib
from functools import cache

import mujoco
import pytest

from small_models import ARM, FINGER, HOPPER, MODELS, PENDULUM, snake
from swim2real.checks.probing import FAINT, probe
from swim2real.pipeline.drafting import draft_robot, write_draft
from swim2real.robots import load_robot
from swim2real.robots.drives import TABLE
from swim2real.robots.robot import CommandLimits
from swimbase.errors import EngineError, RobotError

ENCODERS = '<sensor><jointpos name="angle" joint="shoulder"/></sensor>'


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A robot file that is begun for a model; its draft and its place. Don't write into it."""

    @cache
    def begin(xml: str, name: str = "model"):
        model = tmp_path_factory.mktemp("begun") / f"{name}.xml"
        model.write_text(xml)
        draft, out = draft_robot(model, threads=1), model.with_suffix(".toml")
        write_draft(draft, model, out)
        return draft, out

    return begin


KINDS = [pytest.param(name, marks=() if name in ("pendulum", "finger") else pytest.mark.slow) for name in MODELS]


@pytest.mark.parametrize("name", KINDS)
def test_a_file_loads_as_it_is_and_every_parameter_shows(begun, name):
    draft, out = begun(MODELS[name], name)
    robot = load_robot(out)
    assert list(robot.space.names) == draft.calibrated
    assert set(draft.candidates) == {*draft.calibrated, *draft.aside}
    assert not robot.trials.steady
    found = probe(robot, threads=1)
    assert not any(one.refused or one.lower.failure or one.upper.failure for one in found)
    assert min(one.distance for one in found) >= FAINT
    for parameter in robot.space:
        assert parameter.lower <= parameter.published <= parameter.upper
        assert parameter.meaning.endswith(".")


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_what_is_only_suggested_can_be_used_by_taking_the_signs_away(begun, name):
    draft, out = begun(MODELS[name], name)
    text, out = out.read_text(), out.with_name("whole.toml")
    head, rest = text[: text.index("[[parameters]]")], text[text.index("[[parameters]]") :]
    tables = [line.removeprefix("# ") for line in rest.splitlines() if not line.startswith(("# left out", "# one val"))]
    out.write_text(head.rpartition("\n#")[0] + "\n" + "\n".join(tables))
    assert set(load_robot(out).space.names) == set(draft.candidates)


def test_a_pendulum_has_its_missing_damping_calibrated(begun):
    draft, out = begun(PENDULUM, "pendulum")
    assert (draft.name, draft.camera, draft.markers) == ("pendulum", "side", ("pivot", "elbow", "tip"))
    assert draft.calibrated == ["shoulder_damping", "elbow_damping"]
    parameter = load_robot(out).space["shoulder_damping"]
    assert (parameter.unit, parameter.lower, parameter.published) == ("N·m·s/rad", 0.0, 0.0)
    assert parameter.log_offset == pytest.approx(parameter.upper / 1000)
    assert "shoulder_armature" in draft.aside


def test_a_joint_that_nothing_drives_has_no_inertia_of_motor_and_gears(begun):
    heavy = PENDULUM.replace('joint name="elbow"', 'joint name="elbow" armature="0.002"')
    assert begun(heavy)[0].aside["elbow_armature"] == "no motor and no gears are there"
    motor = '<actuator><motor name="motor" joint="elbow"/></actuator></mujoco>'
    assert "elbow_armature" not in begun(heavy.replace("</mujoco>", motor))[0].aside


def test_what_others_make_up_for_is_left_out_with_the_reason(begun):
    cable = '<tendon><fixed name="cable" damping="0.01"><joint joint="shoulder" coef="1"/></fixed></tendon></mujoco>'
    twice = PENDULUM.replace('name="shoulder"', 'name="shoulder" damping="0.01"').replace("</mujoco>", cable)
    draft, out = begun(twice)
    dampings = {"shoulder_damping", "cable_damping"}
    (kept,) = dampings & set(draft.calibrated)
    (left_out,) = dampings - {kept}
    assert "others make up for it: over its range it alone changes the motion by" in draft.aside[left_out]
    assert f"# left out: {draft.aside[left_out]}\n" in out.read_text()


@pytest.mark.slow
def test_a_snake_swims_in_the_plane_with_one_value_for_its_joints(begun):
    draft, out = begun(snake().replace('type="slide"', 'type="slide" range="-9 9"'))  # far as good as anywhere
    robot = load_robot(out)
    assert draft.camera == "above"
    assert draft.frame == ("M0", "nose")
    assert (robot.recordings.frame, robot.recordings.score_progress) == ((0, 1), True)
    assert robot.recordings.controls == {f"servo{i}": TABLE for i in range(1, 5)}
    assert draft.candidates["joint_damping"].group == ("joint1", "joint2", "joint3", "joint4")
    assert "x_damping" in draft.aside  # what lets it go anywhere isn't a damper
    assert {"fluid_blunt_drag", "fluid_kutta_lift", "servo_kp", "joint_stiffness"} <= set(draft.calibrated)
    assert {"fluid_magnus_lift", "fluid_density", "geom_density"} <= set(draft.aside)
    text = out.read_text()
    assert "# one value for joint1, joint2, joint3, joint4; for more, copy this table and name some in each" in text
    assert "# left out: a mass is better weighed than calibrated" in text


def test_sites_of_tendons_are_no_markers_and_sensors_are_suggested(begun):
    draft, out = begun(FINGER, "finger")
    assert draft.markers == ("base", "middle", "tip")
    assert draft.left_out == {"tendons run through these sites": ("anchor", "guide0", "guide1")}
    text = out.read_text()
    assert "# tendons run through these sites, so they are left out: anchor, guide0, guide1" in text
    assert '# length = {unit = "m", meters_per_unit = 0.01}' in text
    gear = next(one for one in tomllib.loads(text)["parameters"] if one["name"] == "pull_gear")
    assert gear["targets"] == {"to": 'actuator "pull" gear[0]', "relative": True}  # it is negative


def test_a_free_robot_travels_and_its_keyframes_are_named(begun):
    draft, out = begun(HOPPER)
    assert draft.frame == ("front", "rear")
    assert load_robot(out).policy.actuators["drive"].upper == 1.0
    assert draft.calibrated == [
        "left_hip_damping", "left_hip_armature", "drive_gain", "drive_braking", "drive_time_constant"
    ]  # fmt: skip
    text = out.read_text()
    assert "or a keyframe: stand\n" in text
    assert '# "imu[2]" = {unit = "m/s²", meters_per_unit = 0.01}' in text
    assert '# "hip angle" = {unit = "rad", meters_per_unit = 0.01}' in text
    assert "place" not in text
    assert "floor" not in text


def test_servos_have_their_gains_calibrated_and_names_of_any_kind_are_written(begun):
    draft, out = begun(ARM, "my arm")
    assert (draft.name, draft.camera, draft.frame) == ("my arm", "front", None)
    assert {"shoulder_servo_kp", "shoulder_servo_kv", "elbow_servo_kp"} <= set(draft.calibrated)
    assert "elbow_servo_kv" not in draft.candidates  # a damping ratio
    robot = load_robot(out)
    assert robot.recordings.controls == {"shoulder.servo": TABLE, "elbow.servo": TABLE}
    assert robot.policy.actuators["elbow.servo"] == CommandLimits(-1.0, 1.0, 10.0, "-")  # ready to be trained
    assert "# geoms without a name: 1; parameters write to names or classes (main)" in out.read_text()


def test_a_model_with_sensors_and_no_sites_is_recorded_without_a_camera(begun):
    draft, out = begun(re.sub(r"<site [^>]*/>", "", PENDULUM).replace("</mujoco>", ENCODERS + "</mujoco>"))
    written = tomllib.loads(out.read_text())
    assert (draft.markers, written["markers"], "start" in written["recordings"]) == ((), [], False)
    assert written["recordings"]["sensors"] == {"angle": {"unit": "rad", "meters_per_unit": 0.01}}
    assert load_robot(out).marker_names == ()


def test_a_camera_above_a_hull_that_rolls_asks_for_the_heights_of_markers(begun):
    hull = """<mujoco><worldbody><body name="hull"><joint name="x" type="slide" axis="1 0 0"/>
    <joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" axis="0 0 1"/>{}<geom size=".2 .05 .05" type="box"/>
    <site name="bow" pos=".2 0 .08"/><site name="stern" pos="-.2 0 .03"/></body></worldbody></mujoco>"""
    assert not begun(hull.format(""))[0].heights
    draft, out = begun(hull.format('<joint name="roll" axis="1 0 0" stiffness=".1" damping=".01"/>'))
    assert draft.camera == "above"
    assert draft.heights == pytest.approx({"bow": 0.08, "stern": 0.03})
    assert load_robot(out).marker_names == ("bow", "stern")
    assert "bow: 0.08 m, stern: 0.03 m." in out.read_text()
    assert 'targets = \'site "bow", "stern" pos[2]\'' in out.read_text()


NAMELESS = '<mujoco><worldbody><body name="arm"><joint/><geom size="1"/>{}</body></worldbody></mujoco>'


@pytest.mark.parametrize(("xml", "error", "says"), [
    (None, RobotError, r"model '.*p\.xml' is not there; give an MJCF file"),
    ("<mujoco>", RobotError, r"^MuJoCo can't read model '.*p\.xml': XML parse error"),
    (NAMELESS.format(""), RobotError, r"no named site.*add a site for each marker .*the bodies are: arm"),
    (NAMELESS.format('<site name="M0"/>'), RobotError, "nothing that could be calibrated.*name its elements"),
    (PENDULUM.replace('timestep="0.002"', 'timestep="0.002" gravity="1e9 0 0"'), EngineError,
     "can't be simulated with its own values"),
])  # fmt: skip
def test_models_that_cannot_be_begun_with_are_told(tmp_path, xml, error, says):
    model = tmp_path / "p.xml"
    if xml is not None:
        model.write_text(xml)
    with pytest.raises(error, match=says):
        draft_robot(model, threads=1)


def test_actuators_without_names_are_called_after_what_they_act_on_and_the_camera_is_a_question(begun):
    model = ARM.replace('name="shoulder.servo" ', "").replace('name="elbow.servo" ', "")
    twice = model.replace("</actuator>", '<motor joint="elbow.pitch"/></actuator>')
    draft, out = begun(twice)
    names = ["shoulder.pitch", "elbow.pitch", "elbow.pitch_2"]
    assert list(tomllib.loads(out.read_text())["recordings"]["controls"]) == names
    assert [load_robot(out).model.actuator(i).name for i in range(3)] == names
    assert any('actuator "shoulder.pitch"' in draft.candidates[name].target for name in draft.calibrated)
    assert "From where is it filmed? Nothing in the model says so" in out.read_text()


@pytest.mark.parametrize("hidden", ['rgba="1 0 0 0"', 'group="3"'])
def test_an_invisible_site_is_no_marker(begun, hidden):
    names = mujoco.MjSpec.from_string(PENDULUM).sites
    first, *others = [site.name for site in names]
    model = PENDULUM.replace(f'<site name="{first}"', f'<site name="{first}" {hidden}', 1)
    draft, out = begun(model)
    assert draft.markers == tuple(others)
    assert f"# these sites are invisible, so they are left out: {first}\n" in out.read_text()
    assert load_robot(out).marker_names == tuple(others)


def test_sites_that_are_all_invisible_are_markers(begun):
    model = PENDULUM.replace("<site ", '<site group="3" ')
    assert begun(model)[0].markers == tuple(site.name for site in mujoco.MjSpec.from_string(PENDULUM).sites)
