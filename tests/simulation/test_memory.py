"""What actuators remember when a recording begins in mid-motion: filters, muscles, slow servos, delays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markertrack.span import Span
from recorded import blank, make_robot, recorded, telling, with_markers
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.drives import TABLE
from swim2real.robots.robot import Trials
from swim2real.simulation import PlaybackSimulator
from swim2real.trials import Signals

XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body pos="0 0 0.5">
      <joint name="hinge" axis="0 1 0" damping="0.03" stiffness="0.3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.1" contype="0"/>
      <site name="middle" pos="0 0 -0.1"/><site name="tip" pos="0 0 -0.19"/>
    </body>
  </worldbody>
  <actuator>{}</actuator>
</mujoco>
"""
ACTUATORS = {
    "filter": '<general name="drive" joint="hinge" dyntype="filter" dynprm="{time}" gainprm="0.5"/>',
    "exact": '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="{time}" gainprm="0.5"/>',
    "muscle": '<muscle name="drive" joint="hinge" lengthrange="-2 2" force="1" timeconst="{time} 0.1"/>',
    "servo": '<position name="drive" joint="hinge" kp="2" kv="0.05" timeconst="{time}"/>',
    "integrator": '<intvelocity name="drive" joint="hinge" kp="2" actrange="-3 3"/>',
    "delay": '<motor name="drive" joint="hinge" gear="0.3" delay="0.099" nsample="60"/>',
}
SPACE = ParameterSpace((Parameter("time", "s", 0.02, 1.0, "Time to follow a command.", 0.3),))


def robot(kind):
    def build(values):
        return with_markers(XML.format(ACTUATORS[kind].format(**values)), ("middle", "tip"))

    return make_robot(kind, SPACE, build, Trials({"drive": TABLE}, (), "fitted"), ("middle", "tip"), (0, 2))


def whole(body, seed, seconds=4.0, noise=0.0, time=0.3):
    """A recording from rest, under commands that change every 0.4 s."""
    rng, rows = np.random.default_rng(seed), np.arange(0, seconds + 1, 0.02)
    commands = np.interp(rows, np.arange(0, seconds + 2, 0.4), rng.uniform(0, 1, len(np.arange(0, seconds + 2, 0.4))))
    table = Signals(rows, ("drive",), commands[:, None])
    (trial,) = recorded(body, {"time": time}, [blank(body, "a", seconds, 50, controls=table)], noise)
    return replace(trial, sensors=None)


def off(body, trial, time=0.3):
    """How far a playback is from a recording, on average [m]."""
    player = PlaybackSimulator(body, 1)
    (played,) = player.simulate({"time": time}, [player.request(trial)])
    return np.linalg.norm(played.track.positions - trial.track.positions, axis=2).mean()


@pytest.mark.parametrize("kind", ACTUATORS)
@settings(max_examples=4, deadline=None)
@given(begin=st.floats(0.1, 3.0), seed=st.integers(0, 99))
def test_a_recording_that_is_cut_begins_as_it_went_on(kind, begin, seed):
    """The truth meets any part of a recording; so it does where the commands before it are known no more."""
    body = robot(kind)
    cut = whole(body, seed).within(Span(begin))
    assert off(body, cut) < 1e-5
    if kind not in ("delay", "muscle"):  # activations are fitted with the start; nothing shows what was on its way
        assert off(body, replace(cut, controls=cut.controls.cut(0.0, 9.0, before=0.0))) < 1e-4


def test_lines_through_the_first_frames_take_what_was_commanded_before():
    body = robot("exact")
    cut = whole(body, 1).within(Span(1.5))
    bare = replace(cut, controls=cut.controls.cut(0.0, 9.0, before=0.0))
    lines = telling(body, start="markers")
    assert off(lines, cut) < 5e-4 < 2e-3 < off(lines, bare)


def test_from_rest_nothing_is_remembered_but_earlier_commands():
    body = telling(robot("exact"), start="rest")
    trial = whole(body, 1)
    assert off(body, trial) < 1e-9
    data, _ = PlaybackSimulator(body, 1).begin(body.model, PlaybackSimulator(body, 1).request(trial))
    assert (data.act.tolist(), data.time) == ([0.0], 0.0)
    table = Signals(np.append(-1.0, trial.controls.times), ("drive",), np.vstack([[0.8], trial.controls.values]))
    data, _ = PlaybackSimulator(body, 1).begin(
        body.model, PlaybackSimulator(body, 1).request(replace(trial, controls=table))
    )
    assert data.act[0] == pytest.approx(0.8 * (1 - np.exp(-1.0 / 0.3)), rel=1e-6)
    assert data.qpos[0] == 0.0
