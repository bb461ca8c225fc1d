"""Start phase, current, tendon friction, and the state as a tracker reports it."""

import numpy as np
import pytest

import swim2real.rl as rl
from swim2real.rl.body import Bodies
from swim2real.rl.state import Robots
from swim2real.rl.state_estimation import StateEstimator
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH

COLUMNS = (
    "heading", "position", "joint_angles", "velocity", "heading_rate", "joint_rates", "markers", "marker_velocities",
    "turning", "motor_angles", "motor_speeds",
)  # fmt: skip


def swum(disturbances, steps, action=1.0, **options):
    """Info after some steps at one action, from a start."""
    env = rl.make_env("forward", disturbances=disturbances, seconds=30.0)
    env.reset(seed=0, options=options)
    for _ in range(steps):
        info = env.step(np.array([action]))[4]
    return info


def test_a_start_at_any_phase_is_drawn_and_rests():
    env = rl.make_env("forward", disturbances=rl.Disturbances((-np.pi, np.pi)), seed=0)
    angles, state = [], env.environments.state
    for _ in range(8):
        env.reset()
        angles.append(state.motor_angles[0, 0])
    assert min(angles) < -1
    assert max(angles) > 1
    env.reset(options={"phase": 2.0})
    bent = state.joint_angles[0].copy()
    assert np.abs(bent).max() > 0.1
    for _ in range(10):
        env.step(np.zeros(1))
    assert state.motor_angles[0] == pytest.approx(2.0, abs=5e-3)  # the velocity servo yields a little
    assert np.abs(state.joint_angles[0] - bent).max() < 0.03
    assert np.linalg.norm(state.position[0]) < 0.002  # a tail that snapped into place would push it off


def test_a_current_carries_the_robot_along_and_friction_turns_it_to_its_left():
    info = swum(rl.Disturbances(current=(0.05, -0.03)), 500, action=0.0)
    still = swum(rl.UNDISTURBED, 10, action=0.0)
    assert np.linalg.norm(still["position"]) < 1e-9
    x, y = info["position"]
    assert 0.2 < x < 0.5  # it takes a while to be as fast as the water
    assert -0.3 < y < -0.2  # sideways there is more drag
    turns = [swum(rl.Disturbances(tendon_friction=share), 120)["heading"] for share in (0.0, 0.4, 0.8)]
    # with the head toward -x, left is -y: a positive turn
    assert turns[0] + 0.01 < turns[1]
    assert turns[1] + 0.01 < turns[2]


def started(estimate, robot=FISH, **values):
    """A robot, of the published values but for those given, and the estimator of its state, at the start."""
    bodies = Bodies(robot, {**robot.space.published, **values})
    robots, rng, which = Robots(bodies, 1), np.random.default_rng(0), np.zeros(1, int)
    estimator = StateEstimator(robots.bodies, estimate, 1)
    robots.start(0, 0, 0.0)
    robots.read(which)
    estimator.begin(0, 0, robots.state, rng)
    return robots, estimator, rng, which


def tracked(estimate, steps=60, robot=FISH, **values):
    """True and tracked readings of a swim, as columns: heading, place, tail angles, rates."""
    robots, estimator, rng, which = started(estimate, robot, **values)
    rows = []
    for _ in range(steps):
        rows.append([
            np.concatenate([getattr(state, name)[0].ravel() for name in COLUMNS])
            for state in (robots.state, estimator.seen)
        ])  # fmt: skip
        robots.advance(np.full((1, 1), 0.15))
        estimator.update(robots.state, which, [rng])
    return np.array(rows).transpose(1, 0, 2)


def test_a_perfect_tracker_sees_the_true_pose_and_tail():
    true, seen = tracked(rl.StateEstimate(noise=0.0, delay=0))
    np.testing.assert_allclose(seen[:, :3], true[:, :3], atol=1e-3)  # roll and pitch move markers a little
    off = (seen - true)[:, 3:8]
    assert np.sqrt((off**2).mean(axis=0)).max() < 0.08  # for the same reason
    assert np.abs(off.sum(axis=1)).max() < 0.03  # the fin's direction is known well
    assert np.abs(true[:, 3:8]).max() > 0.4
    np.testing.assert_array_equal(seen[:, 16:38], true[:, 16:38])


def test_a_hull_that_rolls_is_not_taken_for_one_that_sways():
    light = {"head_added_mass": 0.6, "body_added_mass": 0.6, "tail_kutta_lift": 1.0}
    true, seen = tracked(rl.StateEstimate(noise=0.0, delay=0), robot=load_robot("fish-rolling"), **light)
    off = np.abs(seen - true).max(axis=0)
    assert off[1:3].max() < 0.002  # m, while its markers sway by more than ten times that
    assert off[3:8].max() < 0.05  # rad
    assert off[-5:-2].max() < 0.3  # rad/s
    assert np.ptp(true[:, -5]) > 1.0  # rolling


def test_speeds_are_differences_of_tracked_places():
    true, seen = tracked(rl.StateEstimate(noise=0.0005, delay=0))
    for places, speeds in ((slice(0, 1), slice(10, 11)), (slice(1, 3), slice(8, 10)), (slice(3, 8), slice(11, 16)),
                           (slice(16, 38), slice(38, 60))):  # fmt: skip
        np.testing.assert_allclose(seen[1:, speeds], np.diff(seen[:, places], axis=0) / 0.02, atol=1e-9)
        assert (seen[0, speeds] == 0).all()
    noise = (seen - true)[:, 16:38].std()
    assert noise == pytest.approx(0.0005, rel=0.1)


def test_a_late_tracker_sees_what_was_but_knows_its_motor():
    true, seen = tracked(rl.StateEstimate(noise=0.0, delay=3))
    np.testing.assert_array_equal(seen[3:, 16:38], true[:-3, 16:38])
    np.testing.assert_array_equal(seen[:3, 16:38], true[[0, 0, 0], 16:38])
    np.testing.assert_array_equal(seen[:, -2:], true[:, -2:])


def test_a_heading_goes_on_beyond_half_a_turn():
    robots, estimator, rng, which = started(rl.StateEstimate(noise=0.0, delay=0))
    for heading in np.linspace(0.0, 9.0, 40):
        robots.batch.data(0).qpos[5] = heading
        robots.read(which)
        estimator.update(robots.state, which, [rng])
        assert robots.state.heading[0] == pytest.approx(heading, abs=1e-6)
        assert estimator.seen.heading[0] == pytest.approx(heading, abs=1e-3)  # two steps of the fit
    np.testing.assert_allclose(estimator.seen.position, robots.state.position, atol=1e-3)
    np.testing.assert_allclose(estimator.seen.joint_angles, 0, atol=1e-2)


@pytest.mark.parametrize("task", ["forward", "target"])
def test_the_estimate_changes_what_is_seen_and_nothing_else(task):
    envs = [rl.make_env(task, disturbances=d) for d in (rl.UNDISTURBED, rl.Disturbances(estimate=rl.StateEstimate()))]
    for env in envs:
        env.reset(seed=0, options={"goal": (-1.0, 0.2)})
    for _ in range(20):
        true, seen = (env.step(np.ones(1)) for env in envs)
    assert true[1] == seen[1]
    assert true[4] == seen[4]
    assert (true[0] != seen[0]).any()
    np.testing.assert_allclose(true[0], seen[0], atol=12.0)  # speeds are rough, above all of the tail's joints
