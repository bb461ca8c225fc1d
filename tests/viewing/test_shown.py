"""A motion to look at, with real markers as ghosts."""

import numpy as np
import pytest

from recorded import PENDULUM as ROBOT
from recorded import PENDULUM_HIDDEN, PENDULUM_SPACE, pendulum_reference
from small_models import snake
from swim2real.calibration import Problem
from swim2real.errors import EngineError, RobotError
from swim2real.viewing import shown_model, shown_trial
from swim2real.viewing.outlines import Outlines
from swim2real.viewing.shown import _rigid


def test_ghosts_of_a_recording_lie_on_its_own_simulation():
    robot, reference = ROBOT, pendulum_reference(1e-4)
    problem = Problem(robot, reference)
    values = {**PENDULUM_SPACE.published, **PENDULUM_HIDDEN}
    compared = problem.evaluate(values).trials[0]
    shown = shown_trial(robot, values, problem.prepared[0].request, 0.5, compared)
    assert shown.camera == "side"
    assert shown.times[-1] == pytest.approx(0.5)
    assert np.abs(np.diff(shown.simulated, axis=0)).max() > 1e-3  # it moves
    np.testing.assert_allclose(shown.real, shown.simulated, atol=5e-3)
    off = shown_trial(
        robot, {**values, "lower_mass": 3 * values["lower_mass"]}, problem.prepared[0].request, 0.5, compared
    )
    assert np.abs(off.real - off.simulated).max() > 2e-2


def test_a_robot_without_trials_is_moved_by_made_up_controls():
    shown = shown_trial(ROBOT, PENDULUM_SPACE.published, None, 1.0)
    assert shown.real.shape == (61, 0, 3)
    assert np.ptp(shown.simulated, axis=0).max() > 0.01


def test_any_model_is_shown(tmp_path):
    (tmp_path / "snake.xml").write_text(snake())
    shown = shown_model(tmp_path / "snake.xml", 2.0, 1.0)
    assert shown.title == "snake.xml, 2.00 Hz"
    assert np.ptp(shown.qpos[:, 3:], axis=0).min() > 0.01  # each joint swings
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody><body/></worldbody></mujoco")
    with pytest.raises(RobotError, match=r"MuJoCo can't read model .*broken.xml': XML parse error"):
        shown_model(tmp_path / "broken.xml", 2.0, 1.0)
    wild = snake().replace('kp="0.2"', 'kp="1e9"').replace('integrator="implicitfast"', 'integrator="Euler"')
    (tmp_path / "wild.xml").write_text(wild)
    with pytest.raises(EngineError, match=r"diverges .* no motion to show"):
        shown_model(tmp_path / "wild.xml", 2.0, 60.0)


def test_outlines_show_the_robot_in_the_middle(tmp_path):
    import mujoco

    (tmp_path / "snake.xml").write_text(snake())
    shown = shown_model(tmp_path / "snake.xml", 2.0, 0.2)
    data = mujoco.MjData(shown.model)
    mujoco.mj_forward(shown.model, data)
    markers = np.array([[0.25, 0.0, 0.0]])
    picture = Outlines(shown.model, "above", 320, 180).drawn(data, markers, np.full((1, 3), np.nan)).astype(int)
    body = np.abs(picture - picture[0, 0]).sum(axis=2) > 60
    rows, columns = np.nonzero(body)
    assert 80 < rows.mean() < 100
    assert 140 < columns.mean() < 180
    assert np.ptp(columns) > 3 * np.ptp(rows)
    blue = (picture[..., 2] - picture[..., 0]) > 100
    assert blue.any()


def test_a_rigid_motion_is_found():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(5, 3, 2))
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    places[2, 1] = np.nan
    found, shift = _rigid(places, places @ turn + [1.0, -2.0])
    np.testing.assert_allclose(found, turn, atol=1e-12)
    np.testing.assert_allclose(shift, [1.0, -2.0], atol=1e-12)
