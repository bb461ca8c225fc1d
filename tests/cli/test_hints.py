"""What the program suggests where something was nearly right."""

import shlex
import shutil

import pytest

from small_models import PENDULUM
from swim2real.cli.options import word

URDF = """
<robot name="arm">
  <link name="base"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
    <inertia ixx="0.002" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="5" velocity="3"/><dynamics damping="0.05"/></joint>
</robot>
"""


def test_a_suggested_command_quotes_a_path_and_a_draft_has_no_name_of_a_built_in_robot(program, tmp_path):
    model = tmp_path / "a fish.xml"
    model.write_text(PENDULUM.replace('<mujoco model="pendulum"', '<mujoco model="fish"'))
    told = program("init", model).done().out
    assert shlex.split(told.partition("then: ")[2]) == ["swim2real", "check", str(model.with_suffix(".toml"))]
    assert 'name = "my-fish"' in model.with_suffix(".toml").read_text()
    assert word("a b") == "'a b'"


@pytest.mark.slow
def test_a_urdf_becomes_a_model_to_which_markers_are_added(program, tmp_path):
    urdf = tmp_path / "an arm.urdf"
    urdf.write_text(URDF)
    told = program("init", urdf).done().out
    out = urdf.with_suffix(".xml")
    assert "the bodies upper and the joints shoulder" in told
    assert '<site name="M0" pos="0 0 0"/>' in told
    assert shlex.split(told.partition("Then: ")[2]) == ["swim2real", "init", str(out)]
    assert f"'{out}' is there; --force writes" in program("init", urdf).sentence(2)
    out.write_text(out.read_text().replace("</body>", '<site name="M0" pos="0 0 -0.2"/></body>', 1))
    program("init", out).done()
    assert "shoulder_damping" in out.with_suffix(".toml").read_text()


def test_a_robot_with_the_name_of_a_built_in_one_is_told_of(program, caplog, pendulum_folder, tmp_path, monkeypatch):
    robot = tmp_path / "fish.toml"
    robot.write_text((pendulum_folder / "pendulum.toml").read_text().replace('name = "pendulum"', 'name = "fish"', 1))
    shutil.copy(pendulum_folder / "pendulum.xml", tmp_path)
    program("quality", pendulum_folder / "tracks", "--robot", robot).done()
    (told,) = (record.getMessage() for record in caplog.records)
    assert f"robot file '{robot}' has the name 'fish' of the robot that comes with swim2real" in told
    assert "give it another 'name'" in told
    caplog.clear()
    monkeypatch.chdir(tmp_path)
    program("quality", pendulum_folder / "tracks", "--robot", "fish")
    assert "for your file say 'fish.toml'" in caplog.records[0].getMessage()
