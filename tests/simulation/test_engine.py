import json

import mujoco
import pytest

from refused import says
from swim2real.robots.fish import FISH
from swim2real.simulation import Engine

# generalized forces along x and y and about z at the fixed state, before MuJoCo 3.14 and from it on
OLD_LAW = (-0.958170443, 11.0581809, 2.35161518)
NEW_LAW = (-0.689918220, 12.7010433, 2.90162460)


@pytest.fixture(scope="module")
def engine() -> Engine:
    return Engine.of(FISH)


def altered(engine, **changes):
    return {**json.loads(json.dumps(engine.as_dict())), **changes}


def test_an_engine_agrees_with_its_own_record_and_reports_other_physics(engine):
    assert Engine.of(FISH) == engine
    assert (engine.name, engine.integrator, engine.timestep) == (f"mujoco {mujoco.__version__}", "implicit", 0.001)
    assert engine.difference(altered(engine)) is None
    assert engine.difference(altered(engine, name="mujoco 3.3.2")) is None
    other = [1.05 * force for force in engine.fluid_fingerprint]
    said = engine.difference(altered(engine, name="mujoco 3.99.0", fluid_fingerprint=other))
    assert says(said, "mujoco 3.99.0", engine.name, "5 %", "Install the recorded engine or calibrate again")
    other = list(engine.fluid_fingerprint)
    other[3] += 1e-6 * max(map(abs, other))  # one force is enough
    said = engine.difference(altered(engine, fluid_fingerprint=other))
    assert says(said, "another model of the robot", "evaluate its parameters again")
    for none in ([1.0], None, "x"):
        assert says(engine.difference(altered(engine, fluid_fingerprint=none)), "unknown")
    assert says(engine.difference(altered(engine, integrator="euler")), "integrator euler")
    assert says(engine.difference(altered(engine, timestep=0.002)), "0.002 s")


def test_the_two_fluid_laws_have_their_known_fingerprints(engine, new_fluid_law):
    forces = [engine.fluid_fingerprint[i] for i in (0, 1, 5)]
    assert forces == pytest.approx(NEW_LAW if new_fluid_law else OLD_LAW, rel=1e-6)
