"""Many simulations in one call do what each does alone, by the fast step or by the engine's."""

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest

from fluidstep.batch import Batch
from fluidstep.step import FastStep
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swimbase.errors import EngineError

PUBLISHED = FISH.space.published
SLOW = {**PUBLISHED, "fluid_slender_drag": 9.9, "motor_arm_length": 0.02}
STEPS = 40
SPEEDS = np.linspace(2.0, 7.0, 7)[:, None]


def compiled(robot, values):
    """The model with its sensors, and without."""
    reader, spec = robot.build(values).compile(), robot.build(values)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    return spec.compile(), reader


def batch_of(robot, sets, count, threads=1):
    models = [compiled(robot, values) for values in sets]
    batch = Batch([model for model, _ in models], [reader for _, reader in models], count, threads)
    for i in range(count):
        batch.start(i, i % len(sets))
    return batch, models


@pytest.mark.parametrize("threads", [1, 3])
def test_each_simulation_is_the_fast_step_of_its_own_set(threads):
    batch, models = batch_of(FISH, [PUBLISHED, SLOW], len(SPEEDS), threads)
    assert batch.fast
    batch.step(SPEEDS, STEPS)
    batch.step(SPEEDS, STEPS, np.arange(1, len(SPEEDS)))
    for i, speed in enumerate(SPEEDS):
        model, reader = models[i % 2]
        alone = mujoco.MjData(model)
        FastStep(model).run(alone, speed, (2 if i else 1) * STEPS)
        np.testing.assert_array_equal(batch.qpos[i], alone.qpos)
        np.testing.assert_array_equal(batch.qvel[i], alone.qvel)
        read = mujoco.MjData(reader)
        read.qpos[:], read.qvel[:] = alone.qpos, alone.qvel
        mujoco.mj_forward(reader, read)
        np.testing.assert_allclose(batch.sensors[i], read.sensordata, atol=1e-12)
    batch.close()


def test_a_robot_that_the_fast_step_does_not_know_is_stepped_by_the_engine():
    finger = load_robot(Path(__file__).parents[2] / "examples/finger/finger.toml")
    batch, [(model, reader)] = batch_of(finger, [finger.space.published], 2)
    assert not batch.fast
    pull = np.array([[0.02], [0.04]])
    batch.step(pull, STEPS)
    for i in range(2):
        alone = mujoco.MjData(model)
        alone.ctrl[:] = pull[i]
        mujoco.mj_step(model, alone, STEPS)
        np.testing.assert_array_equal(batch.qpos[i], alone.qpos)
        read = mujoco.MjData(reader)  # a force: the sensor needs all of the forward dynamics
        read.qpos[:], read.qvel[:], read.ctrl[:] = alone.qpos, alone.qvel, pull[i]
        mujoco.mj_forward(reader, read)
        np.testing.assert_allclose(batch.sensors[i], read.sensordata, rtol=1e-6)


@pytest.mark.parametrize("robot", ["fish", "finger"])
def test_a_diverged_simulation_is_told_and_leaves_the_others_alone(robot):
    known = FISH if robot == "fish" else load_robot(Path(__file__).parents[2] / "examples/finger/finger.toml")
    batch, _ = batch_of(known, [known.space.published], 3)
    controls = np.full((3, 1), 0.03)
    batch.step(controls, STEPS)
    before = batch.qpos.copy()
    batch.data(1).qvel[0] = np.nan
    batch.step(controls, STEPS)
    assert list(batch.failed) == [False, True, False]
    np.testing.assert_array_equal(batch.qpos[1], before[1])  # what was last read
    np.testing.assert_array_equal(batch.qpos[0], batch.qpos[2])
    assert (batch.qpos[0] != before[0]).any()
    batch.start(1, 0)
    batch.step(controls, STEPS)
    assert not batch.failed.any()


def test_sets_of_another_structure_are_refused():
    def thinner(values):
        spec = FISH.build(values)
        if values["motor_arm_length"] == SLOW["motor_arm_length"]:
            spec.delete(spec.geoms[-1])
        return spec

    with pytest.raises(EngineError, match="differ in the structure"):
        batch_of(dataclasses.replace(FISH, build=thinner), [PUBLISHED, SLOW], 2)
