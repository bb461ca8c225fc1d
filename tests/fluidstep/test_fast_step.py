"""The fast step against the engine's own: same numbers, for the fish and for anything else that it claims to step."""

import logging
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import fluidstep
import swimbase
from fluidstep import FastStep, UnsupportedModelError, disagreement
from fluidstep.plan import ABC, DRAG_SLENDER, INERTIA, LIFT, MAGNUS, MASS, SPIN
from refused import refusal, says
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation
from swimbase.errors import EngineError

TOLERANCE = 1e-10  # relative, after one step
IMPLICIT, IMPLICITFAST = mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
PUBLISHED = FISH.space.published

# everything within the limits that the fish doesn't have: other shapes and joints, wind, a floor to touch, several
# trees, turned geoms, bodies without an ellipsoid, tendons across branches, every kind of actuator
ZOO = """
<mujoco><option timestep="0.002" integrator="{integrator}" density="1000" viscosity="0.01" wind="0.3 -.2 .1" {option}/>
<worldbody><geom type="plane" size="5 5 .1"/>
 <body name="root" pos="0 0 {height}">{root}<geom {shape} euler="20 30 40" fluidshape="ellipsoid"/>
  <geom type="capsule" size=".03 .08" pos=".1 .02 .03" euler="10 70 0" fluidshape="ellipsoid"
   fluidcoef=".4 .3 1.1 2 .8"/>
  <body pos=".2 0 0">{joint}<geom type="ellipsoid" size=".05 .02 .01" fluidshape="ellipsoid"/>
   <site name="a" pos="0 .05 0"/>
   <body pos=".1 0 0" euler="0 20 0"><joint type="hinge" axis="0 1 .2" damping=".01" name="h"/>
    <joint type="slide" axis="1 0 0" stiffness="5"/>
    <geom type="cylinder" size=".02 .05" euler="90 10 0" fluidshape="ellipsoid"/>
    <geom type="sphere" size=".03" pos=".02 0 0"/><site name="b"/></body></body>
  <body pos="-.2 0 0"><joint type="hinge" axis="0 0 1" name="k"/>
   <geom type="box" size=".05 .002 .04" euler="10 20 30"/><site name="c" pos="0 .03 0"/></body>
 </body>
 <body pos="1 0 {height}">{root}<geom type="box" size=".1 .05 .02" fluidshape="ellipsoid"/></body>
</worldbody>
<tendon>
 <spatial name="t" damping="2" stiffness="30"><site site="a"/><site site="b"/></spatial>
 <spatial name="t2" damping="1"><site site="b"/><site site="c"/></spatial>
</tendon>
<actuator><motor joint="h"/><velocity joint="k" kv="2"/><position joint="k" kp="3" kv=".1" timeconst=".03"/>
 <muscle joint="h" lengthrange="-1 1"/><velocity tendon="t2" kv="1"/></actuator>
<sensor><framepos objtype="site" objname="a"/><jointvel joint="h"/><velocimeter site="c"/></sensor></mujoco>"""
FREE = {"root": "<freejoint/>", "joint": '<joint type="ball" damping=".02"/>'}
FIXED = {
    "root": '<joint type="slide" axis="1 0 0"/><joint type="hinge" axis="1 2 0"/>',
    "joint": '<joint axis="1 1 1"/>',
}
SHAPES = ('type="box" size=".2 .05 .1"', 'type="cylinder" size=".05 .2"', 'type="sphere" size=".1"')


def zoo(integrator="implicit", height=3.0, shape=SHAPES[0], option="", joints=None) -> mujoco.MjModel:
    joints = joints or (FREE if integrator == "implicit" else FIXED)
    return mujoco.MjModel.from_xml_string(
        ZOO.format(integrator=integrator, height=height, shape=shape, option=option, **joints)
    )


def fishes(count: int, integrator: int, seed: int = 0):
    """Compiled fishes with parameters from anywhere in the box."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        spec = FISH.build(FISH.space.to_values(rng.random(len(FISH.space))))
        spec.option.integrator = integrator
        yield spec.compile()


def worst_of_steps(model: mujoco.MjModel, states: int, seed: int, spread: float) -> float:
    """Largest relative difference of velocities, positions and activations after one step from random states."""
    rng, fast = np.random.default_rng(seed), FastStep(model)
    engine, ours, worst, broken = mujoco.MjData(model), mujoco.MjData(model), 0.0, 0
    for _ in range(states):
        for data in (engine, ours):
            mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, engine.qpos, rng.uniform(-spread, spread, model.nv), 1.0)
        engine.qvel[:] = rng.normal(size=model.nv) * 10 ** rng.uniform(-4, 1)
        engine.ctrl[:] = rng.uniform(-20, 20) * rng.normal(size=model.nu)
        engine.act[:] = rng.uniform(0, 1, model.na)
        ours.qpos[:], ours.qvel[:], ours.act[:] = engine.qpos, engine.qvel, engine.act
        qpos, qvel = engine.qpos.copy(), engine.qvel.copy()
        mujoco.mj_step(model, engine)
        made = fast.run(ours, engine.ctrl, 1)
        assert not made.failed
        np.testing.assert_array_equal(made.qpos[0], qpos)
        np.testing.assert_array_equal(made.qvel[0], qvel)
        np.testing.assert_allclose(made.sensors[0], engine.sensordata, rtol=1e-12, atol=1e-12)
        assert ours.time == engine.time
        if not np.isfinite(engine.qvel).all():  # implicitfast can't factor its matrix in some states
            assert not np.isfinite(ours.qvel).all()
            broken += 1
            continue
        for name in ("qvel", "qpos", "act"):
            a, b = getattr(engine, name), getattr(ours, name)
            if a.size:
                worst = max(worst, float(np.abs(a - b).max() / np.abs(a).max()))
    assert broken <= (states // 4 if model.opt.integrator == IMPLICITFAST else 0)
    return worst


@pytest.mark.parametrize("count", [6, pytest.param(50, marks=pytest.mark.slow)])
@pytest.mark.parametrize("integrator", [IMPLICIT, IMPLICITFAST])
def test_one_step_of_any_fish_from_any_state_is_the_engines(integrator, count):
    worst = [worst_of_steps(model, 40, seed, spread=0.8) for seed, model in enumerate(fishes(count, integrator))]
    assert max(worst) < TOLERANCE


@pytest.mark.parametrize("integrator", [IMPLICIT, IMPLICITFAST])
def test_one_step_at_the_joints_limits_is_the_engines(integrator):
    model = next(fishes(1, integrator))
    assert worst_of_steps(model, 40, 1, spread=3.0) < TOLERANCE
    data = mujoco.MjData(model)
    data.qpos[-3:] = 3.0
    mujoco.mj_forward(model, data)
    assert data.nefc > 0  # limits do act out there


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
def test_one_step_of_other_robots_is_the_engines(integrator, shape):
    assert worst_of_steps(zoo(integrator, shape=shape), 100, 2, spread=0.5) < TOLERANCE
    model = zoo(integrator, shape=shape, joints=FIXED)
    assert worst_of_steps(model, 50, 3, spread=0.5) < TOLERANCE
    model.opt.density = model.opt.viscosity = 0.0  # out of the water
    assert worst_of_steps(model, 20, 5, spread=0.5) < TOLERANCE


@pytest.mark.parametrize("option", ["", 'jacobian="sparse"'])
@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
def test_one_step_in_contact_is_the_engines(integrator, option):
    model = zoo(integrator, height=0.05, option=option)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon > 0
    # contacts amplify rounding: the solver stops at its own tolerance
    assert worst_of_steps(model, 50, 4, spread=0.1) < 1e-7


def test_the_check_passes_and_notices_a_coefficient_off_by_a_millionth():
    for model in (FISH.build(PUBLISHED).compile(), zoo()):
        assert disagreement(FastStep(model)) < TOLERANCE / 10
        for column in (ABC, DRAG_SLENDER, LIFT, MAGNUS, MASS, INERTIA, SPIN):
            spoiled = FastStep(model)
            spoiled._members.geoms[:, :, column] *= 1 + 1e-6
            assert disagreement(spoiled) > TOLERANCE, column
    wrong = FastStep(zoo())
    wrong.plan.dof_last[:] = -1  # free and ball joints taken for hinges
    assert disagreement(wrong) > TOLERANCE


def test_what_the_fast_step_does_not_do_is_refused_with_the_reason():
    def accelerometer(spec):
        site = spec.sites[0].name
        kind = mujoco.mjtSensor.mjSENS_ACCELEROMETER
        spec.add_sensor(name="felt", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)

    def option(name, value):
        return lambda spec: setattr(spec.option, name, value)

    for change, reason in (
        (accelerometer, "sensors of forces or accelerations"),
        (
            option("integrator", mujoco.mjtIntegrator.mjINT_EULER),
            "the integrator is EULER; it must be implicit or implicitfast",
        ),
        (
            option("enableflags", int(mujoco.mjtEnableBit.mjENBL_ENERGY)),
            "an enable flag is set: enableflags is 2, not 0",
        ),
        (option("disableflags", int(mujoco.mjtDisableBit.mjDSBL_DAMPER)), "springs or dampers are switched off"),
    ):
        with pytest.raises(UnsupportedModelError, match=reason):
            FastStep(with_spec(change).build(PUBLISHED).compile())
    with pytest.raises(UnsupportedModelError, match="implicitfast treats free and ball joints in its own way"):
        FastStep(zoo("implicitfast", joints=FREE))


SWIMS = (Swim("slow", Actuation(1.1, 0.0, 0.1), 1.0), Swim("from rest", Actuation(1.5), 0.5))


def with_spec(change):
    def build(values):
        spec = FISH.build(values)
        change(spec)
        return spec

    return replace(FISH, build=build)


def test_an_unsupported_robot_is_simulated_by_the_engine_with_one_warning(caplog, monkeypatch):
    robot = with_spec(lambda spec: setattr(spec.option, "enableflags", int(mujoco.mjtEnableBit.mjENBL_ENERGY)))
    with caplog.at_level(logging.WARNING):
        simulator = Simulator(robot, threads=1)
        trials = simulator.simulate(PUBLISHED, SWIMS[1:])
    (record,) = caplog.records
    assert says(record.message, "'fish'", "engine's own step", "slower", "an enable flag is set")
    assert simulator.step == "engine"
    assert "engine's own step" in trials["from rest"].provenance
    expected = Simulator(FISH, threads=1, step="engine").simulate(PUBLISHED, SWIMS[1:])
    np.testing.assert_array_equal(trials["from rest"].track.positions, expected["from rest"].track.positions)
    said = refusal(EngineError, Simulator, robot, threads=1, step="fast")
    assert says(said, "'fish'", "an enable flag is set", "use step 'engine'")
    assert says(refusal(EngineError, Simulator, FISH, step="quick"), "'quick'", "auto, fast, engine")
    monkeypatch.setattr("swim2real.simulation.simulator.disagreement", lambda fast: 3e-9)
    assert Simulator(FISH, threads=1).step == "engine"
    assert says(caplog.text, "differs from the engine's own by 3e-09")


def test_simulated_trials_are_the_engines(new_fluid_law):
    if new_fluid_law:
        pytest.skip("with the newer fluid forces the engine itself ends up mm away when it starts 1e-16 off")
    fast, engine = (Simulator(FISH, threads=2, step=step).simulate(PUBLISHED, SWIMS) for step in ("fast", "engine"))
    for swim in SWIMS:
        np.testing.assert_allclose(fast[swim.name].track.positions, engine[swim.name].track.positions, atol=1e-6)
        assert "fast step" in fast[swim.name].provenance


@pytest.mark.parametrize("speed", [1e9, 3e10, np.nan])
def test_a_failure_is_told_at_the_engines_time(speed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the engine writes a log
    model = FISH.build(PUBLISHED).compile()
    failures = []
    for fast in (FastStep(model), None):
        stepper = Stepper(model, FISH, 0.1, 12.0, 0.0, fast)
        assert stepper.run(10).failed_at is None
        stepper._data.qvel[8] = speed
        failures.append(stepper.run(20).failed_at)
    assert failures[0] == failures[1] == pytest.approx(0.01)


def swim(model, fast, frequency=1.5, steps=500):
    return Stepper(model, FISH, 0.1, 2 * np.pi * frequency, 0.0, fast).run(steps)


def test_threads_that_share_a_step_change_no_bit():
    model = FISH.build(PUBLISHED).compile()
    fast = FastStep(model)
    frequencies = np.linspace(0.5, 2.0, 8)
    alone = [swim(model, fast, frequency).markers for frequency in frequencies]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda frequency: swim(model, fast, frequency).markers, frequencies))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_each_step_may_have_its_own_control():
    model, rng = zoo(), np.random.default_rng(6)
    control = rng.normal(size=(50, model.nu))
    ours, engine = mujoco.MjData(model), mujoco.MjData(model)
    made = FastStep(model).run(ours, control, 50)
    for row, qpos in zip(control, made.qpos, strict=True):
        np.testing.assert_allclose(qpos, engine.qpos, atol=1e-9)
        engine.ctrl[:] = row
        mujoco.mj_step(model, engine)
    np.testing.assert_allclose(ours.qvel, engine.qvel, atol=1e-8)


SMALL = """<mujoco><option integrator="implicit" density="1000"/><worldbody><body><joint/><geom size=".1"/></body>
</worldbody></mujoco>"""
ELSEWHERE = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}


@pytest.mark.slow
def test_what_another_version_has_kept_on_the_disk_is_left_alone(tmp_path):
    """A kept function is read with the tuples that it takes, which another version may name otherwise."""
    for package in (fluidstep, swimbase):
        shutil.copytree(Path(package.__file__).parent, tmp_path / package.__name__)
    code = f"import fluidstep, mujoco; m = mujoco.MjModel.from_xml_string({SMALL!r}); "
    code += "print(fluidstep.disagreement(fluidstep.FastStep(m)))"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=ELSEWHERE, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert float(done.stdout) < TOLERANCE
        for place in (tmp_path / "fluidstep").glob("*.py"):
            place.write_text(re.sub(r"\bProgram\b", "Programme", place.read_text()))
