"""Errors of parameters where the start of a playback comes from the frames."""

import numpy as np
import pytest

from recorded import PENDULUM, PENDULUM_HIDDEN, pendulum_reference, telling
from swim2real.calibration import Problem
from swim2real.identification.gauss_newton import Evaluator, jacobian
from swim2real.identification.neighborhood import DRAWS, neighborhood, pulls, surrogate
from swim2real.trials import TrialSet


def test_drawn_noise_has_the_spectra_and_the_covariance_of_the_given():
    rng = np.random.default_rng(1)
    rough = rng.normal(size=(301, 3)) @ np.array([[1.0, 0.8, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 2.0]])
    given = np.cumsum(rough, axis=0) - np.cumsum(rough, axis=0).mean(axis=0)
    for noise in (rough, given, given[:-1]):
        drawn = surrogate(noise, rng)
        assert drawn.shape == noise.shape
        assert np.abs(drawn - noise).max() > 0.1 * noise.std()
        spectra = [np.fft.rfft(one, axis=0) for one in (noise, drawn)]
        crossed = [np.einsum("fi,fj->fij", one, one.conj()) for one in spectra]
        np.testing.assert_allclose(crossed[1], crossed[0], rtol=0, atol=1e-9 * np.abs(crossed[0]).max())
        np.testing.assert_allclose(drawn.T @ drawn, noise.T @ noise, rtol=0, atol=1e-9 * np.square(noise).sum())


def errors_of(start, reference):
    """Standard errors without and with draws, and how many evaluations were counted for these."""
    robot = telling(PENDULUM, start=start)
    evaluate = Evaluator(Problem(robot, reference, threads=2), robot.space)
    (at,) = evaluate([robot.space.to_cube(PENDULUM_HIDDEN)])
    slopes, _ = jacobian(evaluate, at)
    before, blocks = evaluate.count, evaluate.problem.blocks()
    drawn = pulls(evaluate, at, slopes)
    count = evaluate.count - before
    around = [neighborhood(slopes, at.residual, blocks, draws) for draws in (None, drawn)]
    return (*(one.standard_errors for one in around), drawn, count)


@pytest.fixture(scope="module")
def reference():
    return pendulum_reference(5e-4)


def test_draws_say_the_same_where_the_start_is_on_record(reference):
    without, drawn, draws, count = errors_of("rest", reference)
    assert (len(draws), count) == (DRAWS, DRAWS + 1)
    assert np.all(np.abs(np.log(drawn / without)) < np.log(2.0))
    assert 0.7 < np.exp(np.log(drawn / without).mean()) < 1.4


@pytest.mark.slow
@pytest.mark.parametrize("start", ["markers", "fitted"])
def test_a_start_from_the_frames_makes_them_larger_and_is_noticed(start, reference):
    unsaid = TrialSet(tuple(type(t)(t.name, t.track, controls=t.controls, sensors=t.sensors) for t in reference),
                      reference.marker_names)  # fmt: skip
    assert not Problem(telling(PENDULUM, start="rest"), unsaid, threads=1).prepared[0].start_is_seen
    assert Problem(telling(PENDULUM, start=start), unsaid, threads=1).prepared[0].start_is_seen
    without, drawn, draws, _ = errors_of(start, unsaid)
    again = errors_of(start, unsaid)[2]
    np.testing.assert_array_equal(again, draws)
    assert np.exp(np.log(drawn / without).mean()) > 1.5
