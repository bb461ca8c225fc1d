"""Dry friction in the fast step: the engine's solver finds it there, so the numbers are the engine's own."""

import mujoco
import numpy as np
import pytest

from fluidstep.step import FastStep, disagreement
from swim2real.robots.fish import FISH
from swim2real.simulation.stepper import Stepper

SLIDES, TAIL = ("slide_x", "slide_y"), tuple(f"tail{i}" for i in range(5))
IMPLICIT, IMPLICITFAST = mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
PUBLISHED = FISH.space.published


def rough(friction: float, joints=SLIDES, point=None, integrator=IMPLICIT) -> mujoco.MjModel:
    """A fish with dry friction in some joints [N or N·m]."""
    spec = FISH.build(PUBLISHED if point is None else FISH.space.to_values(point))
    spec.option.integrator = integrator
    for name in joints:
        spec.joint(name).frictionloss = friction
    return spec.compile()


def one_step(model: mujoco.MjModel, states: int, seed: int) -> tuple[float, float, float]:
    """Largest relative difference of velocities after one step; shares of friction forces that stick and that slip."""
    rng, fast = np.random.default_rng(seed), FastStep(model)
    engine, ours, worst = mujoco.MjData(model), mujoco.MjData(model), 0.0
    held: list[bool] = []
    for _ in range(states):
        for data in (engine, ours):
            mujoco.mj_resetData(model, data)
        # close to rest at the joints and with a motor at rest, so that a small friction can hold the robot
        engine.qpos[:] = 0.003 * rng.uniform(0, 1) * rng.normal(size=model.nq)
        engine.qvel[:] = rng.normal(size=model.nv) * 10 ** rng.uniform(-6, 0)
        engine.qacc_warmstart[:] = rng.normal(size=model.nv) * 10 ** rng.uniform(-6, 2)
        for name in ("qpos", "qvel", "qacc_warmstart"):
            getattr(ours, name)[:] = getattr(engine, name)
        mujoco.mj_step(model, engine)
        made = fast.run(ours, np.zeros(1), 1)
        assert not made.failed
        forces = np.abs(engine.efc_force[: engine.nf])
        held += list(forces < 0.999 * model.dof_frictionloss[model.dof_frictionloss > 0])
        worst = max(worst, float(np.abs(engine.qvel - ours.qvel).max() / np.abs(engine.qvel).max()))
        np.testing.assert_allclose(ours.qfrc_constraint, engine.qfrc_constraint, rtol=0, atol=1e-9)
    return worst, float(np.mean(held)), 1 - float(np.mean(held))


@pytest.mark.parametrize("joints", [SLIDES, TAIL, (*SLIDES, *TAIL)])
@pytest.mark.parametrize("integrator", [IMPLICIT, IMPLICITFAST])
def test_one_step_with_dry_friction_is_the_engines(integrator, joints):
    sticks, slips = 0.0, 0.0
    for seed, friction in enumerate((1e-4, 0.01, 0.05, 0.5)):
        point = np.random.default_rng(seed).random(16)
        worst, stick, slip = one_step(rough(friction, joints, point, integrator), 60, seed)
        assert worst < 1e-9
        sticks, slips = max(sticks, stick), max(slips, slip)
    assert sticks > 0.3
    assert slips > 0.3


def test_the_check_at_a_simulators_start_covers_friction():
    assert disagreement(FastStep(rough(0.03)), 30) < 1e-10
    slippery = FastStep(rough(0.03))
    slippery._dry.dof_frictionloss[:] *= 1.001  # what the engine's solver is given
    assert disagreement(slippery, 30) > 1e-10


def swim(model, fast, steps=1500):
    return Stepper(model, FISH, 0.1, 9.0, 0.0, fast).run(steps)


def test_a_swim_with_friction_is_the_engines_and_slower():
    model = rough(0.03)
    ours, engine = swim(model, FastStep(model)), swim(model, None)
    np.testing.assert_allclose(ours.markers, engine.markers, rtol=0, atol=1e-7)
    smooth = swim(rough(0.0), FastStep(rough(0.0)))
    assert smooth.markers[-1, 0, 0] < ours.markers[-1, 0, 0] - 1e-3  # it swims toward -x
