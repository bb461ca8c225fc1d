"""Problems as the toolbox's objects: residuals that mean the same, and its own optimizer on them."""

import io
from dataclasses import replace

import numpy as np
import pytest
from mujoco import sysid

import pools
import recorded
from swim2real.calibration import Problem
from swim2real.errors import ArgumentError, EngineError, TrialError
from swim2real.robots.fish import FISH
from swim2real.sysid import SysidProblem, to_sysid
from swim2real.trials import MarkerTrack, TrialSet


def residual(problem: SysidProblem) -> np.ndarray:
    return np.concatenate(problem.residual(problem.parameters.as_vector(), problem.parameters)[0])


def moved(reference: TrialSet, **changes) -> TrialSet:
    """The same trials with other tracks: `change(positions)` of each."""
    change = changes["change"]
    trials = [replace(one, track=MarkerTrack(one.track.times, change(one.track.positions.copy()))) for one in reference]
    return TrialSet(tuple(trials), reference.marker_names)


@pytest.fixture(scope="module")
def pendulum():
    return Problem(recorded.PENDULUM, recorded.pendulum_reference(), horizon=None, threads=2)


@pytest.fixture(scope="module")
def floater():
    return Problem(recorded.FLOATER, recorded.floater_reference(), horizon=None, threads=2)


# recordings


def test_a_recording_of_known_parameters_leaves_nothing(floater):
    assert np.linalg.norm(residual(to_sysid(floater, recorded.FLOATER_HIDDEN))) < 1e-12


def test_in_the_world_the_residual_is_that_of_a_calibration(pendulum):
    values = recorded.PENDULUM.space.published
    ours = pendulum.evaluate(values).residual_vector()
    assert np.linalg.norm(ours) > 0.01
    assert np.linalg.norm(residual(to_sysid(pendulum, values))) == pytest.approx(np.linalg.norm(ours), rel=1e-9)


def test_sensors_are_compared_by_their_worth(pendulum):
    values = recorded.PENDULUM.space.published
    mute = recorded.telling(recorded.PENDULUM, sensors=())
    without = Problem(mute, recorded.pendulum_reference(), horizon=None, threads=2)
    gyro = recorded.PENDULUM.recordings.sensors[0]
    loud = recorded.telling(recorded.PENDULUM, sensors=(replace(gyro, meters_per_unit=2 * gyro.meters_per_unit),))
    louder = Problem(loud, recorded.pendulum_reference(), horizon=None, threads=2)
    squares = [float(np.square(residual(to_sysid(one, values))).sum()) for one in (without, pendulum, louder)]
    assert squares[1] > 1.001 * squares[0]
    assert squares[2] - squares[0] == pytest.approx(4 * (squares[1] - squares[0]), rel=1e-6)


def test_where_the_camera_stood_has_no_say_in_a_frame_on_the_robot(floater):
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    away = moved(recorded.floater_reference(), change=lambda places: places @ turn + [0.3, -0.2])
    elsewhere = Problem(recorded.FLOATER, away, horizon=None, threads=2)
    assert np.linalg.norm(residual(to_sysid(elsewhere, recorded.FLOATER_HIDDEN))) < 1e-9


def test_a_marker_that_was_lost_has_no_part(floater):
    def lose(places: np.ndarray) -> np.ndarray:
        places[20:30, 3] = np.nan
        return places

    gaps = Problem(recorded.FLOATER, moved(recorded.floater_reference(), change=lose), horizon=None, threads=2)
    whole, parts = (residual(to_sysid(one, recorded.FLOATER.space.published)) for one in (floater, gaps))
    assert len(parts) == len(whole) - 2 * 2 * 10
    assert np.isfinite(parts).all()


def test_a_track_that_tells_no_place_is_refused():
    def blind(places: np.ndarray) -> np.ndarray:
        places[:10] = np.nan
        return places

    late = moved(recorded.floater_reference(), change=blind)
    problem = Problem(recorded.FLOATER, late, horizon=None, threads=2)
    with pytest.raises(TrialError) as caught:
        to_sysid(problem, recorded.FLOATER_HIDDEN)
    assert str(caught.value) == (
        "trial 'slow': fewer than two markers are seen in its first 6 frames, so nothing tells where it begins; cut "
        "the video"
    )


def test_a_start_that_diverges_is_refused(floater):
    def build(values):
        spec = recorded.build_floater(values)
        spec.option.gravity = [1e13, 0, 0]
        return spec

    broken = replace(recorded.FLOATER, build=build)
    with pytest.raises(EngineError, match=r"^trial 'slow': the simulation diverged .* s after its start; export other"):
        to_sysid(Problem(broken, recorded.floater_reference(), horizon=None, threads=2), broken.space.published)


def test_the_toolboxs_optimizer_finds_known_parameters(pendulum):
    problem = to_sysid(pendulum, recorded.PENDULUM.space.published)
    best, _ = sysid.optimize(
        problem.parameters, problem.residual, verbose=False, output=io.StringIO(), max_iters=8, x_scale="jac"
    )
    for name, hidden in recorded.PENDULUM_HIDDEN.items():
        assert best[name].value.item() == pytest.approx(hidden, rel=0.02)
        assert problem.parameters[name].value.item() == recorded.PENDULUM.space[name].published


def test_a_frozen_parameter_stays_as_it_is(pendulum):
    problem = to_sysid(pendulum, {**recorded.PENDULUM.space.published, "lower_mass": 0.05})
    problem.parameters["lower_mass"].frozen = True
    best, _ = sysid.optimize(
        problem.parameters, problem.residual, verbose=False, output=io.StringIO(), max_iters=1
    )  # fmt: skip
    assert best["lower_mass"].value.item() == 0.05
    assert best["elbow_damping"].value.item() != recorded.PENDULUM.space["elbow_damping"].published
    assert problem.build_model(best).body("lower").mass.item() == pytest.approx(0.05)


# swims


@pytest.mark.slow
def test_swims_of_known_parameters_leave_little_more_than_their_noise():
    problem = Problem(FISH, pools.film(), horizon=None, threads=2)
    known = np.linalg.norm(residual(to_sysid(problem, pools.hidden_values())))
    other = np.linalg.norm(residual(to_sysid(problem, FISH.space.published)))
    assert known < 2e-3  # 0.5 mm of noise a coordinate
    assert other > 5 * known


@pytest.mark.slow
def test_the_toolbox_goes_down_on_the_fish():
    hidden = pools.hidden_values()
    wrong = {**hidden, "motor_arm_length": 1.1 * hidden["motor_arm_length"]}
    problem = to_sysid(Problem(FISH, pools.film(frequencies=(1.6,)), horizon=None, threads=2), wrong)
    for name in FISH.space.names:
        problem.parameters[name].frozen = name != "motor_arm_length"
    best, _ = sysid.optimize(problem.parameters, problem.residual, verbose=False, output=io.StringIO(), max_iters=4)
    assert best["motor_arm_length"].value.item() == pytest.approx(hidden["motor_arm_length"], rel=0.02)


def test_swims_as_the_paper_compares_them_are_refused():
    problem = Problem(FISH, pools.film(seconds=1.5, frequencies=(1.6,)), "paper", threads=2)
    with pytest.raises(ArgumentError) as caught:
        to_sysid(problem, FISH.space.published)
    assert str(caught.value) == "protocol is 'paper'; swims for the toolbox need 'motion' or 'aligned'"
