"""A motion to look at, with real markers as ghosts."""

import numpy as np
import pytest

from recorded import PENDULUM as ROBOT
from recorded import PENDULUM_HIDDEN, PENDULUM_SPACE, pendulum_reference
from small_models import snake
from swim2real.calibration import Problem
from swim2real.viewing import shown_model, shown_trial
from swim2real.viewing.film import Outlines
from swim2real.viewing.motion import _rigid
from swimbase.errors import EngineError, RobotError


def test_ghosts_of_a_recording_lie_on_its_own_simulation():
    problem = Problem(ROBOT, pendulum_reference(1e-4))
    values = {**PENDULUM_SPACE.published, **PENDULUM_HIDDEN}
    request, compared = problem.prepared[0].request, problem.evaluate(values).trials[0]
    shown = shown_trial(ROBOT, values, request, 0.5, compared)
    assert shown.camera == "side"
    assert shown.times[-1] == pytest.approx(0.5)
    assert np.abs(np.diff(shown.simulated, axis=0)).max() > 1e-3  # it moves
    np.testing.assert_allclose(shown.real, shown.simulated, atol=5e-3)
    off = shown_trial(ROBOT, {**values, "lower_mass": 3 * values["lower_mass"]}, request, 0.5, compared)
    assert np.abs(off.real - off.simulated).max() > 2e-2


def test_a_robot_without_trials_is_moved_by_made_up_controls_and_outlines_have_markers():
    shown = shown_trial(ROBOT, PENDULUM_SPACE.published, None, 1.0)
    assert shown.real.shape == (61, 0, 3)
    assert np.ptp(shown.simulated, axis=0).max() > 0.01
    shown = shown_trial(ROBOT, PENDULUM_SPACE.published, None, 0.1)
    picture = Outlines(shown, "side", 320, 180).drawn(0).astype(int)
    assert ((picture[..., 2] - picture[..., 0]) > 100).any()  # blue


def test_any_model_is_shown_and_outlines_have_it_in_the_middle(tmp_path):
    (tmp_path / "snake.xml").write_text(snake())
    shown = shown_model(tmp_path / "snake.xml", 2.0, 1.0)
    assert shown.title == "snake.xml, 2.00 Hz"
    assert np.ptp(shown.qpos[:, 3:], axis=0).min() > 0.01  # each joint swings
    picture = Outlines(shown, "above", 320, 180).drawn(0).astype(int)
    rows, columns = np.nonzero(np.abs(picture - picture[0, 0]).sum(axis=2) > 60)
    assert 80 < rows.mean() < 100
    assert 140 < columns.mean() < 180
    assert np.ptp(columns) > 3 * np.ptp(rows)


STIFF = snake().replace('kp="0.2"', 'kp="1e9"').replace('integrator="implicitfast"', 'integrator="Euler"')


@pytest.mark.parametrize(
    ("model", "error", "says"),
    [("<mujoco><worldbody/></mujoco", RobotError, "made.xml': XML parse error"), (STIFF, EngineError, "diverges")],
)
def test_what_cant_be_shown_is_said(tmp_path, model, error, says):
    (tmp_path / "made.xml").write_text(model)
    with pytest.raises(error, match=says):
        shown_model(tmp_path / "made.xml", 2.0, 60.0)


def test_a_rigid_motion_is_found():
    places = np.random.default_rng(0).normal(size=(5, 3, 2))
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    places[2, 1] = np.nan
    found, shift = _rigid(places, places @ turn + [1.0, -2.0])
    np.testing.assert_allclose(found, turn, atol=1e-12)
    np.testing.assert_allclose(shift, [1.0, -2.0], atol=1e-12)


STIFF = snake().replace('kp="0.2"', 'kp="1e9"').replace('integrator="implicitfast"', 'integrator="Euler"')
