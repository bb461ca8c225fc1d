import json

import mujoco
import pytest

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


def test_the_fingerprint_repeats(engine):
    assert Engine.of(FISH) == engine
    assert engine.name == f"mujoco {mujoco.__version__}"
    assert (engine.integrator, engine.timestep) == ("implicit", 0.001)
    assert max(map(abs, engine.fluid_fingerprint)) > 0.01


def test_an_engine_agrees_with_its_own_record(engine):
    assert engine.difference(altered(engine)) is None


def test_another_version_with_the_same_fluid_law_agrees(engine):
    assert engine.difference(altered(engine, name="mujoco 3.3.2")) is None


def test_another_fluid_law_is_told(engine):
    other = [1.05 * force for force in engine.fluid_fingerprint]
    sentence = engine.difference(altered(engine, name="mujoco 3.99.0", fluid_fingerprint=other))
    assert sentence == (
        f"made with mujoco 3.99.0, whose fluid forces differ from those of the installed {engine.name} by 5 % at the "
        f"fixed state; its parameters aren't valid here. Install the recorded engine or calibrate again"
    )


def test_one_force_that_differs_is_enough(engine):
    forces = list(engine.fluid_fingerprint)
    forces[3] += 1e-6 * max(map(abs, forces))
    assert engine.difference(altered(engine, fluid_fingerprint=forces)) is not None


@pytest.mark.parametrize("change", [{"integrator": "euler"}, {"timestep": 0.002}])
def test_another_integrator_or_timestep_is_told(engine, change):
    sentence = engine.difference(altered(engine, **change))
    assert sentence is not None
    assert sentence.startswith("made with integrator ")
    assert str(next(iter(change.values()))) in sentence


def test_the_two_fluid_laws_have_their_known_fingerprints(engine, new_fluid_law):
    forces = [engine.fluid_fingerprint[i] for i in (0, 1, 5)]
    assert forces == pytest.approx(NEW_LAW if new_fluid_law else OLD_LAW, rel=1e-6)
