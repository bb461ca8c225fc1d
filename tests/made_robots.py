"""Small models and robot files for tests."""

from pathlib import Path

ARM = """
<mujoco model="arm">
  <option timestep="0.002" integrator="implicitfast" density="1000" viscosity="0.001"/>
  <default>
    <joint damping="0.02"/>
    <default class="wet"><geom fluidshape="ellipsoid" fluidcoef="0.5 0.25 1.5 1 1"/></default>
    <default class="soft"><joint stiffness="3"/><tendon stiffness="40"/></default>
  </default>
  <worldbody>
    <site name="base"/>
    <body name="upper">
      <joint name="link0" axis="0 1 0" class="soft" range="-30 60" limited="true"/>
      <geom name="rod0" type="capsule" size="0.01 0.05" pos="0.05 0 0" euler="0 90 0" mass="0.1"/>
      <site name="elbow" pos="0.1 0 0"/>
      <body name="lower" pos="0.1 0 0">
        <joint name="link1" axis="0 1 0" stiffness="2" springref="10"/>
        <inertial mass="0.2" pos="0.04 0 0" diaginertia="2e-4 2e-4 3e-4"/>
        <geom name="rod1" class="wet" type="box" size="0.05 0.01 0.02" pos="0.05 0 0"/>
        <geom class="wet" type="box" size="0.005 0.005 0.005" pos="0.1 0 0"/>
        <site name="tip" pos="0.1 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable" class="soft"><joint joint="link0" coef="1"/><joint joint="link1" coef="-1"/></fixed>
  </tendon>
  <equality><joint name="gear" joint1="link0" joint2="link1" polycoef="0 1 0 0 0" active="false"/></equality>
  <actuator>
    <position name="servo" joint="link0" kp="5" kv="0.3"/>
    <velocity name="motor" joint="link1" kv="0.7"/>
    <motor name="torque" joint="link1" gear="2"/>
    <position name="damped" joint="link0" kp="4" dampratio="1"/>
    <general name="law" joint="link0" gainprm="2" biasprm="0 -1 0"/>
  </actuator>
  <sensor>
    <jointpos name="angle" joint="link0"/>
    <accelerometer name="imu" site="tip"/>
  </sensor>
  <keyframe><key name="up" qpos="0.3 0"/><key name="down" qpos="-0.3 0"/></keyframe>
</mujoco>
"""

ROBOT = """
format = 1
name = "arm"
description = "An arm of two links."
model = "arm.xml"
camera = "side"
markers = ["base", "elbow", "tip"]
"""

RECORDINGS = """
[recordings]
"""

DAMPING = """
[[parameters]]
name = "damping"
unit = "N·m·s/rad"
lower = 1e-3
upper = 1.0
scale = "log"
meaning = "Damping of both joints."
targets = 'joint "link*" damping'
"""


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MESHED = ARM.replace("<option", '<compiler meshdir="parts"/><option', 1).replace(
    "<worldbody>",
    '<asset><mesh name="fin" file="fin.obj" scale="0.1 0.1 0.1"/></asset><worldbody><include file="rest.xml"/>',
)
INCLUDED = '<mujocoinclude><body name="fin"><geom name="fin" type="mesh" mesh="fin"/></body></mujocoinclude>'


def parameter(targets: str, lower: float = 0.001, upper: float = 100.0, more: str = "") -> str:
    """A [[parameters]] table that sets a place; `targets` is TOML."""
    return f'[[parameters]]\nname = "x"\nlower = {lower}\nupper = {upper}\nmeaning = "-"\ntargets = {targets}\n{more}\n'


def made(folder: Path, *parts: str, model: str = ARM, name: str = "arm") -> Path:
    """Writes `NAME.xml` and `NAME.toml` into a folder; the robot file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.xml").write_text(model)
    place = folder / f"{name}.toml"
    place.write_text("".join(parts))
    return place


def made_of_files(folder: Path, *parts: str, models: str = ".") -> Path:
    """The same, of a model with an included file and a mesh, in a folder below."""
    place = made(folder, *parts)
    place.with_suffix(".xml").unlink()
    (folder / models / "parts").mkdir(parents=True)
    for name, text in (("arm.xml", MESHED), ("rest.xml", INCLUDED), ("parts/fin.obj", TETRAHEDRON)):
        (folder / models / name).write_text(text)
    return place
