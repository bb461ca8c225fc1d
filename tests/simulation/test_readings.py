"""Readings in units of the robot file, and readings that begin anew after a turn."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markertrack.track import MarkerTrack
from recorded import blank, make_robot, recorded, telling, with_markers
from refused import refusal, says
from swim2real.calibration import Problem
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.drives import TABLE
from swim2real.robots.robot import Sensor, Trials
from swim2real.trials import Signals, TrialSet
from swimbase.errors import TrialError

XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="crank" axis="0 0 1" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.05" contype="0"/>
      <site name="hub"/><site name="end" pos="0.1 0 0"/></body>
  </worldbody>
  <actuator><velocity name="motor" joint="crank" kv="0.01"/></actuator>
  <sensor><jointpos name="angle" joint="crank"/><jointvel name="rate" joint="crank"/></sensor>
</mujoco>
"""
SPACE = ParameterSpace((Parameter("damping", "N·m·s/rad", 1e-4, 1e-2, "Friction.", 1e-3),))
IN_RAD = {"rad": 1.0, "deg": 180 / np.pi, "rev": 0.5 / np.pi}


def build(values):
    return with_markers(XML.format(**values), ("hub", "end"))


ROBOT = make_robot(
    "crank", SPACE, build, Trials({"motor": TABLE}, (Sensor("angle", "rad", 0.02),), "rest"), ("hub", "end"), (0, 1)
)
ENCODED = replace(
    telling(ROBOT, start="fitted"), marker_names=(), rest_markers=np.zeros((0, 2)), marker_heights=np.zeros(0),
    links=(), build=lambda values: with_markers(XML.format(**values), ()),
)  # fmt: skip


def reference(seed=0):
    """The crank turns several times, to and fro."""
    rng = np.random.default_rng(seed)
    table = Signals(np.arange(0, 3, 0.5), ("motor",), rng.choice([-1, 1], 6)[:, None] * rng.uniform(4, 20, (6, 1)))
    (trial,) = recorded(ROBOT, {"damping": 2e-3}, [blank(ROBOT, "a", 3.0, 60, controls=table)])
    return trial


def loss(robot, trial, damping=1e-3):
    return Problem(robot, TrialSet((trial,), robot.marker_names), threads=1).evaluate({"damping": damping}).loss


def read(trial, values):
    return replace(trial, sensors=Signals(trial.sensors.times, trial.sensors.names, values))


def without_markers(trial):
    return replace(trial, track=MarkerTrack(trial.track.times, np.zeros((len(trial.track.times), 0, 2))))


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 99), unit=st.sampled_from(sorted(IN_RAD)), lowest=st.floats(-1.0, 1.0),
    turns=st.integers(-3, 3), filmed=st.booleans(), said=st.booleans(),
)  # fmt: skip
def test_a_loss_depends_neither_on_a_unit_nor_on_where_a_turn_begins(seed, unit, lowest, turns, filmed, said):
    plain, robot = reference(seed), ROBOT if filmed else ENCODED
    plain = plain if filmed else without_markers(plain)
    turn = 2 * np.pi * IN_RAD[unit]
    angles = plain.sensors.values * IN_RAD[unit] + turns * turn * said
    wrapped = read(plain, lowest * turn + np.mod(angles - lowest * turn, turn))
    sensor = Sensor("angle", unit, 0.02 / IN_RAD[unit], IN_RAD[unit], turn, said)
    expected, found = loss(robot, plain), loss(telling(robot, sensors=(sensor,)), wrapped)
    assert found == pytest.approx(expected, rel=1e-3)
    assert expected > 1e-3  # of another damping


def test_a_gap_hides_no_turn_and_readings_beyond_their_range_are_refused():
    plain = reference()
    turn, values = 2 * np.pi, np.mod(plain.sensors.values, 2 * np.pi)
    values[20:23] = np.nan
    sensor = Sensor("angle", "rad", 0.02, turn=turn)
    assert loss(telling(ROBOT, sensors=(sensor,)), read(plain, values), 2e-3) < 1e-6
    turned = telling(ROBOT, sensors=(Sensor("angle", "deg", 0.02, 180 / np.pi, 1.0, wraps=True),))
    said = refusal(TrialError, loss, turned, read(reference(), np.mod(np.rad2deg(reference().sensors.values), 360)))
    assert says(said, "'angle'", "deg", "the 1 of its range", "'range' in the robot file")


@pytest.mark.parametrize("largest", [2.0, 30.0])
def test_readings_that_dont_jump_by_a_turn_stay(largest):
    """Of a joint that swings, and of a fast motor that is read slowly and counts on."""
    readings = largest * np.sin(np.arange(60) * 0.9)
    assert Sensor("angle", "rad", 0.02, turn=2 * np.pi).period(readings) == 0
