"""Small robots whose trials are recordings: a damped double pendulum with a motor, and three links that float."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import mujoco
import numpy as np

from markertrack.track import MarkerTrack
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.drives import TABLE, Drive
from swim2real.robots.robot import Robot, Sensor, Trials
from swim2real.simulation import PlaybackSimulator
from swim2real.trials import Signals, Trial, TrialSet

PENDULUM_XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <site name="pivot" pos="0.1 0 0.5"/>
    <body name="upper" pos="0.1 0 0.5">
      <joint name="shoulder" axis="0 1 0" damping="{shoulder_damping}"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.1" contype="0" conaffinity="0"/>
      <site name="middle" pos="0 0 -0.2"/>
      <body name="lower" pos="0 0 -0.2">
        <joint name="elbow" axis="0 1 0" damping="{elbow_damping}" limited="true" range="-150 150"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.01" mass="{lower_mass}" contype="0" conaffinity="0"/>
        <site name="end" pos="0 0 -0.15"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="shoulder"/></actuator>
  <sensor><gyro name="gyro" site="end"/><jointpos name="encoder" joint="shoulder"/></sensor>
  <keyframe><key name="raised" qpos="1.2 0.3"/></keyframe>
</mujoco>
"""

FLOATER_XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0" density="1000" viscosity="0.001"/>
  <worldbody>
    <body name="front">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <joint name="yaw" axis="0 0 1"/>
      <geom type="ellipsoid" size="0.08 0.01 0.03" pos="0.07 0 0" mass="0.1" fluidshape="ellipsoid"
        fluidcoef="{drag} 0.25 1.5 1 1"/>
      <site name="nose" pos="0 0 0"/><site name="neck" pos="0.14 0 0"/>
      <body name="mid" pos="0.15 0 0">
        <joint name="bend" axis="0 0 1" damping="0.001" stiffness="{bend_stiffness}"/>
        <geom type="ellipsoid" size="0.06 0.01 0.03" pos="0.06 0 0" mass="0.05" fluidshape="ellipsoid"
        fluidcoef="{drag} 0.25 1.5 1 1"/>
        <site name="waist" pos="0.12 0 0"/>
        <body name="rear" pos="0.12 0 0">
          <joint name="flap" axis="0 0 1" damping="{flap_damping}" stiffness="0.01"/>
          <geom type="ellipsoid" size="0.05 0.005 0.04" pos="0.05 0 0" mass="0.02" fluidshape="ellipsoid"
        fluidcoef="{drag} 0.25 1.5 1 1"/>
          <site name="tail" pos="0.1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="bender" joint="bend" kp="0.3" kv="0.002"/>
    <position name="flapper" joint="flap" kp="0.2" kv="0.002"/>
  </actuator>
</mujoco>
"""

RINGING_XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="low" pos="0 0 0.2">
      <joint name="lower" type="slide" axis="1 0 0" stiffness="{low_stiffness}" damping="{damping}"/>
      <geom type="box" size="0.1 0.02 0.005" mass="0.5"/><site name="left" pos="-0.05 0 0"/>
      <body name="high" pos="0 0 0.2">
        <joint name="upper" type="slide" axis="1 0 0" stiffness="{high_stiffness}" damping="{damping}"/>
        <geom type="box" size="0.1 0.02 0.005" mass="0.5"/><site name="top" pos="0.05 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

PENDULUM_SPACE = ParameterSpace(
    (
        Parameter("shoulder_damping", "N·m·s/rad", 0.0005, 0.02, "Damping of the shoulder.", 0.002, log_offset=0.0),
        Parameter("elbow_damping", "N·m·s/rad", 0.0002, 0.01, "Damping of the elbow.", 0.001, log_offset=0.0),
        Parameter("lower_mass", "kg", 0.03, 0.2, "Mass of the lower arm.", 0.08),
    )
)
FLOATER_SPACE = ParameterSpace(
    (
        Parameter("bend_stiffness", "N·m/rad", 0.003, 0.3, "Stiffness of the front joint.", 0.03, log_offset=0.0),
        Parameter("flap_damping", "N·m·s/rad", 0.0003, 0.03, "Damping of the rear joint.", 0.003, log_offset=0.0),
        Parameter("drag", "-", 0.1, 5.0, "Drag of the links at right angles.", 1.0, log_offset=0.1),
    )
)


RINGING_SPACE = ParameterSpace(
    (
        Parameter("low_stiffness", "N/m", 500.0, 5000.0, "Stiffness of the lower columns.", 1700.0, log_offset=0.0),
        Parameter("high_stiffness", "N/m", 500.0, 5000.0, "Stiffness of the upper columns.", 1700.0, log_offset=0.0),
        Parameter("damping", "N·s/m", 0.1, 5.0, "Damping of all columns.", 1.0, log_offset=0.0),
    )
)


def with_markers(xml: str, names: tuple[str, ...]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(xml)
    for name in names:
        spec.add_sensor(
            name=f"marker:{name}", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name
        )
    return spec


def build_pendulum(values: Mapping[str, float]) -> mujoco.MjSpec:
    return with_markers(PENDULUM_XML.format(**PENDULUM_SPACE.check(values)), ("pivot", "middle", "end"))


def build_floater(values: Mapping[str, float]) -> mujoco.MjSpec:
    return with_markers(FLOATER_XML.format(**FLOATER_SPACE.check(values)), ("nose", "neck", "waist", "tail"))


def build_ringing(values: Mapping[str, float]) -> mujoco.MjSpec:
    return with_markers(RINGING_XML.format(**RINGING_SPACE.check(values)), ("left", "top"))


def rest_of(spec: mujoco.MjSpec, plane: tuple[int, int]) -> np.ndarray:
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = [sensor.name for sensor in spec.sensors if sensor.name.startswith("marker:")]
    places = np.array([data.sensor(name).data for name in names])[:, list(plane)]
    return places - places[0]


def make_robot(
    name: str, space: ParameterSpace, build: Callable[[Mapping[str, float]], mujoco.MjSpec], trials: Trials,
    markers: tuple[str, ...], plane: tuple[int, int],
) -> Robot:  # fmt: skip
    return Robot(
        name, f"A {name} for tests.", space, build, markers, rest_of(build(space.published), plane),
        np.zeros(len(markers)), trials, plane, tuple((i, i + 1) for i in range(len(markers) - 1)),
    )  # fmt: skip


PENDULUM = make_robot(
    "pendulum", PENDULUM_SPACE, build_pendulum,
    Trials({"torque": TABLE}, (Sensor("gyro[1]", "rad/s", 0.001),), "markers"),
    ("pivot", "middle", "end"), (0, 2),
)  # fmt: skip
FLOATER = make_robot(
    "floater", FLOATER_SPACE, build_floater,
    Trials({"bender": Drive(0.5), "flapper": Drive(0.4, -1.2)}, (), "rest", (0, 1), True),
    ("nose", "neck", "waist", "tail"), (0, 1),
)  # fmt: skip
RINGING = make_robot(
    "ringing", RINGING_SPACE, build_ringing, Trials({}, (), "fitted"), ("left", "top"), (0, 2)
)  # a frame of two floors, the first mode at about 6 Hz
RINGING_HIDDEN = {"low_stiffness": 1860.0, "high_stiffness": 2000.0, "damping": 0.6}
PENDULUM_HIDDEN = {"shoulder_damping": 0.004, "elbow_damping": 0.0006, "lower_mass": 0.06}
FLOATER_HIDDEN = {"bend_stiffness": 0.06, "flap_damping": 0.002, "drag": 2.0}


def telling(robot: Robot, **changes: object) -> Robot:
    """The robot with other recordings."""
    return replace(robot, trials=replace(robot.recordings, **changes))


def blank(robot: Robot, name: str, seconds: float, fps: float = 60.0, begin: float = 0.0, **more: object) -> Trial:
    """A recording to be simulated: time stamps without markers."""
    times = begin + np.arange(round(seconds * fps) + 1) / fps
    nowhere = np.full((len(times), len(robot.marker_names), 2), np.nan)
    return Trial(name, MarkerTrack(times, nowhere), **more)


def torque_table(seconds: float, seed: int = 0, begin: float = 0.0) -> Signals:
    """Torques that change every 50 ms."""
    count = round(seconds / 0.05)
    torques = 0.15 * np.random.default_rng(seed).standard_normal(count)
    return Signals(begin + 0.05 * np.arange(count), ("torque",), torques[:, None])


def recorded(
    robot: Robot, values: Mapping[str, float], blanks: list[Trial], noise: float = 0.0, seed: int = 0
) -> TrialSet:
    """What a robot of these values does in recordings, seen with noise [m]."""
    placed = telling(robot, start="rest") if robot.recordings.start in ("markers", "fitted") else robot
    player = PlaybackSimulator(placed, threads=2)
    rng = np.random.default_rng(seed)
    found = player.simulate(values, [player.request(one) for one in blanks])
    trials = []
    for real, made in zip(blanks, found, strict=True):
        assert made.divergence is None
        seen = made.track.positions + noise * rng.standard_normal(made.track.positions.shape)
        trials.append(replace(real, track=MarkerTrack(real.track.times, seen), sensors=made.sensors))
    return TrialSet(tuple(trials), robot.marker_names)


def pendulum_reference(noise: float = 0.0) -> TrialSet:
    """Two recordings of the pendulum that begin in motion: cut out of longer ones, which began at rest."""
    blanks = [
        blank(PENDULUM, name, 3.0, begin=2.0, controls=torque_table(6.0, seed, 2.0)) for seed, name in enumerate("ab")
    ]
    whole = recorded(PENDULUM, PENDULUM_HIDDEN, blanks, noise)
    cut = []
    for trial in whole:
        late = trial.track.times >= 2.5
        track = MarkerTrack(trial.track.times[late], trial.track.positions[late])
        cut.append(replace(trial, track=track))
    return TrialSet(tuple(cut), whole.marker_names)


def floater_reference(noise: float = 0.0) -> TrialSet:
    blanks = [blank(FLOATER, name, 2.0, 50.0, nominal_frequency=f) for name, f in (("slow", 1.0), ("fast", 1.6))]
    return recorded(FLOATER, FLOATER_HIDDEN, blanks, noise)


def ringing_reference(fps: float, noise: float = 0.0) -> TrialSet:
    """Two ring-downs of 3 s, cut out of longer ones a while after the frame was let go of."""
    ways = {"pulled": {"lower": 0.02, "upper": 0.012}, "bent": {"lower": 0.015, "upper": -0.01}}
    blanks = [blank(RINGING, name, 3.1, 400.0, start=start) for name, start in ways.items()]
    whole = recorded(RINGING, RINGING_HIDDEN, blanks, noise)
    cut = []
    for trial in whole:
        shown = slice(23, 23 + 3 * 400, round(400 / fps))
        times = trial.track.times[shown] - trial.track.times[shown][0]
        cut.append(replace(trial, start={}, track=MarkerTrack(times, trial.track.positions[shown])))
    return TrialSet(tuple(cut), whole.marker_names)
