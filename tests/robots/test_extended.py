"""The fish with parameters beyond the paper's 16, and robots by name."""

import json
from dataclasses import replace

import numpy as np
import pytest

from swim2real.calibration import Problem
from swim2real.demo.synthetic import Camera, synthetic_reference
from swim2real.errors import ArgumentError, ParameterError
from swim2real.parameters import read_parameters
from swim2real.pipeline import calibrate
from swim2real.robots import ROBOTS, load_robot
from swim2real.robots.fish import FISH, FISH_EXTENDED
from swim2real.robots.fish.response import DRAG
from swim2real.settings import CalibrationSettings
from swim2real.simulation import Simulator, Swim
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation

PUBLISHED = FISH_EXTENDED.space.published
EXTRA = FISH_EXTENDED.space.names[16:]


def test_robots_have_names():
    assert ROBOTS == ("fish", "fish-extended")
    assert load_robot("fish") is FISH
    assert load_robot("fish-extended") is FISH_EXTENDED
    assert [load_robot(name).name for name in ROBOTS] == list(ROBOTS)
    with pytest.raises(ArgumentError) as caught:
        load_robot("shark")
    assert str(caught.value) == "there is no robot 'shark'; there are fish, fish-extended, or give a robot file (.toml)"


def test_the_sixteen_come_first_and_stay_as_they_are():
    assert FISH_EXTENDED.space.parameters[:16] == FISH.space.parameters
    assert EXTRA[0] == "surface_friction"
    assert len(FISH.space) == 16
    friction = FISH_EXTENDED.space["surface_friction"]
    assert (friction.lower, friction.upper, friction.unit, friction.published) == (0.0, 0.05, "N", 0.0)


def test_the_published_extended_fish_is_the_published_fish():
    assert FISH_EXTENDED.build(PUBLISHED).to_xml() == FISH.build(FISH.space.published).to_xml()


@pytest.mark.parametrize("name", EXTRA)
def test_every_extra_parameter_changes_the_swim(name):
    parameter = FISH_EXTENDED.space[name]
    other = parameter.upper if parameter.published == parameter.lower else parameter.lower
    models = [FISH_EXTENDED.build({**PUBLISHED, name: value}).compile() for value in (parameter.published, other)]
    before, after = (Stepper(model, FISH_EXTENDED, 0.1, 9.0, 0.0).run(300).markers for model in models)
    assert np.linalg.norm(after - before, axis=2).max() > 1e-5


def test_surface_friction_is_on_the_heads_two_slides_alone():
    model = FISH_EXTENDED.build({**PUBLISHED, "surface_friction": 0.03}).compile()
    rough = {model.joint(int(model.dof_jntid[dof])).name: model.dof_frictionloss[dof] for dof in range(model.nv)}
    assert {name: force for name, force in rough.items() if force} == {"slide_x": 0.03, "slide_y": 0.03}


def test_bad_values_are_refused_as_for_the_fish():
    with pytest.raises(ParameterError) as caught:
        FISH_EXTENDED.build({**PUBLISHED, "surface_friction": 0.06})
    assert str(caught.value) == "parameter 'surface_friction' is 0.06, out of bounds; allowed is 0 to 0.05 N"
    with pytest.raises(ParameterError, match="missing parameter: surface_friction"):
        FISH_EXTENDED.build(FISH.space.published)


def test_the_fast_step_takes_the_extended_fish():
    assert Simulator(FISH_EXTENDED, threads=1, step="fast").step == "fast"
    rough = {parameter.name: parameter.upper for parameter in FISH_EXTENDED.space if parameter.name in EXTRA}
    model = FISH_EXTENDED.build({**PUBLISHED, **rough}).compile()
    simulator = Simulator(replace(FISH_EXTENDED, build=lambda values: _Same(model)), threads=1, step="fast")
    assert simulator.step == "fast"  # checked on this model


class _Same:
    def __init__(self, model):
        self.model = model

    def compile(self):
        return self.model


def points_and_values(friction: float):
    """Five random points of the extended fish with a friction [N], and their values."""
    points = np.random.default_rng(0).random((5, len(FISH_EXTENDED.space)))
    values = FISH_EXTENDED.space.to_array(points)
    values[:, 16:] = [PUBLISHED[name] for name in EXTRA]
    values[:, FISH_EXTENDED.space.names.index("surface_friction")] = friction
    return points, values


RATES = np.array([0.5, 1.0, 1.5])  # Hz


def test_without_friction_its_response_is_the_fishs():
    points, values = points_and_values(0.0)
    ours, plain = FISH_EXTENDED.swims.response, FISH.swims.response
    np.testing.assert_allclose(ours.speeds(points, values, RATES), plain.speeds(points[:, :16], values[:, :16], RATES))
    for whole_motion in (False, True):
        beats = ours.beats(points, RATES, whole_motion)
        np.testing.assert_allclose(beats, plain.beats(points[:, :16], RATES, whole_motion))


def test_its_response_expects_friction_to_slow_the_slow():
    points, smooth = points_and_values(0.0)
    rough = points_and_values(0.03)[1]
    response = FISH_EXTENDED.swims.response
    before, after = (np.abs(response.speeds(points, values, RATES)[0]) for values in (smooth, rough))
    np.testing.assert_allclose(np.maximum(before**2 - after**2, 0), np.minimum(before**2, 0.03 / DRAG))
    kept = after / before
    assert np.all(np.diff(kept, axis=1) >= 0)  # the faster the beat, the less


def test_the_drag_it_takes_is_about_right():
    """Two published fish, one with friction: the squared speeds differ by friction over drag."""
    simulator = Simulator(FISH_EXTENDED, threads=1)
    swims = [Swim("fast", Actuation(1.5, 0.0, 0.2), 2.0)]
    trials = [simulator.simulate({**PUBLISHED, "surface_friction": force}, swims)["fast"] for force in (0.0, 0.03)]
    smooth, rough = (trial.track.speed for trial in trials)
    assert DRAG / 3 < 0.03 / (smooth**2 - rough**2) < 3 * DRAG


FREQUENCIES, HIDDEN = (0.6, 1.0, 1.4), 0.03


@pytest.fixture(scope="module")
def rough_swims():
    """Swims of the published fish with friction at the surface, seen without noise."""
    values = {**PUBLISHED, "surface_friction": HIDDEN}
    return synthetic_reference(FISH_EXTENDED, values, FREQUENCIES, 3.0, Camera(), seed=0)


@pytest.mark.slow
def test_a_calibration_of_the_extended_fish_is_one_like_any_other(rough_swims, tmp_path):
    settings = CalibrationSettings(budget=5, seed=0, threads=1)
    outcome = calibrate(rough_swims, FISH_EXTENDED, settings, tmp_path / "run", sensitivity=True)
    assert [one.name for one in outcome.sensitivity][-len(EXTRA) :] == list(EXTRA)
    written = json.loads((tmp_path / "run" / "best.json").read_text())
    assert written["robot"] == "fish-extended"
    best = read_parameters(tmp_path / "run", "fish-extended", FISH_EXTENDED.space)
    assert list(best.values) == list(FISH_EXTENDED.space.names)
    record = [json.loads(line) for line in (tmp_path / "run" / "record.jsonl").read_text().splitlines()]
    assert len(record) == 5
    losses = [entry["loss"] for entry in record]
    assert min(losses) < losses[0]  # the advisor finds a better one
    with pytest.raises(ParameterError, match="is for robot 'fish-extended', not 'fish'"):
        read_parameters(tmp_path / "run", "fish", FISH.space)
    # going on with more budget takes the record up again
    more = calibrate(rough_swims, FISH_EXTENDED, replace(settings, budget=6), tmp_path / "run", resume=True)
    assert more.fit.aligned_marker_error <= min(losses) * (1 + 1e-8)  # an outcome has nine digits


@pytest.mark.slow
@pytest.mark.usefixtures("repeatable_swims")
def test_friction_is_recovered_from_swims(rough_swims):
    """The speeds over frequency tell friction from the other parameters, here all known."""
    problem = Problem(FISH_EXTENDED, rough_swims, threads=1)
    tried = (0.0, 0.015, 0.03, 0.045)
    losses = [problem.evaluate({**PUBLISHED, "surface_friction": force}).loss for force in tried]
    assert tried[int(np.argmin(losses))] == HIDDEN
    assert losses[0] > 5 * min(losses)
    assert np.all(np.diff(losses[:3]) < 0)
    assert np.all(np.diff(losses[2:]) > 0)
