"""Small MJCF models of several kinds, for tests of drafts and probes."""

import re

from swim2real.robots.fish import FISH

PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.002"/>
  <worldbody>
    <site name="pivot"/>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.2"/>
      <site name="elbow" pos="0 0 -0.2"/>
      <body name="lower" pos="0 0 -0.2">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.2"/>
        <site name="tip" pos="0 0 -0.2"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def snake(links: int = 5) -> str:
    """A chain of plates in water, driven at its joints, on a plane of its own."""
    inner = ""
    for i in reversed(range(links)):
        joint = f'<joint name="joint{i}" axis="0 0 1" stiffness="0.02" damping="0.001" range="-60 60"/>' if i else ""
        inner = f"""<body name="link{i}" pos="{0.1 if i else 0} 0 0">{joint}
        {'<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>' if not i else ""}
        {'<joint name="yaw" axis="0 0 1"/>' if not i else ""}
        <geom class="wet" name="plate{i}" type="box" size="0.045 0.004 0.02" pos="0.05 0 0"/>
        <site name="M{i}" pos="0.02 0 0.02"/>
        {'<site name="nose" pos="0.09 0 0.02"/>' if not i else ""}{inner}</body>"""
    servos = "".join(f'<position name="servo{i}" joint="joint{i}" kp="0.2" ctrlrange="-1 1"/>' for i in range(1, links))
    return f"""<mujoco model="snake">
      <compiler angle="degree"/>
      <option timestep="0.002" integrator="implicitfast" gravity="0 0 0" density="1000" viscosity="0.001"/>
      <default><default class="wet"><geom fluidshape="ellipsoid" fluidcoef="0.5 0.25 1.5 1 0" contype="0"
        conaffinity="0" density="1000"/></default></default>
      <worldbody>{inner}</worldbody><actuator>{servos}</actuator></mujoco>"""


def fish() -> str:
    """The fish as an MJCF file."""
    xml = FISH.build(FISH.space.published).to_xml()
    return re.sub(r"<sensor>.*?</sensor>", "", xml, flags=re.DOTALL)


FINGER = """
<mujoco model="finger">
  <option timestep="0.001" gravity="0 0 0"/>
  <worldbody>
    <site name="anchor" pos="0 0 0.02"/>
    <body name="palm"><geom name="palm" type="box" size="0.02 0.01 0.01" mass="0.1"/><site name="base"/>
      <body name="bone0" pos="0.03 0 0">
        <joint name="knuckle0" axis="0 1 0" stiffness="0.2" damping="0.002"/>
        <geom name="bone0" type="capsule" size="0.005" fromto="0 0 0 0.03 0 0" mass="0.01"/>
        <site name="guide0" pos="0.015 0 0.01"/><site name="middle" pos="0.03 0 0"/>
        <body name="bone1" pos="0.03 0 0">
          <joint name="knuckle1" axis="0 1 0" stiffness="0.2" damping="0.002"/>
          <geom name="bone1" type="capsule" size="0.005" fromto="0 0 0 0.03 0 0" mass="0.01"/>
          <site name="guide1" pos="0.015 0 0.01"/><site name="tip" pos="0.03 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="flexor" stiffness="50" damping="0.1" springlength="0.05">
      <site site="anchor"/><site site="guide0"/><site site="guide1"/>
    </spatial>
  </tendon>
  <actuator><motor name="pull" tendon="flexor" gear="-5" ctrlrange="0 1"/></actuator>
  <sensor><tendonpos name="length" tendon="flexor"/><actuatorfrc name="load" actuator="pull"/></sensor>
</mujoco>
"""

HOPPER = """
<mujoco model="hopper">
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="trunk" pos="0 0 0.4">
      <freejoint name="root"/>
      <inertial mass="1.5" pos="0 0 0" diaginertia="0.01 0.01 0.01"/>
      <geom name="trunk" type="box" size="0.1 0.05 0.03"/>
      <site name="front" pos="0.1 0 0"/><site name="rear" pos="-0.1 0 0"/>
      <body name="leg">
        <joint name="left_hip" axis="0 1 0" damping="0.05" armature="0.002" range="-60 60"/>
        <geom name="leg" type="capsule" size="0.015" fromto="0 0 0 0 0 -0.2"/><site name="foot" pos="0 0 -0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator><general name="drive" joint="left_hip" gainprm="3" biastype="affine" biasprm="0 0 -0.2" dyntype="filter"
    dynprm="0.05" ctrlrange="-1 1" ctrllimited="true"/></actuator>
  <sensor>
    <accelerometer name="imu" site="front"/><framepos name="place" objtype="site" objname="foot"/>
    <jointpos name="hip angle" joint="left_hip"/>
  </sensor>
  <keyframe><key name="stand" qpos="0 0 0.25 1 0 0 0 0"/></keyframe>
</mujoco>
"""

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping="0.1" frictionloss="0.02" armature="0.003"/></default>
  <worldbody>
    <body name="base"><geom type="cylinder" size="0.05 0.02"/><site name="base"/>
      <body name="upper arm" pos="0 0 0.05">
        <joint name="shoulder.pitch" axis="1 0 0" range="-1.5 1.5"/>
        <geom name="upper" type="capsule" size="0.02" fromto="0 0 0 0 0.2 0" density="500"/>
        <site name="elbow" pos="0 0.2 0"/>
        <body name="fore arm" pos="0 0.2 0">
          <joint name="elbow.pitch" axis="1 0 0"/>
          <geom name="fore" type="capsule" size="0.02" fromto="0 0 0 0 0.2 0" density="500"/>
          <site name="hand" pos="0 0.2 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder.servo" joint="shoulder.pitch" kp="40" kv="2" ctrlrange="-1 1"/>
    <position name="elbow.servo" joint="elbow.pitch" kp="20" dampratio="1" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""

MODELS = {
    "pendulum": PENDULUM, "snake": snake(), "fish": fish(), "finger": FINGER, "hopper": HOPPER, "arm": ARM
}  # fmt: skip
