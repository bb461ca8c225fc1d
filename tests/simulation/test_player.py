"""Recordings are simulated from their start under their controls, and seen at their time stamps."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import (
    FLOATER,
    FLOATER_HIDDEN,
    PENDULUM,
    PENDULUM_HIDDEN,
    blank,
    floater_reference,
    pendulum_reference,
    telling,
    torque_table,
    with_markers,
)
from refused import refusal, says
from swim2real.robots.drives import SPEED, Drive
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Sensor, Trials
from swim2real.simulation import Engine, PlaybackSimulator
from swim2real.trials import Signals
from swimbase.errors import ArgumentError, EngineError, TrialError

PUBLISHED = PENDULUM.space.published
AT_REST = telling(PENDULUM, start="rest")


def refused(call, *arguments) -> str:
    return refusal((EngineError, TrialError), call, *arguments)


def played(robot, trial, values=None, threads=1):
    player = PlaybackSimulator(robot, threads)
    return player.simulate(values or robot.space.published, [player.request(trial)]).trials[0]


def stepped(robot, values, controls, qpos=None, qvel=None):
    """Markers and sensors before each step, by the engine's plain step."""
    model = robot.build(values).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0 if qpos is None else qpos
    data.qvel[:] = 0 if qvel is None else qvel
    rows = []
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        rows.append(data.sensordata.copy())
    rows = np.array(rows)
    count = len(robot.marker_names)
    return rows[:, -3 * count :].reshape(len(rows), count, 3)[:, :, list(robot.plane)], rows


def test_a_table_is_a_command_that_holds_until_the_next():
    trial = blank(AT_REST, "a", 1.0, 500, begin=3.0, controls=torque_table(1.0, begin=3.0))
    torques = trial.controls.values[:, 0]
    controls = np.append(np.repeat(torques, 25), torques[-1])  # 50 ms of 2 ms each, and the last time stamp
    markers, rows = stepped(AT_REST, PENDULUM_HIDDEN, controls)
    found = played(AT_REST, trial, PENDULUM_HIDDEN)
    assert np.abs(markers[:, 2] - markers[0, 2]).max() > 0.05
    assert np.allclose(found.track.positions, markers, atol=1e-12)
    assert np.array_equal(found.track.times, trial.track.times)
    assert found.sensors.names == ("gyro[1]",)
    assert np.allclose(found.sensors.values[:, 0], rows[:, 1], atol=1e-12)


def test_sines_and_speeds_are_those_of_the_trials_frequency():
    trial = blank(FLOATER, "a", 1.0, 500, nominal_frequency=1.5)
    robot = telling(FLOATER, controls={"bender": Drive(0.5, 0.3, 0.1), "flapper": SPEED})
    times = np.arange(501) * 0.002
    controls = np.column_stack([0.1 + 0.5 * np.sin(2 * np.pi * 1.5 * times + 0.3), np.full(501, 2 * np.pi * 1.5)])
    markers, _ = stepped(robot, FLOATER_HIDDEN, controls)
    assert np.allclose(played(robot, trial, FLOATER_HIDDEN).track.positions, markers, atol=1e-12)


def test_what_drives_nothing_is_named():
    prepared = PlaybackSimulator(PENDULUM, 1).request
    other = Signals([0.0], ["speed"], [[0.0]])
    assert says(refused(prepared, blank(PENDULUM, "a", 1.0)), "'a' has no controls", "'torque' needs a table")
    said = refused(prepared, blank(PENDULUM, "a", 1.0, controls=other))
    assert says(said, "'a'", "'torque'", "no column 'torque'", "speed")
    floating = blank(FLOATER, "a", 1.0)
    said = refused(PlaybackSimulator(FLOATER, 1).request, floating)
    assert says(said, "'a' has no nominal frequency", "'bender'", "reference.json")
    wrong = PlaybackSimulator(telling(FLOATER, controls={"fin": Drive(offset=1.0)}), 1)
    assert says(refused(wrong.request, floating), "'fin'", "bender, flapper")
    assert "this needs recordings" in refusal(ArgumentError, PlaybackSimulator, FISH)


def test_markers_are_seen_between_physics_steps():
    controls = torque_table(1.0)
    coarse = played(AT_REST, blank(AT_REST, "a", 1.0, 60.0, controls=controls))
    markers, _ = stepped(AT_REST, PUBLISHED, np.append(np.repeat(controls.values[:, 0], 25), 0.0))
    times = np.arange(len(markers)) * 0.002
    expected = np.array([np.interp(coarse.track.times, times, markers[:, 2, axis]) for axis in (0, 1)]).T
    assert np.allclose(coarse.track.positions[:, 2], expected, atol=1e-9)


def test_sensors_are_read_at_their_own_times_while_the_robot_is_filmed():
    rows = np.array([-0.1, 0.0, 0.0013, 0.5, 1.0, 1.2])
    trial = blank(
        AT_REST, "a", 1.0, controls=torque_table(1.0), sensors=Signals(rows, ["gyro[1]"], np.zeros((6, 1)))
    )  # fmt: skip
    found = played(AT_REST, trial).sensors
    assert found.times.tolist() == [0.0, 0.0013, 0.5, 1.0]
    often = played(AT_REST, replace(trial, sensors=Signals(np.arange(501) / 500, ["gyro[1]"], np.zeros((501, 1)))))
    assert np.allclose(found.values[2:, 0], often.sensors.values[[250, 500], 0], atol=1e-12)


def test_results_depend_neither_on_threads_nor_on_the_batch():
    reference = pendulum_reference(1e-3)
    candidates = [PUBLISHED, PENDULUM_HIDDEN]
    single, double = PlaybackSimulator(PENDULUM, 1), PlaybackSimulator(PENDULUM, 2)
    plays = [single.request(trial) for trial in reference]
    batched = double.simulate_many(candidates, [double.request(trial) for trial in reference])
    for values, many in zip(candidates, batched, strict=True):
        for play, one in zip(plays, many, strict=True):
            alone = single.simulate(values, [play]).trials[0]
            assert alone.name == one.name == play.trial.name
            assert np.array_equal(alone.track.positions, one.track.positions)
            assert np.array_equal(alone.sensors.values, one.sensors.values)


def test_a_simulation_that_diverges_says_when_and_disturbs_no_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def build(values):
        spec = AT_REST.build(values)
        if values["lower_mass"] == 0.15:
            spec.option.gravity = (0, 0, 1e9)
        if values["lower_mass"] == 0.16:
            spec.geoms[0].size[0] = -1
        return spec

    robot = replace(AT_REST, build=build)
    trial = blank(robot, "a", 1.0, controls=torque_table(1.0))
    player, masses = PlaybackSimulator(robot, 2), (0.15, 0.16, PUBLISHED["lower_mass"])
    bad, none, good = player.simulate_many(
        [{**PUBLISHED, "lower_mass": mass} for mass in masses], [player.request(trial)]
    )
    assert says(bad["a"].divergence, "the simulation diverged ")
    assert 0 <= float(bad["a"].divergence.split()[3]) < 1
    assert says(none["a"].divergence, "the model can't be made: Error: ")
    for one in (bad, none):
        assert np.isnan(one["a"].track.positions).all()
        assert np.array_equal(one["a"].track.times, trial.track.times)
    assert good["a"].divergence is None
    assert not list(tmp_path.iterdir())  # nor a log of the engine's
    assert np.array_equal(good["a"].track.positions, played(AT_REST, trial).track.positions)


def test_a_keyframe_and_a_trials_own_start():
    trial = blank(PENDULUM, "a", 0.5, 500, controls=torque_table(1.0))
    controls = np.append(np.repeat(trial.controls.values[:10, 0], 25), trial.controls.values[10, 0])
    raised = telling(PENDULUM, start="raised")
    expected, _ = stepped(raised, PUBLISHED, controls, (1.2, 0.3))
    assert np.allclose(played(raised, trial).track.positions, expected, atol=1e-12)
    own = replace(trial, start={"elbow": -0.4}, start_velocities={"shoulder": 2.0})
    expected, _ = stepped(raised, PUBLISHED, controls, (1.2, -0.4), (2.0, 0.0))
    assert np.allclose(played(raised, own).track.positions, expected, atol=1e-12)
    expected, _ = stepped(PENDULUM, PUBLISHED, controls, (0.0, -0.4), (2.0, 0.0))
    assert np.allclose(played(PENDULUM, own).track.positions, expected, atol=1e-12)  # no markers are looked at


def test_wrong_starts_are_named():
    assert says(refused(PlaybackSimulator, telling(PENDULUM, start="lying")), "'lying'", "rest, markers, fitted")
    trial = blank(PENDULUM, "a", 0.5, controls=torque_table(1.0), start={"hip": 0.0})
    request = PlaybackSimulator(PENDULUM, 1).request
    assert says(refused(request, trial), "'a'", "joint 'hip'", "(shoulder, elbow)")
    assert says(
        refused(request, replace(trial, start={})), "'a'", "no marker is seen twice in its first 0.10 s", "'start'"
    )


@pytest.mark.parametrize(("robot", "make", "hidden"), [
    (PENDULUM, pendulum_reference, PENDULUM_HIDDEN),
    (telling(FLOATER, start="markers"), floater_reference, FLOATER_HIDDEN),
])  # fmt: skip
def test_the_markers_tell_pose_and_speed_of_a_start(robot, make, hidden):
    """In motion, under controls and unseen forces: the first frames alone tell how the rest of the trial goes."""
    player = PlaybackSimulator(robot, 2)
    for trial in make():
        found = player.simulate(hidden, [player.request(trial)])[trial.name]
        far = np.linalg.norm(found.track.positions - trial.track.positions, axis=2)
        way = np.ptp(trial.track.positions, axis=0).max()
        assert far[:6].max() < 1e-3 * way + 2.5e-4
        assert far.max() < 3e-3 * way + 5e-4


def test_markers_that_are_lost_or_doubted_dont_count_for_the_start():
    trial = pendulum_reference()["b"]
    weights = np.ones(trial.track.confidence.shape)
    positions = trial.track.positions.copy()
    positions[:3, 1] += 0.1
    weights[:3, 1] = 0
    positions[:, 0] = np.nan
    spoiled = replace(trial, track=MarkerTrack(trial.track.times, positions))
    player = PlaybackSimulator(PENDULUM, 1)
    found, believed = (
        player.simulate(PENDULUM_HIDDEN, [player.request(spoiled, given)])["b"] for given in (weights, None)
    )  # fmt: skip
    assert np.abs(found.track.positions - trial.track.positions)[:30].max() < 2e-3
    assert np.abs(believed.track.positions - trial.track.positions)[:30].max() > 2e-2


FREE_XML = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="plate" pos="0 0 0.3">
      <freejoint/><geom type="box" size="0.1 0.05 0.01"/>
      <site name="a" pos="0.1 0 0"/><site name="b" pos="-0.1 0.05 0"/><site name="c" pos="-0.1 -0.05 0"/>
      <body pos="0 0 0.02"><joint name="ball" type="ball"/><geom size="0.02"/></body>
    </body>
  </worldbody>
</mujoco>
"""
FREE_MARKERS = ("a", "b", "c")


def free_plate():
    return replace(
        FLOATER, name="plate", build=lambda values: with_markers(FREE_XML, FREE_MARKERS), marker_names=FREE_MARKERS,
        trials=Trials({}, (), "markers"),
    )  # fmt: skip


def test_free_and_ball_joints():
    """A plate that glides and turns in the plane of the camera, half around and far from where the model has it."""
    times = np.arange(31) / 60
    angles = 2.8 + 1.5 * times
    corners = np.array([0.1, -0.1 + 0.05j, -0.1 - 0.05j])
    turned = np.exp(1j * angles)[:, None] * corners
    turned = np.stack([turned.real, turned.imag], axis=2)
    positions = turned + np.array([2.0, -1.0]) + np.outer(times, [0.3, 0.1])[:, None]
    trial = replace(blank(free_plate(), "a", 0.5), track=MarkerTrack(times, positions))
    found = played(free_plate(), trial)
    assert np.abs(found.track.positions - positions).max() < 1e-3
    engine = Engine.of(free_plate())
    assert max(map(abs, engine.fluid_fingerprint)) == 0
    assert engine.difference(engine.as_dict()) is None
    assert engine.difference({**engine.as_dict(), "fluid_fingerprint": [1.0] * 9}) is not None


def test_sensors_are_compared_by_name_if_they_are_there():
    def telling_sensor(name):
        return telling(PENDULUM, start="rest", sensors=(Sensor(name, "-", 1.0),))

    said = refused(PlaybackSimulator, telling_sensor("force"))
    assert says(said, "'force'", "gyro, encoder, marker:pivot, marker:middle, marker:end")
    for name in ("gyro", "gyro[3]", "gyro[x]"):
        assert says(refused(PlaybackSimulator, telling_sensor(name)), f"'{name}'", "gyro[0] to gyro[2]")
    robot = telling_sensor("encoder")
    found = played(robot, blank(robot, "a", 0.5, controls=torque_table(1.0)))
    positions = found.track.positions
    assert np.allclose(positions[0] - positions[0, 0], AT_REST.rest_markers)
    angles = np.arctan2(*(positions[:, 1] - positions[:, 0]).T * [[-1], [-1]])
    assert np.allclose(found.sensors.column("encoder"), angles, atol=1e-4)
