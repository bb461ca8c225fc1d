"""The fast step of a model from elsewhere, whose bodies have no ellipsoids, and what comes with its import."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from fluidstep import Batch, FastStep, UnsupportedModelError, disagreement
from fluidstep.plan import DRAG, DRAG_LIN, SPIN, SPIN_LIN
from refused import refusal, says
from swimbase.errors import ArgumentError, EngineError

TOLERANCE = 1e-10  # relative, after one step
IMPLICIT, IMPLICITFAST = mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST


@pytest.fixture
def swimmer() -> mujoco.MjModel:
    """Gymnasium's, as it is; its integrator is RK4."""
    found = importlib.util.find_spec("gymnasium")
    if found is None or found.origin is None:
        pytest.skip("the swimmer is in gymnasium, of the extra rl")
    return mujoco.MjModel.from_xml_path(str(Path(found.origin).parent / "envs/mujoco/assets/swimmer.xml"))


@pytest.mark.parametrize("integrator", [IMPLICIT, IMPLICITFAST])
def test_one_step_of_gymnasiums_swimmer_is_the_engines(swimmer, integrator):
    swimmer.opt.integrator = integrator
    swimmer.opt.wind[:] = 0.3, -0.2, 0.1
    assert disagreement(FastStep(swimmer), states=50) < TOLERANCE / 10
    for column in (slice(DRAG, DRAG + 3), DRAG_LIN, slice(SPIN, SPIN + 3), SPIN_LIN):
        spoiled = FastStep(swimmer)
        spoiled._members.geoms[:, :, column] *= 1 + 1e-4
        assert disagreement(spoiled, states=50) > TOLERANCE, column


def test_a_batch_of_the_swimmer_makes_its_fast_steps(swimmer):
    swimmer.opt.integrator = IMPLICIT
    batch, controls = Batch([swimmer], 3), np.random.default_rng(0).uniform(-1, 1, (3, swimmer.nu))
    assert says(refusal(EngineError, batch.step, controls, 10), "simulation 0", "start it first")
    for i in range(3):
        batch.start(i)
    batch.step(controls, 10)
    for i, control in enumerate(controls):
        alone = mujoco.MjData(swimmer)
        FastStep(swimmer).run(alone, control, 10)
        np.testing.assert_array_equal(batch.qpos[i], alone.qpos)
    assert says(refusal(ArgumentError, batch.step, controls[:2], 10), "(2, 2)", "(3, 2)", "(3, steps, 2)")


def test_a_model_as_it_is_and_data_of_another_are_refused(swimmer):
    with pytest.raises(UnsupportedModelError, match="the integrator is RK4; it must be implicit or implicitfast"):
        FastStep(swimmer)
    swimmer.opt.integrator = IMPLICIT
    other = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    said = refusal(EngineError, FastStep(swimmer).run, other, np.zeros(2), 1)
    assert says(said, "[0, 0, 0,", "[5, 5, 2,", "mujoco.MjData(model)")


def test_the_import_brings_no_films_and_needs_no_scipy():
    script = (
        "import sys; sys.modules['scipy'] = None  # which numba imports where it is\n"
        "import fluidstep; fluidstep.FastStep, fluidstep.Batch; print(*sys.modules)"
    )
    made = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    modules = made.stdout.split()
    assert "numba" in modules
    assert not {"cv2", "av", "pydantic", "pandas", "torch", "swim2real", "markertrack"}.intersection(modules)
