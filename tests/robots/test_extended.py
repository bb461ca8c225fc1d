"""The fish with parameters beyond the paper's 16, and robots by name."""

from dataclasses import replace

import numpy as np
import pytest

from fluidstep.step import FastStep, disagreement
from swim2real.calibration import Problem
from swim2real.demo.synthetic import SyntheticCamera, synthetic_reference
from swim2real.robots.fish import FISH, FISH_EXTENDED, FISH_ROLLING
from swim2real.simulation import Simulator, Swim
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation

PUBLISHED = FISH_EXTENDED.space.published
EXTRA = FISH_EXTENDED.space.names[16:]


@pytest.mark.parametrize("name", EXTRA)
def test_every_extra_parameter_changes_the_swim_that_is_the_plain_fishs_without(name):
    values = (PUBLISHED, {**PUBLISHED, name: 1.0})
    models = [FISH.build(FISH.space.published).compile(), *(FISH_EXTENDED.build(one).compile() for one in values)]
    plain, before, after = (Stepper(model, FISH_EXTENDED, 0.1, 9.0, 0.0).run(300).markers for model in models)
    np.testing.assert_array_equal(plain, before)
    assert np.linalg.norm(after - before, axis=2).max() > 1e-5


@pytest.mark.parametrize("robot", [FISH_EXTENDED, FISH_ROLLING])
def test_the_fast_step_takes_it(robot):
    rough = {parameter.name: parameter.upper for parameter in robot.space.parameters[16:]}
    for values in (robot.space.published, {**robot.space.published, **rough}):
        assert disagreement(FastStep(robot.build(values).compile())) < 1e-10


def test_its_response_expects_what_the_extra_parameters_do():
    """The published fish, and the same with more of each extra parameter, simulated from rest."""
    space, driven = replace(FISH_EXTENDED.space, scale="log"), np.array([0.5, 1.0, 1.5])
    simulator, response = Simulator(FISH_EXTENDED, threads=1), FISH_EXTENDED.swims.response
    for extra in ({}, {"hull_added_mass": 1.5}, {"surface_damping": 0.5}):
        values = {**PUBLISHED, **extra}
        swims = [Swim(f"{f}", Actuation(f, 0.0, 0.0), 4 / f) for f in driven]
        point = space.to_cube(values)[None]
        speeds, forward = response.speeds(point, driven)
        found = [trial.track.speed for trial in simulator.simulate(values, swims)]
        assert speeds[0] == pytest.approx(found, rel=0.4)
        assert forward.min() > 0.3
    assert response.lengths.shape == (len(space),)
    assert response.beats(point, driven).shape == (1, 3, 18)


FREQUENCIES, HIDDEN = (0.6, 1.0, 1.4), {"hull_added_mass": 1.0, "surface_damping": 0.6}


@pytest.fixture(scope="module")
def damped_swims():
    """Swims of the published fish with water to accelerate and damping at the surface, seen without noise."""
    return synthetic_reference(FISH_EXTENDED, {**PUBLISHED, **HIDDEN}, FREQUENCIES, 3.0, SyntheticCamera(), seed=0)


@pytest.mark.slow
@pytest.mark.usefixtures("repeatable_swims")
@pytest.mark.parametrize("name", EXTRA)
def test_an_extra_parameter_is_recovered_from_swims(name, damped_swims):
    """The whole motion tells it from the other parameters, here all known."""
    problem = Problem(FISH_EXTENDED, damped_swims, threads=1)
    shares = (0.0, 0.5, 1.0, 1.5)
    values = [{**PUBLISHED, **HIDDEN, name: share * HIDDEN[name]} for share in shares]
    losses = [comparison.loss for comparison in problem.evaluate_many(values)]
    assert shares[int(np.argmin(losses))] == 1.0
    assert losses[0] > 5 * min(losses)
    assert np.all(np.diff(losses[:3]) < 0)
    assert np.all(np.diff(losses[2:]) > 0)
