"""Which way a fit swims from rest, and that one that swims backward isn't passed over."""

from dataclasses import replace

import numpy as np
import pytest
import small_run

from swim2real.calibration import Problem, RunFolder, conclude
from swim2real.calibration.from_rest import backward_from_rest
from swim2real.objective import TAIL_FIRST_LOSS
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, TrialSet

FREQUENCIES = {"f1_30": 1.3, "f1_70": 1.7}  # Hz
# swims head first when it is given a start speed, and tail first when it isn't
BOTH_WAYS = {**FISH.space.published, "fluid_kutta_lift": 5.8, "hinge_damping_3": 0.58, "hinge_damping_4": 0.97}


@pytest.fixture(scope="module")
def simulator():
    return Simulator(FISH, threads=2)


def test_a_perfect_fit_that_swims_backward_from_rest_is_told(simulator, new_fluid_law, tmp_path):
    if new_fluid_law:
        pytest.skip("with the newer lift force these parameters swim another way")
    swims = [Swim(name, Actuation(f, 0.0, 0.15), 2.0) for name, f in FREQUENCIES.items()]
    filmed = TrialSet(tuple(simulator.simulate(BOTH_WAYS, swims)), FISH.marker_names)
    problem = Problem(FISH, filmed, "aligned", simulator=simulator)
    outcome = conclude(RunFolder(tmp_path), problem, None, BOTH_WAYS).to_json()
    assert outcome["fit"]["aligned_marker_error"] < 1e-3
    for name, trial in outcome["fit"]["trials"].items():
        begun = outcome["from_rest"][name]
        assert begun["frequency"] == trial["frequency"] == pytest.approx(FREQUENCIES[name], abs=0.01)
        assert trial["velocity_simulated"] > 0.1
        assert begun["speed"] < -0.1
        assert begun["divergence"] is None
    assert backward_from_rest(RunFolder(tmp_path).outcome().from_rest) == (
        "unusable: from rest, where a policy and the robot begin, this fit swims tail first at 1.30, 1.70 Hz; "
        "train no policy in it, calibrate with --protocol motion or another seed"
    )
    started = Problem(FISH, filmed, "aligned", start="rest", simulator=simulator).evaluate(BOTH_WAYS)
    assert started.loss > 0.1
    assert all(trial.progress.velocity_simulated < -0.1 for trial in started.trials)


def test_a_robot_known_to_swim_head_first_where_no_trial_shows_it_refuses_what_does_not(simulator, new_fluid_law):
    if new_fluid_law:
        pytest.skip("with the newer lift force these parameters swim another way")
    swims = [Swim("slow", Actuation(0.7, 0.0, 0.0), 3.0)]
    filmed = TrialSet(tuple(simulator.simulate(FISH.space.published, swims)), FISH.marker_names)
    known = replace(FISH, trials=replace(FISH.swims, head_first=(1.3, 1.7)))
    plain = Problem(FISH, filmed, simulator=simulator, start="speed")
    strict = Problem(known, filmed, simulator=simulator)
    assert strict.protocol.start == "speed"
    forward = strict.evaluate(FISH.space.published)
    assert forward.loss == plain.evaluate(FISH.space.published).loss
    assert forward.residual_widths.sum() == len(forward.residual_stages()[-1][0])
    assert [len(one[0]) for one in forward.residual_stages()] == [
        len(one[0]) + 4 * (k not in (0, 4))
        for k, one in enumerate(plain.evaluate(FISH.space.published).residual_stages())
    ]
    backward = strict.evaluate(BOTH_WAYS)
    assert backward.tail_first
    least = 0.2 + filmed["slow"].track.speed  # 2 s at more than 0.1 m/s backward, and 1 s of the real speed
    assert all(swim.tail_first and swim.behind > least for swim in backward.unfilmed)
    assert min(swim.near_turning for swim in backward.unfilmed) > 0.01  # already in their second beats
    assert {(swim.behind, swim.near_turning) for swim in forward.unfilmed} == {(0, 0)}
    residual, weights = backward.residual_stages()[-1]
    behind = [swim.behind for swim in backward.unfilmed]
    added = [*behind, *(swim.near_turning for swim in backward.unfilmed)]
    assert np.square(residual * weights)[-4:] == pytest.approx(added)  # one trial: of the loss, if they were part of it
    assert backward.loss > TAIL_FIRST_LOSS + sum(behind)
    assert Problem(known, filmed, "aligned", simulator=simulator).evaluate(BOTH_WAYS).unfilmed == ()


def test_a_fit_that_swims_forward_has_its_steady_speed_from_rest(problem, reference, tmp_path):
    outcome = conclude(RunFolder(tmp_path), problem, None, small_run.HIDDEN).to_json()
    for name, trial in outcome["fit"]["trials"].items():
        assert outcome["from_rest"][name]["speed"] == pytest.approx(trial["velocity_simulated"], rel=0.05)
    assert backward_from_rest(RunFolder(tmp_path).outcome().from_rest) is None
    again = conclude(RunFolder(tmp_path), small_run.make_problem(reference, threads=1), None, small_run.HIDDEN)
    again = again.to_json()
    assert again["from_rest"] == outcome["from_rest"]
