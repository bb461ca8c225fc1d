"""A URDF keeps its base, its massless links and its meshes, wherever a package says that they are."""

import mujoco
import numpy as np
import pytest

from refused import refusal, says
from swim2real.pipeline.drafting import from_urdf
from swim2real.robots.file import read_mjcf
from swimbase.errors import ConsentError, RobotError

INERTIAL = """<inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>
  <inertia ixx="4e-4" ixy="0" ixz="0" iyy="5e-4" iyz="0" izz="6e-4"/></inertial>"""
LINK = """<link name="{name}">{inertial}<visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>"""
HULL = "package://lab_fish/meshes/hull.obj"
OBJ = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def urdf(hull=HULL, extension="", masses=(0.6, 0.08)):
    links = [
        LINK.format(name=name, mesh=hull, inertial=INERTIAL.format(x=x, mass=mass))
        for name, x, mass in zip(("base", "tail"), (0, 0.04), masses, strict=True)
    ]
    return f"""<robot name="lab fish">{extension}{"".join(links)}<link name="imu"/>
      <joint name="beat" type="revolute"><parent link="base"/><child link="tail"/><origin xyz=".08 0 0"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="2" velocity="6"/></joint>
      <joint name="fixed" type="fixed"><parent link="base"/><child link="imu"/></joint></robot>"""


def converted(folder, text, mesh="hull.obj", packages=None):
    """The MJCF, written beside the URDF and read as anybody would; its model."""
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / mesh
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(OBJ)
    (folder / "fish.urdf").write_text(text)
    found = from_urdf(folder / "fish.urdf", packages or {})
    assert {path.suffix for path in folder.iterdir() if path.is_file()} <= {".urdf", ".obj", ".xml"}
    (folder / "fish.xml").write_text(found.text.replace('<body name="base">', '<body name="base"><freejoint/>'))
    return found, read_mjcf(folder / "fish.xml").compile()


@pytest.mark.parametrize("masses", [(0.01, 5.0), (3.3, 0.02)])
def test_base_massless_link_and_meshes_are_kept_and_a_free_joint_fits(tmp_path, masses):
    found, model = converted(tmp_path, urdf("hull.obj", masses=masses))
    assert (found.bodies, found.joints) == (("base", "tail", "imu"), ("beat",))
    np.testing.assert_allclose(model.body_mass[1:], [*masses, 0.0], rtol=1e-5)
    assert (model.nmesh, model.ngeom, model.nv) == (1, 2, 7)
    mujoco.mj_forward(model, mujoco.MjData(model))


@pytest.mark.parametrize("mesh", ["hull.obj", "meshes/hull.obj", "lab_fish/meshes/hull.obj"])
@pytest.mark.parametrize("name", [HULL, HULL.replace("package", "model")])
def test_a_package_is_found_beside_the_file(tmp_path, mesh, name):
    assert converted(tmp_path, urdf(name), mesh)[1].nmesh == 1


def test_a_package_is_found_above_the_file_and_where_a_person_says_but_read_with_consent_only(tmp_path):
    for packages, mesh in ({}, "../meshes/hull.obj"), ({"lab_fish": tmp_path / "other"}, "../other/meshes/hull.obj"):
        said = refusal(ConsentError, converted, tmp_path / "urdf", urdf(), mesh, packages)
        assert says(said, f"model '{tmp_path}/urdf/fish.urdf' reads files outside", "hull.obj", "--allow-outside")
        (tmp_path / "urdf" / mesh).unlink()
    inside = tmp_path / "urdf" / "else"
    assert converted(tmp_path / "urdf", urdf(), "else/meshes/hull.obj", {"lab_fish": inside})[1].nmesh == 1
    file = urdf(f"file://{inside}/meshes/hull.obj")
    assert converted(tmp_path / "urdf", file, "else/meshes/hull.obj")[1].nmesh == 1


@pytest.mark.parametrize("packages", [{}, {"lab_fish": "nowhere"}])
def test_a_package_that_isnt_found_is_asked_for(tmp_path, packages):
    said = refusal(RobotError, converted, tmp_path, urdf(), "other.obj", {k: tmp_path / v for k, v in packages.items()})
    assert says(said, "fish.urdf' names the mesh", HULL, "--package lab_fish=FOLDER")
    said = refusal(RobotError, converted, tmp_path, urdf()[:-9])
    assert says(said, "fish.urdf' can't be read", "line")


def test_what_a_urdf_itself_says_to_mujoco_holds(tmp_path):
    extension = '<mujoco><compiler fusestatic="true" discardvisual="true" meshdir="stl"/></mujoco>'
    found, model = converted(tmp_path, urdf(HULL, extension), "meshes/hull.obj")
    assert (found.bodies, model.ngeom) == (("tail",), 0)
    extension = '<mujoco><compiler meshdir="stl"/></mujoco>'
    assert converted(tmp_path, urdf(HULL, extension), "meshes/hull.obj")[1].ngeom == 2
