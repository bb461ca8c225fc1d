from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from refused import says
from swim2real.calibration import Problem
from swim2real.robots import load_robot
from swim2real.robots.drives import Drive
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Robot
from swim2real.simulation import Simulator, Swim
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation

PUBLISHED = FISH.space.published
STIFF = {**PUBLISHED, "hinge_stiffness_2": 2.0, "fluid_kutta_lift": 1.0}
SWIMS = (
    Swim("slow", Actuation(1.1, 0.0, 0.1), 1.0),
    Swim("fast", Actuation(1.9, 0.0, 0.2), 1.5),
    Swim("from rest", Actuation(1.5), 0.7),
)


LONG = tuple(replace(swim, duration=3.0) for swim in SWIMS)


def rebuilt(change) -> Robot:
    """The fish with a change to its spec."""

    def build(values) -> mujoco.MjSpec:
        spec = FISH.build(values)
        change(spec, values)
        return spec

    return replace(FISH, build=build)


def test_threads_and_batches_change_nothing():
    single, double = Simulator(FISH, threads=1), Simulator(FISH, threads=2)
    candidates = (PUBLISHED, STIFF)
    alone = [[single.simulate(values, [swim]).trials[0] for swim in SWIMS] for values in candidates]
    for one, many in zip(alone, double.simulate_many(candidates, SWIMS), strict=True):
        for a, b in zip(one, many, strict=True):
            assert (a.name, a.provenance) == (b.name, b.provenance)
            np.testing.assert_array_equal(a.track.times, b.track.times)
            np.testing.assert_array_equal(a.track.positions, b.track.positions)
    assert np.abs(alone[0][1].track.positions - alone[1][1].track.positions).max() > 1e-3


def test_the_cycle_is_what_a_swim_at_full_length_does(new_fluid_law):
    swims = [Swim("a", Actuation(1.0, 1.0, 0.1), 3.0), Swim("b", Actuation(1.6, 0.0, 0.1), 3.0)]
    short = Simulator(FISH, 2).simulate(PUBLISHED, swims)
    whole = Simulator(FISH, 2, full_length=True).simulate(PUBLISHED, swims)
    for name in ("a", "b"):
        assert "full length" in whole[name].provenance
        assert short[name].track.speed == pytest.approx(whole[name].track.speed, abs=2e-3 if new_fluid_law else 1e-3)
        gap = np.linalg.norm(short[name].track.body - whole[name].track.body, axis=2)
        assert gap.mean() < 1e-3


def test_a_swim_of_a_hull_that_rolls_slower_than_the_tail_beats_changes_smoothly(new_fluid_law):
    robot = load_robot("fish-rolling")
    loose = {"fluid_kutta_lift": 10.0, "fluid_blunt_drag": 1.81, "fluid_slender_drag": 0.2, "roll_damping": 0.002}
    swims = [Swim("a", Actuation(0.75, 0.0, 0.0), 2.0)]
    near = [{**robot.space.published, **loose, "roll_stiffness": 0.057 * (1 + 1e-3 * k)} for k in range(9)]
    sets = Simulator(robot).simulate_many(near, swims)
    assert "full length" in sets[0].trials[0].provenance
    bodies = np.array([each.trials[0].track.body for each in sets])
    assert np.abs(np.diff(bodies, 2, axis=0)).max() < (1e-4 if new_fluid_law else 1e-6)  # m


def test_a_swim_from_rest_begins_at_rest_and_at_the_motor_angle_that_is_asked():
    swims = [Swim(name, Actuation(1.5, phase), 0.5) for name, phase in (("zero", 0.0), ("half", np.pi))]
    trials = Simulator(FISH, threads=1).simulate(PUBLISHED, swims)
    positions = trials["zero"].track.positions
    np.testing.assert_allclose(positions[0] - positions[0, 0], FISH.rest_markers, atol=1e-12)
    stepper = Stepper(FISH.build(PUBLISHED).compile(), FISH, 0.0, 2 * np.pi * 1.5, 0.0)
    np.testing.assert_allclose(positions, stepper.run(501).markers[::10], atol=1e-9)
    np.testing.assert_allclose(trials["half"].track.positions, positions * [1, -1], atol=1e-9)


@pytest.mark.parametrize("phase", [1.0, -1.0, 7.5])
def test_a_phase_begins_the_same_cycle_later(phase):
    frequency = 1.3
    swims = [
        Swim("zero", Actuation(frequency, 0.0, 0.1), 3.0),
        Swim("later", Actuation(frequency, phase, 0.1), 1.0),
    ]
    trials = Simulator(FISH, threads=2).simulate(PUBLISHED, swims)
    zero, later = trials["zero"].track, trials["later"].track
    lead = phase / (2 * np.pi) % 1.0 / frequency
    expected = CubicSpline(zero.times, zero.positions, axis=0)(later.times + lead)
    np.testing.assert_allclose(later.positions, expected, atol=2e-5)


def test_a_candidate_that_diverges_names_the_time_and_leaves_the_others_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def spoil(spec, values) -> None:
        if values["fluid_kutta_lift"] == STIFF["fluid_kutta_lift"]:
            spec.option.timestep = 0.05

    bad, good = Simulator(rebuilt(spoil), threads=2).simulate_many([STIFF, PUBLISHED], LONG)
    for trial in bad:
        assert says(trial.divergence, "the simulation diverged", "s after its start")
        assert float(trial.divergence.split()[3]) > 0
        assert np.isfinite(trial.track.positions).all()
        assert trial.provenance == "diverged"
    expected = Simulator(FISH, threads=2).simulate(PUBLISHED, LONG)
    for trial, same in zip(good, expected, strict=True):
        assert trial.divergence is None
        np.testing.assert_array_equal(trial.track.positions, same.track.positions)
    assert not list(tmp_path.iterdir())  # nor a log of the engine's


@pytest.mark.parametrize("swims", [LONG, [Swim("rest", Actuation(1.0), 0.5)]])
def test_a_candidate_of_which_no_model_can_be_made_is_a_diverged_trial(swims):
    def spoil(spec, values) -> None:
        if values["fluid_kutta_lift"] == STIFF["fluid_kutta_lift"]:
            spec.geoms[0].size[0] = -1

    none, good = Simulator(rebuilt(spoil), threads=2).simulate_many([STIFF, PUBLISHED], swims)
    assert all(says(trial.divergence, "the model can't be made: Error: ") for trial in none)
    assert not any(trial.divergence for trial in good)


def test_a_motor_too_weak_to_turn_makes_a_diverged_trial():
    def weaken(spec, _) -> None:
        motor = spec.actuators[0]
        motor.gainprm[0], motor.biasprm[2] = 1e-3, -1e-3

    (trial,) = Simulator(rebuilt(weaken), 1).simulate(PUBLISHED, [Swim("stuck", Actuation(2.0, 0.0, 0.1), 1.0)])
    assert (trial.divergence or "").startswith("the motor is stuck: ")
    assert np.isfinite(trial.track.positions).all()


SERVO_XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0" density="1000" viscosity="0.001"/>
  <default><geom fluidshape="ellipsoid" fluidcoef="{drag} 0.25 1.5 2 1" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="hull">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <joint name="yaw" axis="0 0 1"/>
      <geom type="ellipsoid" size="0.1 0.02 0.04" pos="0.08 0 0" mass="0.3"/>
      <site name="nose" pos="0 0 0.05"/><site name="neck" pos="0.15 0 0.05"/>
      <body name="tail" pos="0.18 0 0">
        <joint name="tail" axis="0 0 1" damping="0.001"/>
        <geom type="ellipsoid" size="0.06 0.004 0.05" pos="0.06 0 0" mass="0.02"/><site name="tip" pos="0.12 0 0.05"/>
        <body name="fin" pos="0.12 0 0">
          <joint name="fin" axis="0 0 1" damping="0.0005" stiffness="0.03"/>
          <geom type="ellipsoid" size="0.04 0.003 0.05" pos="0.04 0 0" mass="0.01"/><site name="fin" pos="0.08 0 0.05"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="tail" kp="2" kv="0.02"/></actuator>
</mujoco>
"""
SERVO = """
format = 1
name = "puffer"
description = "A hull whose tail swings with a servo."
model = "puffer.xml"
markers = ["nose", "neck", "tip", "fin"]
[swims]
surge_joints = ["x", "y"]
tail_markers = ["tip", "fin"]
servo = {amplitude = 0.5}
[[parameters]]
name = "drag"
lower = 0.1
upper = 5.0
meaning = "Drag at right angles to the hull and the tail."
targets = 'geom class "main" fluidcoef[0]'
"""


def test_a_tail_on_a_servo_swims_steadily_and_is_calibrated_like_a_motor(tmp_path):
    (tmp_path / "puffer.xml").write_text(SERVO_XML.format(drag=1.0))
    (tmp_path / "puffer.toml").write_text(SERVO)
    robot = load_robot(tmp_path / "puffer.toml")
    assert (robot.swims.motor_joint, robot.trials.controls) == (None, {"servo": Drive(0.5)})
    swims = [Swim(f"f{i}", Actuation(f, 0.0, 0.0), 4.0) for i, f in enumerate((1.0, 1.4))]
    cycles = Simulator(robot, 2).simulate({"drag": 0.6}, swims)
    for swim, trial in zip(swims, cycles, strict=True):
        assert "steady cycle" in trial.provenance
        assert trial.track.speed > 0.02  # forward
        whole = Simulator(robot, 1, full_length=True).simulate({"drag": 0.6}, [swim]).trials[0]
        assert trial.track.speed == pytest.approx(whole.track.speed, abs=1e-3)
    problem = Problem(robot, cycles, threads=2)
    assert problem.protocol.name == "motion"
    at, off = problem.evaluate_many([{"drag": 0.6}, {"drag": 1.5}])
    assert at.loss < 1e-3
    assert off.loss > 3 * at.loss
